# SPDX-License-Identifier: BSD-2-Clause
"""Methods of chains whose quantities have kernels."""

#: By their arguments; one that ends with = is given by its name.
METHODS = {
    "compute_torques": "q va aa",
    "generalized_forces": "q va aa",
    "compute_accelerations": "q va tau",
    "joint_rates": "q va",
    "joint_accelerations": "q va aa",
    "frame_jacobian": "q frame",
    "frame_jacobian_rate": "q va frame",
    "frame_velocity_derivatives": "q va frame",
    "frame_drift": "q va frame",
    "reduced_terms": "q va",
    "actuator_jacobian": "q",
    "torque_derivatives": "q va aa",
    "acceleration_derivatives": "q va tau",
    "linearize": "q va tau",
    "torque_regressor": "q va aa",
    "reactions": "q va tau=",
}

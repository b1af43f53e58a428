# SPDX-License-Identifier: BSD-2-Clause
"""Slotine and Li's adaptive controller, on the regressor of any closed chain.

J.-J. Slotine and W. Li, On the adaptive control of robot manipulators, Int. J. Robotics Research
6(3), 1987. `control_bench.py` compares it with the controllers of the package.

    python examples/adaptive.py
"""

import numpy as np
from scipy.interpolate import make_interp_spline

import sst_pin


class Adaptive:
    """A controller that learns the dynamic parameters while it follows a motion.

    With the errors e = x_d - x of the coordinates and the sliding variable

        s = e' + stiffness e,

    the motors produce the generalized forces Y theta + damping s, and theta changes at a rate
    proportional to Y^T s. Y theta are the forces that the model needs for the reference rates
    va + s and the reference accelerations; its Coriolis matrix C makes M_dot - 2 C skew-symmetric.

    It learns at each call, so time must not decrease between calls: `simulate` takes it only as
    `SampledTorque(control, period)`. It does not learn while its torques exceed the limits.

    Args:
        chain: The model of the robot; each coordinate is the angle of a revolute joint.
        motion: The motion to follow. Before and after it, the robot is held.
        stiffness: Decay rate of the errors where s is 0, () or shape (n,), [1/s].
        damping: Generalized force per s, () or shape (n,), [N m s/rad].
        learning: Speed of learning, without unit; with 0 it does not learn.
        limit: Largest torque of each motor, () or shape (motors,), [N m].

    Attributes:
        theta: The parameters learned so far, in the order of `chain.dynamic_parameters`.
    """

    sampled_only = True  # `simulate` refuses it unless it is sampled

    def __init__(self, chain, motion, *, stiffness, damping, learning, limit=np.inf):
        self.chain = chain
        self.stiffness = stiffness
        self.damping = damping
        self.limit = limit
        self._coordinates = [chain.position_names.index(name) for name in chain.coordinates]
        self._interval = motion.t[0], motion.t[-1]
        self._path = make_interp_spline(motion.t, motion.q[:, self._coordinates], 5)
        self._last = motion.t[0]
        parameters = chain.dynamic_parameters
        self.theta = np.array(parameters.values)
        kinds = [name.rpartition(".")[2] for name in parameters.names]
        self._is_odd = np.isin(kinds, ["viscous", "coulomb", "damping"])
        self._learning = learning * self._squared_sizes(kinds)

    def _squared_sizes(self, kinds):
        """The squared size of each parameter, relative to an inertia; zero: it is not learned."""
        bodies = self.chain.model.inertias
        mass = sum(body.mass for body in bodies) / len(self.chain.joint_names)
        length = self.chain.mechanism.length
        inertia = mass * length**2
        sizes = {"mass": mass, "viscous": inertia, "coulomb": inertia}
        for kind in ("mx", "my", "mz"):
            sizes[kind] = mass * length
        for kind in ("ixx", "ixy", "iyy", "ixz", "iyz", "izz"):
            sizes[kind] = inertia
        return np.array([sizes.get(kind, 0.0) ** 2 for kind in kinds]) / inertia

    def torque(self, t, q, va):
        """Torques of the motors, shape (motors,)."""
        # The desired motion: at rest before and after the interval.
        inside = np.clip(t, *self._interval)
        moving = float(t == inside)
        error = self._path(inside) - q[self._coordinates]
        error = (error + np.pi) % (2 * np.pi) - np.pi
        rate_error = moving * self._path(inside, 1) - va
        desired = moving * self._path(inside, 2)

        s = rate_error + self.stiffness * error
        Y = self._regressor(q, va, va + s, desired + self.stiffness * rate_error)
        forces = Y @ self.theta + self.damping * s
        J = self.chain.actuator_jacobian(q)
        tau = np.linalg.lstsq(J.T, forces, rcond=None)[0]
        if (np.abs(tau) <= self.limit).all():
            self.theta += max(0.0, t - self._last) * self._learning * (Y.T @ s)
        self._last = t
        return np.clip(tau, -np.asarray(self.limit), self.limit)

    def _regressor(self, q, va, reference, aa):
        """Y of M aa + C(va) reference and of the other forces at va, shape (n, p).

        With C from the Christoffel symbols, C(a) b is symmetric and bilinear in a and b. The
        forces c(a) = C(a) a are quadratic, so C(a) b = (c(a + b) - c(a) - c(b)) / 2. Friction is
        odd in the rates; it is taken at va.
        """
        zero = np.zeros_like(va)
        rates = np.array([va + reference, va, reference, zero, zero])
        accelerations = np.array([zero, zero, zero, zero, aa])
        at_sum, at_va, at_reference, at_rest, accelerated = self.chain.torque_regressor(
            np.tile(q, (5, 1)), rates, accelerations
        )
        Y = accelerated + (at_sum - at_va - at_reference + at_rest) / 2
        return np.where(self._is_odd, at_va, Y)


def swings(robot, count):
    """A five-bar that swings `count` times, once a second."""
    t = np.linspace(0, count, 200 * count + 1)
    start = robot.home[[robot.position_names.index(name) for name in robot.coordinates]]
    x = start + 0.2 * np.stack([np.sin(2 * np.pi * t), np.sin(4 * np.pi * t)], axis=-1)
    return sst_pin.coordinate_motion(robot, t, x)


def errors_of_swings(learning, count=5):
    """The largest error of a motor in each swing, [rad]; the model is 20 % too light."""
    machine = sst_pin.robots.five_bar()
    machine.compile()
    parameters = machine.dynamic_parameters
    for body in machine.joint_names:
        parameters = parameters.scale_mass(body, 0.8)
    model = machine.with_parameters(parameters)
    motion = swings(machine, count)
    control = Adaptive(model, motion, stiffness=20, damping=0.2, learning=learning)
    torque = sst_pin.SampledTorque(control, 5e-3)
    result = machine.simulate(torque, motion.q[0], motion.va[0], motion.t, rtol=1e-6, atol=1e-8)
    errors = np.abs(result.q - motion.q)[1:, machine.motor_indices]
    return errors.reshape(count, -1).max(axis=1)


if __name__ == "__main__":
    for learning in (0.0, 0.3):
        errors = 1e3 * errors_of_swings(learning)
        print(f"learning {learning}: largest errors of five swings {errors.round(2)} mrad")

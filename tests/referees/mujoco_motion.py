# SPDX-License-Identifier: BSD-2-Clause
"""MuJoCo's own simulation of the closed SST.

MuJoCo closes the loops by welds, which give way like stiff springs: the motion tends to the rigid
robot's as the stiffness grows.
"""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from sst_pin.arrays import Array
from sst_pin.description.parameters import Parameters
from sst_pin.sst.robot import SST
from sst_pin.verification.mujoco_tree import MujocoTree


def welded_motion(
    parameters: Parameters,
    R: ArrayLike,
    omega: ArrayLike,
    torque: Callable[[float], ArrayLike],
    duration: float,
    *,
    step: float = 1e-4,
    stiffness: float = 1e6,
) -> tuple[Array, Array]:
    """Times, (N,), and {E} in the base at them by leg 1, (N, 3, 3), by MuJoCo with welds.

    The star starts with R and omega; `torque` is a function of time. MuJoCo's Runge-Kutta `step`,
    [s], is stable below about 1 / sqrt(stiffness), which is that of the welds, critically damped,
    per unit of inertia, [1/s^2]. Dry friction is MuJoCo's own, which creeps where it should stick.
    """
    robot = SST(parameters)
    tree = MujocoTree(robot.mechanism, closure_stiffness=stiffness)
    model, data = tree.mj, tree.data
    model.opt.timestep, model.opt.tolerance = step, 0  # all iterations
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    q, va, _ = robot.joint_motion(R, omega, np.zeros(3))
    tree.move(q, robot.joint_rates(q, va))
    motors = [model.joint(name).dofadr[0] for name in robot.motor_names]

    def control(_: Any, state: Any) -> None:  # called at each stage of a step
        state.qfrc_applied[motors] = torque(state.time)

    steps = round(duration / step)
    path = np.empty((steps + 1, 3, 3))
    mujoco.set_mjcb_control(control)
    try:
        for i in range(steps + 1):
            mujoco.mj_kinematics(model, data)
            path[i] = tree.placement("closedloop1_A").rotation
            if i < steps:
                mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_control(None)
    return np.linspace(0, steps * step, steps + 1), path

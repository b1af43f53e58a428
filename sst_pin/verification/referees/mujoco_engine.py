# SPDX-License-Identifier: BSD-2-Clause
"""MuJoCo: its inverse dynamics of our URDF, and its simulation of the closed robot.

`MujocoInverse` is exact: the forces in the tree's joints by `mj_inverse`, brought down to the
motors by MuJoCo's own Jacobians. In `welded_motion` the loops are closed by MuJoCo's welds, which
give way like stiff springs: the motion tends to the rigid robot's as the stiffness grows.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ...arrays import Array
from ...description.frames import star_orientations
from ...description.parameters import Parameters
from ...description.urdf_writer import urdf_of
from . import Moment, engine, legs, require_same

_STARS = ("star_1", "star_2", "star_3")


class MujocoInverse:
    """`mj_inverse` on the tree, projected to the motors."""

    name = "MuJoCo mj_inverse, projected"
    package = "mujoco"

    def __init__(self, parameters: Parameters) -> None:
        self._mujoco = mujoco = engine("mujoco")
        self._parameters = parameters
        self._model = mujoco.MjModel.from_xml_string(_blind_urdf(parameters))
        self._model.opt.gravity[:] = parameters.gravity
        # The tree alone; MuJoCo's dry friction is a constraint too, and a regularised one.
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._data = mujoco.MjData(self._model)

    def torques(
        self, R: ArrayLike, omega: ArrayLike, alpha: ArrayLike, platform_moment: Moment = None
    ) -> Array:
        """Motor torques; see `Referee.torques`."""
        mujoco, model, data = self._mujoco, self._model, self._data
        J, q_dot = self.move(R, omega)
        J_dot = self._turning(mujoco.mj_jacDot, np.zeros(3))
        data.qacc[:] = np.linalg.solve(J, np.tile(alpha, 3) - J_dot @ q_dot)
        mujoco.mj_inverse(model, data)  # what it returns covers viscous friction
        force = data.qfrc_inverse + self._parameters.coulomb_friction * np.sign(q_dot)
        if platform_moment is not None:
            force = force - J[:3].T @ np.asarray(platform_moment, dtype=float)
        V = np.linalg.solve(J, np.tile(np.eye(3), (3, 1)))  # q_dot = V omega
        # The power of the forces is that of the motors, for every omega.
        tau: Array = np.linalg.solve(V[::3].T, V.T @ force)
        return tau

    def move(self, R: ArrayLike, omega: ArrayLike) -> tuple[Array, Array]:
        """The tree, its loops closed: angular Jacobian of the star's arcs, (9, 9), joint rates."""
        mujoco, model, data, p = self._mujoco, self._model, self._data, self._parameters
        data.qpos[:] = legs(p, R).angles.ravel()
        mujoco.mj_fwdPosition(model, data)
        for name, R_E in zip(_STARS, star_orientations(p), strict=True):
            found = data.body(name).xmat.reshape(3, 3) @ R_E
            require_same(found, np.asarray(R), "the star's orientation")
        J = self._turning(mujoco.mj_jacBody)
        data.qvel[:] = np.linalg.solve(J, np.tile(omega, 3))
        mujoco.mj_fwdVelocity(model, data)
        return J, data.qvel.copy()

    def _turning(self, jacobian: Callable[..., None], *point: Array) -> Array:
        """Angular Jacobian of the three arcs of the star, or its rate, shape (9, 9)."""
        J = np.zeros((3, 3, 9))
        for rows, name in zip(J, _STARS, strict=True):
            part = np.zeros((3, 9))
            jacobian(self._model, self._data, None, part, *point, self._data.body(name).id)
            rows[:] = part
        return J.reshape(9, 9)


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
    mujoco = engine("mujoco")
    model = welded(mujoco, parameters, step, stiffness)
    data = mujoco.MjData(model)
    _, data.qvel[:] = MujocoInverse(parameters).move(R, omega)
    data.qpos[:] = legs(parameters, R).angles.ravel()

    def control(_: Any, state: Any) -> None:  # called at each stage of a step
        state.qfrc_applied[::3] = torque(state.time)

    steps = round(duration / step)
    path = np.empty((steps + 1, 3, 3))
    star = data.body("star_1")
    mujoco.set_mjcb_control(control)
    try:
        for i in range(steps + 1):
            mujoco.mj_kinematics(model, data)
            path[i] = star.xmat.reshape(3, 3)
            if i < steps:
                mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_control(None)
    return np.linspace(0, steps * step, steps + 1), path


def _blind_urdf(parameters: Parameters) -> str:
    """Our URDF with its visuals, which need files, switched off for MuJoCo."""
    return urdf_of(parameters).replace('discardvisual="false"', 'discardvisual="true"')


def welded(mujoco: Any, parameters: Parameters, step: float, stiffness: float) -> Any:
    """The closed robot: welds with a stiffness [1/s^2], critically damped, steps in [s]."""
    spec = mujoco.MjSpec.from_string(_blind_urdf(parameters))
    for name, R_E in zip(_STARS, star_orientations(parameters), strict=True):
        quat = Rotation.from_matrix(R_E).as_quat(scalar_first=True)
        spec.body(name).add_site(name=name, quat=quat)
    for other in _STARS[1:]:
        kinds = {"type": mujoco.mjtEq.mjEQ_WELD, "objtype": mujoco.mjtObj.mjOBJ_SITE}
        weld = spec.add_equality(name1=_STARS[0], name2=other, **kinds)
        weld.solref[:] = -stiffness, -2 * np.sqrt(stiffness)  # negative: the numbers themselves
        weld.solimp[:2] = 0.99, 0.99  # the rest of the way is for the stiffness to close
    model = spec.compile()
    model.opt.gravity[:] = parameters.gravity
    model.opt.timestep = step
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.tolerance = 0  # all iterations
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return model

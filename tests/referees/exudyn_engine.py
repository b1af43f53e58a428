# SPDX-License-Identifier: BSD-2-Clause
"""Exudyn: seven rigid bodies in redundant coordinates, nine joints with Lagrange multipliers.

`ExudynInstant` takes the mass matrix, the forces and the constraint Jacobian of one instant from
Exudyn. `stepped_torques` and `stepped_motion` leave the whole problem to Exudyn's generalised-alpha
integrator, without friction: they tend to the exact answer with the square of the step.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sst_pin.arrays import Array, in_one_turn
from sst_pin.description.parameters import Parameters

from .exudyn_robot import ExudynRobot, LegAxes, frames, legs, of_all_bodies, require_same, turning

#: Moment of the surroundings on the star, base axes, shape (3,), [N m]; None for none.
Moment = ArrayLike | None
#: Orientation, angular velocity and acceleration of the star as functions of time, base axes.
StarMotion = Callable[[float], tuple[ArrayLike, ArrayLike, ArrayLike]]


class ExudynInstant:
    """Motor torques from Exudyn's equations of motion at one instant."""

    name = "Exudyn, instantaneous"

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        # The joints are fitted to the bodies in some pose far from a flat leg ...
        poses: Array = Rotation.random(100, 0).as_matrix()
        fit = max(poses, key=lambda R: float(np.sin(legs(parameters, R).angles[:, 1]).min()))
        self._start = legs(parameters, fit).angles[:, 0]
        self._turns = np.zeros(3)
        self._robot = ExudynRobot(parameters, fit, np.zeros(3), lambda t: self._turns)

    def torques(
        self, R: ArrayLike, omega: ArrayLike, alpha: ArrayLike, platform_moment: Moment = None
    ) -> Array:
        p, robot, exu = self._parameters, self._robot, self._robot.exudyn
        pose = legs(p, R)
        rates, spins, spin_rates = turning(pose, np.asarray(omega), np.asarray(alpha))
        coordinates = np.zeros((3, 7, 7))  # and their first two derivatives; body by body
        e = Rotation.from_matrix(frames(pose, R)).as_quat(scalar_first=True)
        coordinates[:, :, 3:] = e, _turn(spins, e) / 2, _turn(spin_rates, e) / 2
        coordinates[2, :, 3:] -= (spins**2).sum(axis=-1, keepdims=True) / 4 * e
        x, x_dot, x_ddot = coordinates.reshape(3, 49)
        self._turns = pose.angles[:, 0] - self._start
        robot.load(_joint_moments(p, pose, rates, platform_moment))
        mass, force, Phi, residual = robot.equations(x, x_dot)
        # ... and hold in every other one: Exudyn's word on position and velocity.
        require_same(residual, np.zeros_like(residual), "the constraints")
        wanted = np.zeros_like(residual)
        wanted[robot.motor_rows] = -rates[:, 0]  # the residual is offset minus angle
        require_same(Phi @ x_dot, wanted, "the rate of the constraints")
        multipliers = np.linalg.lstsq(Phi.T, force - mass @ x_ddot, rcond=None)[0]
        robot.system.systemData.SetAECoordinates(multipliers.tolist())
        torque = exu.OutputVariableType.TorqueLocal
        return np.array([robot.system.GetObjectOutput(m, torque)[2] for m in robot.motors])


def stepped_torques(
    parameters: Parameters, motion: StarMotion, duration: float, steps: int
) -> tuple[Array, Array]:
    """Times, (steps + 1,), and torques at them, (steps + 1, 3), of motors that turn as asked.

    The motors are constraints. The first torques are some 10 N m off, since Exudyn's initial
    accelerations leave out those of the motors; damping by a spectral radius of 0.6 has made up for
    it after some twenty steps.
    """
    R, omega, _ = motion(0.0)
    start = legs(parameters, R).angles[:, 0]

    @lru_cache(maxsize=8)  # Newton's iterations ask again and again
    def turns(t: float) -> Array:
        return in_one_turn(legs(parameters, motion(t)[0]).angles[:, 0] - start)

    robot = ExudynRobot(parameters, R, omega, turns)
    output = robot.exudyn.OutputVariableType.TorqueLocal
    item = robot.utilities.SensorObject
    sensors = [
        item(objectNumber=m, outputVariableType=output, storeInternal=True, writeToFile=False)
        for m in robot.motors
    ]
    data = robot.step(duration, steps, 0.6, sensors)
    return data[0][:, 0], np.stack([d[:, 3] for d in data], axis=-1)


def stepped_motion(
    parameters: Parameters,
    R: ArrayLike,
    omega: ArrayLike,
    torque: Callable[[float], ArrayLike],
    duration: float,
    steps: int,
) -> tuple[Array, Array]:
    """Times, (steps + 1,), and {E} in the base at them, (steps + 1, 3, 3), by direct dynamics.

    The motion starts at R and omega of the star; `torque` is a function of time, shape (3,).
    """
    robot = ExudynRobot(parameters, R, omega, None)
    e = legs(parameters, R).e

    @lru_cache(maxsize=8)
    def torques(t: float) -> Array:
        return np.asarray(torque(t), dtype=float)

    def moment(k: int) -> Callable[[Any, float, Any], list[float]]:
        return lambda _, t, __: [float(x) for x in torques(t)[k] * e[k]]

    options: dict[str, Any] = {"loadVector": [0, 0, 0]}
    for k, link in enumerate(robot.bodies[:6:2]):
        robot.system.CreateTorque(itemNumber=link, loadVectorUserFunction=moment(k), **options)
    sensor = robot.utilities.SensorBody(
        bodyNumber=robot.bodies[-1],
        outputVariableType=robot.exudyn.OutputVariableType.RotationMatrix,
        storeInternal=True,
        writeToFile=False,
    )
    (data,) = robot.step(duration, steps, 1.0, [sensor])
    return data[:, 0], data[:, 1:].reshape(-1, 3, 3)


def _turn(spins: Array, e: Array) -> Array:
    """Products of quaternions (0, spin) e, scalar first, row by row."""
    scalar = -np.vecdot(spins, e[:, 1:])
    return np.column_stack([scalar, spins * e[:, :1] + np.cross(spins, e[:, 1:])])


def _joint_moments(p: Parameters, pose: LegAxes, rates: Array, platform_moment: Moment) -> Array:
    """Moments of friction, and of the surroundings on the star, on all bodies, shape (7, 3)."""
    friction = p.viscous_friction.reshape(3, 3) * rates
    friction = -friction - p.coulomb_friction.reshape(3, 3) * np.sign(rates)
    on_link, on_passive, on_star = (
        friction[:, i : i + 1] * axis for i, axis in enumerate((pose.e, pose.u, pose.n))
    )
    star = on_star.sum(axis=0)
    if platform_moment is not None:
        star = star + np.asarray(platform_moment, dtype=float)
    return of_all_bodies(on_link - on_passive, on_passive - on_star, star)

# SPDX-License-Identifier: BSD-2-Clause
"""Exudyn: seven rigid bodies in redundant coordinates, nine joints with Lagrange multipliers.

`ExudynInstant` takes the mass matrix, the forces and the constraint Jacobian of one instant from
Exudyn. `stepped_torques` and `stepped_motion` leave the whole problem to Exudyn's generalised-alpha
integrator: they tend to the exact answer with the square of the step.

A body has seven coordinates, the position of its reference point (always O) and Euler parameters p
with p_dot = (0, omega) p / 2. The joints of legs 2 and 3 on the star lock two rotations and
nothing else, so that no constraint is redundant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ..errors import InputError
from ..parameters import Parameters
from . import engine
from .geometry import Legs, legs, require_same

Array = NDArray[np.float64]

#: Orientation, angular velocity and acceleration of the star as functions of time, base axes.
Motion = Callable[[float], tuple[ArrayLike, ArrayLike, ArrayLike]]
#: What turns the three motors, one function of time each, [rad].
_Turns = Sequence[Callable[[float], float]]


class ExudynInstant:
    """Motor torques from Exudyn's equations of motion at one instant.

    Args:
        parameters: The SST.

    Raises:
        MissingExtraError: Without Exudyn.
    """

    name = "Exudyn, instantaneous"
    package = "exudyn"
    frictionless = False

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        # The joints are fitted to the bodies in some pose far from a flat leg ...
        poses: Array = Rotation.random(100, 0).as_matrix()
        fit = max(poses, key=lambda R: float(np.sin(legs(parameters, R).angles[:, 1]).min()))
        self._start = legs(parameters, fit).angles[:, 0]
        self._turns = np.zeros(3)
        turns = [lambda t, k=k: float(self._turns[k]) for k in range(3)]
        self._robot = _Robot(parameters, fit, np.zeros(3), turns)

    def torques(
        self,
        R: ArrayLike,
        omega: ArrayLike,
        alpha: ArrayLike,
        platform_moment: ArrayLike | None = None,
    ) -> Array:
        """Motor torques; see `Referee.torques`."""
        p, robot, exu = self._parameters, self._robot, self._robot.exudyn
        pose = legs(p, R)
        rates, spins, spin_rates = _turning(pose, np.asarray(omega), np.asarray(alpha))
        coordinates = np.zeros((3, 7, 7))  # and their first two derivatives; body by body
        e = Rotation.from_matrix(_frames(pose, R)).as_quat(scalar_first=True)
        coordinates[:, :, 3:] = e, _turn(spins, e) / 2, _turn(spin_rates, e) / 2
        coordinates[2, :, 3:] -= (spins**2).sum(axis=-1, keepdims=True) / 4 * e
        x, x_dot, x_ddot = coordinates.reshape(3, 49)
        self._turns = pose.angles[:, 0] - self._start
        robot.load(_joint_moments(p, pose, rates, platform_moment))
        mass, force, Phi, residual = robot.equations(x, x_dot)
        # ... and hold in every other one: Exudyn's word on position and velocity.
        require_same(residual, np.zeros_like(residual), "the constraints")
        wanted = np.zeros_like(residual)
        wanted[robot.motor_rows] = (Phi @ x_dot)[robot.motor_rows]
        require_same(np.abs(wanted[robot.motor_rows]), np.abs(rates[:, 0]), "a motor rate")
        require_same(Phi @ x_dot, wanted, "the rate of the constraints")
        multipliers = np.linalg.lstsq(Phi.T, force - mass @ x_ddot)[0]
        robot.system.systemData.SetAECoordinates(multipliers.tolist())
        torque = exu.OutputVariableType.TorqueLocal
        return np.array([robot.system.GetObjectOutput(m, torque)[2] for m in robot.motors])


def stepped_torques(
    parameters: Parameters,
    motion: Motion,
    duration: float,
    steps: int,
    *,
    spectral_radius: float = 0.6,
) -> tuple[Array, Array]:
    """Inverse dynamics in time: the motors are constraints that turn as the motion asks.

    The first torques are some 10 N m off, since Exudyn's initial accelerations leave out those of
    the motors; damping by a spectral radius below one has made up for it after some twenty steps.

    Args:
        parameters: The SST, without friction.
        motion: Of the star, for example `paper_circle`; called at times from 0 on.
        duration: [s].
        steps: Number of steps, all equal.
        spectral_radius: Of the integrator at infinite frequency, in [0, 1].

    Returns:
        Times, shape (steps + 1,), and motor torques at them, shape (steps + 1, 3), [N m].

    Raises:
        MissingExtraError: Without Exudyn.
        InputError: For an SST with friction.
    """
    _require_frictionless(parameters)
    R, omega, _ = motion(0.0)
    start = legs(parameters, R).angles[:, 0]

    @lru_cache(maxsize=8)  # Newton's iterations ask again and again
    def turns(t: float) -> Array:
        turn = legs(parameters, motion(t)[0]).angles[:, 0] - start
        wrapped: Array = (turn + np.pi) % (2 * np.pi) - np.pi
        return wrapped

    robot = _Robot(parameters, R, omega, [lambda t, k=k: float(turns(t)[k]) for k in range(3)])
    output = robot.exudyn.OutputVariableType.TorqueLocal
    item = robot.utilities.SensorObject
    sensors = [
        item(objectNumber=m, outputVariableType=output, storeInternal=True, writeToFile=False)
        for m in robot.motors
    ]
    data = robot.step(duration, steps, spectral_radius, sensors)
    return data[0][:, 0], np.stack([d[:, 3] for d in data], axis=-1)


def stepped_motion(
    parameters: Parameters,
    R: ArrayLike,
    omega: ArrayLike,
    torque: Callable[[float], ArrayLike],
    duration: float,
    steps: int,
    *,
    spectral_radius: float = 1.0,
) -> tuple[Array, Array]:
    """Direct dynamics in time: the motion of the star under given motor torques.

    Args:
        parameters: The SST, without friction.
        R: {E} in the base at the start, shape (3, 3).
        omega: Angular velocity of the star at the start, base axes, shape (3,), [rad/s].
        torque: Motor torques of shape (3,) as a function of time, [N m].
        duration: [s].
        steps: Number of steps, all equal.
        spectral_radius: Of the integrator at infinite frequency, in [0, 1].

    Returns:
        Times, shape (steps + 1,), and {E} in the base at them, shape (steps + 1, 3, 3).

    Raises:
        MissingExtraError: Without Exudyn.
        InputError: For an SST with friction.
    """
    _require_frictionless(parameters)
    robot = _Robot(parameters, R, omega, None)
    e = legs(parameters, R).e
    torques = lru_cache(maxsize=8)(lambda t: np.asarray(torque(t), dtype=float))
    for k in range(3):
        robot.system.CreateTorque(
            itemNumber=robot.bodies[2 * k],
            loadVector=[0, 0, 0],
            loadVectorUserFunction=lambda _, t, __, k=k: (torques(t)[k] * e[k]).tolist(),
        )
    sensor = robot.utilities.SensorBody(
        bodyNumber=robot.bodies[-1],
        outputVariableType=robot.exudyn.OutputVariableType.RotationMatrix,
        storeInternal=True,
        writeToFile=False,
    )
    (data,) = robot.step(duration, steps, spectral_radius, [sensor])
    return data[:, 0], data[:, 1:].reshape(-1, 3, 3)


class _Robot:
    """The SST in Exudyn, its joints fitted in one pose.

    Args:
        parameters: The SST.
        R: {E} in the base in that pose, shape (3, 3).
        omega: Angular velocity of the star in that pose, shape (3,).
        turns: How far the motors are from that pose, as functions of time; None for free ones.
    """

    def __init__(
        self, parameters: Parameters, R: ArrayLike, omega: ArrayLike, turns: _Turns | None
    ) -> None:
        self.exudyn, self.utilities = engine("exudyn"), engine("exudyn.utilities")
        self._container = self.exudyn.SystemContainer()  # owns the system
        self.system = system = self._container.AddSystem()
        pose = legs(parameters, R)
        frames = _frames(pose, R)
        _, spins, _ = _turning(pose, np.asarray(omega), np.zeros(3))
        p = parameters
        pairs = [body for pair in zip(p.links, p.passive_links, strict=True) for body in pair]
        ground = system.CreateGround()
        self.bodies = [
            system.CreateRigidBody(
                referenceRotationMatrix=frame,
                initialAngularVelocity=spin.tolist(),
                inertia=self.utilities.RigidBodyInertia(
                    body.mass, body.inertia, body.center_of_mass, inertiaTensorAtCOM=True
                ),
                gravity=p.gravity.tolist(),
            )
            for body, frame, spin in zip([*pairs, p.star], frames, spins, strict=True)
        ]

        def joint(first: int, second: int, axes: Array, locked: list[int], **options: Any) -> Any:
            return system.CreateGenericJoint(
                itemNumbers=[first, second],
                position=[0, 0, 0],
                rotationMatrixAxes=axes,
                constrainedAxes=locked,
                useGlobalFrame=True,
                **options,
            )

        self.motors = []
        for k in range(3):
            link, passive = self.bodies[2 * k : 2 * k + 2]
            drive: dict[str, Any] = {}
            if turns is not None:
                drive["offsetUserFunction"] = lambda _, t, *__, turn=turns[k]: [0.0] * 5 + [turn(t)]
            locked = [1, 1, 1, 1, 1, int(turns is not None)]
            self.motors.append(joint(ground, link, frames[2 * k], locked, **drive))
            joint(link, passive, frames[2 * k], [1, 1, 1, 0, 1, 1])
            locked = [1, 1, 1, 1, 1, 0] if k == 0 else [0, 0, 0, 1, 1, 0]
            joint(passive, self.bodies[-1], frames[2 * k + 1], locked)
        self._loads = [
            system.CreateTorque(itemNumber=body, loadVector=[0, 0, 0]) for body in self.bodies
        ]
        system.Assemble()
        reference = self.exudyn.ConfigurationType.Reference
        self._reference = system.systemData.GetODE2Coordinates(configuration=reference)
        self.motor_rows = [system.systemData.GetObjectLTGAE(m)[5] for m in self.motors]

    def load(self, moments: Array) -> None:
        """Put moments on the bodies, base axes, shape (7, 3), [N m]."""
        for load, moment in zip(self._loads, moments, strict=True):
            self.system.SetLoadParameter(load, "loadVector", moment.tolist())

    def equations(self, x: Array, x_dot: Array) -> tuple[Array, Array, Array, Array]:
        """Mass matrix M, force f, Phi and constraint residual: M x_ddot + Phi^T multipliers = f."""
        initial, data = self.exudyn.ConfigurationType.Initial, self.system.systemData
        data.SetODE2Coordinates((x - self._reference).tolist(), initial)
        data.SetODE2Coordinates_t(x_dot.tolist(), initial)
        settings = self._settings()
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
        solver, n = self.exudyn.MainSolverImplicitSecondOrder(), len(x)
        solver.InitializeSolver(self.system, settings)
        solver.ComputeMassMatrix(self.system)
        mass = np.array(solver.GetSystemMassMatrix())[:n, :n]
        solver.ComputeODE2RHS(self.system)
        force = np.array(solver.GetSystemResidual())[:n]
        solver.ComputeAlgebraicEquations(self.system)
        residual = np.array(solver.GetSystemResidual())[n:]
        solver.ComputeJacobianODE2RHS(self.system, 0, 0, 0)  # clears the matrix
        solver.ComputeJacobianAE(self.system)
        Phi = np.array(solver.GetSystemJacobian())[n:, :n]
        solver.FinalizeSolver(self.system, settings)
        return mass, force, Phi, residual

    def step(
        self, duration: float, steps: int, spectral_radius: float, sensors: list[Any]
    ) -> list[Array]:
        """Integrate in time; what each sensor saw, its first column being time."""
        numbers = [self.system.AddSensor(sensor) for sensor in sensors]
        self.system.Assemble()
        settings = self._settings()
        settings.solution.sensors.writePeriod = duration / steps
        settings.timeIntegration.endTime = duration
        settings.timeIntegration.numberOfSteps = steps
        settings.timeIntegration.generalizedAlpha.spectralRadius = spectral_radius
        newton = settings.timeIntegration.newton
        newton.useModifiedNewton = False  # its default tolerances leave 0.01 N m
        newton.relativeTolerance, newton.absoluteTolerance = 1e-10, 1e-12
        self.system.SolveDynamic(settings)
        return [np.array(self.system.GetSensorStoredData(number)) for number in numbers]

    def _settings(self) -> Any:
        settings = self.exudyn.SimulationSettings()
        settings.solution.file.write = False
        return settings


def _frames(pose: Legs, R: ArrayLike) -> Array:
    """{1k} and {2k} of each leg, then {E}, shape (7, 3, 3)."""
    e, u, n, _ = pose
    link = np.stack([u, np.cross(e, u), e], axis=-1)
    passive = np.stack([u, np.cross(n, u), n], axis=-1)
    return _all_bodies(link, passive, np.asarray(R, dtype=float))


def _all_bodies(link: Array, passive: Array, star: Array) -> Array:
    """Values of link_1, passive_1, link_2, ..., star, along a first axis of length 7."""
    return np.concatenate([np.stack([link, passive], axis=1).reshape(6, *star.shape), [star]])


def _turning(pose: Legs, omega: Array, alpha: Array) -> tuple[Array, Array, Array]:
    """Joint rates, shape (3, 3), and angular velocities and accelerations of all bodies, (7, 3)."""
    e, u, n, _ = pose
    axes = np.stack([e, u, n], axis=-1)  # omega = e gamma_dot + u mu_dot + n beta_dot
    rates = np.linalg.solve(axes, np.tile(omega, (3, 1))[..., None])[..., 0]
    link = rates[:, :1] * e
    passive = link + rates[:, 1:2] * u
    u_turns = rates[:, 1:2] * np.cross(link, u)
    n_turns = rates[:, 2:] * np.cross(passive, n)
    second = np.linalg.solve(axes, (alpha - u_turns - n_turns)[..., None])[..., 0]
    link_rate = second[:, :1] * e
    passive_rate = link_rate + second[:, 1:2] * u + u_turns
    return (
        rates,
        _all_bodies(link, passive, omega),
        _all_bodies(link_rate, passive_rate, alpha),
    )


def _turn(spins: Array, e: Array) -> Array:
    """Products of quaternions (0, spin) e, scalar first, row by row."""
    scalar = -(spins * e[:, 1:]).sum(axis=-1, keepdims=True)
    return np.hstack([scalar, spins * e[:, :1] + np.cross(spins, e[:, 1:])])


def _joint_moments(
    p: Parameters, pose: Legs, rates: Array, platform_moment: ArrayLike | None
) -> Array:
    """Moments of friction, and of the surroundings on the star, on all bodies, shape (7, 3)."""
    friction = p.viscous_friction.reshape(3, 3) * rates
    friction = -friction - p.coulomb_friction.reshape(3, 3) * np.sign(rates)
    on_link, on_passive, on_star = (
        friction[:, i : i + 1] * axis for i, axis in enumerate((pose.e, pose.u, pose.n))
    )
    star = on_star.sum(axis=0)
    if platform_moment is not None:
        star = star + np.asarray(platform_moment, dtype=float)
    return _all_bodies(on_link - on_passive, on_passive - on_star, star)


def _require_frictionless(parameters: Parameters) -> None:
    if parameters.viscous_friction.any() or parameters.coulomb_friction.any():
        raise InputError("parameters", "friction is not part of Exudyn's time stepping here")

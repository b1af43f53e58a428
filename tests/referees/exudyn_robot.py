# SPDX-License-Identifier: BSD-2-Clause
"""The SST as Exudyn sees it: seven rigid bodies in redundant coordinates, nine joints.

A body has seven coordinates, the position of its reference point (always O) and Euler parameters.
The joints of legs 2 and 3 on the star lock two rotations and nothing else, so that no constraint
is redundant.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sst_pin.arrays import Array
from sst_pin.description.parameters import Parameters
from sst_pin.errors import ClosureError

#: Turns of the three motors as a function of time, shape (3,), [rad].
Turns = Callable[[float], Array]
#: Largest difference of a pose by an engine's own frames, [rad] or [rad/s].
_TOLERANCE = 1e-9


class LegAxes(NamedTuple):
    """Joint axes and angles of the three legs, a row for each, shape (3, 3)."""

    e: Array  #: Actuated axes e_k, base axes.
    u: Array  #: Axes e_{k+3} of mu_k, towards R_k.
    n: Array  #: Axes e_{k+6} of beta_k, normals of the arcs.
    angles: Array  #: gamma_k, mu_k, beta_k, [rad].


def legs(parameters: Parameters, R: ArrayLike) -> LegAxes:
    """The legs that carry the star at R, {E} in the base, with 0 < mu_k < pi.

    Only a start: each engine holds what it gets from here against its own frames.
    """
    R = np.asarray(R, dtype=float)
    v = parameters.base_directions
    e = _unit(np.cross(v, v[[1, 2, 0]]))
    # The arcs stand round s at the angles 0, alpha_2, alpha_2 + alpha_3.
    turn = np.cumsum([0.0, *parameters.arc_angles[1:]])
    n = -np.outer(np.sin(turn), R[:, 1]) + np.outer(np.cos(turn), R[:, 2])
    u = _unit(np.cross(e, n))  # in the planes of base arc and star arc
    angles = _angle(e, v, u), _angle(u, e, n), _angle(n, u, np.tile(R[:, 0], (3, 1)))
    return LegAxes(e, u, n, np.stack(angles, axis=-1))


def require_same(found: Array, wanted: Array, what: str) -> None:
    """Refuse a pose by an engine's own kinematics that differs from the wanted one."""
    error = float(np.abs(found - wanted).max())
    if not error <= _TOLERANCE:
        raise ClosureError(f"{what} of the engine is off by {error:.3g}", error)


def _unit(a: Array) -> Array:
    lengths: Array = np.linalg.norm(a, axis=-1, keepdims=True)
    return a / lengths


def _angle(axis: Array, start: Array, end: Array) -> Array:
    """Angles about unit axes that bring one direction to another, row by row."""
    return np.arctan2(np.vecdot(np.cross(axis, start), end), np.vecdot(start, end))


class ExudynRobot:
    """The SST in Exudyn, its joints fitted in one pose with R and omega of the star.

    `turns` says how far the motors are from that pose; None leaves them free to turn.
    """

    def __init__(
        self, parameters: Parameters, R: ArrayLike, omega: ArrayLike, turns: Turns | None
    ) -> None:
        self.exudyn = import_module("exudyn")
        self.utilities = import_module("exudyn.utilities")
        self._container = self.exudyn.SystemContainer()  # owns the system
        self.system = system = self._container.AddSystem()
        pose = legs(parameters, R)
        axes = frames(pose, R)
        _, spins, _ = turning(pose, np.asarray(omega), np.zeros(3))
        p = parameters
        pairs = [body for pair in zip(p.links, p.passive_links, strict=True) for body in pair]
        ground = system.CreateGround()
        self.bodies = [
            system.CreateRigidBody(
                referenceRotationMatrix=placed,
                initialAngularVelocity=spin.tolist(),
                inertia=self.utilities.RigidBodyInertia(
                    body.mass, body.inertia, body.center_of_mass, inertiaTensorAtCOM=True
                ),
                gravity=p.gravity.tolist(),
            )
            for body, placed, spin in zip([*pairs, p.star], axes, spins, strict=True)
        ]

        def joint(first: int, second: int, frame: Array, locked: list[int], **options: Any) -> Any:
            return system.CreateGenericJoint(
                itemNumbers=[first, second],
                position=[0, 0, 0],
                rotationMatrixAxes=frame,
                constrainedAxes=locked,
                useGlobalFrame=True,
                **options,
            )

        self.motors = []
        for k in range(3):
            link, passive = self.bodies[2 * k : 2 * k + 2]
            drive = {} if turns is None else {"offsetUserFunction": _offset(turns, k)}
            locked = [1, 1, 1, 1, 1, int(turns is not None)]
            self.motors.append(joint(ground, link, axes[2 * k], locked, **drive))
            joint(link, passive, axes[2 * k], [1, 1, 1, 0, 1, 1])
            locked = [1, 1, 1, 1, 1, 0] if k == 0 else [0, 0, 0, 1, 1, 0]
            joint(passive, self.bodies[-1], axes[2 * k + 1], locked)
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


def _offset(turns: Turns, k: int) -> Callable[..., list[float]]:
    """Offset of motor k's joint, three displacements and three rotations."""
    return lambda system, t, *_: [0.0] * 5 + [float(turns(t)[k])]


def frames(pose: LegAxes, R: ArrayLike) -> Array:
    """{1k} and {2k} of each leg, then {E}, shape (7, 3, 3)."""
    e, u, n, _ = pose
    link = np.stack([u, np.cross(e, u), e], axis=-1)
    passive = np.stack([u, np.cross(n, u), n], axis=-1)
    return of_all_bodies(link, passive, np.asarray(R, dtype=float))


def of_all_bodies(link: Array, passive: Array, star: Array) -> Array:
    """Values of link_1, passive_1, link_2, ..., star, along a first axis of length 7."""
    return np.concatenate([np.stack([link, passive], axis=1).reshape(6, *star.shape), [star]])


def turning(pose: LegAxes, omega: Array, alpha: Array) -> tuple[Array, Array, Array]:
    """Joint rates, shape (3, 3); angular velocities and accelerations of all bodies, (7, 3)."""
    e, u, n, _ = pose
    axes = np.stack([e, u, n], axis=-1)  # omega = e gamma_dot + u mu_dot + n beta_dot
    rates = _solve(axes, np.tile(omega, (3, 1)))
    link = rates[:, :1] * e
    passive = link + rates[:, 1:2] * u
    u_turns = rates[:, 1:2] * np.cross(link, u)
    n_turns = rates[:, 2:] * np.cross(passive, n)
    second = _solve(axes, alpha - u_turns - n_turns)
    link_rate = second[:, :1] * e
    passive_rate = link_rate + second[:, 1:2] * u + u_turns
    spins = of_all_bodies(link, passive, omega)
    return rates, spins, of_all_bodies(link_rate, passive_rate, alpha)


def _solve(matrices: Array, rows: Array) -> Array:
    """One linear system for each leg."""
    return np.asarray(np.linalg.solve(matrices, rows[..., None])[..., 0], dtype=np.float64)

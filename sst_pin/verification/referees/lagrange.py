# SPDX-License-Identifier: BSD-2-Clause
"""Lagrange multipliers: the tree's equations of motion with the closures' forces as unknowns.

Direct dynamics is Pinocchio's own, `constraintDynamics`; inverse dynamics, and the direct one with
closures that Pinocchio does not know, solve for the multipliers here. Both take any closed chain.
The chain is asked for its model, closures, motors and friction coefficients, for nothing else.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ...chain.closed_chain import ClosedChain
from ...description.parameters import Parameters
from ...errors import DescriptionError
from ...sst.robot import SST
from .geometry import legs, require_same

Array = NDArray[np.float64]

#: Rows of [linear; angular] that each kind of closure holds.
_ROWS = {"6d": slice(0, 6), "3d": slice(0, 3), "orientation": slice(3, 6)}
#: Regularisation of the multipliers: with none, redundant closures end in NaN without a word.
_MU = 1e-6
#: Singular values below this count as redundant closures, relative to the largest.
_REDUNDANT = 1e-10


class _Motion(NamedTuple):
    """Closures and joint rates: Phi q_ddot + drift = 0."""

    Phi: Array
    drift: Array
    motors: Array
    q_dot: Array


class LagrangeMultipliers:
    """The cut tree with a force in each cut.

    Args:
        parameters: The SST.
    """

    name = "Lagrange multipliers"
    package = "pin"

    def __init__(self, parameters: Parameters) -> None:
        self._parameters, self._chain = parameters, SST(parameters)
        model = self._chain.model
        names = ("closedloop1_A", "closedloop1_B", "closedloop2_B")  # {E} at the end of each leg
        self._ends = [model.getFrameId(name) for name in names]

    def torques(
        self,
        R: ArrayLike,
        omega: ArrayLike,
        alpha: ArrayLike,
        platform_moment: ArrayLike | None = None,
    ) -> Array:
        """Motor torques; see `Referee.torques`."""
        model = self._chain.model
        data = model.createData()
        q = legs(self._parameters, R).angles.ravel()
        pin.computeJointJacobians(model, data, q)
        J = np.vstack([_jacobian(model, data, frame)[3:] for frame in self._ends])
        q_dot = np.linalg.solve(J, np.tile(omega, 3))
        pin.forwardKinematics(model, data, q, q_dot, np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        for frame in self._ends:
            require_same(data.oMf[frame].rotation, np.asarray(R), "the star's orientation")
        drift = np.concatenate([_acceleration(model, data, frame)[3:] for frame in self._ends])
        q_ddot = np.linalg.solve(J, np.tile(alpha, 3) - drift)
        loads = None if platform_moment is None else J[:3].T @ np.asarray(platform_moment)
        motors = list(self._chain.actuated)
        return torques(self._chain, q, q_dot[motors], q_ddot[motors], loads)


def torques(
    chain: ClosedChain, q: Array, va: Array, aa: Array, loads: Array | None = None
) -> Array:
    """Inverse dynamics of any closed chain: motor torques and multipliers solved for together.

    Args:
        chain: The robot.
        q: Joint coordinates on the closures, shape (m,).
        va: Rates of the actuated joints, shape (n,).
        aa: Their accelerations, shape (n,).
        loads: Further forces in the joints of the tree, shape (m,), [N m] or [N].

    Returns:
        tau, shape (n,).
    """
    motion = _motion(chain, q, va)
    system = np.vstack([motion.Phi, motion.motors])
    q_ddot = _solve(system, np.concatenate([-motion.drift, aa]))
    model = chain.model
    need = pin.rnea(model, model.createData(), q, motion.q_dot, q_ddot)
    need = need - _given(chain, motion.q_dot, loads)
    # need = motors^T tau + Phi^T multipliers
    return _solve(system.T, need)[-len(va) :]


def accelerations(
    chain: ClosedChain, q: Array, va: Array, tau: Array, loads: Array | None = None
) -> Array:
    """Direct dynamics of any closed chain by Pinocchio's `constraintDynamics`.

    Args:
        chain: The robot; its closures are of kind "6d" or "3d".
        q: Joint coordinates on the closures, shape (m,).
        va: Rates of the actuated joints, shape (n,).
        tau: Motor torques, shape (n,).
        loads: As in `torques`.

    Returns:
        Accelerations of the actuated joints, shape (n,).

    Raises:
        DescriptionError: For a closure that Pinocchio does not know.
    """
    model, motion = chain.model, _motion(chain, q, va)
    kinds = {"6d": pin.ContactType.CONTACT_6D, "3d": pin.ContactType.CONTACT_3D}
    constraints = []
    for closure in _closures(chain):
        if closure.kind not in kinds:
            raise DescriptionError(
                f"closure of {closure.frame_a} and {closure.frame_b}",
                [f"Pinocchio has none of kind {closure.kind!r}; use accelerations_by_multipliers"],
            )
        ends = [model.frames[model.getFrameId(f)] for f in (closure.frame_a, closure.frame_b)]
        placements = [part for f in ends for part in (f.parentJoint, f.placement)]
        constraints.append(
            pin.RigidConstraintModel(kinds[closure.kind], model, *placements, pin.LOCAL)
        )
    data, settings = model.createData(), pin.ProximalSettings(1e-14, _MU, 20)
    workspaces = [constraint.createData() for constraint in constraints]
    pin.initConstraintDynamics(model, data, constraints, workspaces)
    force = motion.motors.T @ tau + _given(chain, motion.q_dot, loads)
    q_ddot: Array = pin.constraintDynamics(
        model, data, q, motion.q_dot, force, constraints, workspaces, settings
    )
    return motion.motors @ q_ddot


def accelerations_by_multipliers(
    chain: ClosedChain, q: Array, va: Array, tau: Array, loads: Array | None = None
) -> Array:
    """Direct dynamics of any closed chain, multipliers solved for here; as `accelerations`."""
    model, motion = chain.model, _motion(chain, q, va)
    M = pin.crba(model, model.createData(), q)
    M = np.triu(M) + np.triu(M, 1).T
    force = motion.motors.T @ tau + _given(chain, motion.q_dot, loads)
    force = force - pin.nle(model, model.createData(), q, motion.q_dot)
    rows = len(motion.Phi)
    system = np.block([[M, motion.Phi.T], [motion.Phi, np.zeros((rows, rows))]])
    q_ddot = _solve(system, np.concatenate([force, -motion.drift]))[: model.nv]
    return motion.motors @ q_ddot


def _closures(chain: ClosedChain) -> list[Any]:
    """Closures of the kinds that this referee knows.

    Raises:
        DescriptionError: For others.
    """
    others = [c for c in chain.closures if getattr(c, "kind", None) not in _ROWS]
    if others:
        raise DescriptionError(f"closure {others[0]}", ["this referee knows 6d, 3d, orientation"])
    return list(chain.closures)


def _motion(chain: ClosedChain, q: Array, va: Array) -> _Motion:
    """Closures by Pinocchio's frames, and the joint rates that keep them closed."""
    model = chain.model
    data = model.createData()
    pairs = [
        (model.getFrameId(c.frame_a), model.getFrameId(c.frame_b), _ROWS[c.kind])
        for c in _closures(chain)
    ]
    pin.computeJointJacobians(model, data, q)
    Phi = np.vstack(
        [(_jacobian(model, data, b) - _jacobian(model, data, a))[rows] for a, b, rows in pairs]
    )
    motors = np.eye(model.nv)[list(chain.actuated)]
    q_dot = _solve(np.vstack([Phi, motors]), np.concatenate([np.zeros(len(Phi)), va]))
    pin.forwardKinematics(model, data, q, q_dot, np.zeros(model.nv))
    pin.updateFramePlacements(model, data)
    drift = np.concatenate(
        [(_acceleration(model, data, b) - _acceleration(model, data, a))[r] for a, b, r in pairs]
    )
    return _Motion(Phi, drift, motors, q_dot)


def _given(chain: ClosedChain, q_dot: Array, loads: Array | None) -> Array:
    """Joint forces that are neither the motors' nor the closures'."""
    friction = chain.friction.viscous * q_dot + chain.friction.coulomb * np.sign(q_dot)
    return -friction if loads is None else loads - friction


def _solve(system: Array, right: Array) -> Array:
    """Solution of a consistent system with redundant rows or columns."""
    solution = np.linalg.lstsq(system, right, rcond=_REDUNDANT)[0]
    return np.asarray(solution, dtype=np.float64)


def _jacobian(model: pin.Model, data: pin.Data, frame: int) -> Array:
    jacobian: Array = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
    return jacobian


def _acceleration(model: pin.Model, data: pin.Data, frame: int) -> Array:
    """Of the frame's origin, base axes, [linear; angular]."""
    kind = pin.LOCAL_WORLD_ALIGNED
    vector: Array = pin.getFrameClassicalAcceleration(model, data, frame, kind).vector
    return vector

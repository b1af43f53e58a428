# SPDX-License-Identifier: BSD-2-Clause
"""Lagrange multipliers: the tree's equations of motion with the closures' forces as unknowns.

Everything is solved by least squares on the columns of RNEA and on all rows of the closures,
redundant ones too. Takes any closed chain, any joints, closures and motors. From the chain it reads
only the `Mechanism`, the description, and no computed results.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..description.parameters import Parameters
from ..model.closures import Closure, Coupling, Distance, Rolling, frames_of
from ..model.mechanism import Mechanism
from ..sst.robot import SST
from .referees import Moment, legs, require_same

#: Singular values below this count as redundant closures, relative to the largest.
_REDUNDANT = 1e-10
_EYE = np.eye(3)


class _Rates(NamedTuple):
    """Closures and rates: Phi v_dot + drift = 0."""

    mechanism: Mechanism
    Phi: Array
    drift: Array
    v: Array


class LagrangeMultipliers:
    """The cut tree of an SST with a force in each cut."""

    name = "Lagrange multipliers"
    package = "pin"

    def __init__(self, parameters: Parameters) -> None:
        self._parameters, self._chain = parameters, SST(parameters)
        model = self._chain.mechanism.model
        names = ("closedloop1_A", "closedloop1_B", "closedloop2_B")  # {E} at the end of each leg
        self._ends = [model.getFrameId(name) for name in names]

    def torques(
        self, R: ArrayLike, omega: ArrayLike, alpha: ArrayLike, platform_moment: Moment = None
    ) -> Array:
        """Motor torques; see `Referee.torques`."""
        model = self._chain.mechanism.model
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
    """The smallest motor torques of a motion of any closed chain, shape (motors,).

    q lies on the closures; `loads` are further forces on the rates of the tree, shape (nv,). Where
    the motors cannot produce the motion, the torques are the nearest ones.
    """
    motion = _motion(chain, q, va)
    need = _need(motion, q, aa) - (0 if loads is None else loads)
    # need = B tau + Phi^T multipliers; motions that the closures leave do not see the latter.
    _, sizes, V = np.linalg.svd(motion.Phi)
    free = V[np.count_nonzero(sizes > _REDUNDANT * sizes.max(initial=0.0)) :]
    return _solve(free @ _actuation(motion, q), free @ need)


def generalized_forces(chain: ClosedChain, q: Array, va: Array, aa: Array) -> Array:
    """The forces along the coordinates that a motion needs, shape (n,)."""
    motion = _motion(chain, q, va)
    system = np.vstack([motion.Phi, motion.mechanism.selection])
    return _solve(system.T, _need(motion, q, aa))[len(motion.Phi) :]


def accelerations(chain: ClosedChain, q: Array, va: Array, tau: Array) -> Array:
    """Direct dynamics of any closed chain: accelerations of the coordinates, shape (n,)."""
    model, motion = chain.mechanism.model, _motion(chain, q, va)
    data, zero = model.createData(), np.zeros(model.nv)
    rest = pin.rnea(model, data, q, zero, zero)
    # `pin.crba` is wrong for trees whose joints are not added depth-first.
    M = np.stack([pin.rnea(model, data, q, zero, e) - rest for e in np.eye(model.nv)], axis=1)
    force = _actuation(motion, q) @ tau + _given(motion, q)
    force -= pin.rnea(model, data, q, motion.v, zero)
    # A unit for the multipliers, so that M is not lost in rounding.
    rows, unit = len(motion.Phi), np.abs(M).max()
    system = np.block([[M / unit, motion.Phi.T], [motion.Phi, np.zeros((rows, rows))]])
    v_dot = _solve(system, np.concatenate([force / unit, -motion.drift]))[: model.nv]
    return motion.mechanism.selection @ v_dot


def _motion(chain: ClosedChain, q: Array, va: Array) -> _Rates:
    """Closures by Pinocchio's frames, and the rates that keep them closed."""
    mechanism = chain.mechanism
    Phi, _ = _rows(mechanism, q, np.zeros(mechanism.model.nv))
    right = np.concatenate([np.zeros(len(Phi)), va])
    v = _solve(np.vstack([Phi, mechanism.selection]), right)
    return _Rates(mechanism, *_rows(mechanism, q, v), v)


def _rows(mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """Phi, shape (rows, nv), and Phi_dot v, shape (rows,), of all closures."""
    model = mechanism.model
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    pin.updateFramePlacements(model, data)
    parts = []
    for closure in mechanism.closures:
        if isinstance(closure, Coupling):
            parts.append(_coupling(model, closure, q, v))
        else:
            ends = [_frame(model, data, name, v) for name in frames_of(closure)]
            parts.append(_relative(closure, *ends))
    Phi, drift = zip((np.empty((0, model.nv)), np.empty(0)), *parts, strict=True)
    return np.vstack(Phi), np.concatenate(drift)


class _Frame(NamedTuple):
    """A frame: Jacobian, twist and acceleration as [linear; angular] of its origin, base axes."""

    placement: pin.SE3
    J: Array
    twist: Array
    drift: Array


def _frame(model: pin.Model, data: pin.Data, name: str, v: Array) -> _Frame:
    frame = model.getFrameId(name)
    J = _jacobian(model, data, frame)
    return _Frame(data.oMf[frame], J, J @ v, _acceleration(model, data, frame))


def _relative(closure: Closure | Distance | Rolling, A: _Frame, B: _Frame) -> tuple[Array, Array]:
    """Rows G [r_dot; w] of the position r and the angular velocity w of B in the axes of A.

    G moves with r and with the axes of B, which w turns.
    """
    R_a = A.placement.rotation
    d = B.placement.translation - A.placement.translation
    r, R = R_a.T @ d, R_a.T @ B.placement.rotation
    J = B.J - A.J
    J[:3] += pin.skew(d) @ A.J[3:]
    J = np.vstack([R_a.T @ J[:3], R_a.T @ J[3:]])
    omega, relative = A.twist[3:], B.twist - A.twist
    drift = B.drift - A.drift
    slid = relative[:3] - np.cross(omega, d)
    drift[:3] -= np.cross(A.drift[3:], d) + np.cross(omega, np.cross(omega, d) + 2 * slid)
    drift[3:] -= np.cross(omega, relative[3:])
    r_dot, w = R_a.T @ slid, R_a.T @ relative[3:]
    drift = np.concatenate([R_a.T @ drift[:3], R_a.T @ drift[3:]])
    if isinstance(closure, Distance):
        G, G_dot = np.zeros((1, 6)), np.zeros((1, 6))
        G[0, :3], G_dot[0, :3] = r, r_dot
    elif isinstance(closure, Rolling):
        G, G_dot = _rolling(closure, R[:, 2], np.cross(w, R[:, 2]))
    else:
        held = np.array(closure.held)
        G, G_dot = np.eye(6)[held], np.zeros((held.sum(), 6))
        if held[3:].sum() == 1:  # one axis of A and one of B stay at a right angle
            k = int(np.flatnonzero(held[3:])[0])
            a, b = _EYE[(k + 1) % 3], R[:, (k + 2) % 3]
            G[-1, 3:], G_dot[-1, 3:] = np.cross(a, b), np.cross(a, np.cross(w, b))
    return G @ J, G @ drift + G_dot @ np.concatenate([r_dot, w])


def _rolling(closure: Rolling, axle: Array, axle_dot: Array) -> tuple[Array, Array]:
    """The velocity r_dot - radius w x up of the contact."""
    up, up_dot, normal = _EYE[2], np.zeros(3), _EYE[2]
    if not closure.ball:  # up is at a right angle to the axle
        g = normal - normal @ axle * axle
        g_dot = -(normal @ axle_dot) * axle - normal @ axle * axle_dot
        size = np.linalg.norm(g)
        up = g / size
        up_dot = (g_dot - up * (up @ g_dot)) / size
    of_turns = [closure.radius * pin.skew(u) for u in (up, up_dot)]
    return np.hstack([_EYE, of_turns[0]]), np.hstack([np.zeros((3, 3)), of_turns[1]])


def _coupling(model: pin.Model, closure: Coupling, q: Array, v: Array) -> tuple[Array, Array]:
    row, drift = np.zeros((1, model.nv)), 0.0
    for name, polynomial in {closure.joint: (0.0, -1.0), **closure.polynomials}.items():
        joint = model.joints[model.getJointId(name)]
        P = Polynomial(polynomial or (0.0,))
        row[0, joint.idx_v] = P.deriv()(q[joint.idx_q])
        drift += P.deriv(2)(q[joint.idx_q]) * v[joint.idx_v] ** 2
    return row, np.array([drift])


def _need(motion: _Rates, q: Array, aa: Array) -> Array:
    """The forces of motors and closures on the tree, shape (nv,)."""
    system = np.vstack([motion.Phi, motion.mechanism.selection])
    v_dot = _solve(system, np.concatenate([-motion.drift, aa]))
    model = motion.mechanism.model
    need: Array = pin.rnea(model, model.createData(), q, motion.v, v_dot)
    return need - _given(motion, q)


def _given(motion: _Rates, q: Array) -> Array:
    """Forces on the tree that are neither the motors' nor the closures', nor weights."""
    mechanism, v = motion.mechanism, motion.v
    friction, springs = mechanism.friction, mechanism.springs
    force = -friction.viscous * v - friction.coulomb * np.sign(v)
    force -= springs.stiffness * pin.difference(mechanism.model, springs.reference, q)
    for line, (length, row) in zip(mechanism.lines.forces, _lines(mechanism, q), strict=True):
        stretched = line.stiffness * (length - line.rest_length)
        force -= (line.preload + stretched + line.damping * row @ v) * row
    return force


def _actuation(motion: _Rates, q: Array) -> Array:
    """Forces on the tree from motor torques, shape (nv, motors)."""
    B = motion.mechanism.motors
    for (_, row), shares in zip(
        _lines(motion.mechanism, q), motion.mechanism.lines.motors, strict=True
    ):
        B = B + np.outer(row, shares)
    return B


def _lines(mechanism: Mechanism, q: Array) -> list[tuple[float, Array]]:
    """Length of each line, and the forces on the tree that push its ends apart by 1 N."""
    model, data, found = mechanism.model, mechanism.model.createData(), []
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    for line in mechanism.lines.forces:
        a, b = (model.getFrameId(name) for name in (line.frame_a, line.frame_b))
        way = data.oMf[b].translation - data.oMf[a].translation
        length = float(np.linalg.norm(way))
        apart = _jacobian(model, data, b)[:3] - _jacobian(model, data, a)[:3]
        found.append((length, way @ apart / length))
    return found


def _solve(system: Array, right: Array) -> Array:
    """Solution of a consistent system with redundant rows or columns, refined once."""
    solution = np.linalg.lstsq(system, right, rcond=_REDUNDANT)[0]
    left_over = right - system @ solution
    solution = solution + np.linalg.lstsq(system, left_over, rcond=_REDUNDANT)[0]
    return np.asarray(solution, dtype=np.float64)


def _jacobian(model: pin.Model, data: pin.Data, frame: int) -> Array:
    jacobian: Array = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
    return jacobian


def _acceleration(model: pin.Model, data: pin.Data, frame: int) -> Array:
    """Acceleration of the frame's origin, base axes, [linear; angular]."""
    kind = pin.LOCAL_WORLD_ALIGNED
    vector: Array = pin.getFrameClassicalAcceleration(model, data, frame, kind).vector
    return vector.copy()

# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives of inverse and direct dynamics along the motions that keep the loops closed.

The tree's partial derivatives come first: of its inverse dynamics, with all wrenches of the loops
on it, and of the velocities and accelerations of the closures' rows. The loops then say how the
rates of the tree follow the coordinates. docs/derivatives.md derives the equations.

Derivatives by q are taken along each rate of the tree, as Pinocchio's are.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import InputError
from ..loops.loops import Loops
from ..loops.row_derivatives import (
    ClosurePartials,
    FrameMotions,
    TreeMotion,
    brackets,
    partials,
)
from ..loops.rows import cross, skew
from ..model.mechanism import Friction
from .dynamics import Context, applied_forces, direct_dynamics

#: Loaded bodies, frames on them, the wrenches w at the world's origin, and w_q, derivatives by q.
_Load = tuple[list[int], FrameMotions, Array, Array]


class TorqueDerivatives(NamedTuple):
    """Derivatives of the generalised forces f, those of the torques where motor k is coordinate k.

    Attributes:
        dq: Along the motions L e_k of q, va and aa held, shape (..., n, n).
        dva: By va, shape (..., n, n).
        daa: By aa: the generalised inertia matrix, shape (..., n, n).
    """

    dq: Array
    dva: Array
    daa: Array


class AccelerationDerivatives(NamedTuple):
    """Derivatives of the accelerations aa of the coordinates.

    Attributes:
        dq: Along the motions L e_k of q, va and tau held, shape (..., n, n).
        dva: By va, shape (..., n, n).
        dtau: By the motor torques, shape (..., n, motors).
    """

    dq: Array
    dva: Array
    dtau: Array


class FrameVelocityDerivatives(NamedTuple):
    """Derivatives of a frame's [linear; angular] velocity, base axes, at its origin.

    Attributes:
        dq: Along the motions L e_k of q, va held, shape (..., 6, n).
        dva: By va: the Jacobian, shape (..., 6, n).
    """

    dq: Array
    dva: Array


def linear_system(d: AccelerationDerivatives, rates: Array | None) -> tuple[Array, Array]:
    """A, shape (..., 2 n, 2 n), and B, shape (..., 2 n, motors), of x' = A x + B u.

    `rates` are `Derivatives.displacement_rates`, shape (..., n, n), or None if no joint axes move.
    """
    rows = np.concatenate(d, axis=-1)
    n = rows.shape[-2]
    both = np.zeros((*rows.shape[:-2], 2 * n, rows.shape[-1]))
    both[..., :n, n : 2 * n] = np.eye(n)
    both[..., n:, :] = rows
    if rates is not None:
        both[..., :n, :n] = rates
    return both[..., : 2 * n], both[..., 2 * n :]


def discrete(A: Array, B: Array, dt: float) -> tuple[Array, Array]:
    """The exact step of x' = A x + B u over dt with u held: the exponential of [A B; 0 0] dt."""
    from scipy.linalg import expm

    states, inputs = B.shape[-2:]
    both = np.zeros((*A.shape[:-2], states + inputs, states + inputs))
    both[..., :states, :states], both[..., :states, states:] = A, B
    with np.errstate(over="ignore", invalid="ignore"):
        step = expm(both * dt)
    if (~np.isfinite(step).all(axis=(-2, -1)) & np.isfinite(both).all(axis=(-2, -1))).any():
        fastest = float(np.abs(np.linalg.eigvals(np.nan_to_num(A)).real).max())
        raise InputError(
            "dt",
            f"{dt:g} s is too long: the exponential overflows, A has poles of {fastest:.3g} /s",
        )
    return step[..., :states, :states], step[..., :states, states:]


class Derivatives:
    """Derivatives of the dynamics of one mechanism; one object per thread.

    Arguments are those of `dynamics.inverse_dynamics` and `dynamics.direct_dynamics`.
    """

    def __init__(self, context: Context) -> None:
        self._memory = context
        self._mechanism = context.mechanism
        #: The normal tree with its last body at the world's origin.
        self._near = pin.Model(context.tree.model)

    def torques(
        self, sign_width: float, q: Array, va: Array, aa: Array, wrenches: Array | None
    ) -> Array:
        """Derivatives of f by q, va and aa side by side, shape (n, 3 n)."""
        tau = np.zeros(self._mechanism.motor_count)
        by_q, by_va, inertia, _ = self._forces(self._friction(sign_width), q, va, aa, tau, wrenches)
        return np.concatenate((by_q, by_va, inertia), axis=1)

    def accelerations(
        self, sign_width: float, q: Array, va: Array, tau: Array, wrenches: Array | None
    ) -> Array:
        """Derivatives of aa by q, va and tau side by side, shape (n, 2 n + motors)."""
        friction = self._friction(sign_width)
        aa, _ = direct_dynamics(self._memory, friction, q, va, tau, wrenches)
        by_q, by_va, inertia, L = self._forces(friction, q, va, aa, tau, wrenches)
        motors = L.T.dot(self._memory.actuation(q))
        return np.linalg.solve(inertia, np.concatenate((-by_q, -by_va, motors), axis=1))

    @property
    def axes_move(self) -> bool:
        """Whether a coordinate belongs to a joint with several rates, whose axes can move."""
        tree = self._memory.tree
        several = [joint.nv > 1 for joint in list(tree.model.joints)[1:] for _ in range(joint.nv)]
        return bool(tree.S[several][:, self._mechanism.coordinates].any())

    def displacement_rates(self, q: Array, va: Array) -> Array:
        """-S [v, L e_k]: rates of a displacement due to joints' axes that move, shape (n, n)."""
        context = self._memory
        tree = self._memory.tree
        v, _ = context.complement.motion(q, va, context.steady)
        v = tree.S.dot(v)
        L = tree.S.dot(context.complement.L)
        rates = np.zeros_like(L)
        for joint, data in zip(tree.model.joints, context.data.joints, strict=True):
            if joint.nv > 1:
                k = slice(joint.idx_v, joint.idx_v + joint.nv)
                S = np.array(data.S)
                rates[k] = S.T.dot(brackets(S.dot(v[k])[:, None], S.dot(L[k])))
        return -tree.S.T.dot(rates)[self._mechanism.coordinates]

    def frame_velocity(self, q: Array, va: Array, frame: int) -> Array:
        """Derivatives of a frame's velocity by q and va side by side, shape (6, 2 n)."""
        loops = self._memory.loops
        complement = self._memory.complement
        v, v_dot = complement.motion(q, va, self._memory.steady)
        tree = TreeMotion(loops, v, v_dot)
        L = complement.L
        v_q = -complement.inverse.dot(partials(loops, q, tree).velocity_q.dot(L))
        motion = tree.frames_of([frame])
        J = np.concatenate((motion.M_q[:, 0, :3, 3].T, motion.J[0, 3:]))
        by_q = np.concatenate((motion.M_tq[:, 0, :3, 3].T, motion.twist_q[0, 3:]))
        return np.concatenate((by_q.dot(L) + J.dot(v_q), J.dot(L)), axis=1)

    def _forces(
        self, friction: Friction, q: Array, va: Array, aa: Array, tau: Array, wrenches: Array | None
    ) -> tuple[Array, Array, Array, Array]:
        """Derivatives of f - L^T B tau by q, va and aa, and L."""
        context = self._memory
        mechanism = self._mechanism
        v, v_dot = context.complement.motion(q, va, aa)
        L = context.complement.L
        G = context.complement.inverse
        tree = TreeMotion(context.loops, v, v_dot)
        rows = partials(context.loops, q, tree)
        force = context.tree_forces(v, v_dot)
        force -= applied_forces(context, friction, q, v, wrenches, tau)
        reactions = G.T.dot(force)
        lines = mechanism.lines
        loads = [_on_frames(closures, reactions) for closures in rows.closures]
        if not lines.none:
            lengths, J = context.lines.evaluate(q)
            along = partials(context.lines.loops, q, tree)
            pulls = lines.tensions(lengths, J.dot(v), tau)
            pulls = pulls + context.lines.inertial_tensions(q, v, v_dot)
            loads += [_on_frames(line, -pulls) for line in along.closures]
        if wrenches is not None and wrenches.any():
            loads.append(_on_mass_centres(tree, context.loops, wrenches.reshape(-1, 6)))
        force_q, force_v, M = self._tree_forces(v, v_dot, loads)
        for row, k, second in rows.coupled:
            force_q[k, k] -= reactions[row] * second
        if not lines.none:
            stiffness, _, damping, _ = lines.numbers * lines.taut(lengths, J.dot(v))
            force_q += (J.T * stiffness).dot(J) + (J.T * damping).dot(along.velocity_q)
            force_v += (J.T * damping).dot(J)
            force_q += (J.T * lines.masses).dot(along.acceleration_q)
            force_v += (J.T * lines.masses).dot(along.acceleration_v)
            M = M + (J.T * lines.masses).dot(J)
        force_v += np.diag(-friction.slopes(v))
        if not mechanism.springs.none:
            force_q -= mechanism.springs.slopes(mechanism.model, q)
        v_q = -G.dot(rows.velocity_q.dot(L))
        v_dot_q = -G.dot(rows.acceleration_q.dot(L) + rows.acceleration_v.dot(v_q))
        v_dot_va = -G.dot(rows.acceleration_v.dot(L))
        by_q = L.T.dot(force_q.dot(L) + force_v.dot(v_q) + M.dot(v_dot_q))
        by_va = L.T.dot(force_v.dot(L) + M.dot(v_dot_va))
        inertia = L.T.dot(M).dot(L)
        return by_q, by_va, (inertia + inertia.T) / 2, L

    def _tree_forces(
        self, v: Array, v_dot: Array, loads: list[_Load]
    ) -> tuple[Array, Array, Array]:
        """Derivatives of RNEA minus the forces of the loads, by q, v and v_dot.

        For Pinocchio, external wrenches turn with their bodies; the difference of w_q from the
        derivative of such a wrench is taken into account here. Pinocchio takes inertias about the
        world's origin, which loses digits with the square of the distance: the tree is moved there.
        """
        context = self._memory
        model = self._memory.tree.model
        S = self._memory.tree.S
        total = np.zeros((model.njoints, 6))
        for joints, _, w, _ in loads:
            np.add.at(total, joints, w)
        in_bodies = pin.StdVec_Force()
        for placement, of_body in zip(context.data.oMi, total, strict=True):
            in_bodies.append(placement.actInv(pin.Force(of_body)))
        there = context.data.oMi[model.njoints - 1].translation.copy()
        for root in model.children[0]:
            placement = model.jointPlacements[root]
            self._near.jointPlacements[root] = pin.SE3(
                placement.rotation, placement.translation - there
            )
        arguments = (context.loops.q, S.dot(v), S.dot(v_dot), in_bodies)
        by = pin.computeRNEADerivatives(self._near, context.data, *arguments)
        force_q, force_v, M = (S.T.dot(x).dot(S) for x in by)
        for _, frames, w, w_q in loads:
            turning = w_q - _turning_along(frames.J, w)
            force_q -= np.tensordot(frames.J, turning, axes=((0, 1), (0, 1)))
        return force_q, force_v, M

    def _friction(self, sign_width: float) -> Friction:
        return replace(self._mechanism.friction, sign_width=sign_width)


def _on_frames(closures: ClosurePartials, reactions: Array) -> _Load:
    """Forces along the rows of closures or lines, as wrenches on the frames that they connect."""
    forces = reactions[closures.rows.at]
    w = np.einsum("kr,kri->ki", forces, closures.rows.W).reshape(-1, 6)
    w_q = np.einsum("kr,kriq->kiq", forces, closures.W_q)
    return closures.rows.bodies.ravel(), closures.frames, w, w_q.reshape(len(w), 6, -1)


def _on_mass_centres(tree: TreeMotion, loops: Loops, wrenches: Array) -> _Load:
    """Constant wrenches at the mass centres: the bodies, the wrenches at the origin, their w_q."""
    loaded = np.asarray(wrenches.any(axis=1))
    joints = [j for j, load in zip(loops.tree.bodies[1:], loaded, strict=True) if load]
    levers = [pin.SE3(np.eye(3), loops.tree.model.inertias[joint].lever) for joint in joints]
    places = [loops.data.oMi[j] * lever for j, lever in zip(joints, levers, strict=True)]
    frames = tree.frames(joints, [place.homogeneous for place in places])
    forces, moments = wrenches[loaded].reshape(-1, 2, 3).swapaxes(0, 1)
    w = np.hstack((forces, moments + cross(frames.M[:, :3, 3], forces)))
    w_q = np.zeros_like(frames.J)
    w_q[:, 3:] = -skew(forces) @ frames.M_q[..., :3, 3].transpose(1, 2, 0)
    return joints, frames, w, w_q


def _turning_along(twists: Array, w: Array) -> Array:
    """Derivatives of wrenches, shape (k, 6), that move with the twists, shape (k, 6, nv)."""
    force = -skew(w[:, :3])
    moment = -skew(w[:, 3:])
    linear, omega = twists[:, :3], twists[:, 3:]
    return np.concatenate((force @ omega, moment @ omega + force @ linear), axis=1)

# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives of inverse and direct dynamics along the motions that keep the loops closed.

The tree's partial derivatives come first: of its inverse dynamics, with all wrenches of the loops
on it, and of the velocities and accelerations of the closures' rows. The loops then say how the
rates of the tree follow the coordinates. docs/derivatives.md derives the equations.

Derivatives by q are taken along each rate of the tree, as Pinocchio's are.
"""

from collections.abc import Sequence
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
    Partials,
    TreeMotion,
    partials,
)
from ..loops.vectors import brackets, cross, skew
from ..model.dry_friction import sign_slope
from ..model.mechanism import Friction
from ..model.weight_shares import WeightShares
from .dynamics import Context, applied_forces, direct_dynamics


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
    both[..., :states, :states] = A
    both[..., :states, states:] = B
    with np.errstate(over="ignore", invalid="ignore"):
        step = expm(both * dt)
    if (~np.isfinite(step).all(axis=(-2, -1)) & np.isfinite(both).all(axis=(-2, -1))).any():
        fastest = float(np.abs(np.linalg.eigvals(np.nan_to_num(A)).real).max())
        raise InputError(
            "dt",
            f"{dt:g} s is too long: the exponential overflows, A has poles of {fastest:.3g} /s",
        )
    return step[..., :states, :states], step[..., :states, states:]


class _ForceDerivatives(NamedTuple):
    """Derivatives of the forces along the coordinates, shapes (n, n), and L, shape (nv, n)."""

    by_q: Array
    by_va: Array
    inertia: Array
    L: Array


class _Load(NamedTuple):
    """Wrenches on k frames of the normal tree.

    Attributes:
        joints: The bodies of the frames.
        frames: The frames.
        w: [force; moment] at the world's origin, shape (k, 6).
        w_q: Derivatives of w by q, shape (k, 6, nv).
    """

    joints: Sequence[int]
    frames: FrameMotions
    w: Array
    w_q: Array


def _on_frames(closure: ClosurePartials, reactions: Array) -> _Load:
    """Forces along the rows of a closure or line, as wrenches on the frames that it connects."""
    forces = reactions[closure.rows.at]
    w = forces.dot(closure.W).reshape(2, 6)
    w_q = np.tensordot(forces, closure.W_q, axes=1).reshape(2, 6, -1)
    return _Load(closure.rows.bodies, closure.frames, w, w_q)


def _on_mass_centres(tree: TreeMotion, loops: Loops, wrenches: Array) -> _Load:
    """Constant wrenches [force; moment] at the mass centres, shape (r, 6), as a load."""
    loaded = np.flatnonzero(wrenches.any(axis=1))
    joints = [loops.tree.bodies[1 + body] for body in loaded]
    levers = [pin.SE3(np.eye(3), loops.tree.model.inertias[joint].lever) for joint in joints]
    places = [loops.data.oMi[j] * lever for j, lever in zip(joints, levers, strict=True)]
    frames = tree.frames(joints, [place.homogeneous for place in places])
    forces, moments = wrenches[loaded].reshape(-1, 2, 3).swapaxes(0, 1)
    w = np.hstack((forces, moments + cross(frames.M[:, :3, 3], forces)))
    w_q = np.zeros_like(frames.J)
    w_q[:, 3:] = -skew(forces) @ frames.M_q[..., :3, 3].transpose(1, 2, 0)
    return _Load(joints, frames, w, w_q)


def _lifts(tree: TreeMotion, loops: Loops, weight_shares: WeightShares) -> _Load:
    """Forces that carry what bodies do not have of their weight, as a load."""
    lifted = weight_shares.lifted(loops.model)
    joints = [loops.tree.bodies[1 + body] for body in lifted]
    frames = tree.frames(joints, [loops.data.oMi[joint].homogeneous for joint in joints])
    # A placement M takes the first moment m c and the mass m to those about the world's origin:
    # M [m c; m] = [m (R c + p); m].
    masses, *moments = np.transpose(list(lifted.values()))
    moments_and_masses = np.transpose([*moments, masses])
    at_origin = np.einsum("kij,kj->ki", frames.M[:, :3], moments_and_masses)
    at_origin_q = np.einsum("qkij,kj->kiq", frames.M_q[..., :3, :], moments_and_masses)
    g = loops.model.gravity.linear
    w = np.hstack((-np.outer(masses, g), cross(g, at_origin)))
    w_q = np.zeros_like(frames.J)
    w_q[:, 3:] = skew(g) @ at_origin_q
    return _Load(joints, frames, w, w_q)


def _turning_along(twists: Array, w: Array) -> Array:
    """Derivatives of wrenches w, shape (k, 6), that are fixed to bodies, shape (k, 6, nv).

    A body with the twist [v; omega] takes [force; moment] along, which changes by
    [omega x force; omega x moment + v x force].
    """
    force = -skew(w[:, :3])
    moment = -skew(w[:, 3:])
    linear = twists[:, :3]
    omega = twists[:, 3:]
    return np.concatenate((force @ omega, moment @ omega + force @ linear), axis=1)


class _TreePartials(NamedTuple):
    """Derivatives of the forces on the tree, where q, v and v_dot are independent, (nv, nv).

    Attributes:
        by_q: Along each rate of the tree.
        by_v: By v.
        M: By v_dot: the mass matrix.
    """

    by_q: Array
    by_v: Array
    M: Array


class _LinePartials(NamedTuple):
    """The tensions of lines and their derivatives, where q, v and v_dot are independent.

    Attributes:
        rows: Derivatives of the lengths' rates and second derivatives.
        J: The rates of the lengths are J v, shape (lines, nv).
        tensions: Shape (lines,).
        stiffness: Derivatives of the tensions by the lengths, shape (lines,).
        damping: By the rates of the lengths, shape (lines,).
        masses: By their second derivatives, shape (lines,).
    """

    rows: Partials
    J: Array
    tensions: Array
    stiffness: Array
    damping: Array
    masses: Array


def _line_partials(
    context: Context, friction: Friction, q: Array, tau: Array, tree: TreeMotion
) -> _LinePartials:
    """The lines' tensions and their derivatives at q, with motor torques tau."""
    lines = context.mechanism.lines
    v = tree.v
    lengths, J = context.lines.evaluate(q)
    rates = J.dot(v)
    tensions = lines.tensions(lengths, rates, friction.sign_width, tau)
    tensions = tensions + context.lines.inertial_tensions(q, v, tree.v_dot)
    taut = lines.taut(lengths, rates)  # 0 for slack cables, else 1
    damping = lines.damping * taut
    if lines.coulomb.any():
        damping = damping + lines.coulomb * sign_slope(rates, friction.sign_width)
    return _LinePartials(
        rows=partials(context.lines.loops, q, tree),
        J=J,
        tensions=tensions,
        stiffness=lines.stiffness * taut,
        damping=damping,
        masses=lines.masses,
    )


def _with_lines(of_tree: _TreePartials, lines: _LinePartials) -> _TreePartials:
    """The derivatives with those of the tensions; the lines keep their directions here."""
    by_q, by_v, M = of_tree
    per_length = lines.J.T * lines.stiffness
    per_rate = lines.J.T * lines.damping
    per_acceleration = lines.J.T * lines.masses
    by_q = by_q + per_length.dot(lines.J)
    by_q += per_rate.dot(lines.rows.velocity_q)
    by_q += per_acceleration.dot(lines.rows.acceleration_q)
    by_v = by_v + per_rate.dot(lines.J)
    by_v += per_acceleration.dot(lines.rows.acceleration_v)
    return _TreePartials(by_q, by_v, M + per_acceleration.dot(lines.J))


def _along_coordinates(
    of_tree: _TreePartials, rows: Partials, L: Array, G: Array
) -> _ForceDerivatives:
    """The chain rule: derivatives of L^T (forces on the tree), with constant L.

    G is the inverse of Phi: Phi G x = x, with coordinates at rest.
    """
    # How v and v_dot follow the coordinates: Phi v = 0 and Phi v_dot + Phi_dot v = 0.
    v_q = -G.dot(rows.velocity_q.dot(L))
    v_dot_q = -G.dot(rows.acceleration_q.dot(L) + rows.acceleration_v.dot(v_q))
    v_dot_va = -G.dot(rows.acceleration_v.dot(L))

    force_q, force_v, M = of_tree
    inertia = L.T.dot(M).dot(L)
    return _ForceDerivatives(
        by_q=L.T.dot(force_q.dot(L) + force_v.dot(v_q) + M.dot(v_dot_q)),
        by_va=L.T.dot(force_v.dot(L) + M.dot(v_dot_va)),
        inertia=(inertia + inertia.T) / 2,
        L=L,
    )


class Derivatives:
    """Derivatives of the dynamics of one mechanism; one object per thread.

    Arguments are those of `dynamics.inverse_dynamics` and `dynamics.direct_dynamics`.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._mechanism = context.mechanism
        #: The normal tree, moved so that its last body is at the world's origin (`_tree_forces`).
        self._at_origin = pin.Model(context.tree.model)

    def torques(
        self, sign_width: float, q: Array, va: Array, aa: Array, wrenches: Array | None
    ) -> Array:
        """Derivatives of f by q, va and aa side by side, shape (n, 3 n)."""
        tau = np.zeros(self._mechanism.motor_count)
        of_f = self._forces(self._friction(sign_width), q, va, aa, tau, wrenches)
        return np.concatenate((of_f.by_q, of_f.by_va, of_f.inertia), axis=1)

    def accelerations(
        self, sign_width: float, q: Array, va: Array, tau: Array, wrenches: Array | None
    ) -> Array:
        """Derivatives of aa by q, va and tau side by side, shape (n, 2 n + motors)."""
        friction = self._friction(sign_width)
        aa, _ = direct_dynamics(self._context, friction, q, va, tau, wrenches)
        of_f = self._forces(friction, q, va, aa, tau, wrenches)
        of_tau = of_f.L.T.dot(self._context.actuation(q))
        # f(q, va, aa) - L^T B tau = 0 at all q, va and tau.
        right = np.concatenate((-of_f.by_q, -of_f.by_va, of_tau), axis=1)
        return np.linalg.solve(of_f.inertia, right)

    @property
    def axes_move(self) -> bool:
        """Whether a coordinate belongs to a joint with several rates, whose axes can move."""
        tree = self._context.tree
        several = [joint.nv > 1 for joint in list(tree.model.joints)[1:] for _ in range(joint.nv)]
        return bool(tree.S[several][:, self._mechanism.coordinates].any())

    def displacement_rates(self, q: Array, va: Array) -> Array:
        """-S [v, L e_k]: rates of a displacement due to joints' axes that move, shape (n, n)."""
        context = self._context
        tree = self._context.tree
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
        loops = self._context.loops
        complement = self._context.complement
        v, v_dot = complement.motion(q, va, self._context.steady)
        tree = TreeMotion(loops, v, v_dot)
        L = complement.L
        v_q = -complement.inverse.dot(partials(loops, q, tree).velocity_q.dot(L))
        motion = tree.frames_of([frame])
        # The origin of the frame is the last column of its placement M. So the linear velocity, and
        # its derivatives, are in that of M_dot; the angular velocity is in the twist.
        J_linear = motion.M_q[:, 0, :3, 3].T
        linear_q = motion.M_dot_q[:, 0, :3, 3].T
        J = np.concatenate((J_linear, motion.J[0, 3:]))
        velocity_q = np.concatenate((linear_q, motion.twist_q[0, 3:]))
        return np.concatenate((velocity_q.dot(L) + J.dot(v_q), J.dot(L)), axis=1)

    def _forces(
        self, friction: Friction, q: Array, va: Array, aa: Array, tau: Array, wrenches: Array | None
    ) -> _ForceDerivatives:
        """Derivatives of f - L^T B tau by q, va and aa.

        With the forces F(q, v, v_dot) that the tree needs, f = L^T F. No derivative of L is needed:
        let lambda be the forces of the closures at q, so that F - Phi^T lambda = 0 along the
        dependent rates. As L^T Phi^T = 0 at all q, also f = L^T (F - Phi^T lambda), with constant
        lambda. A change of L has rows for the dependent rates only, where the bracket is zero. So
        df = L^T d(F - Phi^T lambda): closures act on the tree as loads on their frames.
        """
        context = self._context
        mechanism = self._mechanism
        v, v_dot = context.complement.motion(q, va, aa)  # evaluates L, G and the loops at q
        L = context.complement.L
        G = context.complement.inverse
        tree = TreeMotion(context.loops, v, v_dot)
        rows = partials(context.loops, q, tree)
        force = context.tree_forces(v, v_dot)
        force -= applied_forces(context, friction, q, v, wrenches, tau)
        reactions = G.T.dot(force)  # lambda

        # Loads on the bodies: of closures, of lines, external wrenches, and lifted weights.
        loads = [_on_frames(closure, reactions) for closure in rows.closures]
        of_lines: _LinePartials | None = None
        if not mechanism.lines.none:
            of_lines = _line_partials(context, friction, q, tau, tree)
            loads += [_on_frames(line, -of_lines.tensions) for line in of_lines.rows.closures]
        if wrenches is not None and wrenches.any():
            loads.append(_on_mass_centres(tree, context.loops, wrenches.reshape(-1, 6)))
        if mechanism.weight_shares is not None:
            loads.append(_lifts(tree, context.loops, mechanism.weight_shares))

        # Partial derivatives of F - Phi^T lambda.
        of_tree = self._tree_forces(v, v_dot, loads)
        for joint in rows.couplings:  # they act on no frame
            of_tree.by_q[joint.rate, joint.rate] -= reactions[joint.row] * joint.second
        if of_lines is not None:
            of_tree = _with_lines(of_tree, of_lines)
        of_tree.by_v[...] -= np.diag(friction.slopes(v))
        if not mechanism.springs.none:
            of_tree.by_q[...] -= mechanism.springs.slopes(mechanism.model, q)
        return _along_coordinates(of_tree, rows, L, G)

    def _tree_forces(self, v: Array, v_dot: Array, loads: list[_Load]) -> _TreePartials:
        """Derivatives of RNEA minus the forces of the loads.

        For Pinocchio, external wrenches turn with their bodies; the difference of w_q from the
        derivative of such a wrench is taken into account here. Pinocchio takes inertias about the
        world's origin, which loses digits with the square of the distance: the tree is moved there.
        """
        context = self._context
        model = self._context.tree.model
        S = self._context.tree.S
        on_bodies = np.zeros((model.njoints, 6))
        for load in loads:
            np.add.at(on_bodies, load.joints, load.w)
        in_body_axes = pin.StdVec_Force()
        for placement, of_body in zip(context.data.oMi, on_bodies, strict=True):
            in_body_axes.append(placement.actInv(pin.Force(of_body)))
        there = context.data.oMi[model.njoints - 1].translation.copy()
        for root in model.children[0]:
            placement = model.jointPlacements[root]
            self._at_origin.jointPlacements[root] = pin.SE3(
                placement.rotation, placement.translation - there
            )
        rnea_q, rnea_v, mass_matrix = pin.computeRNEADerivatives(
            self._at_origin, context.data, context.loops.q, S.dot(v), S.dot(v_dot), in_body_axes
        )
        by_q = S.T.dot(rnea_q).dot(S)
        for load in loads:
            not_turning = load.w_q - _turning_along(load.frames.J, load.w)
            by_q -= np.tensordot(load.frames.J, not_turning, axes=((0, 1), (0, 1)))
        return _TreePartials(by_q, by_v=S.T.dot(rnea_v).dot(S), M=S.T.dot(mass_matrix).dot(S))

    def _friction(self, sign_width: float) -> Friction:
        return replace(self._mechanism.friction, sign_width=sign_width)

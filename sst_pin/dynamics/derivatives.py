# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives of inverse and direct dynamics along the motions that keep the loops closed.

docs/derivatives.md derives the equations. `Derivatives` computes them in three steps:

1. On the tree, where q, v and v_dot are independent: derivatives of its inverse dynamics. Closures,
   lines and external wrenches are loads on its bodies (`_Load`): wrenches that change with q.
2. On the tree too: derivatives of the velocities and accelerations of the closures' rows
   (`row_derivatives`). These say how v and v_dot must change so that the loops stay closed.
3. The chain rule joins both (`_along_coordinates`).

The functions of steps 1 and 3 come after the class. Then come functions for linear models.

On the tree, a derivative by q has a column for each rate: the derivative along this rate, as
Pinocchio's. Along the loops, it has a column for each coordinate k: the derivative along L e_k, the
motion of all joints at the rate 1 of coordinate k. A subscript q or v names such derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from .dynamics import Context, applied_forces, direct_dynamics, tensions_in_motion


class TorqueDerivatives(NamedTuple):
    """Derivatives of the generalised forces f.

    If motor k drives coordinate k, f are the motor torques. L e_k is the motion of all joints at
    the rate 1 of coordinate k.

    Attributes:
        dq: By q along L e_k in column k, with constant va and aa, shape (..., n, n).
        dva: By va, shape (..., n, n).
        daa: By aa: the mass matrix in the coordinates, shape (..., n, n).
    """

    dq: Array
    dva: Array
    daa: Array


class AccelerationDerivatives(NamedTuple):
    """Derivatives of the accelerations aa of the coordinates.

    Attributes:
        dq: By q along L e_k in column k, with constant va and tau, shape (..., n, n).
        dva: By va, shape (..., n, n).
        dtau: By the motor torques, shape (..., n, motors).
    """

    dq: Array
    dva: Array
    dtau: Array


class FrameVelocityDerivatives(NamedTuple):
    """Derivatives of a frame's [linear; angular] velocity, base axes, at its origin.

    Attributes:
        dq: By q along L e_k in column k, with constant va, shape (..., 6, n).
        dva: By va: the Jacobian, shape (..., 6, n).
    """

    dq: Array
    dva: Array


class Derivatives:
    """Derivatives of the dynamics of one mechanism; one object per thread.

    Arguments are those of `dynamics.inverse_dynamics` and `dynamics.direct_dynamics`.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._mechanism = context.mechanism
        #: The normal tree, moved so that its last body is at the world's origin (`_tree_partials`).
        self._at_origin = pin.Model(context.tree.model)

    def torques(
        self, sign_width: float, q: Array, va: Array, aa: Array, wrenches: Array | None
    ) -> Array:
        """Derivatives of f by q, va and aa side by side, shape (n, 3 n)."""
        tau = np.zeros(self._mechanism.motor_count)
        f = self._force_derivatives(self._friction(sign_width), q, va, aa, tau, wrenches)
        return np.concatenate((f.by_q, f.by_va, f.by_aa), axis=1)

    def accelerations(
        self, sign_width: float, q: Array, va: Array, tau: Array, wrenches: Array | None
    ) -> Array:
        """Derivatives of aa by q, va and tau side by side, shape (n, 2 n + motors)."""
        friction = self._friction(sign_width)
        aa, _ = direct_dynamics(self._context, friction, q, va, tau, wrenches)
        f = self._force_derivatives(friction, q, va, aa, tau, wrenches)
        by_tau = f.L.T.dot(self._context.actuation(q))
        # f(q, va, aa) - L^T B tau = 0 at all q, va and tau, also after a change of one of them. Let
        # f_q, f_va and f_aa be the derivatives of the left side, `f.by_q` and so on. Then
        # f_aa aa_q = -f_q, f_aa aa_va = -f_va and f_aa aa_tau = L^T B.
        right = np.concatenate((-f.by_q, -f.by_va, by_tau), axis=1)
        return np.linalg.solve(f.by_aa, right)

    @property
    def axes_move(self) -> bool:
        """Whether a coordinate belongs to a joint with several rates, whose axes can move."""
        tree = self._context.tree
        # For each rate of the normal tree, whether its joint has several rates.
        has_several = list[bool]()
        for joint in list(tree.model.joints)[1:]:
            has_several += [joint.nv > 1] * joint.nv
        # These rates are S v: the entries of S show whether a coordinate changes one of them.
        return bool(tree.S[has_several][:, self._mechanism.coordinates].any())

    def displacement_rates(self, q: Array, va: Array) -> Array:
        """Rates of displacements that are due to moving joint axes, shape (n, n).

        Column k has the rates of the coordinates' displacements for a displacement of coordinate k.
        A joint with several rates, such as a ball, has axes that move with it. Along the motion v,
        its displacement L e_k has the rate -[v, L e_k], the bracket of the joint's twists.
        """
        context = self._context
        tree = self._context.tree
        v, _ = context.complement.motion(q, va, context.zero_aa)
        # The rates of the normal tree are S v.
        v = tree.S.dot(v)
        L = tree.S.dot(context.complement.L)
        bracket_rates = np.zeros_like(L)
        for joint, data in zip(tree.model.joints, context.data.joints, strict=True):
            if joint.nv > 1:
                k = slice(joint.idx_v, joint.idx_v + joint.nv)
                axes = np.array(data.S)  # the twists of the joint's rates, in columns
                twist = axes.dot(v[k])
                # The columns of `axes` are orthonormal: axes^T takes a twist to rates.
                bracket_rates[k] = axes.T.dot(brackets(twist[:, None], axes.dot(L[k])))
        return -tree.S.T.dot(bracket_rates)[self._mechanism.coordinates]

    def frame_velocity(self, q: Array, va: Array, frame: int) -> Array:
        """Derivatives of a frame's velocity by q and va side by side, shape (6, 2 n)."""
        loops = self._context.loops
        complement = self._context.complement
        v, v_dot = complement.motion(q, va, self._context.zero_aa)
        motion = TreeMotion(loops, v, v_dot)
        L = complement.L
        v_q = -complement.inverse.dot(partials(loops, q, motion).velocity_q.dot(L))
        of_frame = motion.frames_of([frame])
        # The origin of the frame is the last column of its placement M. Its derivative by q is the
        # linear Jacobian. The linear velocity is the last column of M_dot, and the angular velocity
        # is the last part of the twist.
        J_linear = of_frame.M_q[:, 0, :3, 3].T
        linear_q = of_frame.M_dot_q[:, 0, :3, 3].T
        J = np.concatenate((J_linear, of_frame.J[0, 3:]))
        velocity_q = np.concatenate((linear_q, of_frame.twist_q[0, 3:]))
        return np.concatenate((velocity_q.dot(L) + J.dot(v_q), J.dot(L)), axis=1)

    def _force_derivatives(
        self, friction: Friction, q: Array, va: Array, aa: Array, tau: Array, wrenches: Array | None
    ) -> _ForceDerivatives:
        """Derivatives of f - L^T B tau by q, va and aa; B is `Context.actuation`.

        Let F(q, v, v_dot) be the forces that the motion of the tree needs, less those of motors,
        friction, springs, lines and external wrenches: f - L^T B tau = L^T F.

        No derivative of L is needed, for this reason:

        1. Let lambda be the forces of the closures at q: the entries of F - Phi^T lambda for the
           dependent rates are zero. Keep this lambda constant.
        2. As Phi L = 0 at all q, also L^T F = L^T (F - Phi^T lambda), and the product rule gives
           d(L^T F) = dL^T (F - Phi^T lambda) + L^T d(F - Phi^T lambda).
        3. The first term is zero: the rows of L for the coordinates are constant, so that dL has
           only rows of dependent rates, and these meet the zero entries of step 1.

        So d(L^T F) = L^T d(F - Phi^T lambda): closures act on the tree as loads on their frames.
        """
        context = self._context
        mechanism = self._mechanism
        v, v_dot = context.complement.motion(q, va, aa)  # evaluates L, G and the loops at q
        L = context.complement.L
        G = context.complement.inverse  # Phi G b = b, and G b moves the dependent joints only
        motion = TreeMotion(context.loops, v, v_dot)
        rows = partials(context.loops, q, motion)  # step 2
        F = context.tree_forces(v, v_dot)
        F -= applied_forces(context, friction, q, v, wrenches, tau)
        # lambda solves Phi_u^T lambda = F_u, where u are the dependent rates. The rows of G for
        # these rates are the inverse of Phi_u, the others are zero: lambda = G^T F.
        multipliers = G.T.dot(F)

        # Step 1. The loads on bodies: closures, lines, external wrenches, and forces that cancel
        # a part of the weights.
        loads = [_on_frames(closure, multipliers) for closure in rows.closures]
        of_lines: _LinePartials | None = None
        if not mechanism.lines.none:
            of_lines = _line_partials(context, friction, q, tau, motion)
            loads += [_on_frames(line, -of_lines.tensions) for line in of_lines.rows.closures]
        if wrenches is not None and wrenches.any():
            loads.append(_on_mass_centres(motion, context.loops, wrenches.reshape(-1, 6)))
        if mechanism.weight_shares is not None:
            loads.append(_on_weightless_parts(motion, context.loops, mechanism.weightless_parts))

        # Partial derivatives of F - Phi^T lambda.
        of_tree = self._tree_partials(v, v_dot, loads)
        # A coupling P(q_k) + ... = 0 acts on no frame. Its force on rate k is P' lambda, with the
        # derivative P'' lambda by q_k.
        for joint in rows.couplings:
            of_tree.by_q[joint.rate, joint.rate] -= multipliers[joint.row] * joint.second
        if of_lines is not None:
            of_tree = _with_lines(of_tree, of_lines)
        of_tree.by_v[...] -= np.diag(friction.slopes(v))
        if not mechanism.springs.none:
            of_tree.by_q[...] -= mechanism.springs.slopes(mechanism.model, q)
        return _along_coordinates(of_tree, rows, L, G)  # step 3

    def _tree_partials(self, v: Array, v_dot: Array, loads: list[_Load]) -> _TreePartials:
        """Derivatives of RNEA minus the forces J^T w of the loads.

        Pinocchio differentiates RNEA for external wrenches that are fixed to their bodies, and turn
        with them. The loads change by w_q instead. So J^T times the difference, w_q minus the
        change of a wrench fixed to the body, is subtracted.

        Pinocchio takes inertias about the world's origin, which loses digits with the square of the
        distance. So the tree is moved: its last body comes to the origin.
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
        last_body = context.data.oMi[model.njoints - 1].translation.copy()
        for root in model.children[0]:
            placement = model.jointPlacements[root]
            self._at_origin.jointPlacements[root] = pin.SE3(
                placement.rotation, placement.translation - last_body
            )
        rnea_q, rnea_v, mass_matrix = pin.computeRNEADerivatives(
            self._at_origin, context.data, context.loops.q, S.dot(v), S.dot(v_dot), in_body_axes
        )
        by_q = S.T.dot(rnea_q).dot(S)
        for load in loads:
            J = load.frames.J
            difference = load.w_q - _derivatives_fixed_to_bodies(load.w, J)
            # The sum of J^T difference over all frames, which are the first axis.
            by_q -= np.tensordot(J, difference, axes=((0, 1), (0, 1)))
        return _TreePartials(by_q, by_v=S.T.dot(rnea_v).dot(S), M=S.T.dot(mass_matrix).dot(S))

    def _friction(self, sign_width: float) -> Friction:
        return replace(self._mechanism.friction, sign_width=sign_width)


# --- step 1: the tree and its loads -----------------------------------------------------------


class _TreePartials(NamedTuple):
    """Derivatives of the forces on the tree, where q, v and v_dot are independent.

    Attributes:
        by_q: By q, shape (nv, nv).
        by_v: By v, shape (nv, nv).
        M: By v_dot: the mass matrix of the tree, shape (nv, nv).
    """

    by_q: Array
    by_v: Array
    M: Array


class _Load(NamedTuple):
    """Wrenches on k frames of the normal tree.

    Attributes:
        joints: Numbers of the joints whose bodies carry the frames, k of them.
        frames: Motions of the frames.
        w: [force; moment] at the world's origin, base axes, shape (k, 6).
        w_q: Derivatives of w by q, shape (k, 6, nv).
    """

    joints: Sequence[int]
    frames: FrameMotions
    w: Array
    w_q: Array


def _on_frames(closure: ClosurePartials, forces: Array) -> _Load:
    """Forces along the rows of a closure or line, as wrenches on its frames B and A.

    `forces` are those of all rows of Phi; the rows of this closure are used.
    """
    of_rows = forces[closure.rows.at]
    # A row of W, shape (rows, 12), has the wrenches on B and on A for the force 1 along this row.
    w = of_rows.dot(closure.W).reshape(2, 6)
    w_q = np.tensordot(of_rows, closure.W_q, axes=1).reshape(2, 6, -1)
    return _Load(closure.rows.bodies, closure.frames, w, w_q)


def _on_mass_centres(motion: TreeMotion, loops: Loops, wrenches: Array) -> _Load:
    """Constant wrenches [force; moment] at the mass centres, shape (r, 6), as a load."""
    loaded = np.flatnonzero(wrenches.any(axis=1))
    joints = [loops.tree.bodies[1 + body] for body in loaded]
    levers = [pin.SE3(np.eye(3), loops.tree.model.inertias[joint].lever) for joint in joints]
    places = [loops.data.oMi[j] * lever for j, lever in zip(joints, levers, strict=True)]
    frames = motion.frames(joints, [place.homogeneous for place in places])
    forces = wrenches[loaded, :3]
    moments = wrenches[loaded, 3:]
    # At the origin the moment is moment + c x force with the mass centre c, the last column of M.
    # Its derivative is c_q x force = -force x c_q.
    c = frames.M[:, :3, 3]  # shape (k, 3)
    c_q = np.moveaxis(frames.M_q[..., :3, 3], 0, -1)  # shapes (nv, k, 3) to (k, 3, nv)
    w = np.hstack((forces, moments + cross(c, forces)))
    w_q = np.zeros_like(frames.J)
    w_q[:, 3:] = -skew(forces) @ c_q
    return _Load(joints, frames, w, w_q)


def _on_weightless_parts(motion: TreeMotion, loops: Loops, parts: Mapping[int, Array]) -> _Load:
    """Forces that cancel the part of the weights that does not act, as a load on their bodies.

    `parts` is `Mechanism.weightless_parts`: [mass; first moment] of this part, by the indices of
    the bodies.
    """
    joints = [loops.tree.bodies[1 + body] for body in parts]
    frames = motion.frames(joints, [loops.data.oMi[joint].homogeneous for joint in joints])
    # A placement M takes the first moment m c and the mass m to those about the world's origin:
    # M [m c; m] = [m (R c + p); m], without the last row. Axes: k bodies, i and j of M, q rates.
    masses, *moments = np.transpose(list(parts.values()))
    moments_and_masses = np.transpose([*moments, masses])
    at_origin = np.einsum("kij,kj->ki", frames.M[:, :3], moments_and_masses)
    at_origin_q = np.einsum("qkij,kj->kiq", frames.M_q[..., :3, :], moments_and_masses)
    # The force is -m g, and its moment about the origin m (R c + p) x (-g) = g x m (R c + p).
    g = loops.model.gravity.linear
    w = np.hstack((-np.outer(masses, g), cross(g, at_origin)))
    w_q = np.zeros_like(frames.J)
    w_q[:, 3:] = skew(g) @ at_origin_q
    return _Load(joints, frames, w, w_q)


def _derivatives_fixed_to_bodies(w: Array, twists: Array) -> Array:
    """Derivatives by q of wrenches w that are fixed to moving bodies, shape (k, 6, nv).

    `w` has the shape (k, 6). `twists` are the twists [v; omega] of the bodies per rate of the tree,
    shape (k, 6, nv). Such a wrench changes by [omega x force; omega x moment + v x force].
    """
    force_x = skew(w[:, :3])  # omega x force = -force x omega
    moment_x = skew(w[:, 3:])
    v = twists[:, :3]
    omega = twists[:, 3:]
    return np.concatenate((-force_x @ omega, -moment_x @ omega - force_x @ v), axis=1)


class _LinePartials(NamedTuple):
    """The tensions of lines and their derivatives, where q, v and v_dot are independent.

    The tension of a line depends on its length l, and on l_dot and l_ddot.

    Attributes:
        rows: Derivatives of l_dot and l_ddot by q and v, and the lines as closures of one row.
        J: l_dot = J v, shape (lines, nv).
        tensions: Tensions, those of moving masses included, shape (lines,), [N].
        stiffness: Derivatives of the tensions by l, shape (lines,).
        damping: Derivatives of the tensions by l_dot, shape (lines,).
        masses: Derivatives of the tensions by l_ddot, shape (lines,).
    """

    rows: Partials
    J: Array
    tensions: Array
    stiffness: Array
    damping: Array
    masses: Array


def _line_partials(
    context: Context, friction: Friction, q: Array, tau: Array, motion: TreeMotion
) -> _LinePartials:
    """The lines' tensions and their derivatives at q, with motor torques tau."""
    lines = context.mechanism.lines
    v = motion.v
    tensions = tensions_in_motion(context, friction, q, v, motion.v_dot, tau)
    lengths = context.lines.loops.f  # at q, as J: the line above has evaluated the lines
    J = context.lines.loops.Phi
    rates = J.dot(v)
    taut = lines.taut(lengths, rates)  # 0 for slack cables, else 1
    damping = lines.damping * taut
    if lines.coulomb.any():
        damping = damping + lines.coulomb * sign_slope(rates, friction.sign_width)
    return _LinePartials(
        rows=partials(context.lines.loops, q, motion),
        J=J,
        tensions=tensions,
        stiffness=lines.stiffness * taut,
        damping=damping,
        masses=lines.masses,
    )


def _with_lines(of_tree: _TreePartials, lines: _LinePartials) -> _TreePartials:
    """The derivatives of the tree, plus the derivatives of J^T tensions for constant J.

    The loads on the tree already contain the changes of J, the directions of the lines.
    """
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


# --- step 3: the chain rule -------------------------------------------------------------------


class _ForceDerivatives(NamedTuple):
    """Derivatives of the forces along the coordinates, and L.

    Attributes:
        by_q: By q along L e_k in column k, shape (n, n).
        by_va: By va, shape (n, n).
        by_aa: By aa: the mass matrix in the coordinates, shape (n, n).
        L: Joint orthogonal complement, shape (nv, n).
    """

    by_q: Array
    by_va: Array
    by_aa: Array
    L: Array


def _along_coordinates(
    of_tree: _TreePartials, rows: Partials, L: Array, G: Array
) -> _ForceDerivatives:
    """The chain rule: derivatives of L^T F, with constant L and the forces F(q, v, v_dot).

    G is `JointComplement.inverse`: Phi G b = b, and G b has zero rates of the coordinates. So the
    solution of Phi x = -b without rates of the coordinates is x = -G b.
    """
    # The velocity b = Phi v and the acceleration c = Phi v_dot + Phi_dot v of the rows are zero.
    # Their derivatives along L: b_q L + Phi v_q = 0 and c_q L + c_v v_q + Phi v_dot_q = 0.
    v_q = -G.dot(rows.velocity_q.dot(L))
    v_dot_q = -G.dot(rows.acceleration_q.dot(L) + rows.acceleration_v.dot(v_q))
    v_dot_va = -G.dot(rows.acceleration_v.dot(L))

    force_q, force_v, M = of_tree
    inertia = L.T.dot(M).dot(L)
    return _ForceDerivatives(
        by_q=L.T.dot(force_q.dot(L) + force_v.dot(v_q) + M.dot(v_dot_q)),
        by_va=L.T.dot(force_v.dot(L) + M.dot(v_dot_va)),
        by_aa=(inertia + inertia.T) / 2,
        L=L,
    )


# --- linear models ----------------------------------------------------------------------------


def linear_system(d: AccelerationDerivatives, rates: Array | None) -> tuple[Array, Array]:
    """A, shape (..., 2 n, 2 n), and B, shape (..., 2 n, motors), of x' = A x + B u.

    x = (displacements of the coordinates, deviations of va), and u are deviations of the torques.
    `rates` are `Derivatives.displacement_rates`, shape (..., n, n), or None if no joint axes move.
    """
    # The columns of [A B] belong to the displacements, to va and to u.
    accelerations = np.concatenate(d, axis=-1)
    n = accelerations.shape[-2]
    A_B = np.zeros((*accelerations.shape[:-2], 2 * n, accelerations.shape[-1]))
    if rates is not None:
        A_B[..., :n, :n] = rates
    A_B[..., :n, n : 2 * n] = np.eye(n)
    A_B[..., n:, :] = accelerations
    return A_B[..., : 2 * n], A_B[..., 2 * n :]


def discrete(A: Array, B: Array, dt: float) -> tuple[Array, Array]:
    """A and B of the exact step over dt, with constant u: x(t + dt) = A_d x(t) + B_d u.

    They are the upper blocks of the exponential of [A B; 0 0] dt.
    """
    from scipy.linalg import expm

    states, inputs = B.shape[-2:]
    A_B = np.zeros((*A.shape[:-2], states + inputs, states + inputs))
    A_B[..., :states, :states] = A
    A_B[..., :states, states:] = B
    with np.errstate(over="ignore", invalid="ignore"):
        step = expm(A_B * dt)
    # Samples that are NaN already have failed before.
    is_valid = np.isfinite(A_B).all(axis=(-2, -1))
    overflows = is_valid & ~np.isfinite(step).all(axis=(-2, -1))
    if overflows.any():
        fastest = float(np.abs(np.linalg.eigvals(np.nan_to_num(A)).real).max())
        raise InputError(
            "dt",
            f"{dt:g} s is too long: the exponential overflows, A has poles of {fastest:.3g} /s",
        )
    return step[..., :states, :states], step[..., :states, states:]

# SPDX-License-Identifier: BSD-2-Clause
"""Equations of motion in the coordinates, Eqs. (63)-(96), one configuration: the reference path.

The long form (`terms`) assembles every term of Eq. (92) from K, T, M and Omega. The short form
(`inverse_dynamics`) is the same equation with v = L va and v_dot = L aa + L_dot va in the inverse
dynamics of the tree, RNEA:

    f = L^T (RNEA(q, v, v_dot) - tau^f - tau^s - K^T w).

f are the forces that the motion needs along the coordinates, whoever supplies them. tau^f are the
forces of friction and tau^s those of springs, in joints and along lines. w are external wrenches.
`direct_dynamics` solves the equation for aa. `force_sizes` says how large the forces are that may
cancel in f. All functions use a `Context`, which has L and Pinocchio's data at the current
configuration.

The paper's decoupled form [5, 6] is K = N_l N_d: N_d gives the twist of each body relative to its
parent, and N_l adds the twists of all bodies before it; see `noc.decoupled`. `pin.rnea` is this
form as two recursions. The first one, from the base to the ends, computes twists: it multiplies by
N_d and N_l. The second one, back to the base, computes forces: it multiplies by N_l^T and N_d^T.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import SingularConfigurationError
from ..loops.assembly import Assembly
from ..loops.continuity import Continuity
from ..loops.line_kinematics import LineKinematics
from ..loops.loops import Loops
from ..loops.ranks import independent_rows
from ..loops.vectors import cross
from ..model.conventions import EARTH_GRAVITY
from ..model.dry_friction import sign_of
from ..model.mechanism import Friction, Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE, ROUNDING, WITHOUT_MASS
from ..summaries import Summary, as_html, as_text
from .noc import JointComplement, bodies, body_jacobians, decoupled, natural_complement


@dataclass(frozen=True, repr=False)
class Terms(Summary):
    """Every matrix of Eq. (92): f = inertia aa + coriolis va - gravity - friction - springs.

    There are nv rates, of which n belong to the coordinates, and r bodies. Units are SI, axes are
    those of the base. Here, and only here, twists are [omega; v] and wrenches [moment; force], as
    in the paper, at the mass centres.

    Attributes:
        Phi: Independent rows of the constraint Jacobian, shape (nv - n, nv), Eqs. (3), (5).
        L: Joint orthogonal complement, shape (nv, n), Eq. (17).
        L_dot: Its rate, shape (nv, n), Eq. (20).
        K: Body Jacobians, shape (6 r, nv), Eq. (12).
        K_dot: Their rate, shape (6 r, nv), Eq. (15).
        N_l: Transfer of twists from body to body, K = N_l N_d, shape (6 r, 6 r), [5, 6].
        N_d: Twist of each body relative to its parent, shape (6 r, nv), [5, 6].
        T: Natural orthogonal complement, shape (6 r, n), Eqs. (22), (23).
        T_dot: Its rate, shape (6 r, n), Eq. (25).
        M: Stacked mass matrix, shape (6 r, 6 r), Eq. (69).
        Omega: Stacked angular velocities, shape (6 r, 6 r), Eq. (70).
        inertia: Mass matrix in the coordinates, shape (n, n), Eq. (93).
        coriolis: Coriolis matrix (with centrifugal terms), shape (n, n), Eq. (94).
        gravity: Generalized forces of the weights, tau^g, shape (n,), Eq. (95).
        friction: Generalized forces of friction, L^T tau^f, shape (n,), Eq. (96); they oppose the
            rates. Dampers and dry friction along lines are among them.
        springs: Generalized forces of the springs, those along lines among them, shape (n,).
    """

    Phi: Array
    L: Array
    L_dot: Array
    K: Array
    K_dot: Array
    N_l: Array
    N_d: Array
    T: Array
    T_dot: Array
    M: Array
    Omega: Array
    inertia: Array
    coriolis: Array
    gravity: Array
    friction: Array
    springs: Array

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """Shapes of the matrices, in a row for each step of the paper."""
        rows = {
            "closures": "Phi L L_dot",
            "bodies": "K K_dot M Omega",
            "recursion": "N_l N_d",
            "complement": "T T_dot",
            "matrices": "inertia coriolis",
            "forces": "gravity friction springs",
        }
        return "Terms of Eq. (92)", [(word, _shapes(self, names)) for word, names in rows.items()]


class ReducedTerms(NamedTuple):
    """f = inertia aa + coriolis va - gravity - friction, Eq. (92), for a batch.

    Attributes:
        inertia: Mass matrix, shape (..., n, n), Eq. (93).
        coriolis: Coriolis matrix, shape (..., n, n), Eq. (94).
        gravity: Forces of weights and springs, shape (..., n), Eq. (95).
        friction: Forces of friction, shape (..., n), Eq. (96).

    Example:
        >>> va, aa = [1, 0, 0], [0, 1, 0]
        >>> terms = robot.reduced_terms(robot.home, va)
        >>> tau = terms.inertia @ aa + terms.coriolis @ va - terms.gravity - terms.friction
        >>> bool(np.allclose(tau, robot.compute_torques(robot.home, va, aa)))
        True
    """

    inertia: Array
    coriolis: Array
    gravity: Array
    friction: Array

    def __repr__(self) -> str:
        return as_text(*self._summary())

    def _repr_html_(self) -> str:
        return as_html(*self._summary())

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """Shapes of the terms."""
        rows = {"matrices": "inertia coriolis", "forces": "gravity friction"}
        return "ReducedTerms of Eq. (92)", [(word, _shapes(self, x)) for word, x in rows.items()]

    @classmethod
    def of_rows(cls, rows: Array, n: int) -> ReducedTerms:
        """The terms from rows of numbers, shape (..., 2 n (n + 1)).

        A row has the entries of `inertia`, then those of `coriolis`, `gravity` and `friction`.
        """
        inertia, coriolis, gravity, friction = np.split(
            rows, [n * n, 2 * n * n, 2 * n * n + n], axis=-1
        )
        square = (*rows.shape[:-1], n, n)
        return cls(inertia.reshape(square), coriolis.reshape(square), gravity, friction)


def _shapes(terms: Terms | ReducedTerms, names: str) -> str:
    """Names with shapes, as L (9, 3)."""
    return ", ".join(f"{name} {getattr(terms, name).shape}" for name in names.split())


class Context:
    """Loops, L and Pinocchio data of one mechanism; one object per thread.

    All of them belong to one configuration, the current q. It is the last one for which `evaluate`,
    `complement.evaluate` or `complement.motion` was called.

    Attributes:
        mechanism: The mechanism.
        loops: f, Phi and Phi_dot of the closures.
        tree: The normal tree, on which Pinocchio computes; its rates are S v.
        data: Pinocchio's data of the normal tree.
        complement: L and the inverse of Phi^u.
        lines: Lengths of the lines and their rates.
        assembly: Closes the loops by steps in which wheels may slip and braked joints may move.
        without_slip: Closes the loops by steps in which wheels roll and braked joints rest.
        whole_inertia: The size of the robot's inertia, [kg m^2], by the function `whole_inertia`.
        zero_aa: Accelerations of the coordinates that are zero, shape (n,).
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.loops = Loops(mechanism.model, mechanism.closures)
        self.tree = self.loops.tree
        self.data = self.loops.data
        self.complement = JointComplement(mechanism, self.loops)
        self.lines = LineKinematics(mechanism)
        self.assembly = Assembly(mechanism, self.loops)
        self.without_slip = Assembly(mechanism, self.loops, slipping=False)
        self.whole_inertia = whole_inertia(mechanism)
        self.zero_aa = np.zeros(len(mechanism.coordinates))

    @cached_property
    def continuity(self) -> Continuity:
        """Follows motions from one configuration to the next."""
        return Continuity(self.mechanism, self.loops)

    def evaluate(self, q: Array, tolerance: float = CLOSURE_TOLERANCE) -> None:
        """Compute all that depends on q; q must be normalised and close the loops."""
        self.mechanism.space.require_on_manifold(q)
        self.loops.evaluate_closed(q, self.mechanism.row_scale, tolerance)

    def actuation(self, q: Array) -> Array:
        """B at q, motors on lines included: forces on the tree are B tau, shape (nv, motors).

        A motor on a line pushes the ends of the line apart if its force is positive, so the force
        acts along the rate J v of the length.
        """
        B = self.mechanism.actuation
        on_lines = self.mechanism.lines.actuation
        if not on_lines.any():
            return B
        _, J = self.lines.evaluate(q)
        return B + J.T.dot(on_lines)

    def tree_forces(self, v: Array, v_dot: Array) -> Array:
        """Inverse dynamics of the tree at the current q, shape (nv,), by recursions (RNEA).

        They are K^T (M t_dot + Omega M t - w^g), Eqs. (68), (77), and the forces of rotors and of
        masses that move with the lengths of lines.
        """
        # In the normal tree, each mimic joint has a coordinate of its own. So its configuration is
        # loops.q, and its rates are S v. Lines have the configuration of the model.
        S = self.tree.S
        motion = self.tree.model, self.data, self.loops.q, S.dot(v), S.dot(v_dot)
        if self.mechanism.weight_shares is None:
            forces = pin.rnea(*motion).dot(S)
        else:
            forces = pin.rnea(*motion, pin.StdVec_Force(self.lifts())).dot(S)
        if self.mechanism.lines.masses.any():
            # A motion needs J^T times these tensions. J is the Jacobian of the lengths of lines.
            tensions = self.lines.inertial_tensions(self.loops.q_of_model, v, v_dot)
            J = self.lines.loops.Phi
            forces = forces + tensions.dot(J)
        return forces

    def lifts(self) -> list[pin.Force]:
        """Forces that cancel the part of each body's weight that does not act, at the current q.

        `pin.rnea` gives each body its whole weight, but on some bodies only a share of it acts; see
        `WeightShares`. The rest has the mass m and the first moment m c, so the force is -m g, with
        the moment m c x (-g). There is one force for each joint of the normal tree, at its origin
        and in its axes.
        """
        lifts = [pin.Force.Zero() for _ in range(self.tree.model.njoints)]
        for body, weightless_part in self.mechanism.weightless_parts.items():
            joint = self.tree.bodies[body + 1]
            g = self.data.oMi[joint].rotation.T @ self.mechanism.model.gravity.linear
            mass = weightless_part[0]
            first_moment = weightless_part[1:]
            lifts[joint] = pin.Force(-mass * g, -cross(first_moment, g))
        return lifts

    def tree_inertia(self) -> Array:
        """Mass matrix of the tree at the current q, shape (nv, nv)."""
        S = self.tree.S
        inertia = S.T.dot(pin.crba(self.tree.model, self.data, self.loops.q)).dot(S)
        if self.mechanism.lines.masses.any():
            inertia = inertia + self.lines.inertia(self.loops.q_of_model)
        return inertia


def whole_inertia(mechanism: Mechanism) -> float:
    """The size of the whole robot's inertia, [kg m^2], with which coordinates are compared.

    It is the sum of three parts, for joints that all move at the rate 1, free of units:

    - masses move by about the robot's length: all masses, also those that move with the lengths of
      lines, times the square of this length;
    - bodies turn: the trace of each body's inertia about the origin of its own joint;
    - rotors turn: the inertia of each rotor times the square of its rate's scale.
    """
    model = mechanism.model
    mass = mechanism.lines.masses.sum()
    inertia = model.armature.dot(mechanism.rate_scale**2)
    for body in list(model.inertias)[1:]:
        mass += body.mass
        about_joint = body.inertia - body.mass * np.linalg.matrix_power(pin.skew(body.lever), 2)
        inertia += np.trace(about_joint)
    return float(mass * mechanism.length**2 + inertia)


def applied_forces(
    context: Context,
    friction: Friction,
    q: Array,
    v: Array,
    wrenches: Array | None,
    tau: Array | None = None,
) -> Array:
    """Motors, friction, springs, lines, external wrenches as forces on the tree, shape (nv,).

    `tau` are the torques of the motors; without them, motors give no force.
    """
    springs = context.mechanism.springs
    lines = context.mechanism.lines
    force = np.zeros(len(v)) if tau is None else context.mechanism.actuation.dot(tau)
    if not friction.none:
        force = force + friction.forces(v)
    if not springs.none:
        force = force + springs.forces(context.mechanism.model, q)
    if not lines.none:
        lengths, J = context.lines.evaluate(q)
        tensions = lines.tensions(lengths, J.dot(v), friction.sign_width, tau)
        force = force - tensions.dot(J)  # a tension pulls: its force acts against the length
    if wrenches is not None:
        force = force + wrenches.ravel().dot(body_jacobians(context.loops))
    return force


def tensions_in_motion(
    context: Context,
    friction: Friction,
    q: Array,
    v: Array,
    v_dot: Array,
    tau: Array | None = None,
) -> Array:
    """Tensions of all lines in a motion of the tree, shape (lines,), [N].

    They are those of springs, dampers, dry friction, motors, and of masses that move with the
    lengths. `applied_forces` has all but the masses, which are part of `Context.tree_forces`.
    The lines are evaluated at q: `context.lines.loops` has their lengths f and J = Phi.
    """
    lengths, J = context.lines.evaluate(q)
    applied = context.mechanism.lines.tensions(lengths, J.dot(v), friction.sign_width, tau)
    return np.asarray(applied + context.lines.inertial_tensions(q, v, v_dot))


def inverse_dynamics(
    context: Context, q: Array, va: Array, aa: Array, wrenches: Array | None
) -> Array:
    """Generalised forces f of a motion, shape (n,), by the short form of Eq. (92).

    `wrenches` are external [force; moment] on each body at its mass centre, base axes, shape
    (r, 6), or None.
    """
    v, v_dot = context.complement.motion(q, va, aa)  # Eqs. (16), (20)
    applied = applied_forces(context, context.mechanism.friction, q, v, wrenches)
    return (context.tree_forces(v, v_dot) - applied).dot(context.complement.L)  # Eq. (91)


def force_sizes(context: Context, q: Array, va: Array, aa: Array, wrenches: Array | None) -> Array:
    """Sum of the sizes of all forces in each coordinate, shape (n,).

    Forces may cancel; a sum that is much smaller than these sizes is rounding. The sizes are upper
    bounds: directions are ignored, rotations move mass centres by the length of the robot, and each
    body has at least its weight on Earth.
    """
    mechanism = context.mechanism
    model = mechanism.model
    r = model.njoints - 1
    v, v_dot = context.complement.motion(q, va, aa)

    # Wrenches [moment; force] on the bodies, each of shape (6 r,) as the rows of K.
    K, K_dot, M, Omega, weights = bodies(context.loops, v, mechanism.weight_shares)
    on_bodies = [M @ (K @ v_dot), M @ (K_dot @ v), Omega @ (M @ (K @ v)), weights]
    if wrenches is not None:
        force, moment = np.hsplit(wrenches, 2)
        on_bodies.append(np.hstack([moment, force]).ravel())
    # Axes: kinds of wrenches, bodies, moment or force, x y z. Sizes are summed over the first and
    # the last one.
    sizes = np.abs(on_bodies).reshape(-1, r, 2, 3).sum(axis=(0, 3))
    moments = sizes[:, 0]
    forces = sizes[:, 1] + EARTH_GRAVITY * np.abs([body.mass for body in list(model.inertias)[1:]])

    # Sizes of the bodies' angular and linear velocities at the rate 1 of each joint, shape (r, nv).
    twists = np.linalg.norm(K.reshape(r, 2, 3, -1), axis=2)
    angular = twists[:, 0]
    linear = twists[:, 1] + mechanism.length * angular
    on_rates = angular.T @ moments + linear.T @ forces

    # Forces of lines and joints.
    if not mechanism.lines.none:
        tensions = tensions_in_motion(context, mechanism.friction, q, v, v_dot)
        J = context.lines.loops.Phi
        on_rates += np.abs(tensions[:, None] * J).sum(axis=0)
    on_rates += np.abs(mechanism.friction.forces(v))
    on_rates += np.abs(mechanism.springs.forces(model, q))
    on_rates += np.abs(model.armature * v_dot)
    return np.abs(context.complement.L).T @ on_rates


def direct_dynamics(
    context: Context,
    friction: Friction,
    q: Array,
    va: Array,
    tau: Array,
    wrenches: Array | None,
    tolerance: float = CLOSURE_TOLERANCE,
) -> tuple[Array, Array]:
    """Accelerations aa of the coordinates from Eq. (92), and v = L va.

    The loops may be open up to `tolerance`. `friction` replaces that of the mechanism.
    """
    v, bias = context.complement.motion(q, va, context.zero_aa, tolerance)  # bias = L_dot va
    force = applied_forces(context, friction, q, v, wrenches, tau) - context.tree_forces(v, bias)
    L = context.complement.L
    inertia = L.T.dot(context.tree_inertia()).dot(L)  # Eq. (93)
    # A coordinate may move no mass, and then Eq. (92) has no solution. Its inertia is not exactly
    # zero but rounding, so it is compared with the largest that it could be. At the rate 1 of a
    # coordinate, the joints have the rates in its column of L. If the inertia of the whole robot
    # moved at each of these rates, the coordinate would have the inertia `largest`.
    squared_rates = np.square(L / context.mechanism.rate_scale[:, None]).sum(axis=0)
    largest = context.whole_inertia * squared_rates
    aa = _solve_for_accelerations(inertia, force.dot(L), WITHOUT_MASS * largest)
    if aa is None:
        if not np.isfinite(inertia).all():
            problem = "the mass matrix has entries that are not finite numbers"
            raise SingularConfigurationError(problem, float("inf"))
        values = np.linalg.eigvalsh(inertia)
        why = "a coordinate moves no mass at this configuration"
        if values[0] < -ROUNDING * np.abs(values).max():
            why = "the inertia of a body is negative"
        problem = f"the mass matrix is not positive definite: {why}"
        raise SingularConfigurationError(problem, float(np.linalg.cond(inertia)))
    return aa, v


def _solve_for_accelerations(inertia: Array, force: Array, least: Array) -> Array | None:
    """Accelerations for forces; None if a pivot of the mass matrix is rounding or below `least`."""
    try:
        factor = np.linalg.cholesky(inertia)
    except np.linalg.LinAlgError:
        return None
    pivots = np.diag(factor) ** 2
    if not (pivots > ROUNDING * np.diag(inertia) + least).all():  # NaN too
        return None
    return np.asarray(np.linalg.solve(inertia, force), float)


def terms(context: Context, q: Array, va: Array) -> Terms:
    """All matrices of Eq. (92), the long form, for q, shape (nq,), and va, shape (n,)."""
    context.complement.evaluate(q)
    mechanism = context.mechanism
    model = mechanism.model
    Phi = context.loops.Phi
    L = context.complement.L
    v = L @ va  # Eq. (16)
    Phi_dot = context.loops.Phi_dot(v)
    L_dot = context.complement.L_dot(Phi_dot)
    v_dot = L_dot @ va  # for aa = 0
    context.complement.require_accelerations(v, v_dot, Phi_dot @ v)
    of_bodies = bodies(context.loops, v, mechanism.weight_shares)
    T, T_dot = natural_complement(of_bodies, L, L_dot)
    K, K_dot, M, Omega, weights = of_bodies
    N_l, N_d = decoupled(context.loops)
    lengths, J = context.lines.evaluate(q)
    tensions = _tensions_by_kind(mechanism, lengths, J @ v)
    # Two inertias are not in the paper: of rotors geared to joints (model.armature), and of masses
    # that move with the lengths of lines. These are L^T times their forces per acceleration.
    rotors = L.T * model.armature
    on_lines = L.T @ (J.T * mechanism.lines.masses)
    J_dot = np.zeros_like(J)
    if mechanism.lines.masses.any():
        J_dot = context.lines.loops.Phi_dot(v)
    Phi_without_units = Phi * mechanism.row_scale[:, None] * mechanism.rate_scale
    return Terms(
        Phi=Phi[independent_rows(Phi_without_units)],
        L=L,
        L_dot=L_dot,
        K=K,
        K_dot=K_dot,
        N_l=N_l,
        N_d=N_d,
        T=T,
        T_dot=T_dot,
        M=M,
        Omega=Omega,
        inertia=T.T @ M @ T + rotors @ L + on_lines @ J @ L,  # Eq. (93)
        coriolis=(
            T.T @ M @ T_dot
            + T.T @ Omega @ M @ T
            + rotors @ L_dot
            + on_lines @ (J @ L_dot + J_dot @ L)
        ),  # Eq. (94)
        gravity=T.T @ weights,  # Eq. (95)
        friction=L.T @ (mechanism.friction.forces(v) - tensions.friction @ J),  # Eq. (96)
        springs=L.T @ (mechanism.springs.forces(model, q) - tensions.springs @ J),
    )


class _Tensions(NamedTuple):
    """Tensions of all lines by their causes, without motors, shapes (lines,), [N]."""

    springs: Array  #: Of springs and preload.
    friction: Array  #: Of dampers and dry friction.


def _tensions_by_kind(mechanism: Mechanism, lengths: Array, rates: Array) -> _Tensions:
    """Tensions of springs and of friction in lines with these lengths and their rates."""
    lines = mechanism.lines
    taut = lines.taut(lengths, rates)  # 0 for slack cables, else 1
    springs = taut * (lines.preload + lines.stiffness * (lengths - lines.rest_lengths))
    dry_friction = lines.coulomb * sign_of(rates, mechanism.friction.sign_width)
    return _Tensions(springs, friction=taut * lines.damping * rates + dry_friction)

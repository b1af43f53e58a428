# SPDX-License-Identifier: BSD-2-Clause
"""The natural orthogonal complement: L, K, T and their rates, Eqs. (3)-(25), one configuration.

Sect. 3 of the paper with its letters. `JointComplement` computes L, Eqs. (3)-(8), (16)-(20);
`bodies` computes K, M and Omega, `natural_complement` T, and `decoupled` the factors of K. Joints
keep the order of the tree: they are not sorted into actuated and unactuated ones. Phi^a are the
columns of Phi for the coordinates, Phi^u those for the dependent rates.

In `Bodies`, T and N_l, and only there, twists are [omega; v] and wrenches [moment; force], at the
mass centres in base axes, as in the paper. Everywhere else they are [v; omega] and [force; moment],
as Pinocchio's.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import SingularConfigurationError
from ..loops.coordinate_choice import choose_coordinates
from ..loops.loops import Loops, connected
from ..loops.ranks import condition_number
from ..model.mechanism import Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE, INCONSISTENT, MAX_CONDITION_NUMBER, RESTS
from ..model.weight_shares import WeightShares
from ..summaries import listed

#: Normal equations give pseudo-inverses up to this condition number k. With numbers that are
#: rounded to eps = 2.2e-16, the relative error of the result is about k^2 eps. The Newton step in
#: `_invert` squares this error to k^4 eps^2. For k < eps^-1/3 = 1.7e5 the squared error is less
#: than k eps, which is the error of an inverse by any method.
_NORMAL_EQUATIONS = 1e5


class _Block:
    """A block of Phi^u: some rows, and the dependent rates that are in these rows only.

    Attributes:
        rows: Indices of the rows.
        rates: Indices of the dependent rates in v.
        scale: Factors that make the block free of units, shape (rows, rates).
        in_Phi: Indices of the block's entries in Phi.ravel(), shape (rows, rates).
        in_inverse: Indices of the entries of the block's inverse in `JointComplement.inverse`.
        twice_identity: Twice the identity, shape (rates, rates).
    """

    def __init__(self, mechanism: Mechanism, rows: Indices, dependent: Indices) -> None:
        self.rows = rows
        self.rates = mechanism.dependent[dependent]
        self.scale = mechanism.row_scale[rows, None] * mechanism.rate_scale[self.rates]
        self.in_Phi = rows[:, None] * mechanism.model.nv + self.rates
        self.in_inverse = np.ix_(self.rates, rows)
        self.twice_identity = 2 * np.eye(len(dependent))


class JointComplement:
    """L and the inverse of Phi^u at one configuration; one object per thread.

    Phi keeps its redundant rows. They are consistent, so that least squares over all rows equals
    the inverse over independent ones. Rows and rates are made free of units first. Loops that share
    no dependent joint are inverted separately, so that the cost is linear in their number.

    Attributes:
        blocks: The blocks of Phi^u, which share no row and no dependent rate.
        L: Joint orthogonal complement, shape (nv, n), Eq. (17): Phi L = 0.
        inverse: G, shape (nv, rows): x = G c solves Phi x = c with x = 0 for the coordinates. Its
            rows for the dependent rates are the inverse of Phi^u, the others are zero.
    """

    def __init__(self, mechanism: Mechanism, loops: Loops) -> None:
        self._mechanism = mechanism
        self._loops = loops
        self._S_a = mechanism.selection.T  # the identity at the coordinates, shape (nv, n)
        self._row_scale = mechanism.row_scale
        per_rate = mechanism.rate_scale
        per_coordinate = mechanism.rate_scale[mechanism.coordinates]
        #: Factors that make Phi L free of units, shape (rows, n).
        self._scale_of_Phi_L = mechanism.row_scale[:, None] * per_coordinate
        #: Factors that make L free of units, shape (nv, n).
        self._scale_of_L = per_coordinate / per_rate[:, None]
        # Entry (i, k) of `touched` says whether row i of Phi depends on rate k.
        row_count, nv = loops.touched.shape
        self.blocks = [
            _Block(mechanism, *part) for part in connected(loops.touched[:, mechanism.dependent])
        ]
        self.inverse = np.zeros((nv, row_count))
        # Rows of square blocks are not redundant. Others may be: rows of blocks with more rows than
        # rates, and rows without a dependent rate.
        in_square_blocks = sum(len(b.rates) for b in self.blocks if len(b.rows) == len(b.rates))
        self._redundant = in_square_blocks < row_count

    def evaluate(self, q: Array, tolerance: float = CLOSURE_TOLERANCE) -> None:
        """Compute L at q; the loops must be closed up to a tolerance."""
        if not self._mechanism.space.euclidean:  # q has unit vectors
            self._mechanism.space.require_on_manifold(q)
        self._loops.evaluate_closed(q, self._row_scale, tolerance)
        self._factorise()

    def motion(
        self, q: Array, va: Array, aa: Array, tolerance: float = CLOSURE_TOLERANCE
    ) -> tuple[Array, Array]:
        """v and v_dot of the tree for a motion of the coordinates, shapes (nv,)."""
        self.evaluate(q, tolerance)
        v = self.L.dot(va)  # Eq. (16)
        drift = self._loops.drift(v)  # Phi_dot v
        v_dot = self.accelerations(aa, drift)
        self.require_accelerations(v, v_dot, drift)
        return v, v_dot

    def require_accelerations(self, v: Array, v_dot: Array, drift: Array) -> None:
        """Check Eq. (8), Phi v_dot + Phi_dot v = 0, in redundant rows too; drift is Phi_dot v.

        At some poses there are rates that satisfy the rows, but no accelerations with them: the
        robot cannot move there. For instance, the joints of a braced frame may have rates at one
        pose, although the frame is rigid.

        Rounding and open loops violate redundant rows a little: each row, free of units, by up to
        `_allowed` times the size of the motion.
        """
        if not self._redundant:
            return
        loops = self._loops
        mechanism = self._mechanism
        violations = (loops.Phi.dot(v_dot) + drift) * self._row_scale
        rates = v / mechanism.rate_scale
        accelerations = v_dot / mechanism.rate_scale
        # Phi_dot v is quadratic in the rates, and Phi v_dot linear in the accelerations.
        size = rates.dot(rates) + math.sqrt(accelerations.dot(accelerations))
        if violations.dot(violations) <= (self._least_allowed * size) ** 2:
            return  # a quick test that suffices: no entry is larger than the norm
        worst = int(np.abs(violations).argmax())
        if np.isfinite(size) and not abs(violations[worst]) <= self._allowed * size:
            self._refuse_motion(rates, worst)

    def _refuse_motion(self, rates: Array, row: int) -> None:
        """Raise the error for rates, free of units, with which no accelerations satisfy a row."""
        mechanism = self._mechanism
        rows = [(closure, name) for closure in mechanism.closures for name in closure.rows]
        closure, row_name = rows[row]
        moving = np.abs(rates) > RESTS * np.abs(rates).max()
        names = listed(np.array(mechanism.space.rate_names)[moving].tolist())
        raise SingularConfigurationError(
            f"singular configuration: rates of the joints {names} are possible here, but no motion "
            f"with them: no accelerations satisfy the row {row_name} of the closure {closure}; "
            "move away, or lock joints that cannot move: locked=[...]",
            float("inf"),
        )

    def _factorise(self) -> None:
        """Compute L and the inverse; the error names the rates that the closures do not determine.

        Redundant rows must hold too, up to the errors f of the loops, Eq. (2).
        """
        Phi = self._loops.Phi
        self._invert(Phi)
        least = self._largest / MAX_CONDITION_NUMBER
        if not all(size > least for size in self._smallest):  # NaN too
            self._refuse(Phi, least)
        Phi_a = Phi.take(self._mechanism.coordinates, axis=1)
        self.L: Array = self._S_a - self.inverse.dot(Phi_a)  # Eqs. (7), (17)
        if self._redundant:
            self._require_rates(Phi)

    def _invert(self, Phi: Array) -> None:
        """Compute the inverse, and the singular values that judge the blocks of Phi^u.

        The singular values are free of units. All equations for v are Phi v = 0, and v = va for the
        coordinates. The equations of the coordinates are a block with the singular value 1.
        """
        #: The largest singular value of all blocks, with the block of the coordinates.
        self._largest = 1.0
        #: The smallest singular value of each block of Phi^u.
        self._smallest: list[float] = []
        for block in self.blocks:
            A = Phi.take(block.in_Phi) * block.scale
            inverse, largest, smallest = _inverse(A)
            # A step of Newton's method for inverses (Newton-Schulz), which removes rounding.
            inverse = (block.twice_identity - inverse.dot(A)).dot(inverse)
            self.inverse[block.in_inverse] = inverse * block.scale.T
            self._largest = max(self._largest, largest)
            self._smallest.append(smallest)

    def _require_rates(self, Phi: Array) -> None:
        """Check Phi L = 0 in redundant rows too, Eq. (19).

        It does not hold if the closures allow fewer motions than there are coordinates.
        """
        violations = (Phi.dot(self.L) * self._scale_of_Phi_L).ravel()
        if violations.dot(violations) <= self._least_allowed**2:
            return  # a quick test that suffices: no entry is larger than the norm
        if not np.abs(violations).max(initial=0.0) <= self._allowed:
            self._refuse(Phi, 0.0)  # no block is singular

    @property
    def _allowed(self) -> float:
        """Largest allowed violation of a redundant row, free of units, for rates va of size 1.

        Redundant rows agree with the other rows only where the loops are closed. Loops that are
        open by f displace dependent joints by up to f times the condition number. The entries of
        Phi are up to `_largest`, so Phi changes by up to `_largest` times this displacement. The
        violation is this change times the rates of the joints, which are up to the largest entry
        of L.
        """
        openness = np.abs(self._row_scale * self._loops.f).max()
        condition = self._largest / min(self._smallest, default=1.0)
        displacement = CLOSURE_TOLERANCE + openness * condition
        change_of_Phi = displacement * self._largest
        largest_rate = np.abs(self.L * self._scale_of_L).max(initial=1.0)
        return float(INCONSISTENT * change_of_Phi * largest_rate)

    @property
    def _least_allowed(self) -> float:
        """A lower bound of `_allowed` that is quick to compute: f = 0, entries of L up to 1."""
        return INCONSISTENT * CLOSURE_TOLERANCE * self._largest

    def _refuse(self, Phi: Array, least: float) -> None:
        """Raise the error; blocks whose smallest singular value is at most `least` are singular."""
        mechanism = self._mechanism
        undetermined: list[str] = []
        for block, smallest in zip(self.blocks, self._smallest, strict=True):
            if not smallest > least:
                undetermined += [mechanism.space.rate_names[k] for k in block.rates]
        if undetermined:
            why = (
                "the coordinates do not determine the rates of the dependent joints "
                f"{listed(undetermined)}"
            )
        else:
            coordinates = listed(mechanism.coordinate_rate_names)
            why = f"the closures hold the coordinates {coordinates} themselves"

        Phi_without_units = Phi * mechanism.row_scale[:, None] * mechanism.rate_scale
        others = choose_coordinates(mechanism, np.nan_to_num(Phi_without_units))
        names = listed(mechanism.space.names_of(others.tolist()))
        if not len(others):
            cure = "nothing can move here"
        elif len(others) > len(mechanism.coordinates):
            cure = (
                f"the closures leave {len(others)} freedoms here to {len(mechanism.coordinates)} "
                "coordinates; move away, or where they do so everywhere use "
                f"chain.with_coordinates([{names}])"
            )
        else:
            cure = (
                f"move away, or use chain.with_coordinates([...]); here {names} describe the motion"
            )
        parts = [(block.rows, block.rates) for block in self.blocks]
        raise SingularConfigurationError(
            f"singular configuration: {why}; {cure}",
            condition_number(mechanism, Phi_without_units, parts),
        )

    def accelerations(self, aa: Array, drift: Array) -> Array:
        """v_dot with Phi v_dot = -drift, drift = Phi_dot v, shape (nv,)."""
        return self.L.dot(aa) - self.inverse.dot(drift)  # Eqs. (8), (20)

    def L_dot(self, Phi_dot: Array) -> Array:
        """Rate of L, shape (nv, n): the rate of Phi L = 0 is Phi L_dot = -Phi_dot L."""
        return -self.inverse.dot(Phi_dot.dot(self.L))  # Eq. (20)


def _norm(A: Array) -> float:
    entries = A.ravel()
    return math.sqrt(entries.dot(entries))


class _PseudoInverse(NamedTuple):
    """The pseudo-inverse of a matrix A of full column rank, and the size of its singular values.

    Attributes:
        matrix: Shape (columns, rows); zero if A has no full column rank.
        largest: Largest singular value of A, or an upper bound: the Frobenius norm of A.
        smallest: Smallest singular value of A, or a lower bound: 1 over the Frobenius norm of the
            inverse. It is 0 or NaN if there is no inverse.
    """

    matrix: Array
    largest: float
    smallest: float


def _inverse(A: Array) -> _PseudoInverse:
    """The pseudo-inverse of a matrix; fewer rows than columns have none."""
    rows, columns = A.shape
    if rows > columns:
        return _inverse_by_least_squares(A)
    inverse = _inverse_or_none(A) if rows == columns else None
    if inverse is None:
        return _PseudoInverse(np.zeros((columns, rows)), 0.0, 0.0)
    return _PseudoInverse(inverse, _norm(A), 1 / _norm(inverse))


def _inverse_by_least_squares(A: Array) -> _PseudoInverse:
    """`_inverse` of a matrix with more rows than columns.

    Normal equations are quick. They are precise enough below the condition number
    `_NORMAL_EQUATIONS`. For larger ones, a singular value decomposition is used.
    """
    # The singular values of A^T A are the squares of those of A.
    inverse_of_square = _inverse_or_none(A.T.dot(A))
    if inverse_of_square is not None:
        largest = _norm(A)
        largest_of_inverse = math.sqrt(_norm(inverse_of_square))
        if largest * largest_of_inverse < _NORMAL_EQUATIONS:
            matrix = inverse_of_square.dot(A.T)
            return _PseudoInverse(matrix, largest, 1 / largest_of_inverse)
    if not np.isfinite(A).all():
        return _PseudoInverse(np.zeros(A.T.shape), 0.0, 0.0)
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    if not s[-1] > 0:
        return _PseudoInverse(np.zeros(A.T.shape), 0.0, 0.0)
    return _PseudoInverse((Vt.T / s).dot(U.T), s[0], s[-1])


def _inverse_or_none(A: Array) -> Array | None:
    """The inverse of a square matrix; None if it is singular to the last digit."""
    try:
        return np.asarray(np.linalg.inv(A), dtype=float)
    except np.linalg.LinAlgError:
        return None


class Bodies(NamedTuple):
    """Jacobians and inertias of all r bodies."""

    #: t = K v, shape (6 r, nv), Eqs. (11), (12).
    K: Array
    #: Its rate, shape (6 r, nv), Eq. (15).
    K_dot: Array
    #: Stacked mass matrix, shape (6 r, 6 r), Eqs. (67), (69).
    M: Array
    #: Stacked angular velocities as cross-product matrices, shape (6 r, 6 r), Eq. (70).
    Omega: Array
    #: w^g, wrenches of the weights, shape (6 r,), Eq. (77).
    gravity: Array


def body_jacobians(loops: Loops) -> Array:
    """Jacobians [v; omega] of the bodies at their mass centres, shape (6 r, nv), at the current q.

    External wrenches w = [force; moment] at the mass centres have the forces J^T w on the joints. K
    has the same rows in the paper's order.
    """
    J = _at_mass_centers(_jacobians_of_bodies(loops, pin.getJointJacobian), mass_centers(loops))
    return J.dot(loops.tree.S).reshape(-1, loops.model.nv)


def bodies(loops: Loops, v: Array, weight_shares: WeightShares | None) -> Bodies:
    """K, K_dot, M, Omega and w^g at rates v of the tree.

    `weight_shares` is not None if only a share s of a body's weight acts. This weight s m g has the
    moment m d x g about the mass centre. The offset d of the body has the axes of its joint.
    """
    model = loops.model
    S = loops.tree.S
    c = mass_centers(loops)
    pin.computeJointJacobiansTimeVariation(loops.tree.model, loops.data, loops.q, S.dot(v))
    # K and K_dot have the shape (r, 6, nv) here.
    J = _at_mass_centers(_jacobians_of_bodies(loops, pin.getJointJacobian), c)
    K = _in_paper_order(J).dot(S)
    J_dot = _at_mass_centers(_jacobians_of_bodies(loops, pin.getJointJacobianTimeVariation), c)
    K_dot = _in_paper_order(J_dot).dot(S)
    # The mass centre has the velocity v_0 + omega x c, with v_0 at the origin. `J_dot` is the rate
    # for constant c; the rate of omega x c has the term omega x c_dot too.
    c_dot = K[:, 3:] @ v
    K_dot[:, 3:] += np.cross(K[:, :3], c_dot[:, :, None], axis=1)
    omega = K[:, :3] @ v

    r = model.njoints - 1
    M = np.zeros((r, 6, r, 6))
    Omega = np.zeros((r, 6, r, 6))
    weights = np.zeros((r, 6))
    for i, body in enumerate(list(model.inertias)[1:]):
        R = loops.data.oMi[loops.tree.bodies[i + 1]].rotation
        M[i, :3, i, :3] = R @ body.inertia @ R.T  # Eq. (67)
        M[i, 3:, i, 3:] = body.mass * np.eye(3)
        Omega[i, :3, i, :3] = pin.skew(omega[i])  # Eq. (67), as a cross-product matrix
        weight = body.mass * model.gravity.linear
        if weight_shares is not None:
            weights[i, :3] = np.cross(R @ weight_shares.offsets[i], weight)
            weight = weight_shares.shares[i] * weight
        weights[i, 3:] = weight
    return Bodies(
        K.reshape(-1, model.nv),
        K_dot.reshape(-1, model.nv),
        M.reshape(6 * r, 6 * r),
        Omega.reshape(6 * r, 6 * r),
        weights.ravel(),
    )


def natural_complement(bodies: Bodies, L: Array, L_dot: Array) -> tuple[Array, Array]:
    """T and its rate, shape (6 r, n): t = T va, t_dot = T aa + T_dot va, Eqs. (21), (24)."""
    T = bodies.K @ L  # Eqs. (22), (23)
    T_dot = bodies.K_dot @ L + bodies.K @ L_dot  # the rate of Eq. (22), Eq. (25)
    return T, T_dot


def decoupled(loops: Loops) -> tuple[Array, Array]:
    """N_l, shape (6 r, 6 r), and N_d, shape (6 r, nv), with K = N_l N_d, as in [5, 6] of the paper.

    N_d is block diagonal and has the twist of each body relative to its parent. N_l has unit blocks
    on the diagonal and zeros above; it adds the twist of a body to those of all bodies after it.
    The forward recursion of inverse dynamics is N_l, the backward recursion is its transpose.
    """
    model = loops.model
    c = mass_centers(loops)
    r = len(c)
    J = _jacobians_of_bodies(loops, pin.getJointJacobian)
    N_l = np.zeros((r, 6, r, 6))
    J_of_parents = np.zeros_like(J)
    # Body i is that of joint i + 1; joint 0 is the base.
    for i in range(r):
        for joint in list(model.supports[i + 1])[1:]:
            j = joint - 1  # body i itself, or a body between the base and body i
            transfer = np.eye(6)
            transfer[3:, :3] = -pin.skew(c[i] - c[j])  # v_i = v_j + omega x (c_i - c_j)
            N_l[i, :, j] = transfer
        parent = model.parents[i + 1]
        if parent:
            J_of_parents[i] = J[parent - 1]
    N_d = _in_paper_order(_at_mass_centers(J - J_of_parents, c)).dot(loops.tree.S)
    return N_l.reshape(6 * r, 6 * r), N_d.reshape(6 * r, model.nv)


def mass_centers(loops: Loops) -> Array:
    """Mass centres of the bodies in base axes, shape (r, 3)."""
    pairs = list(zip(loops.tree.bodies, loops.model.inertias, strict=True))[1:]
    return np.array([loops.data.oMi[joint].act(body.lever) for joint, body in pairs])


def _jacobians_of_bodies(loops: Loops, jacobian: Callable[..., Array]) -> Array:
    """Jacobians [v; omega] of all bodies at the world's origin, shape (r, 6, normal rates).

    `jacobian` is Pinocchio's function for the Jacobian of a joint, or for its rate.
    """
    model = loops.tree.model
    data = loops.data
    J = [jacobian(model, data, joint, pin.WORLD) for joint in loops.tree.bodies[1:]]
    return np.array(J).reshape(len(J), 6, -1)


def _at_mass_centers(J: Array, c: Array) -> Array:
    """Jacobians [v; omega] at the mass centres c from those at the origin, shape (r, 6, rates)."""
    v, omega = np.split(J, 2, axis=1)
    return np.concatenate([v + np.cross(omega, c[..., None], axis=1), omega], axis=1)


def _in_paper_order(J: Array) -> Array:
    """Jacobians [omega; v], Eq. (9), from [v; omega], shape (r, 6, rates)."""
    v, omega = np.split(J, 2, axis=1)
    return np.concatenate([omega, v], axis=1)

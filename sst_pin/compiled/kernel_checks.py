# SPDX-License-Identifier: BSD-2-Clause
"""Validity checks, returned with the results of a kernel: valid if each is at most 1.

They fail if the loops of a sample are open, if a pivot is much smaller than in the sample
configurations, if a redundant row does not hold, or if a solution x of a linear system A x = b
leaves a residual r = A x - b that is larger than rounding.

**Residuals.** Rounding alone gives |r| of some eps |A| |x|; the bound is `_ROUNDINGS` times that.
Elimination leaves more only where a small pivot makes entries grow. Computing all of r costs as
much as a product with A, for each solution. Instead one number is computed, s . r = (s^T A) x -
s . b with a fixed vector s of random signs: s^T A is computed once for all solutions.

One number is enough. For random signs the mean of (s . r)^2 is |r|^2. The errors in r come from
different roundings, so that s . r is close to a normal variable of that size: it is below |r| / K
with a probability of about 0.8 / K. A residual of 100 times the bound passes in less than one of
100 samples, and it would do harm to the twelfth digit only: 100 * 30 eps is 1e-12. Larger ones pass
as much less often as they are larger. The signs are the same in all runs, so that a sample has the
same verdict each time.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from casadi import SX

from ..arrays import Array
from ..model.thresholds import (
    CLOSURE_TOLERANCE,
    INCONSISTENT,
    LEAST_LENGTH,
    ROUNDING,
    UNSUPPLIED,
    WITHOUT_MASS,
)
from .elimination import Factors, total
from .equations import Equations
from .symbols import Sparse, add, column, is_zero

#: Largest residual of the closures: half of the reference path's tolerance.
CLOSED = 0.5 * CLOSURE_TOLERANCE
#: Largest residual of a solution, in roundings of the matrix times the solution.
_ROUNDINGS = 30
#: The largest part of a force that may be missing is UNSUPPLIED, or this many roundings if that is
#: more, as in single precision.
_MISSING = 1e4
#: Rounding of the sum of all forces, free of units.
_BALANCED = 1e-14
#: Rounding of double precision, for which the thresholds are chosen.
_DOUBLE = float(np.finfo(float).eps)
#: Solutions up to this count as zero, [rad/s], [N m] and the like.
_NOTHING = 1e-10


class Checks:
    """Checks of one robot's kernels.

    `closed` is the largest scaled residual of the closures, `rounding` that of the numbers.
    """

    def __init__(
        self, equations: Equations, closed: float = CLOSED, rounding: float = _DOUBLE
    ) -> None:
        self._equations = equations
        self._closed = closed
        self._rounding = rounding
        mechanism = equations.mechanism
        self._row_scale = mechanism.row_scale
        self._rate_scale = mechanism.rate_scale
        self._dependent = [int(i) for i in mechanism.dependent]

    @cached_property
    def of_state(self) -> list[Any]:
        """Checks that loops are closed, pivots large, lines long, and that redundant rows hold."""
        e = self._equations
        # The sum of squares of the scaled residuals: at most the square of the bound only if each
        # residual is at most the bound. A largest element would need a branch for each.
        gaps = [s**2 * x.squared_gap for s, x in zip(self._row_scale, e.rows, strict=True)]
        gaps += [gap**2 for gap in e.kinematics.unit_gaps]
        open_loops = total(gaps) / self._closed**2
        parts = zip(e.factors.parts, e.pivots.sizes, strict=True)
        small_pivots = total(part.small(sizes) for part, sizes in parts)
        # Twice the bound of the reference path, which then decides near it.
        least = 2 * LEAST_LENGTH * e.mechanism.length
        short_lines = [least / line.length for line in e.tree.lines]
        return [open_loops, small_pivots, *self._redundant_in_rates, *short_lines]

    # --- redundant rows -----------------------------------------------------------------------

    @cached_property
    def _redundant(self) -> list[int]:
        """Rows that solutions leave out, or fit by least squares."""
        e = self._equations
        exact = {i for part in e.factors.parts if isinstance(part, Factors) for i in part.rows}
        return [i for i, row in enumerate(e.rows) if row.Phi and i not in exact]

    @property
    def _slack(self) -> float:
        """Largest violation of redundant rows, free of units."""
        return 2 * INCONSISTENT * self._closed  # `closed` is half of the reference path's tolerance

    @property
    def _redundant_in_rates(self) -> list[Any]:
        """More than 1 where redundant rows allow fewer rates than the others: Phi L = 0."""
        e = self._equations
        if not self._redundant:
            return []
        units = self._rate_scale[e.mechanism.coordinates]
        squares = []
        for i in self._redundant:
            for L, unit in zip(e.L, units, strict=True):
                violation = total(x * L[j] for j, x in e.rows[i].Phi.items() if j in L)
                squares.append((self._row_scale[i] * unit * violation) ** 2)
        return [total(squares) / self._slack**2]

    def redundant_in_accelerations(self, x: Sparse) -> list[Any]:
        """More than 1 where accelerations x at v violate redundant rows: Phi x + Phi_dot v = 0.

        Where only rates fit the closures, as in the pose in which a braced frame shakes, redundant
        rows are left over. There is no check without redundant rows.

        As `JointComplement.require_accelerations`, the violation r is compared with |v|^2 + |x|,
        free of units: Phi_dot v grows with the square of v. Kernels compare squares,
        |r|^2 <= slack^2 (|v|^4 + |x|^2), because roots and divisions are slow, and v and x may be
        zero. This is the same bound up to a factor of sqrt(2).
        """
        e = self._equations
        if not self._redundant:
            return []
        scale = self._rate_scale
        no_accelerations: Sparse = {}
        violations = []
        for i in self._redundant:
            row = e.rows[i]
            of_x = total(entry * x[j] for j, entry in row.Phi.items() if j in x)
            violations.append(self._row_scale[i] * (row.acceleration(e.v, no_accelerations) + of_x))
        r_squared = total(violation**2 for violation in violations)
        v_squared = total((rate / float(scale[j])) ** 2 for j, rate in e.v.items())
        x_squared = total((rate / float(scale[j])) ** 2 for j, rate in x.items())
        excess = r_squared / self._slack**2 - v_squared**2 - x_squared
        return [excess / _NOTHING**2]  # at most 1 also where all three are zero, up to rounding

    # --- solutions of a quantity --------------------------------------------------------------

    def solved(self, x: Sparse) -> list[Any]:
        """Checks that accelerations x solve Phi x = -Phi_dot v, Eq. (8), in redundant rows too."""
        return self.unsolved(x, self._equations.drift) + self.redundant_in_accelerations(x)

    @property
    def of_rates(self) -> list[Any]:
        """Checks that v solves Phi v = 0."""
        return self.unsolved(self._equations.v, {})

    @property
    def of_steady_motion(self) -> list[Any]:
        """Checks that redundant rows allow the motion with constant rates of the coordinates."""
        return self.redundant_in_accelerations(self._equations.at_rest)

    @property
    def of_forces(self) -> list[Any]:
        """Checks of all linear solutions in inverse dynamics."""
        e = self._equations
        return self.of_rates + self.solved(e.dv) + self.unbalanced(e.tree_forces)

    @property
    def of_complement(self) -> list[Any]:
        """Checks that the columns of L solve Phi x = 0."""
        return [check for x in self._equations.L for check in self.unsolved(x, {})]

    @property
    def of_accelerations(self) -> list[Any]:
        """Checks of all linear solutions in direct dynamics but that with the mass matrix.

        `at_rest` are the accelerations of the joints where those of the coordinates are zero.
        """
        e = self._equations
        return self.of_rates + self.solved(e.at_rest) + self.of_complement

    @property
    def of_motors(self) -> list[Any]:
        """A check that the motors hold all coordinates; none where each holds its own."""
        e = self._equations
        if e.mechanism.driven_one_to_one:
            return []
        factors, sizes = e.motor_factors
        return [factors.small(sizes)]

    @property
    def massless(self) -> list[Any]:
        """More than 1 where a pivot of the mass matrix is negative or too small.

        It is too small below rounding of its diagonal entry plus a part of the inertia of the whole
        robot. The sum over all pivots is stricter than each by itself.
        """
        e = self._equations
        factors = e.inertia_factors
        scale = self._rate_scale
        least = WITHOUT_MASS * e.tree.whole_inertia
        precision = self._rounding / _DOUBLE
        small = []
        for inverse, entry, L in zip(factors.inverses, factors.diagonal, e.L, strict=True):
            fastest = total((x / float(scale[j])) ** 2 for j, x in L.items())
            small.append(inverse * (precision * ROUNDING * entry + least * fastest))
        negative = total(ca.fabs(x) - x for x in factors.inverses)  # zero if all are positive
        return [1e30 * negative, total(small)]  # any negative pivot fails

    def unsolved(self, x: Sparse, right: Sparse) -> list[Any]:
        """More than 1 where the rates x do not solve Phi x = right because a pivot was small.

        Only rows that elimination changes count: in the others no entry can grow. There is no
        check if there are none.
        """
        unit, signs, sums = self._row_sums
        terms = [entry * x[j] for j, entry in sums.items() if j in x]
        terms += [-(sign * right[i]) for i, sign in signs.items() if i in right]
        scale = self._rate_scale
        return self._exceeds(unit, terms, [x[j] / scale[j] for j in self._dependent if j in x])

    def unbalanced(self, tau: Sparse) -> list[Any]:
        """More than 1 where the multipliers do not balance tau along the dependent rates."""
        unit, signs, sums = self._column_sums
        x = self._equations.multipliers(tau)
        scale = self._row_scale
        terms = [entry * x[i] for i, entry in sums.items() if i in x]
        terms += [-(sign * tau[j]) for j, sign in signs.items() if j in tau]
        return self._exceeds(unit, terms, [x[i] / scale[i] for i in x])

    def unsupplied(self, tau: Sparse, f: SX) -> list[Any]:
        """2 for each coordinate where motor torques leave more of f over than rounding, else 0.

        The rest of f is compared with the torques that act on the coordinate, and with the rounding
        of all coordinates.
        """
        e = self._equations
        precision = self._rounding / _DOUBLE
        A = e.motor_matrix
        units = self._rate_scale[e.mechanism.coordinates]
        sizes = units * (ca.fabs(A) @ ca.fabs(column(tau, range(A.shape[1]))))
        left = units * ca.fabs(A @ column(tau, range(A.shape[1])) - f)
        floor = _BALANCED * precision * ca.sum1(sizes)
        most = max(UNSUPPLIED, _MISSING * self._rounding)
        return ca.vertsplit(2 - 2 * (left <= most * sizes + floor))

    @cached_property
    def _row_sums(self) -> tuple[float, dict[int, float], Sparse]:
        """A unit, the vector s, by row, and s^T Phi, by rate."""
        e = self._equations
        unit, signs = _signs(e.factors.changed[0], self._row_scale)
        sums: Sparse = {}
        for i, sign in signs.items():
            sums = add(sums, {j: sign * x for j, x in e.rows[i].Phi.items()})
        return unit, signs, sums

    @cached_property
    def _column_sums(self) -> tuple[float, dict[int, float], Sparse]:
        """A unit, the vector s, by rate, and Phi s, by row."""
        e = self._equations
        unit, signs = _signs(e.factors.changed[1], self._rate_scale)
        sums = {
            i: total(signs[j] * x for j, x in e.rows[i].Phi.items() if j in signs)
            for i in e.factors.rows
        }
        return unit, signs, {i: x for i, x in sums.items() if not is_zero(x)}

    def _exceeds(self, unit: float, terms: list[Any], solution: list[Any]) -> list[Any]:
        """More than 1 where a residual is too large for its solution.

        The check is |s . r|^2 / bound^2 <= |x|^2 + _NOTHING^2, without a division by x, which may
        be zero. The result is at most 1 where it holds. `terms` are those of s . r; as s is divided
        by `unit`, so is the bound.
        """
        if not terms:
            return []
        bound = _ROUNDINGS * self._rounding * self._equations.pivots.norm / unit
        excess = (total(terms) / bound) ** 2 - total(x**2 for x in solution)
        return [excess / _NOTHING**2]


def _signs(places: Sequence[int], scale: Array) -> tuple[float, dict[int, float]]:
    """A unit, and the vector s: random signs, always the same, times the scales in this unit.

    The unit is the first scale. If all are equal, s is 1 or -1 and its products cost nothing.
    """
    unit = float(scale[places[0]]) if places else 1.0
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=len(places))
    return unit, {i: float(x * scale[i] / unit) for i, x in zip(places, signs, strict=True)}

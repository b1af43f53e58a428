# SPDX-License-Identifier: BSD-2-Clause
"""Validity checks: numbers that a kernel returns beside its results, at most 1 if these are right.

A kernel is code without branches. Its order of elimination was chosen at a few sample
configurations and is not valid everywhere. So a kernel returns checks of

- the state: the loops are closed, no pivot is much smaller than at the sample configurations;
- redundant rows: the solution of Phi x = b satisfies them too;
- solutions x of linear systems A x = b: the residual A x - b is no larger than rounding;
- the motors and the mass matrix.

Checks have no branches either, because kernels compute several samples side by side. If b may be
zero, the condition |a| <= |b| is checked as a^2 - b^2 <= 0 up to rounding, not as a / b <= 1.

**Redundant rows.** At regular configurations, redundant rows of Phi follow from the others. Phi_u,
the columns of the dependent rates, is factorised in parts of two kinds (see `loop_factors`):

- A part of the class `Factors` solves as many rows as it has dependent rates, by elimination. It
  leaves its redundant rows out.
- A part of the class `Orthogonal` fits its rows by least squares.

*Rows at risk* are rows that a solution may violate: the rows left out, and the rows fitted.

**Residuals.** A computed solution x of A x = b leaves the residual r = A x - b. Rounding alone
makes |r| a few times eps |A| |x|, where eps is the relative rounding of a number. The bound is
`_ROUNDINGS` times eps |A| |x|. Elimination leaves more only where a small pivot makes entries grow.
Computing r would cost a product with A for each solution. Instead a kernel computes one number,

    s . r = (s^T A) x - s . b,

with a fixed *probe vector* s of random signs. It computes s^T A once for all solutions.

One number is enough. The entries of r come from different roundings. With random signs, s . r is
close to a normal variable with mean zero and standard deviation |r|. The density of this variable
is at most 0.4 / |r|. Let |r| be k times the bound. The check misses this if s . r is between
-|r| / k and |r| / k. The probability of this is at most the density times the width of this
interval: 0.4 / |r| * 2 |r| / k = 0.8 / k. An example is k = 100, where |r| = 100 * 30 eps |A| |x|
is still only 7e-13 |A| |x|. It is missed in less than one of 100 samples. The signs are the same in
all runs, so that a sample gets the same verdict each time.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

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

#: Largest residual of the closures: half of the reference path's tolerance, so that the reference
#: path accepts what kernels accept.
CLOSED = 0.5 * CLOSURE_TOLERANCE
#: Rounding of double precision, for which the thresholds are chosen.
_DOUBLE = float(np.finfo(float).eps)
#: Largest residual of a solution x, in multiples of eps |A| |x|. Elimination without growth leaves
#: a few multiples for each unknown of a loop.
_ROUNDINGS = 30
#: A force counts as supplied if the missing fraction is below `UNSUPPLIED`, or below this many
#: roundings, because linear solutions may lose four digits. In single precision, this bound is the
#: larger one.
_MISSING = 1e4
#: Relative rounding error of the sum of all forces in double precision: the sum has some tens of
#: terms, each with its rounding.
_BALANCED = 1e-14
#: Solutions up to this count as zero, [rad/s], [N m] and the like. For a robot at rest, solutions
#: consist of rounding and have no size with which a residual could be compared.
_NEGLIGIBLE = 1e-10


class _Probe(NamedTuple):
    """The probe vector s of residuals A x - b, and s^T A.

    The entries of s are random signs times the scales that make rows of A free of units, divided by
    `unit`, which is the first of these scales. So the entries are 1 or -1 if all scales are equal,
    and products with them cost nothing. The division changes no check, because the bound of s . r
    is divided by `unit` too.

    There are two systems:

    - Phi x = b for rates x: the rows of A are rows of Phi, its columns are rates;
    - Phi_u^T x = b for multipliers x: the rows of A are dependent rates, its columns are rows of
      Phi.
    """

    unit: float
    #: The entries of s, by row of A.
    s: dict[int, float]
    #: s^T A, by column of A; zeros are left out.
    sums: Sparse


class Checks:
    """Checks of one robot's kernels.

    A kernel returns `of_state` and the checks of its quantity. Members return lists of checks. A
    list is empty if there is nothing to check, for instance if a robot has no redundant rows. Only
    `small_pivots` and `unit_lengths` return a single expression.

    Args:
        equations: The equations of the robot.
        closed: Largest residual of the closures, free of units.
        rounding: Relative rounding of the kernel's numbers.
    """

    def __init__(
        self, equations: Equations, closed: float = CLOSED, rounding: float = _DOUBLE
    ) -> None:
        self._equations = equations
        self._closed = closed
        self._rounding = rounding
        #: How much coarser the numbers are than those of double precision.
        self._coarseness = rounding / _DOUBLE
        mechanism = equations.mechanism
        self._row_scale = mechanism.row_scale
        self._rate_scale = mechanism.rate_scale
        self._dependent = [int(i) for i in mechanism.dependent]

    # --- the state ----------------------------------------------------------------------------

    @cached_property
    def of_state(self) -> list[Any]:
        """Checks that all kernels have.

        Loops are closed, pivots and lines are not too short, and redundant rows allow all rates.
        """
        return [
            self._open_loops,
            self.small_pivots,
            *self._redundant_in_rates,
            *self._short_lines,
        ]

    @property
    def _open_loops(self) -> Any:
        """The sum of squares of the scaled residuals, relative to the square of the bound.

        If it is at most 1, each residual is at most the bound. To find the largest residual would
        take a branch for each. The term of a row is its squared scale times `Row.squared_gap`. Some
        rows that hold rotations have only one gap together, such as the two rows that keep the axis
        of a hinge parallel: the first row has this gap, and the others have zero. The scales of
        all rows that hold rotations are 1.
        """
        e = self._equations
        rows = zip(self._row_scale, e.rows, strict=True)
        squares = [scale**2 * row.squared_gap for scale, row in rows]
        return total(squares) / self._closed**2 + self.unit_lengths

    @property
    def unit_lengths(self) -> Any:
        """The term of `_open_loops` for the unit vectors of q: quaternions, cosine-sine pairs."""
        return total(gap**2 for gap in self._equations.kinematics.unit_gaps) / self._closed**2

    @property
    def small_pivots(self) -> Any:
        """More than 1 where a pivot of Phi_u is much smaller than at the sample configurations.

        A pivot is too small if it is less than 1/1000 of `size`, its largest one at the sample
        configurations. `pivot_check` of a part returns the sum of (size / (1000 pivot))^2 over its
        pivots. An `Orthogonal` has squared lengths in the place of pivots: a length less than
        1/1000 of its largest one has a square less than 1/1000^2, so 1000 is squared there.
        """
        e = self._equations
        parts = zip(e.factors.parts, e.pivots.sizes, strict=True)
        return total(part.pivot_check(sizes) for part, sizes in parts)

    @property
    def _short_lines(self) -> list[Any]:
        """For each line the shortest valid length over its length.

        A line without length has no direction. The shortest valid length is twice that of the
        reference path, which decides about lines with lengths between both.
        """
        e = self._equations
        least = 2 * LEAST_LENGTH * e.mechanism.length
        return [least / line.length for line in e.tree.lines]

    # --- rows at risk -------------------------------------------------------------------------

    @cached_property
    def _rows_at_risk(self) -> list[int]:
        """Rows of Phi that a solution of Phi x = b may violate, by number.

        These are all rows but those that a part of the class `Factors` solves. Rows without entries
        are left out, because no rates can violate them.
        """
        e = self._equations
        solved = set[int]()
        for part in e.factors.parts:
            if isinstance(part, Factors):
                solved.update(part.rows)
        return [i for i, row in enumerate(e.rows) if row.Phi and i not in solved]

    @property
    def _largest_violation(self) -> float:
        """Largest violation of the rows at risk, free of units.

        `INCONSISTENT` is in multiples of the tolerance of closed loops, which is twice `closed`;
        see `CLOSED`.
        """
        return 2 * INCONSISTENT * self._closed

    @property
    def _redundant_in_rates(self) -> list[Any]:
        """More than 1 where the rates L va violate rows at risk: Phi L != 0.

        There the redundant rows allow fewer rates than the others.
        """
        e = self._equations
        if not self._rows_at_risk:
            return []
        units = self._rate_scale[e.mechanism.coordinates]
        squares = []
        for i in self._rows_at_risk:
            for L, unit in zip(e.L, units, strict=True):
                # Row i of Phi times a column of L.
                violation = total(x * L[j] for j, x in e.rows[i].Phi.items() if j in L)
                squares.append((self._row_scale[i] * unit * violation) ** 2)
        return [total(squares) / self._largest_violation**2]

    def redundant_in_accelerations(self, x: Sparse) -> list[Any]:
        """More than 1 where accelerations x at v violate rows at risk: Phi x + Phi_dot v != 0.

        At some poses the rates fit all rows but the accelerations do not. An example is the pose in
        which an overconstrained frame can shake but not move.

        r = Phi x + Phi_dot v is the violation, free of units. Phi_dot v grows with the square of v.
        So the reference path (`JointComplement.require_accelerations`) requires

            |r| <= bound (|v|^2 + |x|).

        Kernels compare squares, because roots are slow: |r|^2 <= bound^2 (|v|^4 + |x|^2), which is
        the same bound up to a factor of sqrt(2). They subtract, because v and x may be zero:

            (|r|^2 / bound^2 - |v|^4 - |x|^2) / negligible^2 <= 1,

        which also holds where r, v and x are zero up to rounding.
        """
        e = self._equations
        if not self._rows_at_risk:
            return []
        scale = self._rate_scale
        no_accelerations: Sparse = {}
        violations = []
        for i in self._rows_at_risk:
            row = e.rows[i]
            Phi_x = total(entry * x[j] for j, entry in row.Phi.items() if j in x)
            # The acceleration of a row at rates v and accelerations dv is Phi dv + Phi_dot v.
            Phi_dot_v = row.acceleration(e.v, no_accelerations)
            violations.append(self._row_scale[i] * (Phi_dot_v + Phi_x))
        r_squared = total(violation**2 for violation in violations)
        v_squared = total((rate / float(scale[j])) ** 2 for j, rate in e.v.items())
        x_squared = total((entry / float(scale[j])) ** 2 for j, entry in x.items())
        excess = r_squared / self._largest_violation**2 - v_squared**2 - x_squared
        return [excess / _NEGLIGIBLE**2]

    # --- residuals of linear solutions --------------------------------------------------------

    def unsolved(self, x: Sparse, right: Sparse) -> list[Any]:
        """More than 1 where the rates x do not solve Phi x = right because a pivot was small.

        Only rows with entries that elimination changes are checked: in the others no entry can
        grow. Rows of an `Orthogonal` are not among them, because no entry of it grows. The residual
        takes all of x. The bound takes only its dependent rates x_u as |x|: the other rates are
        known, and x_u solves a system with the matrix Phi_u.
        """
        scale = self._rate_scale
        sizes = [x[j] / scale[j] for j in self._dependent if j in x]
        return self._large_residual(self._probe_of_rates, x, right, sizes)

    def unbalanced(self, tau: Sparse) -> list[Any]:
        """More than 1 where the multipliers x do not solve Phi_u^T x = tau_u.

        tau_u are the forces tau along the dependent rates. The equations of this system are the
        columns of Phi_u. Only columns with entries that elimination changes are checked, for the
        same reason as in `unsolved`.
        """
        x = self._equations.multipliers(tau)
        scale = self._row_scale
        return self._large_residual(
            self._probe_of_multipliers, x, tau, [x[i] / scale[i] for i in x]
        )

    @cached_property
    def _probe_of_rates(self) -> _Probe:
        """The probe of Phi x = b, on the rows of Phi that elimination changes."""
        e = self._equations
        rows, _ = e.factors.changed_elements  # of Phi_u: rows and columns that elimination changes
        unit, s = _random_signs(rows, self._row_scale)
        s_Phi: Sparse = {}  # s^T Phi, by rate
        for i, sign in s.items():
            s_Phi = add(s_Phi, {j: sign * entry for j, entry in e.rows[i].Phi.items()})
        return _Probe(unit, s, s_Phi)

    @cached_property
    def _probe_of_multipliers(self) -> _Probe:
        """The probe of Phi_u^T x = b, on the columns of Phi_u that elimination changes."""
        e = self._equations
        _, columns = e.factors.changed_elements  # of Phi_u, as in `_probe_of_rates`
        unit, s = _random_signs(columns, self._rate_scale)
        Phi_s: Sparse = {}  # s^T Phi_u^T, by row of Phi
        for i in e.factors.rows:
            entry = total(s[j] * x for j, x in e.rows[i].Phi.items() if j in s)
            if not is_zero(entry):
                Phi_s[i] = entry
        return _Probe(unit, s, Phi_s)

    def _large_residual(
        self, probe: _Probe, x: Sparse, b: Mapping[int, Any], sizes: Iterable[Any]
    ) -> list[Any]:
        """More than 1 where the residual r of A x = b is too large.

        The condition is |s . r| <= 30 eps |A| |x|. As |x| may be zero, squares are subtracted, and
        a negligible |x| counts as zero:

            ((s . r)^2 / (30 eps |A|)^2 - |x|^2) / negligible^2 <= 1.

        Args:
            probe: The vector s, and s^T A.
            x: The solution, by column of A.
            b: The right side, by row of A.
            sizes: The entries of x that make up |x|, free of units.
        """
        terms = [entry * x[j] for j, entry in probe.sums.items() if j in x]
        terms += [-(sign * b[i]) for i, sign in probe.s.items() if i in b]
        if not terms:
            return []
        s_r = total(terms)
        # For |A|, `pivots.norm` is the largest norm of Phi_u in the samples, free of units. As s is
        # divided by the probe's unit, so is the bound.
        bound = _ROUNDINGS * self._rounding * self._equations.pivots.norm / probe.unit
        excess = (s_r / bound) ** 2 - total(size**2 for size in sizes)
        return [excess / _NEGLIGIBLE**2]

    # --- the solutions that a quantity needs --------------------------------------------------

    @property
    def of_rates(self) -> list[Any]:
        """Checks that v solves Phi v = 0."""
        return self.unsolved(self._equations.v, {})

    def of_joint_accelerations(self, x: Sparse) -> list[Any]:
        """Checks that accelerations x solve Phi x = -Phi_dot v, Eq. (8), in redundant rows too."""
        right = self._equations.drift  # -Phi_dot v
        return self.unsolved(x, right) + self.redundant_in_accelerations(x)

    @property
    def of_complement(self) -> list[Any]:
        """Checks that the columns of L solve Phi x = 0."""
        checks = list[Any]()
        for L in self._equations.L:
            checks += self.unsolved(L, {})
        return checks

    @property
    def of_steady_motion(self) -> list[Any]:
        """Checks that redundant rows allow the motion with constant rates of the coordinates."""
        return self.redundant_in_accelerations(self._equations.dv_without_aa)

    @property
    def of_forces(self) -> list[Any]:
        """Checks of all linear solutions in inverse dynamics."""
        e = self._equations
        return self.of_rates + self.of_joint_accelerations(e.dv) + self.unbalanced(e.tree_forces)

    @property
    def of_accelerations(self) -> list[Any]:
        """Checks of all linear solutions in direct dynamics but the one with the mass matrix.

        Direct dynamics uses the accelerations of the joints for aa = 0.
        """
        e = self._equations
        return self.of_rates + self.of_joint_accelerations(e.dv_without_aa) + self.of_complement

    # --- motors and mass ----------------------------------------------------------------------

    @property
    def of_motors(self) -> list[Any]:
        """A check that the motors hold all coordinates; none if each motor drives one coordinate.

        Where they do not hold them, the rows of the motor matrix L^T B are dependent, and a pivot
        is small against its size in the samples.
        """
        e = self._equations
        if e.mechanism.driven_one_to_one:
            return []
        factors, sizes = e.motor_factors
        return [factors.pivot_check(sizes)]

    def unsupplied(self, tau: Sparse, f: SX) -> list[Any]:
        """For each coordinate 2 if the motor torques tau do not supply the force f, else 0.

        The missing part of f is compared with the sum of the sizes of all torques that act on the
        coordinate, and with the rounding of the forces on all coordinates.
        """
        e = self._equations
        A = e.motor_matrix
        torques = column(tau, range(A.shape[1]))
        units = self._rate_scale[e.mechanism.coordinates]
        sizes = units * (ca.fabs(A) @ ca.fabs(torques))
        missing = units * ca.fabs(A @ torques - f)
        largest_part = max(UNSUPPLIED, _MISSING * self._rounding)
        rounding_of_all = _BALANCED * self._coarseness * ca.sum1(sizes)
        is_supplied = missing <= largest_part * sizes + rounding_of_all
        return ca.vertsplit(2 - 2 * is_supplied)

    @property
    def massless(self) -> list[Any]:
        """More than 1 where a pivot of the mass matrix A = L^T M L is negative or too small.

        All must be positive, and the pivot of coordinate k must be larger than

            ROUNDING A_kk + WITHOUT_MASS I |L e_k|^2,

        with the inertia I of the whole robot. In single precision, ROUNDING is multiplied by
        `_coarseness`. I |L e_k|^2 is the inertia that the coordinate would have if all bodies moved
        as the joints do at its unit rate.

        The factors have the inverses of the pivots and the entries A_kk. Both are in the order of
        the coordinates, as the columns L e_k are. The first check refuses negative pivots. A
        positive pivot is large enough if its bound times its inverse is at most 1. The second check
        is the sum of these products over all pivots: one check for all, and a little stricter.
        """
        e = self._equations
        factors = e.inertia_factors
        scale = self._rate_scale
        least_inertia = WITHOUT_MASS * e.tree.whole_inertia
        products = []
        for inverse, entry, L in zip(factors.inverses, factors.diagonal, e.L, strict=True):
            L_squared = total((x / float(scale[j])) ** 2 for j, x in L.items())
            least_pivot = self._coarseness * ROUNDING * entry + least_inertia * L_squared
            products.append(inverse * least_pivot)
        negative = total(ca.fabs(x) - x for x in factors.inverses)  # zero if all are positive
        return [1e30 * negative, total(products)]  # 1e30: any negative pivot is refused


def _random_signs(indices: Sequence[int], scale: Array) -> tuple[float, dict[int, float]]:
    """`_Probe.unit`, the first scale, and `_Probe.s`; the signs are the same at each call."""
    if not indices:
        return 1.0, {}
    unit = float(scale[indices[0]])
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=len(indices))
    s = {i: float(sign * scale[i] / unit) for i, sign in zip(indices, signs, strict=True)}
    return unit, s

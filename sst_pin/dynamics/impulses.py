# SPDX-License-Identifier: BSD-2-Clause
"""Impulses of stops, dry friction, ropes and contacts in one time step.

The step is that of Moreau and Jean [1]. M is the inertia in the coordinates (with implicit damping
and stiffness), `free` are their rates without impulses, and J is the Jacobian of the rows. Impulses
x change the rates to

    va = free + M^-1 J^T x.

The rows then have the rates w = J va + bias + compliance x. For each row, x and w satisfy a law:

    STOP     0 <= x, 0 <= w, x w = 0                (also for ropes and cables)
    DRY      |x| <= bound; w = 0, or x = -bound sign w
    contact  rows (SIDE, SIDE, NORMAL): the normal row, with x_n, as a stop; the impulse s of both
             sides has |s| <= friction x_n; w_s = 0, or s = -friction x_n w_s / |w_s|
             (Coulomb's cone)

All laws together are x = P(x - w), with the projection P of Alart and Curnier [2]: P clips the
impulses to their bounds and cones. Projected Gauss-Seidel sweeps [3] come near the solution, and
Newton's method on x - P(x - w) finishes. Redundant contacts, as four corners of a sole, make
J M^-1 J^T singular; a proximal term in Newton's matrix makes its equations solvable and leaves the
solution as it is. [4] compares such methods.

`impulses` finds the rows that act and asks `_Problem` for their impulses. `_Problem.solution` makes
series of sweeps and of Newton's steps until the error is small.

[1] M. Jean, The non-smooth contact dynamics method, Comput. Methods Appl. Mech. Eng. 177 (1999).
[2] P. Alart, A. Curnier, A mixed formulation for frictional contact problems prone to Newton like
    solution methods, Comput. Methods Appl. Mech. Eng. 92 (1991).
[3] F. Jourdan, P. Alart, M. Jean, A Gauss-Seidel like algorithm to solve frictional contact
    problems, Comput. Methods Appl. Mech. Eng. 155 (1998).
[4] V. Acary, M. Bremond, O. Huber, On solving contact problems with Coulomb friction: formulations
    and numerical comparisons, in: Advanced Topics in Nonsmooth Dynamics (2018).
"""

from typing import NamedTuple

import numpy as np

from ..arrays import Array, Flags, Indices

# Kinds of rows.
STOP = 0
DRY = 1
SIDE = 2
NORMAL = 3
#: The error is the largest entry of x - P(x - w), relative to the largest impulse. Impulses up to
#: this error are a solution. Rows are divided by the roots of their diagonal entries of
#: J M^-1 J^T first, so that all impulses have the same unit, the root of an energy.
SOLVED = 1e-9
#: Newton's method goes on to this error. Its last step squares the error, so that most solutions
#: are exact to rounding.
_ROUNDING = 1e-11

# A series is some sweeps and then some of Newton's steps; see `_Problem.solution`.
#: Sweeps of a series.
_SWEEPS = 10
#: The most Newton steps of a series.
_STEPS = 20
#: The most series.
_SERIES = 30
#: From this series on, a solution need not be exact to rounding.
_REFINED = 3
#: The error is divided by the largest impulse. If a step has no solution, its impulses grow without
#: bound, and this quotient would become small. So the divisor is at most this multiple of the
#: largest entry of u, the rates of the rows without impulses (see `_Problem`). In the divided
#: rows, u has the same unit as the impulses. A choice.
_LARGEST = 1e3
#: Proximal terms of the series in turn, relative to the diagonal of J M^-1 J^T; a choice. The first
#: one is small beside the regular parts of this matrix. Redundant contacts can contradict each
#: other, for instance corners of a sole that begins to tilt. Larger terms then keep Newton's steps
#: short. A contradiction as small as 1e-9 can put the solution far away from the start. Smaller
#: terms then allow the long steps to it.
_PROXIMAL = (1e-6, 1e-8, 1e-3, 1e-7, 1e-5, 1e-2)


class Rows(NamedTuple):
    """Rows of stops, dry friction and contacts on the coordinates.

    Attributes:
        J: Jacobian of the rows on the rates of the coordinates, shape (m, n).
        bias: Rates that are added to J va, shape (m,).
        compliance: Rates per impulse, shape (m,); zero for rigid rows.
        kinds: STOP, DRY, or SIDE, SIDE, NORMAL of a contact, shape (m,).
        bounds: Largest impulse of a DRY row, coefficient of friction at a NORMAL row, shape (m,).
    """

    J: Array
    bias: Array
    compliance: Array
    kinds: Indices
    bounds: Array


class Impulses(NamedTuple):
    """The solution of one step.

    Attributes:
        rates: Rates of the coordinates after the impulses, shape (n,).
        x: Impulses, shape (m,).
        residual: Error of x = P(x - w), see `SOLVED`; infinite if the rates are not finite.
    """

    rates: Array
    x: Array
    residual: float


def impulses(inertia: Array, free: Array, rows: Rows, start: Array) -> Impulses:
    """Impulses of rows on coordinates with an inertia, shape (n, n), and free rates, shape (n,).

    Rows act if they have dry friction, or if they are violated (w < 0) by the free rates, or by the
    rates after the impulses of the rows that act already. Other rows have no impulse. `start` are
    impulses near the solution, shape (m,).
    """
    Y = np.linalg.solve(inertia, rows.J.T)  # M^-1 J^T
    one_sided = (rows.kinds == STOP) | (rows.kinds == NORMAL)
    is_dry = (rows.kinds == DRY) & (rows.bounds > 0)
    # Rows on which the loops allow no motion have zeros on the diagonal of J M^-1 J^T + compliance:
    # their impulses change no rate.
    diagonal = np.einsum("ij,ji->i", rows.J, Y) + rows.compliance
    moves = _of_whole_contacts(diagonal > 0, rows.kinds)

    acting = np.zeros(len(start), dtype=bool)
    x = np.zeros(len(start))
    rates = free
    residual = 0.0
    # At the beginning of each round, x solves the laws of the rows that act, and `rates` are the
    # rates after x. A round looks for other rows that these rates violate. If there are any, they
    # act too, and x is computed anew for all of them. So there are at most m rounds.
    while True:
        w = rows.J @ rates + rows.bias
        needed = _of_whole_contacts(is_dry | (one_sided & (w < 0)), rows.kinds)
        added = needed & ~acting & moves
        if not added.any():
            if not np.isfinite(rates).all():
                residual = np.inf
            return Impulses(rates, x, residual)
        acting |= added
        # Without finite rates, there are no impulses to compute: the step has failed.
        x = np.zeros(len(start))
        residual = np.inf
        if np.isfinite(w).all():
            x[acting], residual = _solved(rows, Y, free, start, acting)
        rates = free + Y @ x


def _of_whole_contacts(flags: Flags, kinds: Indices) -> Flags:
    """The flags of rows, where both sides of a contact have the flag of its normal."""
    flags = flags.copy()
    normals = np.flatnonzero(kinds == NORMAL)
    flags[normals - 1] = flags[normals]
    flags[normals - 2] = flags[normals]
    return flags


def _solved(rows: Rows, Y: Array, free: Array, start: Array, acting: Flags) -> tuple[Array, float]:
    """Impulses of the rows that act, and their residual."""
    J = rows.J[acting]
    A = J @ Y[:, acting] + np.diag(rows.compliance[acting])
    u = J @ free + rows.bias[acting]
    kinds = rows.kinds[acting]
    # Rows are divided by the roots of their diagonal entries. The three rows of a contact have the
    # same divisor, so that the cone of friction stays round.
    sizes = np.diag(A).copy()
    for normal in np.flatnonzero(kinds == NORMAL):
        contact = slice(normal - 2, normal + 1)  # its rows: side, side, normal
        sizes[contact] = sizes[contact].max()
    units = np.sqrt(sizes)
    # Impulses are multiplied by the units, and so are the bounds of dry friction. Those of contacts
    # are coefficients.
    bounds = np.where(kinds == DRY, rows.bounds[acting] * units, rows.bounds[acting])
    problem = _Problem(A / units / units[:, None], u / units, kinds, bounds)
    x, residual = problem.solution(start[acting] * units)
    return x / units, residual


class _Problem:
    """The impulses x of rows that act: x = P(x - w), with their rates w = A x + u.

    A is J M^-1 J^T + diag(compliance), and u are the rates of the rows without impulses. Rows are
    scaled, so that the diagonal of A is at most 1.
    """

    def __init__(self, A: Array, u: Array, kinds: Indices, bounds: Array) -> None:
        self._A = A
        self._u = u
        self._kinds = kinds
        self._bounds = bounds
        self._normals = np.flatnonzero(kinds == NORMAL)
        self._friction = bounds[self._normals]

    def solution(self, start: Array) -> tuple[Array, float]:
        """The solution near a start, and its residual.

        Two of three series sweep from the best impulses so far, which come from Newton's steps. The
        first series and every third one after it sweep from `swept`: the impulses after the sweeps
        of the last such series, before Newton's steps. Each of them makes more sweeps than the one
        before. Neither start is best for all problems.
        """
        swept = start
        best = start
        least = np.inf
        for series in range(_SERIES):
            if series % 3 == 0:
                swept = self._after_sweeps(swept, _SWEEPS * (1 + series))
                x = swept
            else:
                x = self._after_sweeps(best, _SWEEPS)
            x, error = self._newton(x, _PROXIMAL[series % len(_PROXIMAL)])
            if error < least:
                best = x
                least = error
            if least < _ROUNDING or (least < SOLVED and series >= _REFINED):
                break
        return best, least

    def _newton(self, x: Array, proximal: float) -> tuple[Array, float]:
        """The best impulses of some steps of Newton's method from x, and their residual.

        The steps end at a solution to rounding, or at a solution that the next step does not
        improve.
        """
        best = x
        least = np.inf
        largest_size = _LARGEST * float(np.abs(self._u).max())
        for _ in range(_STEPS):
            y = x - self._A @ x - self._u  # x - w
            F = x - self._projected(y)
            error = float(np.abs(F).max())
            size = float(min(np.abs(x).max(), largest_size))
            if error:
                error = error / size if size else np.inf  # relative, see `SOLVED`
            if not error < least and least < SOLVED:
                break
            if error < least:
                best = x
                least = error
            if least < _ROUNDING:
                break
            # With S = dP/dy and dy = dx - A dx, d(x - P(y)) = (1 - S + S A) dx. The proximal term
            # is added to the diagonal of A.
            slopes = self._slopes(y)
            dF = np.eye(len(x)) - slopes + slopes @ self._A + proximal * slopes
            try:
                x = x - np.linalg.solve(dF, F)
            except np.linalg.LinAlgError:
                break
            if not np.isfinite(x).all():
                break
        return best, least

    def _projected(self, y: Array) -> Array:
        """P(y)."""
        clipped = np.clip(y, -self._bounds, self._bounds)
        x = np.where(self._kinds == STOP, np.maximum(y, 0.0), clipped)
        # Contacts: both sides together are shortened to the radius of the cone.
        normal = np.maximum(y[self._normals], 0.0)
        # The sides are the two rows before each normal row; their indices, shape (contacts, 2).
        sides = np.stack((self._normals - 1, self._normals - 2), axis=1)
        sizes = np.linalg.norm(y[sides], axis=1)
        radius = self._friction * normal
        outside = sizes > radius
        factors = np.where(outside, radius / np.where(outside, sizes, 1.0), 1.0)
        x[self._normals] = normal
        x[sides] = y[sides] * factors[:, None]
        return x

    def _slopes(self, y: Array) -> Array:
        """Derivatives of P by y, shape (m, m)."""
        inside = np.where(self._kinds == STOP, y > 0, np.abs(y) <= self._bounds)
        of_contact = (self._kinds == SIDE) | (self._kinds == NORMAL)
        slopes = np.diag(np.where(inside & ~of_contact, 1.0, 0.0))
        for k, friction in zip(self._normals, self._friction, strict=True):
            if not y[k] > 0:
                continue
            slopes[k, k] = 1.0
            sides = slice(k - 2, k)
            size = float(np.linalg.norm(y[sides]))
            radius = friction * y[k]
            if size > radius:  # P is radius times the direction of the sides
                direction = y[sides] / size
                slopes[sides, sides] = radius / size * (np.eye(2) - np.outer(direction, direction))
                slopes[sides, k] = friction * direction
            else:
                slopes[sides, sides] = np.eye(2)
        return slopes

    def _after_sweeps(self, x: Array, count: int) -> Array:
        """Impulses after a number of sweeps of projected Gauss-Seidel."""
        for _ in range(count):
            x = self._swept(x)
        return x

    def _swept(self, x: Array) -> Array:
        """Impulses after one sweep: row by row, the impulse that solves its law for fixed others.

        The sides of a contact come right after its normal row.
        """
        x = x.copy()
        A = self._A
        for i in np.flatnonzero(self._kinds != SIDE):
            x[i] -= (A[i] @ x + self._u[i]) / A[i, i]  # w_i = 0
            if self._kinds[i] == DRY:
                x[i] = min(max(x[i], -self._bounds[i]), self._bounds[i])
                continue
            x[i] = max(x[i], 0.0)
            if self._kinds[i] == NORMAL:
                sides = slice(i - 2, i)
                # One divisor for both sides, not less than the eigenvalues of their block of A.
                trace = A[i - 1, i - 1] + A[i - 2, i - 2]
                in_plane = np.zeros(2)
                if trace > 0:
                    in_plane = x[sides] - (A[sides] @ x + self._u[sides]) / trace
                size = np.linalg.norm(in_plane)
                radius = self._bounds[i] * x[i]
                x[sides] = in_plane if size <= radius else in_plane * (radius / size)
        return x

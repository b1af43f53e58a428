# SPDX-License-Identifier: BSD-2-Clause
"""Impulses of stops, dry friction, ropes and contacts in one time step.

The step is that of Moreau and Jean [1]: rates are free + M^-1 J^T x with impulses x, and w = J
rates + bias + compliance x are the rates of the rows. Row by row,

    STOP     0 <= x, 0 <= w, x w = 0
    DRY      |x| <= bound; w = 0, or x = -bound sign w
    contact  rows (SIDE, SIDE, NORMAL): the normal row as a stop; the impulse s in the plane has
             |s| <= friction x_n; w_s = 0, or s = -friction x_n w_s / |w_s|   (Coulomb's cone)

All of it is x = P(x - w), with the projection P of Alart and Curnier [2]: P clips the impulses to
their bounds and cones. Projected Gauss-Seidel sweeps [3] come near the solution, and Newton's
method on x - P(x - w) finishes. Redundant contacts, as four corners of a sole, make J M^-1 J^T
singular; a proximal term in Newton's matrix leaves the solution as it is. [4] compares such
methods.

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
#: Largest error of x = P(x - w) in a solution, relative to the largest impulse. Both are in the
#: units of the square root of an energy: rows are divided by the square root of their diagonal
#: entries of J M^-1 J^T.
SOLVED = 1e-9
#: Newton's method goes on to this error. Its last step squares the error, so that most solutions
#: are exact to rounding.
_ROUNDING = 1e-11
#: Sweeps before a series of Newton's steps.
_SWEEPS = 10
#: The most steps in a series.
_STEPS = 20
#: The most series.
_SERIES = 30
#: A solution that is not exact to rounding is improved in this number of series.
_REFINED = 3
#: Impulses larger than this multiple of the rates count as this multiple in the error: where no
#: impulses solve a step, they grow without bound.
_LARGEST = 1e3
#: Proximal terms of the series in turn, relative to the diagonal of J M^-1 J^T. Regular parts of
#: this matrix are larger than the first. Where redundant contacts contradict each other, as corners
#: of a sole that begins to tilt, larger ones keep the steps short; smaller ones are for
#: contradictions of a billionth, where the solution is far away.
_PROXIMAL = (1e-6, 1e-8, 1e-3, 1e-7, 1e-5, 1e-2)


class Rows(NamedTuple):
    """Rows of stops, dry friction and contacts on the coordinates.

    Attributes:
        J: Their rates for rates of the coordinates, shape (m, n).
        bias: Rates that are added, shape (m,).
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
        residual: Largest error of x = P(x - w), relative to the largest impulse; see `SOLVED`.
    """

    rates: Array
    x: Array
    residual: float


def impulses(inertia: Array, free: Array, rows: Rows, start: Array) -> Impulses:
    """Impulses of rows on coordinates with an inertia, shape (n, n), and free rates, shape (n,).

    Only rows that act are solved for: dry friction, stops and contacts that the free rates violate,
    and those that the impulses of the others violate. `start` is near the solution, shape (m,).
    """
    Y = np.linalg.solve(inertia, rows.J.T)  # M^-1 J^T
    one_sided = (rows.kinds == STOP) | (rows.kinds == NORMAL)
    is_dry = (rows.kinds == DRY) & (rows.bounds > 0)
    # Impulses of the other rows change no rate: the diagonal of J M^-1 J^T is zero there.
    diagonal = np.einsum("ij,ji->i", rows.J, Y) + rows.compliance
    moves = _of_whole_contacts(diagonal > 0, rows.kinds)

    acting = np.zeros(len(start), dtype=bool)
    x = np.zeros(len(start))
    rates = free
    residual = 0.0
    while True:  # each round adds rows, so that there are at most m rounds
        w = rows.J @ rates + rows.bias
        needed = _of_whole_contacts(is_dry | (one_sided & (w < 0)), rows.kinds)
        added = needed & ~acting & moves
        if not added.any():
            return Impulses(rates, x, residual)
        acting |= added
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
    normals = np.flatnonzero(kinds == NORMAL)
    of_contacts = normals[:, None] - [0, 1, 2]
    sizes[of_contacts] = sizes[of_contacts].max(axis=1, keepdims=True)
    units = np.sqrt(sizes)
    bounds = np.where(kinds == DRY, rows.bounds[acting] * units, rows.bounds[acting])
    problem = _Problem(A / units / units[:, None], u / units, kinds, bounds)
    x, residual = problem.solution(start[acting] * units)
    return x / units, residual


class _Problem:
    """x = P(x - w), w = A x + u, with the diagonal of A at most 1."""

    def __init__(self, A: Array, u: Array, kinds: Indices, bounds: Array) -> None:
        self._A = A
        self._u = u
        self._kinds = kinds
        self._bounds = bounds
        self._normals = np.flatnonzero(kinds == NORMAL)
        self._friction = bounds[self._normals]

    def solution(self, start: Array) -> tuple[Array, float]:
        """The solution near a start, and its residual.

        Every third series of Newton's steps starts from the result of sweeps without Newton's
        steps, which more sweeps continue each time. The others start from the best impulses so far.
        Neither is best for all problems.
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
            near, error = self._newton(x, _PROXIMAL[series % len(_PROXIMAL)])
            if error < least:
                best = near
                least = error
            if least < _ROUNDING or (least < SOLVED and series >= _REFINED):
                break
        return best, least

    def _newton(self, x: Array, proximal: float) -> tuple[Array, float]:
        """The best of some steps of Newton's method, and its residual."""
        best = x
        least = np.inf
        largest = _LARGEST * float(np.abs(self._u).max())
        for _ in range(_STEPS):
            y = x - self._A @ x - self._u  # x - w
            F = x - self._projected(y)
            error = float(np.abs(F).max())
            size = float(min(np.abs(x).max(), largest))
            if error:
                error = error / size if size else np.inf
            if not error < least and least < SOLVED:
                break  # a solution that does not become better
            if error < least:
                best = x
                least = error
            if least < _ROUNDING:
                break
            # With S = dP/dy and dy = dx - A dx, d(x - P(y)) = (1 - S + S A) dx; the proximal term
            # is added.
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
        sides = self._normals[:, None] - [1, 2]
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
        """Impulses after one sweep; the sides of a contact follow its normal row."""
        x = x.copy()
        A = self._A
        for i in np.flatnonzero(self._kinds != SIDE):
            x[i] -= (A[i] @ x + self._u[i]) / A[i, i]
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

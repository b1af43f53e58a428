# SPDX-License-Identifier: BSD-2-Clause
"""Quantities whose columns are computed along directions of the coordinates, side by side.

The code of one direction grows in proportion to the robot, that of whole matrices faster. What no
direction changes is computed once for a sample. The coordinates come in groups (`branches`), and
each group has its own code, a pass, which runs for as many directions at once as a register has
lanes.

Derivatives of accelerations are those of the forces at these accelerations, then one solution with
the inertia matrix, for all columns: docs/derivatives.md, The direct dynamics.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
from casadi import SX

from . import branches, frame_velocities, symbolic_derivatives
from .elimination import total
from .equations import Equations
from .kernel_checks import Checks
from .symbols import Sparse, SymmetricFactors, add, column


class Place(NamedTuple):
    """Where results along the coordinates are: that of coordinate k is at `first` + k `stride`."""

    first: int
    stride: int


class Pass(NamedTuple):
    """Results along some directions of the coordinates."""

    #: The part of the direction along each of these coordinates.
    direction: SX
    #: Indices of the coordinates.
    coordinates: list[int]
    #: Results along the direction, in a column; results that are zero are left out.
    results: SX
    #: Where they are in the result of the quantity.
    places: list[Place]
    #: Checks, as those of a kernel.
    checks: SX


class Solution(NamedTuple):
    """The result is A^-1 times what was computed, A = P^T L D L^T P of full rank."""

    #: Reciprocals of D, then the entries of L below its unit diagonal.
    factors: SX
    #: Row of the result by row of L.
    order: list[int]
    #: Row and column in L of the entries, column by column.
    entries: list[tuple[int, int]]


class Directions(NamedTuple):
    """How a kernel computes its result along directions."""

    #: Size of the result, and of its rows.
    size: int
    width: int
    #: Where the output of the kernel, which is computed once, is in the result.
    places: list[int]
    passes: list[Pass]
    solution: Solution | None = None


#: Results by their places in the result of a quantity; what is left out is zero.
_Placed = dict[Place, SX]
#: Results and checks along a direction.
_Along = Callable[[SX], tuple[_Placed, list[Any]]]


class _ByDirections(NamedTuple):
    """What makes a kernel of one quantity by directions."""

    #: Symbols of each input by its name, column vectors.
    inputs: dict[str, SX]
    #: Size of the result, and of its rows.
    size: int
    width: int
    #: The results that differ from direction to direction.
    along: _Along
    #: Results that are computed once, by their places, and checks of these.
    once: dict[int, SX]
    checks: list[Any]
    solution: Solution | None = None


def make(
    e: Equations, checks: Checks, quantity: str, frame: str | None
) -> tuple[tuple[dict[str, SX], SX, list[Any]], Directions]:
    """Parts of a kernel, of what is computed once for a sample; the rest by directions.

    The parts are inputs, a column of results, and checks.
    """
    if frame is None:
        made = QUANTITIES[quantity](e, checks)
    else:
        made = FRAMES[quantity](e, checks, frame)
    passes = []
    for group in branches.groups(e):
        symbols = SX.sym("direction", len(group))
        direction = SX(len(e.L), 1)
        for k, symbol in zip(group, ca.vertsplit(symbols), strict=True):
            direction[k] = symbol
        placed, more = made.along(direction)
        placed = {place: x for place, x in placed.items() if not x.is_zero()}
        results = ca.vertcat(SX(0, 1), *placed.values())
        of_pass = ca.vertcat(SX(0, 1), *map(SX, more))
        passes.append(Pass(symbols, group, results, list(placed), of_pass))
    once = {place: x for place, x in made.once.items() if not x.is_zero()}
    directions = Directions(made.size, made.width, list(once), passes, made.solution)
    results_once = ca.vertcat(SX(0, 1), *once.values())
    return (made.inputs, results_once, made.checks), directions


def _in_column(x: SX, width: int, first: int) -> _Placed:
    """Entries of a column of a matrix with rows of this width: column `first` for coordinate 0."""
    return {Place(i * width + first, 1): entry for i, entry in enumerate(ca.vertsplit(x))}


def _in_row(x: SX, width: int, first: int = 0) -> _Placed:
    """Entries, from the column `first` on, of a row of a matrix with rows of this width."""
    return {Place(first + i, width): entry for i, entry in enumerate(ca.vertsplit(x))}


def _torque_derivatives(e: Equations, checks: Checks) -> _ByDirections:
    """Derivatives of f by q, va and aa side by side, row by row."""
    n = len(e.L)
    tree = symbolic_derivatives.OnTree(e, e.aa, SX(*e.tau.shape))

    def along(direction: SX) -> tuple[_Placed, list[Any]]:
        by_q, by_va, more = symbolic_derivatives.of_forces_along(e, checks, tree, direction)
        by_aa, of_inertia = symbolic_derivatives.of_inertia_along(e, checks, tree, direction)
        placed = _in_column(by_q, 3 * n, 0) | _in_column(by_va, 3 * n, n)
        return placed | _in_column(by_aa, 3 * n, 2 * n), more + of_inertia

    inputs = {"q": e.q, "va": e.va, "aa": e.aa, "external_wrenches": e.loads}
    return _ByDirections(
        inputs=inputs, size=3 * n * n, width=3 * n, along=along, once={}, checks=checks.of_forces
    )


def _acceleration_derivatives(e: Equations, checks: Checks) -> _ByDirections:
    """Derivatives of aa by q, va and tau side by side, row by row."""
    n = len(e.L)
    motors = e.tau.numel()
    width = 2 * n + motors
    tree = symbolic_derivatives.OnTree(e, e.accelerations, e.tau)
    factors = e.inertia_factors

    def along(direction: SX) -> tuple[_Placed, list[Any]]:
        by_q, by_va, more = symbolic_derivatives.of_forces_along(e, checks, tree, direction)
        if isinstance(factors, SymmetricFactors):
            return _in_column(-by_q, width, 0) | _in_column(-by_va, width, n), more
        of_all = factors.solve(ca.horzcat(-by_q, -by_va, direction))
        by_motors = e.motor_matrix.T @ of_all[:, 2]  # a row: the inverse is symmetric
        placed = _in_column(of_all[:, 0], width, 0) | _in_column(of_all[:, 1], width, n)
        return placed | _in_row(by_motors, width, 2 * n), more

    inputs = {"q": e.q, "va": e.va, "tau": e.tau, "external_wrenches": e.loads}
    more = checks.of_accelerations + checks.massless
    if not isinstance(factors, SymmetricFactors):
        return _ByDirections(
            inputs=inputs, size=n * width, width=width, along=along, once={}, checks=more
        )
    once = {i * width + 2 * n + k: e.motor_matrix[i, k] for i in range(n) for k in range(motors)}
    return _ByDirections(
        inputs=inputs,
        size=n * width,
        width=width,
        along=along,
        once=once,
        checks=more,
        solution=_solution(factors),
    )


def _solution(factors: SymmetricFactors) -> Solution:
    """The solution with a matrix that is factorised."""
    upper = factors.LT
    entries = [(j, i) for i, j in zip(*upper.sparsity().get_triplet(), strict=True)]
    places = sorted(range(len(entries)), key=lambda k: entries[k][::-1])
    values = ca.vertsplit(upper.nz[:])
    column = ca.vertcat(1 / ca.densify(factors.D), SX(0, 1), *(values[k] for k in places))
    return Solution(column, list(factors.order), [entries[k] for k in places])


def _displacement_rates(e: Equations, checks: Checks) -> _ByDirections:
    n = len(e.L)

    def along(direction: SX) -> tuple[_Placed, list[Any]]:
        moved = symbolic_derivatives.of_displacement(e, _step(e, direction))
        return _in_column(moved, n, 0), []

    more = checks.of_rates + checks.of_steady_motion
    return _ByDirections(
        inputs={"q": e.q, "va": e.va}, size=n * n, width=n, along=along, once={}, checks=more
    )


def _reduced_terms(e: Equations, checks: Checks) -> _ByDirections:
    """Inertia and Coriolis matrix, forces of gravity and springs, of friction."""
    n = len(e.L)

    def along(direction: SX) -> tuple[_Placed, list[Any]]:
        step = _step(e, direction)
        change, right = e.held(step, e.Phi_dot)
        inertial = e.tree.forces({}, step, loads=False, weight=False)
        coriolis = e.tree.coriolis_forces(e.v, step, change)
        more = checks.unsolved(step, {}) + checks.unsolved(change, right)
        more += checks.unbalanced(inertial) + checks.unbalanced(coriolis)
        of_inertia = _in_column(e.reduced(inertial), n, 0)
        return of_inertia | _in_column(e.reduced(coriolis), n, n * n), more

    gravity = add(e.tree.forces({}, {}, loads=False), e.tree.springs(e.v))
    friction = e.tree.friction(e.v)
    terms = ca.vertcat(-e.reduced(gravity), -e.reduced(friction))
    once = {2 * n * n + i: x for i, x in enumerate(ca.vertsplit(terms))}
    more = checks.of_rates + checks.of_steady_motion
    more += checks.unbalanced(gravity) + checks.unbalanced(friction)
    return _ByDirections(
        inputs={"q": e.q, "va": e.va},
        size=2 * n * (n + 1),
        width=n,
        along=along,
        once=once,
        checks=more,
    )


def _torque_regressor(e: Equations, checks: Checks) -> _ByDirections:
    """Y row by row: row k has the derivatives of the power along L e_k by all parameters."""
    nv = e.mechanism.model.nv
    blocks = e.parameters.by_parameters()
    sizes = [block.shape[1] for block in blocks]
    motors = len(e.motor_columns)
    width = sum(sizes) + nv + motors
    forces = column(e.tree_forces, range(nv))

    def along(direction: SX) -> tuple[_Placed, list[Any]]:
        step = _step(e, direction)
        rates = column(step, range(nv))
        of_numbers = ca.gradient(ca.dot(rates, forces), e.p).T
        *first, lines = (of_numbers @ ca.sparsify(ca.DM(block)) for block in blocks)
        pushed = (total(x * step[i] for i, x in B.items() if i in step) for B in e.motor_columns)
        row = ca.horzcat(*first, rates.T, lines, *map(SX, pushed))
        return _in_row(row.T, width), checks.unsolved(step, {})

    inputs = {"q": e.q, "va": e.va, "aa": e.aa}
    more = checks.of_rates + checks.solved(e.dv)
    return _ByDirections(
        inputs=inputs, size=len(e.L) * width, width=width, along=along, once={}, checks=more
    )


def _frame_jacobian(e: Equations, checks: Checks, frame: str) -> _ByDirections:
    n = len(e.L)

    def along(direction: SX) -> tuple[_Placed, list[Any]]:
        step = _step(e, direction)
        velocity = frame_velocities.velocity(e, frame, step)
        return _in_column(velocity, n, 0), checks.unsolved(step, {})

    return _ByDirections(inputs={"q": e.q}, size=6 * n, width=n, along=along, once={}, checks=[])


def _frame_jacobian_rate(e: Equations, checks: Checks, frame: str) -> _ByDirections:
    n = len(e.L)

    def along(direction: SX) -> tuple[_Placed, list[Any]]:
        step = _step(e, direction)
        rate, more = frame_velocities.rate_of_column(e, checks, frame, step)
        return _in_column(rate, n, 0), checks.unsolved(step, {}) + more

    more = checks.of_rates + checks.of_steady_motion
    return _ByDirections(
        inputs={"q": e.q, "va": e.va}, size=6 * n, width=n, along=along, once={}, checks=more
    )


def _frame_velocity_derivatives(e: Equations, checks: Checks, frame: str) -> _ByDirections:
    """Derivatives of the velocity by q and va side by side."""
    n = len(e.L)

    def along(direction: SX) -> tuple[_Placed, list[Any]]:
        step = _step(e, direction)
        by_q, more = frame_velocities.derivative_along(e, checks, frame, step)
        by_va = frame_velocities.velocity(e, frame, step)
        placed = _in_column(by_q, 2 * n, 0) | _in_column(by_va, 2 * n, n)
        return placed, checks.unsolved(step, {}) + more

    more = checks.of_rates + checks.of_steady_motion
    return _ByDirections(
        inputs={"q": e.q, "va": e.va}, size=12 * n, width=2 * n, along=along, once={}, checks=more
    )


QUANTITIES: dict[str, Callable[[Equations, Checks], _ByDirections]] = {
    "torque_derivatives": _torque_derivatives,
    "acceleration_derivatives": _acceleration_derivatives,
    "displacement_rates": _displacement_rates,
    "reduced_terms": _reduced_terms,
    "torque_regressor": _torque_regressor,
}
FRAMES: dict[str, Callable[[Equations, Checks, str], _ByDirections]] = {
    "frame_jacobian": _frame_jacobian,
    "frame_jacobian_rate": _frame_jacobian_rate,
    "frame_velocity_derivatives": _frame_velocity_derivatives,
}


def _step(e: Equations, direction: SX) -> Sparse:
    """Rates of the tree along a direction of the coordinates."""
    return e.complete(ca.vertsplit(direction), {})

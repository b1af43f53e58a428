# SPDX-License-Identifier: BSD-2-Clause
"""Kernels that compute matrices column by column, for several columns side by side.

The results of these quantities are matrices (derivatives, mass matrix, Jacobians) with a column, or
a row, for each coordinate. The column or row of coordinate k is computed along the *direction*
L e_k: the motion of the joints for a unit rate of this coordinate. The code for one direction grows
in proportion to the robot; the code for a whole matrix grows faster.

A kernel has two sorts of code:

- one function for all that does not depend on the direction, which runs *once* for a sample;
- *passes*: the coordinates are divided into groups (`branches`), and each group has a function for
  any of its directions. It runs for as many directions at once as a register has lanes.

Derivatives of accelerations can have a last step. The passes compute derivatives of the forces. One
solution with the inertia matrix for all columns makes accelerations of them (docs/derivatives.md,
The direct dynamics).

`make` makes the symbols of a kernel. The functions in `QUANTITIES` and `FRAMES` write down what
each quantity is along a direction.
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


class KernelParts(NamedTuple):
    """Symbols of the inputs, results and checks of one quantity."""

    #: Symbols of each input by its name, column vectors.
    inputs: dict[str, SX]
    #: The results in a column. For a kernel along directions, only those that are computed once.
    output: SX
    #: Checks (see `kernel_checks`), without those of the state.
    checks: list[Any]


class Place(NamedTuple):
    """Where a result along the direction of a coordinate stands in the result of a quantity.

    For coordinate k its index is `first` + k `stride`. The result is a matrix, written row by row.
    The stride is 1 if column k belongs to coordinate k. It is the width of a row if row k does.
    """

    first: int
    stride: int


class Pass(NamedTuple):
    """The results along a direction of a group of coordinates."""

    #: Symbols of a direction: a rate for each coordinate of the group.
    direction: SX
    #: Indices of the coordinates of the group.
    coordinates: list[int]
    #: Results along the direction, in a column; results that are zero are left out.
    results: SX
    #: The place of each result.
    places: list[Place]
    #: Checks of this direction, in a column.
    checks: SX


class Solution(NamedTuple):
    """A last step that multiplies the computed matrix by A^-1, with P^T A P = L D L^T.

    L is lower triangular with ones on its diagonal, D is diagonal and P a permutation.
    """

    #: Reciprocals of D, then the entries of L below its diagonal.
    factors: SX
    #: The row of A for each row of L.
    order: list[int]
    #: Row and column of each entry of L below its diagonal, column by column.
    entries: list[tuple[int, int]]


class Directions(NamedTuple):
    """How a kernel computes its result along directions."""

    #: Number of entries of the result, which is a matrix.
    size: int
    #: Number of columns of the result.
    width: int
    #: For each entry of `KernelParts.output`, its index in the result.
    places: list[int]
    passes: list[Pass]
    #: The last step, if there is one.
    solution: Solution | None = None


#: Results along a direction, by their places. Results that are left out are zero.
_Results = dict[Place, SX]
#: A function of a direction (a rate for each coordinate) that returns results and checks.
_Along = Callable[[SX], tuple[_Results, list[Any]]]


class _QuantitySymbols(NamedTuple):
    """What `make` needs of one quantity: symbols, and the function along a direction."""

    #: Symbols of each input by its name, column vectors.
    inputs: dict[str, SX]
    #: As in `Directions`.
    size: int
    #: As in `Directions`.
    width: int
    #: The function that computes the results along a direction.
    along: _Along
    #: The results that are computed once, by their indices in the result.
    once: dict[int, SX]
    #: Checks that are computed once.
    checks: list[Any]
    solution: Solution | None = None


def make(
    e: Equations, checks: Checks, quantity: str, frame: str | None
) -> tuple[KernelParts, Directions]:
    """The parts of a kernel that are computed once for a sample, and the rest by directions.

    Args:
        e: The equations.
        checks: Checks of the robot's kernels.
        quantity: A name in `QUANTITIES`, or in `FRAMES` if a frame is given.
        frame: The name of a frame; None for a quantity of the whole robot.
    """
    if frame is None:
        symbols = QUANTITIES[quantity](e, checks)
    else:
        symbols = FRAMES[quantity](e, checks, frame)
    passes = [_pass(e, symbols.along, group) for group in branches.groups(e)]
    once = {index: x for index, x in symbols.once.items() if not x.is_zero()}
    directions = Directions(
        size=symbols.size,
        width=symbols.width,
        places=list(once),
        passes=passes,
        solution=symbols.solution,
    )
    output = ca.vertcat(SX(0, 1), *once.values())
    return KernelParts(symbols.inputs, output, symbols.checks), directions


def _pass(e: Equations, along: _Along, group: list[int]) -> Pass:
    """The pass of a group of coordinates."""
    rates = SX.sym("direction", len(group))
    direction = SX(len(e.L), 1)  # zero for all other coordinates
    for k, rate in zip(group, ca.vertsplit(rates), strict=True):
        direction[k] = rate
    results, checks = along(direction)
    results = {place: x for place, x in results.items() if not x.is_zero()}
    return Pass(
        direction=rates,
        coordinates=group,
        results=ca.vertcat(SX(0, 1), *results.values()),
        places=list(results),
        checks=ca.vertcat(SX(0, 1), *map(SX, checks)),
    )


def _in_column(x: SX, width: int, first: int) -> _Results:
    """Places for results x that are column `first` + k of a matrix, for coordinate k.

    `width` is the number of columns of the matrix.
    """
    return {Place(i * width + first, 1): entry for i, entry in enumerate(ca.vertsplit(x))}


def _in_row(x: SX, width: int, first: int = 0) -> _Results:
    """Places for results x that are row k of a matrix, from column `first` on, for coordinate k.

    `width` is the number of columns of the matrix.
    """
    return {Place(first + i, width): entry for i, entry in enumerate(ca.vertsplit(x))}


def _joint_rates(e: Equations, direction: SX) -> Sparse:
    """The rates L x of the tree for a direction x."""
    return e.complete(ca.vertsplit(direction), {})


# --- dynamics -----------------------------------------------------------------------------------


def _torque_derivatives(e: Equations, checks: Checks) -> _QuantitySymbols:
    """Derivatives of f by q, va and aa side by side, shape (n, 3 n)."""
    n = len(e.L)
    width = 3 * n
    no_torques = SX(*e.tau.shape)
    tree = symbolic_derivatives.TreeDerivatives(e, e.aa, no_torques)

    def along(direction: SX) -> tuple[_Results, list[Any]]:
        by_q, by_va, more_checks = symbolic_derivatives.of_forces_along(e, checks, tree, direction)
        by_aa, inertia_checks = symbolic_derivatives.of_inertia_along(e, checks, tree, direction)
        results = _in_column(by_q, width, 0)
        results |= _in_column(by_va, width, n)
        results |= _in_column(by_aa, width, 2 * n)
        return results, more_checks + inertia_checks

    return _QuantitySymbols(
        inputs={"q": e.q, "va": e.va, "aa": e.aa, "external_wrenches": e.loads},
        size=n * width,
        width=width,
        along=along,
        once={},
        checks=checks.of_forces,
    )


def _acceleration_derivatives(e: Equations, checks: Checks) -> _QuantitySymbols:
    """Derivatives of aa by q, va and tau side by side, shape (n, 2 n + motors)."""
    n = len(e.L)
    motors = e.tau.numel()
    width = 2 * n + motors
    tree = symbolic_derivatives.TreeDerivatives(e, e.accelerations, e.tau)
    factors = e.inertia_factors

    def forces_along(direction: SX) -> tuple[_Results, list[Any]]:
        """-f_q and -f_va. The last step multiplies all columns by the inverse inertia matrix."""
        by_q, by_va, more_checks = symbolic_derivatives.of_forces_along(e, checks, tree, direction)
        return _in_column(-by_q, width, 0) | _in_column(-by_va, width, n), more_checks

    def accelerations_along(direction: SX) -> tuple[_Results, list[Any]]:
        """Derivatives of aa, solved by articulated bodies for each direction."""
        by_q, by_va, more_checks = symbolic_derivatives.of_forces_along(e, checks, tree, direction)
        solutions = factors.solve(ca.horzcat(-by_q, -by_va, direction))
        # The third solution is a column of the inverse inertia matrix, which is symmetric. So it is
        # also a row, and row k of the derivatives by tau is this row times L^T B.
        by_tau = e.motor_matrix.T @ solutions[:, 2]
        results = _in_column(solutions[:, 0], width, 0)
        results |= _in_column(solutions[:, 1], width, n)
        results |= _in_row(by_tau, width, 2 * n)
        return results, more_checks

    along = accelerations_along
    once = dict[int, SX]()
    solution = None
    if isinstance(factors, SymmetricFactors):
        along = forces_along
        solution = _solution(factors)
        for i in range(n):
            for motor in range(motors):
                once[i * width + 2 * n + motor] = e.motor_matrix[i, motor]
    return _QuantitySymbols(
        inputs={"q": e.q, "va": e.va, "tau": e.tau, "external_wrenches": e.loads},
        size=n * width,
        width=width,
        along=along,
        once=once,
        checks=checks.of_accelerations + checks.massless,
        solution=solution,
    )


def _solution(factors: SymmetricFactors) -> Solution:
    """The last step for a factorised matrix A."""
    L = factors.LT.T  # CasADi stores it column by column
    rows, columns = L.sparsity().get_triplet()
    inverses = 1 / ca.densify(factors.D)
    return Solution(
        factors=ca.vertcat(inverses, *(L.nz[k] for k in range(L.nnz()))),
        order=list(factors.order),
        entries=list(zip(rows, columns, strict=True)),
    )


def _displacement_rates(e: Equations, checks: Checks) -> _QuantitySymbols:
    """D of `Engine.displacement_rates`, shape (n, n)."""
    n = len(e.L)

    def along(direction: SX) -> tuple[_Results, list[Any]]:
        column_of_D = symbolic_derivatives.displacement_rates_along(e, _joint_rates(e, direction))
        return _in_column(column_of_D, n, 0), []

    return _QuantitySymbols(
        inputs={"q": e.q, "va": e.va},
        size=n * n,
        width=n,
        along=along,
        once={},
        checks=checks.of_rates + checks.of_steady_motion,
    )


def _reduced_terms(e: Equations, checks: Checks) -> _QuantitySymbols:
    """Inertia matrix, Coriolis matrix, forces of gravity with springs, forces of friction.

    The shapes are (n, n), (n, n), (n,) and (n,).
    """
    n = len(e.L)

    def along(direction: SX) -> tuple[_Results, list[Any]]:
        L = _joint_rates(e, direction)
        L_dot, right = e.rates_of_change(L, e.Phi_dot)
        inertial = e.tree.forces({}, L, loads=False, weight=False)
        coriolis = e.tree.coriolis_forces(e.v, L, L_dot)
        more_checks = checks.unsolved(L, {}) + checks.unsolved(L_dot, right)
        more_checks += checks.unbalanced(inertial) + checks.unbalanced(coriolis)
        results = _in_column(e.projected(inertial), n, 0)
        results |= _in_column(e.projected(coriolis), n, n * n)
        return results, more_checks

    gravity = add(e.tree.forces({}, {}, loads=False), e.tree.springs(e.v))
    friction = e.tree.friction(e.v)
    terms = ca.vertcat(-e.projected(gravity), -e.projected(friction))
    once_checks = checks.of_rates + checks.of_steady_motion
    once_checks += checks.unbalanced(gravity) + checks.unbalanced(friction)
    return _QuantitySymbols(
        inputs={"q": e.q, "va": e.va},
        size=2 * n * (n + 1),
        width=n,
        along=along,
        once={2 * n * n + i: x for i, x in enumerate(ca.vertsplit(terms))},
        checks=once_checks,
    )


def _torque_regressor(e: Equations, checks: Checks) -> _QuantitySymbols:
    """Y, shape (n, p): row k has the derivatives of f_k by all parameters of the regressor.

    f_k is the power of the forces of the tree along L e_k.
    """
    nv = e.mechanism.model.nv
    blocks = e.parameters.by_parameters()  # derivatives of p by the parameters
    offsets = nv + len(e.motor_columns)  # one for each rate and each motor
    width = sum(block.shape[1] for block in blocks) + offsets
    forces = column(e.tree_forces, range(nv))

    def along(direction: SX) -> tuple[_Results, list[Any]]:
        L = _joint_rates(e, direction)
        rates = column(L, range(nv))
        by_p = ca.gradient(ca.dot(rates, forces), e.p).T  # derivatives of f_k, shape (1, size of p)
        *bodies_and_joints, lines = (by_p @ ca.sparsify(ca.DM(block)) for block in blocks)
        # The derivative by the offset of a joint force is the rate of the joint, the derivative by
        # the offset of a motor torque is the rate of the motor.
        motor_rates = []
        for B_k in e.motor_columns:
            motor_rates.append(SX(total(x * L[i] for i, x in B_k.items() if i in L)))
        row = ca.horzcat(*bodies_and_joints, rates.T, lines, *motor_rates)
        return _in_row(row.T, width), checks.unsolved(L, {})

    return _QuantitySymbols(
        inputs={"q": e.q, "va": e.va, "aa": e.aa},
        size=len(e.L) * width,
        width=width,
        along=along,
        once={},
        checks=checks.of_rates + checks.of_joint_accelerations(e.dv),
    )


QUANTITIES: dict[str, Callable[[Equations, Checks], _QuantitySymbols]] = {
    "torque_derivatives": _torque_derivatives,
    "acceleration_derivatives": _acceleration_derivatives,
    "displacement_rates": _displacement_rates,
    "reduced_terms": _reduced_terms,
    "torque_regressor": _torque_regressor,
}


# --- frames -------------------------------------------------------------------------------------


def _frame_jacobian(e: Equations, checks: Checks, frame: str) -> _QuantitySymbols:
    """The Jacobian J of a frame, shape (6, n)."""
    n = len(e.L)

    def along(direction: SX) -> tuple[_Results, list[Any]]:
        L = _joint_rates(e, direction)
        velocity = frame_velocities.velocity(e, frame, L)
        return _in_column(velocity, n, 0), checks.unsolved(L, {})

    return _QuantitySymbols(inputs={"q": e.q}, size=6 * n, width=n, along=along, once={}, checks=[])


def _frame_jacobian_rate(e: Equations, checks: Checks, frame: str) -> _QuantitySymbols:
    """The rate J_dot of the Jacobian of a frame, shape (6, n)."""
    n = len(e.L)

    def along(direction: SX) -> tuple[_Results, list[Any]]:
        L = _joint_rates(e, direction)
        rate, more_checks = frame_velocities.rate_of_column(e, checks, frame, L)
        return _in_column(rate, n, 0), checks.unsolved(L, {}) + more_checks

    return _QuantitySymbols(
        inputs={"q": e.q, "va": e.va},
        size=6 * n,
        width=n,
        along=along,
        once={},
        checks=checks.of_rates + checks.of_steady_motion,
    )


def _frame_velocity_derivatives(e: Equations, checks: Checks, frame: str) -> _QuantitySymbols:
    """Derivatives of the velocity J va by q and va side by side, shape (6, 2 n)."""
    n = len(e.L)
    width = 2 * n

    def along(direction: SX) -> tuple[_Results, list[Any]]:
        L = _joint_rates(e, direction)
        by_q, more_checks = frame_velocities.derivative_along(e, checks, frame, L)
        by_va = frame_velocities.velocity(e, frame, L)
        results = _in_column(by_q, width, 0) | _in_column(by_va, width, n)
        return results, checks.unsolved(L, {}) + more_checks

    return _QuantitySymbols(
        inputs={"q": e.q, "va": e.va},
        size=6 * width,
        width=width,
        along=along,
        once={},
        checks=checks.of_rates + checks.of_steady_motion,
    )


FRAMES: dict[str, Callable[[Equations, Checks, str], _QuantitySymbols]] = {
    "frame_jacobian": _frame_jacobian,
    "frame_jacobian_rate": _frame_jacobian_rate,
    "frame_velocity_derivatives": _frame_velocity_derivatives,
}

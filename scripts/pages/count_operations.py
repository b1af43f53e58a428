# SPDX-License-Identifier: BSD-2-Clause
"""Count the operations of each method's equations and write docs/evidence.md.

What is counted are the expressions of `sst_pin.compiled`, from which the kernels are made. Their
values are compared with `compute_torques` and `compute_accelerations` before a count is believed.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import markdown_tables
import sst_pin
from markdown_tables import Table, Tables
from sst_pin.compiled import kernels
from sst_pin.compiled.elimination import Factors, pivot_order
from sst_pin.compiled.equations import Equations
from sst_pin.compiled.symbols import SymmetricFactors, add
from tests.gallery import ladder

PAGE = Path(__file__).parents[2] / "docs" / "evidence.md"
TOLERANCE = 1e-9  # relative to the largest torque or acceleration
CELLS = (2, 4, 8, 16)  # of the ladders

KINDS = ("additions", "multiplications", "divisions", "square roots", "trig")
ADD, MULTIPLY, DIVIDE, ROOT, TRIG = KINDS
#: CasADi's instructions that are arithmetic; a change of sign is free.
_INSTRUCTIONS = {
    **dict.fromkeys((ca.OP_ADD, ca.OP_SUB), ADD),
    **dict.fromkeys((ca.OP_MUL, ca.OP_TWICE, ca.OP_SQ), MULTIPLY),
    **dict.fromkeys((ca.OP_DIV, ca.OP_INV), DIVIDE),
    ca.OP_SQRT: ROOT,
    **dict.fromkeys((ca.OP_SIN, ca.OP_COS, ca.OP_ATAN2), TRIG),
}
_FREE = {ca.OP_NEG, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}


def operations(function: ca.Function) -> Counter[str]:
    """The operations of an expression, by kind."""
    codes = [function.instruction_id(i) for i in range(function.n_instructions())]
    return Counter(_INSTRUCTIONS[code] for code in codes if code not in _FREE)


# --- the methods ------------------------------------------------------------------------------


def equations_of(robot: sst_pin.ClosedChain) -> Equations:
    """The generated equations of a robot."""
    return robot.casadi()._equations


def torques_short(e: Equations) -> ca.SX:
    """L^T RNEA, L never formed: one factorisation gives rates, accelerations and forces.

    Motors that are no coordinates are solved for once; kernels correct the rounding of that.
    """
    if e.mechanism.driven_one_to_one:
        return e.generalized_forces
    tau = e.motor_factors[0].solve_transposed(dict(enumerate(ca.vertsplit(e.generalized_forces))))
    return ca.vertcat(*(tau[k] for k in sorted(tau)))


def torques_with_L(e: Equations) -> ca.SX:
    """L^T RNEA with the columns of L, Eqs. (17), (91)."""
    return e.projected_by_L(e.tree_forces)


def torques_long(e: Equations) -> ca.SX:
    """Every term of Eq. (92) by itself, Eqs. (93)-(95)."""
    return e.inertia @ e.aa + _bias(e)


def _bias(e: Equations) -> ca.SX:
    """The terms of Eq. (92) without the accelerations."""
    forces = add(e.tree.forces({}, {}), add(e.tree.friction(e.v), e.tree.springs(e.v)))
    return e.coriolis @ e.va + e.projected_by_L(forces)


def torques_checked(e: Equations) -> ca.SX:
    """`torques_short` with the checks of the kernel."""
    kernel = kernels.make(e, "torques")
    return ca.vertcat(kernel.output, kernel.checks)


def accelerations_short(e: Equations) -> ca.SX:
    """Eq. (92) solved, the terms without the accelerations from one recursion."""
    return e.accelerations


def accelerations_long(e: Equations) -> ca.SX:
    """Eq. (92) solved, every term by itself."""
    return SymmetricFactors(e.inertia).solve(e.projected_by_L(e.motor_forces(e.tau)) - _bias(e))


def accelerations_multipliers(e: Equations) -> ca.SX:
    """Accelerations of all joints together with the Lagrange multipliers of the closures."""
    nv = e.mechanism.model.nv
    rows = list(_independent(e))
    system: list[dict[int, Any]] = [{} for _ in range(nv + len(rows))]
    for (i, j), entry in e.tree.composite_inertia({}).items():
        system[i][j] = system[j][i] = entry
    for k, (row, _) in enumerate(rows, start=nv):
        for j, entry in row.items():
            system[k][j] = system[j][k] = entry
    places = [(i, j) for i, row in enumerate(system) for j in row]
    where = tuple(np.array(places).T)
    pattern = np.zeros((len(system), len(system)), dtype=bool)
    pattern[where] = True
    symbols = ca.vertcat(*(ca.SX(system[i][j]) for i, j in places))
    values = np.zeros((len(e.at_samples(symbols)), *pattern.shape))
    values[:, where[0], where[1]] = e.at_samples(symbols)[..., 0]
    order, _ = pivot_order(pattern, values)
    forces = add(e.motor_forces(e.tau), {i: -x for i, x in e.forces({}).items()})
    right = forces | {k: drift for k, (_, drift) in enumerate(rows, start=nv) if drift is not None}
    solution = Factors(system, order).solve(right)
    return ca.vertcat(*(ca.SX(solution[int(i)]) for i in e.mechanism.coordinates))


def _independent(e: Equations) -> Iterator[tuple[Mapping[int, Any], Any]]:
    """Rows of Phi and their drifts; of a loop of which all rows count, combinations of them."""
    for part in e.factors.parts:
        if isinstance(part, Factors):
            yield from ((e.rows[i].Phi, e.drift.get(i)) for i in part.rows)
            continue
        own: dict[int, dict[int, Any]] = {j: {} for i in part.rows for j in e.rows[i].Phi}
        for i in part.rows:
            for j, entry in e.rows[i].Phi.items():
                own[j][i] = entry
        columns = {j: part.solve(column) for j, column in own.items()}
        drift = part.solve({i: e.drift[i] for i in part.rows if i in e.drift})
        for k in sorted(drift):
            yield {j: column[k] for j, column in columns.items() if k in column}, drift[k]


LONG = "NOC, every term of Eq. (92)"
SHORT = "NOC, one recursion"
WITH_L = "NOC, with L"
MULTIPLIERS = "Lagrange multipliers"
WORK = "virtual work"
CHECKED = "NOC, one recursion, checked"
INVERSE: dict[str, Callable[[Equations], ca.SX]] = {
    LONG: torques_long,
    WITH_L: torques_with_L,
    SHORT: torques_short,
    CHECKED: torques_checked,
}
DIRECT: dict[str, Callable[[Equations], ca.SX]] = {
    LONG: accelerations_long,
    MULTIPLIERS: accelerations_multipliers,
    SHORT: accelerations_short,
}


def by_virtual_work(sst: sst_pin.ClosedChain) -> sst_pin.ClosedChain:
    """An SST in coordinates of its star: leg 1's joints are Euler angles of the star."""
    leg = ["gamma_1", "mu_1", "beta_1"]
    return sst_pin.ClosedChain(sst.model, sst.closures, sst.motor_names, coordinates=leg)


ROBOTS: dict[str, Callable[[], sst_pin.ClosedChain]] = {
    "SST": sst_pin.SST,
    "hexaglide": sst_pin.robots.hexaglide,
}


def expression(e: Equations, problem: str, name: str) -> ca.Function:
    """One method for one robot: a function of q, va, aa or tau, and the symbolic parameters."""
    inverse = problem == "inverse"
    last = e.aa if inverse else e.tau
    output = (INVERSE if inverse else DIRECT)[name](e)
    return ca.Function("count", [e.q, e.va, last, e.p], [ca.densify(output)], {"cse": True})


def require_right(
    robot: sst_pin.ClosedChain, e: Equations, problem: str, name: str, counted: ca.Function
) -> None:
    """Refuse an expression whose values are not the reference path's at sample configurations."""
    numbers = e.parameters.pack(e.mechanism, e.mechanism.friction)
    rates = np.random.default_rng(0).normal(size=(2, len(e._samples), len(e.mechanism.coordinates)))
    for q, va, last in zip(e._samples, *rates, strict=True):
        compute = robot.compute_torques if problem == "inverse" else robot.compute_accelerations
        wanted = compute(q, va, last)
        found = counted(q, va, last, numbers).full().ravel()[: len(wanted)]
        error = np.abs(found - wanted).max() / np.abs(wanted).max()
        if not error <= TOLERANCE:
            raise ArithmeticError(f"{problem} dynamics, {name}: off by {error:.2g}, relative")


@cache
def count_all() -> dict[tuple[str, str, str], Counter[str]]:
    """Count every method for every robot, by problem, robot and method, if it is right."""
    tallies = {}
    for problem, methods in (("inverse", INVERSE), ("direct", DIRECT)):
        for title, build in ROBOTS.items():
            robot = build()
            cases = [(name, name, robot) for name in methods]
            if title == "SST":
                cases.append((WORK, SHORT, by_virtual_work(robot)))
            for label, name, case in cases:
                e = equations_of(case)
                counted = expression(e, problem, name)
                require_right(case, e, problem, name, counted)
                tallies[problem, title, label] = operations(counted)
    return tallies


@cache
def count_ladders() -> dict[int, tuple[int, int]]:
    """Operations of the inverse and the direct dynamics of ladders, by their cells."""
    counts = {}
    for cells in CELLS:
        e = equations_of(ladder(cells))
        methods = (expression(e, problem, SHORT) for problem in ("inverse", "direct"))
        counts[cells] = tuple(operations(method).total() for method in methods)
    return counts


# --- the page ---------------------------------------------------------------------------------


def counts_of(problem: str, _: Table) -> Table:
    """The operations of each method for each robot."""
    table = [(f"{problem} dynamics", ADD, MULTIPLY, "all", "of one recursion")]
    counts = count_all()
    for (its_problem, robot, name), tally in counts.items():
        if its_problem == problem:
            numbers = tally[ADD], tally[MULTIPLY], tally.total()
            ratio = tally.total() / counts[problem, robot, SHORT].total()
            table.append((f"{robot}: {name}", *map(str, numbers), f"{ratio:.2f}"))
    return table


TABLES: Tables = {
    "inverse": partial(counts_of, "inverse"),
    "direct": partial(counts_of, "direct"),
}


def main(arguments: list[str] | None = None) -> int:
    return markdown_tables.main(PAGE, TABLES, {}, arguments)


if __name__ == "__main__":
    sys.exit(main())

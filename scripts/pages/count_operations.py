# SPDX-License-Identifier: BSD-2-Clause
"""Count the operations in the generated equations of each method, time them, write docs/cost.md.

What is counted are the expressions of `sst_pin.compiled`, from which the kernels are made. Their
values are compared with `compute_torques` and `compute_accelerations` before a count is believed.
"""

from __future__ import annotations

import argparse
import platform
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import sst_pin
from sst_pin.compiled import kernels
from sst_pin.compiled.elimination import Factors, pivot_order
from sst_pin.compiled.equations import Equations
from sst_pin.compiled.symbols import add, solve_symmetric
from sst_pin.sst.paper import PERIOD
from sst_pin.verification.virtual_work import VirtualWork

Array = NDArray[np.float64]

PAGE = Path(__file__).parents[2] / "docs" / "cost.md"
TIMES = "\n## Times\n"
TOLERANCE = 1e-9  # relative to the largest torque or acceleration
CELLS = (2, 4, 8, 16)  # of the ladders
SAMPLES = 1001  # of example 1, as `sst-pin paper` takes them

KINDS = ("additions", "multiplications", "divisions", "square roots", "trig")
ADD, MULTIPLY, DIVIDE, ROOT, TRIG = KINDS
#: CasADi's instructions that are arithmetic; a change of sign is free.
_INSTRUCTIONS = {
    ca.OP_ADD: ADD,
    ca.OP_SUB: ADD,
    ca.OP_MUL: MULTIPLY,
    ca.OP_TWICE: MULTIPLY,
    ca.OP_SQ: MULTIPLY,
    ca.OP_DIV: DIVIDE,
    ca.OP_INV: DIVIDE,
    ca.OP_SQRT: ROOT,
    ca.OP_SIN: TRIG,
    ca.OP_COS: TRIG,
    ca.OP_ATAN2: TRIG,
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
    """L^T RNEA, L never formed: one factorisation gives rates, accelerations and forces."""
    return kernels.make(e, "torques").output


def torques_with_L(e: Equations) -> ca.SX:
    """L^T RNEA with the columns of L, Eqs. (17), (91)."""
    return e.project(e.tree_forces)


def torques_long(e: Equations) -> ca.SX:
    """Every term of Eq. (92) by itself, Eqs. (93)-(95)."""
    return e.inertia @ e.aa + _bias(e)


def _bias(e: Equations) -> ca.SX:
    """The terms of Eq. (92) without the accelerations."""
    forces = add(e.tree.forces({}, {}), add(e.tree.friction(e.v), e.tree.springs))
    return e.coriolis @ e.va + e.project(forces)


def torques_checked(e: Equations) -> ca.SX:
    """`torques_short` with the checks of the kernel."""
    kernel = kernels.make(e, "torques")
    return ca.vertcat(kernel.output, kernel.checks)


def accelerations_short(e: Equations, tau: ca.SX) -> ca.SX:
    """Eq. (92) solved, the terms without the accelerations from one recursion."""
    return e.accelerations(tau)[0]


def accelerations_long(e: Equations, tau: ca.SX) -> ca.SX:
    """Eq. (92) solved, every term by itself."""
    return solve_symmetric(e.inertia, e.project(e.motor_forces(tau)) - _bias(e))[0]


def accelerations_multipliers(e: Equations, tau: ca.SX) -> ca.SX:
    """Accelerations of all joints together with the Lagrange multipliers of the closures."""
    nv, rows = e.mechanism.model.nv, list(_independent(e))
    system: list[dict[int, Any]] = [{} for _ in range(nv + len(rows))]
    for (i, j), entry in e.tree.composed({}).items():
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
    forces = add(e.motor_forces(tau), {i: -x for i, x in e.forces({}).items()})
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


LONG, SHORT, WITH_L = "NOC, every term of Eq. (92)", "NOC, one recursion", "NOC, with L"
MULTIPLIERS, WORK, CHECKED = "Lagrange multipliers", "virtual work", "NOC, one recursion, checked"
INVERSE: dict[str, Callable[[Equations], ca.SX]] = {
    LONG: torques_long,
    WITH_L: torques_with_L,
    SHORT: torques_short,
    CHECKED: torques_checked,
}
DIRECT: dict[str, Callable[[Equations, ca.SX], ca.SX]] = {
    LONG: accelerations_long,
    MULTIPLIERS: accelerations_multipliers,
    SHORT: accelerations_short,
}


def by_virtual_work(sst: sst_pin.ClosedChain) -> sst_pin.ClosedChain:
    """An SST in coordinates of its star: leg 1's joints are Euler angles of the star."""
    leg = ["gamma_1", "mu_1", "beta_1"]
    return sst_pin.ClosedChain(sst.model, sst.closures, sst.motor_names, coordinates=leg)


ROBOTS: dict[str, Callable[[], sst_pin.ClosedChain]] = {
    "SST": partial(sst_pin.SST, kernels=False),
    "planar 3-RRR": sst_pin.robots.planar_3rrr,
    "hexaglide": sst_pin.robots.hexaglide,
}


class Count(NamedTuple):
    """The operations of an expression and its function (q, va, aa or tau, open numbers)."""

    tally: Counter[str]
    function: ca.Function


def count(e: Equations, problem: str, name: str) -> Count:
    """Count one method for one robot."""
    if problem == "inverse":
        last, output = e.aa, INVERSE[name](e)
    else:
        last = ca.SX.sym("tau", e.mechanism.motors.shape[1])
        output = DIRECT[name](e, last)
    function = ca.Function("count", [e.q, e.va, last, e.p], [ca.densify(output)], {"cse": True})
    return Count(operations(function), function)


def require_right(
    robot: sst_pin.ClosedChain, e: Equations, problem: str, name: str, counted: Count
) -> None:
    """Compare an expression with the reference path at sample configurations of the robot.

    Raises:
        ArithmeticError: When the values differ.
    """
    numbers = e.parameters.pack(e.mechanism, e.mechanism.friction)
    rates = np.random.default_rng(0).normal(size=(2, len(e._samples), len(e.mechanism.coordinates)))
    for q, va, last in zip(e._samples, *rates, strict=True):
        compute = robot.compute_torques if problem == "inverse" else robot.compute_accelerations
        wanted = compute(q, va, last)
        found = counted.function(q, va, last, numbers).full().ravel()[: len(wanted)]
        error = np.abs(found - wanted).max() / np.abs(wanted).max()
        if not error <= TOLERANCE:
            raise ArithmeticError(f"{problem} dynamics, {name}: off by {error:.2g}, relative")


@cache
def count_all() -> dict[tuple[str, str, str], Counter[str]]:
    """Count every method for every robot, by problem, robot and method, once its values are right.

    Raises:
        ArithmeticError: When what was counted computes something else.
    """
    tallies = {}
    for problem, methods in (("inverse", INVERSE), ("direct", DIRECT)):
        for title, build in ROBOTS.items():
            robot = build()
            cases = [(name, name, robot) for name in methods]
            if title == "SST":
                cases.append((WORK, SHORT, by_virtual_work(robot)))
            for label, name, case in cases:
                e = equations_of(case)
                counted = count(e, problem, name)
                require_right(case, e, problem, name, counted)
                tallies[problem, title, label] = counted.tally
    return tallies


@cache
def count_ladders() -> dict[int, tuple[int, int]]:
    """Operations of the inverse and the direct dynamics of ladders, by their cells."""
    counts = {}
    for cells in CELLS:
        e = equations_of(sst_pin.robots.ladder(cells))
        inverse, direct = (count(e, problem, SHORT) for problem in ("inverse", "direct"))
        counts[cells] = inverse.tally.total(), direct.tally.total()
    return counts


# --- time -------------------------------------------------------------------------------------


def measure(rounds: int = 7, calls: int = 20) -> dict[str, tuple[float, float]]:
    """Medians [s] for one instant and for all of example 1; all methods take turns."""
    p = sst_pin.Parameters()
    robot, work = sst_pin.SST(p, kernels=False), VirtualWork(p)

    def long(R: Array, omega: Array, alpha: Array) -> Array:
        q, va, aa = robot.joint_motion(R, omega, alpha)
        terms = robot.noc(q, va)
        return terms.inertia @ aa + terms.coriolis @ va - terms.gravity - terms.friction

    def short(R: Array, omega: Array, alpha: Array) -> Array:
        return robot.compute_torques(*robot.joint_motion(R, omega, alpha))

    def one_by_one(R: Array, omega: Array, alpha: Array) -> None:
        for sample in zip(R, omega, alpha, strict=True):
            long(*sample)

    circle = sst_pin.paper_circle(np.linspace(0, PERIOD, SAMPLES))
    instant = [x[SAMPLES // 5] for x in circle]
    jobs = {
        LONG: (partial(long, *instant), partial(one_by_one, *circle)),
        SHORT: (partial(short, *instant), partial(short, *circle)),
        WORK: (partial(work.torques, *instant), partial(work.torques, *circle)),
    }
    seconds: dict[str, list[list[float]]] = {name: [[], []] for name in jobs}
    for _ in range(rounds):
        for name, pair in jobs.items():
            for found, call, times in zip(seconds[name], pair, (calls, 1), strict=True):
                start = time.perf_counter()
                for _ in range(times):
                    call()
                found.append((time.perf_counter() - start) / times)
    return {name: tuple(map(float, map(np.median, found))) for name, found in seconds.items()}


# --- the page ---------------------------------------------------------------------------------

_COUNTS_PAGE = """# Cost of the methods

The paper compares its natural orthogonal complement (NOC) with virtual work by CPU time, 1.7316 s
and 2.7612 s (Sect. 7.2). It says that an exact comparison needs the number of additions and
multiplications of each method (Sect. 6.1), but does not give these numbers. This page gives them
for the equations that this package generates.
(The text of Sect. 7.2 calls virtual work the faster method; its times and the 37 % of Sect. 6.1
say the opposite.)

`scripts/pages/count_operations.py` writes this page. With `--check` it counts again, and fails if
the counts on this page are outdated.

## What is counted

`compile()` writes the equations of a robot as CasADi expressions before they become C. The counts
are the operations of these expressions for one sample, from (q, va, aa) to the motor torques or
from (q, va, tau) to the accelerations. The expressions have no products with zeros and ones, they
compute equal subexpressions once, and they compute only what the result needs. The geometry is
inserted as numbers; masses, mass centres, inertias and gravity remain variables. There is no
friction and no load.

- **NOC, every term of Eq. (92)**: the inertia matrix, the Coriolis matrix and the gravity terms,
  each by itself, Eqs. (93)-(95).
- **NOC, with L**: L^T RNEA(q, v, dv), with the columns of L, Eq. (17).
- **NOC, one recursion**: the same product without forming L. One factorisation of Phi_u gives rates
  and accelerations, and transposed it takes the loads to the coordinates. For the direct dynamics
  one recursion gives all terms without accelerations, and L^T M L is factorised by Cholesky. This
  is what the kernels do. "Checked" includes the checks for open loops and small pivots.
- **Lagrange multipliers**: the accelerations of all joints and the multipliers of the closures from
  one linear system, solved by the same sparse elimination. The inverse dynamics by multipliers is
  "one recursion": the transposed solution is the multipliers.
- **Virtual work**, as in the paper's [10, 11], writes the equations of motion in coordinates of the
  star, J^T tau = f. The joints of leg 1 are Euler angles of the star, so this is the same robot
  with `coordinates=["gamma_1", "mu_1", "beta_1"]`.

Subtractions count as additions, a doubling as a multiplication; trig is sin, cos and atan2.
Changes of sign, comparisons and copies are not counted. The script compares the values of each
expression with `compute_torques` or `compute_accelerations` to 1e-9; otherwise it writes no page.

## Counts

{inverse}

{direct}

- The form of a method matters more than the method. With every term by itself, the inverse dynamics
  takes {long} times the operations of one recursion, because it computes whole matrices of
  which only the products with va and aa are needed.
- Forming L takes {with_L} times the operations of solving with it.
- Virtual work over NOC, for the SST: {work:.2f} for the inverse and {direct_work:.2f} for the
  direct dynamics. The methods differ less than two forms of one method. From the state of an
  integrator virtual work also needs the direct kinematics of the star at each step, an iteration
  that has no fixed count. The NOC does not; this is its real advantage, as Sect. 6.2 says.
- Direct dynamics by multipliers takes {multipliers} times the operations of the NOC.
- The checks take {checked} times the operations of the torques alone.

## Growth with the number of bodies

Ladders of parallelograms, each cell with three bodies, one loop and one motor:

{ladders}

The inverse dynamics grows in proportion to the number of bodies: every further cell costs
{per_cell} operations. The direct dynamics also factorises an inertia matrix as large as the number
of coordinates, so it grows faster.
"""

_TIMES_PAGE = """
One run, medians of interleaved repeats; Python {python}, NumPy {numpy}, Pinocchio {pinocchio}.
Inverse dynamics from the motion of the star by the reference path and by
`sst_pin.verification.virtual_work`; example 1 has {samples} instants here.

{table}

| virtual work over NOC | every term | one recursion |
|---|--:|--:|
| paper, 2.7612 s / 1.7316 s | {paper:.3f} | |
| one instant | {one} |
| example 1 | {circle} |

The paper's ratio cannot be compared with these, because its virtual work program and its number of
samples are unknown. The ratios here are above and below one, because they depend on the
implementation: the NOC uses Pinocchio's C++, sample by sample from Python; virtual work uses NumPy,
where the samples of a batch share the cost of the calls.
"""


def _table(problem: str) -> str:
    lines = [
        f"| {problem} dynamics | {' | '.join(KINDS)} | all | of one recursion |",
        "|---|" + "--:|" * 7,
    ]
    counts = count_all()
    for (its_problem, robot, name), tally in counts.items():
        if its_problem == problem:
            ratio = tally.total() / counts[problem, robot, SHORT].total()
            numbers = " | ".join(str(tally[kind]) for kind in KINDS)
            lines.append(f"| {robot}: {name} | {numbers} | {tally.total()} | {ratio:.2f} |")
    return "\n".join(lines)


def _over_short(problem: str, name: str) -> str:
    """Smallest and largest ratio of a method to the short form."""
    counts = count_all()
    ratios = [
        counts[problem, robot, name].total() / counts[problem, robot, SHORT].total()
        for robot in ROBOTS
    ]
    return f"{min(ratios):.2f} to {max(ratios):.2f}"


def counts_page() -> str:
    """What the page says before its times."""
    counts, ladders = count_all(), count_ladders()
    work = [
        counts[problem, "SST", WORK].total() / counts[problem, "SST", SHORT].total()
        for problem in ("inverse", "direct")
    ]
    rows = [
        f"| {cells} | {3 * cells} | {inverse} | {direct} |"
        for cells, (inverse, direct) in ladders.items()
    ]
    (first, (least, _)), *_, (last, (most, _)) = ladders.items()
    return _COUNTS_PAGE.format(
        inverse=_table("inverse"),
        direct=_table("direct"),
        long=_over_short("inverse", LONG),
        with_L=_over_short("inverse", WITH_L),
        work=work[0],
        direct_work=work[1],
        multipliers=_over_short("direct", MULTIPLIERS),
        checked=_over_short("inverse", CHECKED),
        ladders="\n".join(
            ["| cells | bodies | inverse dynamics | direct dynamics |", "|" + "--:|" * 4, *rows]
        ),
        per_cell=round((most - least) / (last - first)),
    )


def times_page(seconds: dict[str, tuple[float, float]]) -> str:
    """What the page says of times."""
    lines = ["| | one instant, µs | example 1, ms |", "|---|--:|--:|"]
    for name, (one, circle) in seconds.items():
        lines.append(f"| {name} | {1e6 * one:.0f} | {1e3 * circle:.1f} |")
    ratios = [
        " | ".join(f"{seconds[WORK][i] / seconds[form][i]:.3f}" for form in (LONG, SHORT))
        for i in (0, 1)
    ]
    return _TIMES_PAGE.format(
        python=platform.python_version(),
        numpy=np.__version__,
        pinocchio=pin.__version__,
        samples=SAMPLES,
        table="\n".join(lines),
        paper=2.7612 / 1.7316,
        one=ratios[0],
        circle=ratios[1],
    )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Count operations, time methods, write the page.")
    parser.add_argument("--check", action="store_true", help="recount and compare, write nothing")
    options = parser.parse_args(arguments)
    page = counts_page()
    if options.check:
        current = PAGE.is_file() and PAGE.read_text(encoding="utf-8").split(TIMES)[0] == page
        print(f"{PAGE.name}: the counts are {'current' if current else 'stale'}")
        return 0 if current else 1
    PAGE.write_text(page + TIMES + times_page(measure()), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

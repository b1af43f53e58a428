# SPDX-License-Identifier: BSD-2-Clause
"""Comparison of the torques with every installed referee: `sst-pin verify`."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..description.parameters import Parameters
from ..errors import ClosureError, MissingExtraError
from ..simulation.energy import energy_error
from ..sst import paper
from ..sst.platform_motion import paper_circle
from ..sst.robot import SST
from . import lagrange
from .referees import Referee, exudyn_engine, mujoco_engine
from .referees.symbolic import SymbolicLagrange
from .referees.virtual_work import VirtualWork
from .sampling import random_parameters, random_state

#: Referees of one instant, and those of them that have direct dynamics too.
REFEREES = (
    VirtualWork,
    lagrange.LagrangeMultipliers,
    SymbolicLagrange,
    mujoco_engine.MujocoInverse,
    exudyn_engine.ExudynInstant,
)
DIRECT = (VirtualWork, SymbolicLagrange)
#: Tolerance for the same equations, relative to the largest torque or acceleration: rounding
#: times the condition numbers of the cases, 1e-12 at worst, leaves three digits to spare.
SAME_EQUATIONS = 1e-9
#: Largest error of the order by which an engine tends to the exact answer.
ORDER = 0.2

State = tuple[Array, Array, Array, Array | None]


class Comparison(NamedTuple):
    """One line of the table: a referee's answers beside ours."""

    referee: str
    compared: str
    cases: int  #: Number of instants, or of steps.
    absolute: float  #: Worst difference, [N m], [rad/s^2], [rad] or [J].
    relative: float  #: Worst difference relative to the largest value of its case.
    limit: float | None  #: Of `relative`; None where `note` tells how it was judged.
    seconds: float  #: Time of the referee.
    passed: bool
    note: str = ""


class Judge:
    """Collects differences of one referee on one question."""

    def __init__(self, referee: str, compared: str, limit: float = SAME_EQUATIONS) -> None:
        self._title, self._limit, self._seconds = (referee, compared), limit, 0.0
        self._differences: list[tuple[float, float]] = []  # absolute and relative

    def hold(self, answer: Callable[[], Array], expected: Array) -> None:
        """Ask for an answer and compare it with ours; NaN is the worst of all."""
        began = time.perf_counter()
        off = float(np.abs(answer() - expected).max())
        self._seconds += time.perf_counter() - began
        off = off if np.isfinite(off) else np.inf
        self._differences.append((off, off / max(float(np.abs(expected).max()), 1e-300)))

    def verdict(self) -> Comparison:
        """The line of the table."""
        worst, relative = map(max, zip(*self._differences, strict=True))
        line = *self._title, len(self._differences), worst, relative, self._limit
        return Comparison(*line, self._seconds, relative <= self._limit)


def verify_sst(quick: bool = False) -> Iterator[Comparison]:
    """Every installed referee on example 1, on random states and on random SSTs.

    `quick` takes fewer cases, and none that step in time.
    """
    count = 5 if quick else 40
    t = np.linspace(0, paper.PERIOD, 13 if quick else 101)
    circle = list(zip(*paper_circle(t), strict=True))
    yield from _instants("example 1", [(Parameters(), [(*state, None) for state in circle])])
    rng = np.random.default_rng(0)
    states = [_loaded(SST(), rng) for _ in range(count)]
    yield from _instants("the paper's robot, loads", [(Parameters(), states)])
    for friction, name in ((False, "random SSTs, loads"), (True, "random SSTs, friction, loads")):
        robots = [random_parameters(rng, friction) for _ in range(count)]
        cases = [(p, [_loaded(SST(p), rng) for _ in range(3)]) for p in robots]
        yield from _instants(name, cases)
    yield from _accelerations([random_parameters(rng) for _ in range(count)], rng)
    yield _energy(SST(), 201)
    if not quick:
        yield from verify_in_time()


def skipped() -> list[MissingExtraError]:
    """Missing packages of referees, and how to install them."""
    return all_referees(Parameters())[1]


def all_referees(parameters: Parameters) -> tuple[list[Referee], list[MissingExtraError]]:
    """All installed referees for one SST, and for each missing one how to install it."""
    available, missing = list[Referee](), list[MissingExtraError]()
    for kind in REFEREES:
        try:
            available.append(kind(parameters))
        except MissingExtraError as error:
            missing.append(error)
    return available, missing


def verify_chain(chain: ClosedChain, count: int = 20) -> Iterator[Comparison]:
    """Lagrange multipliers on any closed chain, at random configurations in random motion."""
    rng = np.random.default_rng(0)
    name, of = lagrange.LagrangeMultipliers.name, chain.mechanism.model.name or "chain"
    forces = Judge(name, f"forces along the coordinates, {of}")
    torques, back = Judge(name, f"torques, {of}"), Judge(name, f"accelerations, {of}")
    sufficient = chain.mobility().sufficient
    for q, va, aa in _chain_states(chain, count, rng):
        ours = chain.generalized_forces(q, va, aa)
        forces.hold(partial(lagrange.generalized_forces, chain, q, va, aa), ours)
        tau = rng.normal(size=len(chain.motor_names))
        if sufficient:
            tau = chain.compute_torques(q, va, aa)
            torques.hold(partial(lagrange.torques, chain, q, va, aa), tau)
        ours = chain.compute_accelerations(q, va, tau)
        back.hold(partial(lagrange.accelerations, chain, q, va, tau), ours)
    yield from (judge.verdict() for judge in (*[torques] * sufficient, forces, back))


def _chain_states(
    chain: ClosedChain, count: int, rng: np.random.Generator
) -> Iterator[tuple[Array, Array, Array]]:
    """Assembled configurations away from singularities, with a motion of the coordinates."""
    start, model = chain.generic_configuration(), chain.mechanism.model
    n, limit = chain.degrees_of_freedom, max(1e3, float(chain.condition_number(start)))
    found = 0
    for _ in range(100 * count):
        guess = pin.integrate(model, start, rng.normal(scale=0.3, size=model.nv))
        with suppress(ClosureError):
            q = chain.assemble(guess, fixed=())
            if chain.condition_number(q) < limit:
                yield q, rng.normal(size=n), rng.normal(size=n)
                found += 1
        if found == count:
            return
    raise ClosureError("no configurations away from singularities were found", np.inf)


def _loaded(robot: SST, rng: np.random.Generator) -> State:
    return (*random_state(robot, rng), rng.normal(scale=5, size=3))


def _instants(
    name: str, cases: Sequence[tuple[Parameters, Sequence[State]]]
) -> Iterator[Comparison]:
    """Inverse dynamics of every referee."""
    judges: dict[str, Judge] = {}
    for parameters, states in cases:
        robot = SST(parameters)
        asked = all_referees(parameters)[0]
        for R, omega, alpha, moment in states:
            motion = robot.joint_motion(R, omega, alpha)
            tau = robot.compute_torques(*motion, platform_moment=moment)
            for referee in asked:
                judge = judges.setdefault(referee.name, Judge(referee.name, f"torques, {name}"))
                judge.hold(partial(referee.torques, R, omega, alpha, moment), tau)
    yield from (judge.verdict() for judge in judges.values())


def _accelerations(robots: Sequence[Parameters], rng: np.random.Generator) -> Iterator[Comparison]:
    """Direct dynamics of those referees that have one."""
    judges: dict[str, Judge] = {}
    what = "accelerations, random SSTs, friction"
    for parameters in robots:
        robot = SST(parameters)
        R, omega, alpha = random_state(robot, rng)
        q, va, aa = robot.joint_motion(R, omega, alpha)
        tau = robot.compute_torques(q, va, aa)
        answers = {
            referee.name: (partial(referee.accelerations, R, omega, tau), alpha)
            for referee in all_referees(parameters)[0]
            if isinstance(referee, DIRECT)
        }
        back = robot.compute_accelerations(q, va, tau)
        multipliers = partial(lagrange.accelerations, robot, q, va, tau)
        answers[lagrange.LagrangeMultipliers.name] = multipliers, back
        for who, (answer, ours) in answers.items():
            judges.setdefault(who, Judge(who, what)).hold(answer, ours)
    yield from (judge.verdict() for judge in judges.values())


def _energy(robot: SST, samples: int) -> Comparison:
    """Work of the motors against kinetic and potential energy along example 1."""
    judge = Judge("energy", "work of the motors, example 1", 1e-8)  # quadrature of the power
    motion = paper.example_1(robot, np.linspace(0, paper.PERIOD, samples))
    work = robot.kinetic_energy(motion.q, motion.va) + robot.potential_energy(motion.q)
    judge.hold(lambda: energy_error(robot, motion) + work, work)
    return judge.verdict()


def verify_in_time() -> Iterator[Comparison]:
    """Example 2 by virtual work, Exudyn and MuJoCo, each by its own integrator."""
    robot = SST()
    R, omega, _ = paper_circle(0.0)
    example = paper.example_1(robot, np.linspace(0, paper.PERIOD, 1001))
    torque = example.torque()

    judge = Judge("virtual work", "path, example 2")
    t = np.linspace(0, paper.PERIOD, 21)
    wanted = paper_circle(t).R
    other = VirtualWork(Parameters())
    judge.hold(lambda: other.simulate(lambda t, R, omega: torque(t), R, omega, t)[0], wanted)
    yield judge.verdict()

    for row in (_exudyn(robot, torque), _mujoco(torque)):
        with suppress(MissingExtraError):
            yield from row


def _exudyn(robot: SST, torque: Callable[[float], Array]) -> Iterator[Comparison]:
    (R, omega, _), quarter, run_in = paper_circle(0.0), paper.PERIOD / 4, 30
    expected = paper.example_1(robot, np.linspace(0, quarter, 61)).tau

    def torque_error(steps: float) -> float:
        _, tau = exudyn_engine.stepped_torques(Parameters(), paper_circle, quarter, int(steps))
        every = int(steps) // 60
        late = slice(run_in, None)  # its first torques miss the motors' accelerations
        return float(np.abs(tau[::every] - expected)[late].max())

    def path_error(steps: float) -> float:
        t, path = exudyn_engine.stepped_motion(
            Parameters(), R, omega, torque, paper.PERIOD, int(steps)
        )
        return float(np.abs(path - paper_circle(t).R).max())

    name, by = "Exudyn, time-stepped", (120, 240, 480)
    yield _converging(name, "torques, example 1", torque_error, by, by[-1], 2)
    by = (250, 500, 1000)
    yield _converging(name, "path, example 2", path_error, by, by[-1], 2)


def _mujoco(torque: Callable[[float], Array]) -> Iterator[Comparison]:
    R, omega, _ = paper_circle(0.0)

    def path_error(stiffness: float) -> float:
        t, path = mujoco_engine.welded_motion(
            Parameters(), R, omega, torque, paper.PERIOD / 8, stiffness=stiffness
        )
        return float(np.abs(path - paper_circle(t).R).max())

    name, by = "path, 1/8 of example 2", (1e4, 1e5, 1e6)
    yield _converging("MuJoCo, welded", name, path_error, by, len(by), 1)


def _converging(
    referee: str,
    compared: str,
    error: Callable[[float], float],
    by: Sequence[float],
    cases: int,
    order: int,
) -> Comparison:
    """A referee whose error must shrink with a power of its steps or its stiffness."""
    began = time.perf_counter()
    errors = np.array([error(value) for value in by])
    orders = -np.diff(np.log(errors)) / np.diff(np.log(by))
    passed = bool(np.abs(orders - order).max() < ORDER)
    note = f"order {orders[-1]:.2f}, {order} claimed"
    first, last = float(errors[0]), float(errors[-1])
    seconds = time.perf_counter() - began
    return Comparison(referee, compared, cases, last, last / first, None, seconds, passed, note)


def table(rows: Sequence[Comparison]) -> str:
    """The comparisons as plain text."""
    lines = [("referee", "compared", "cases", "worst abs", "worst rel", "limit", "time", "")]
    for row in rows:
        limit = "" if row.limit is None else f"{row.limit:.0e}"
        numbers = (f"{row.absolute:.1e}", f"{row.relative:.1e}", limit, f"{row.seconds:.2f} s")
        verdict = ", ".join(filter(None, ("ok" if row.passed else "DISAGREES", row.note)))
        lines.append((row.referee, row.compared, str(row.cases), *numbers, verdict))
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )

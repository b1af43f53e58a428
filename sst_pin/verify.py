# SPDX-License-Identifier: BSD-2-Clause
"""The torques held against every referee that is installed: `sst-pin verify`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import paper, referees
from .closed_chain import ClosedChain
from .errors import ClosureError, MissingExtraError
from .parameters import Parameters
from .platform_motion import paper_circle
from .referees import lagrange
from .sampling import random_parameters, random_state
from .simulation import energy_error
from .sst import SST
from .virtual_work import VirtualWork

Array = NDArray[np.float64]

#: Referees that solve the same equations, relative to the largest torque or acceleration: rounding
#: times the condition numbers of the cases, 1e-12 at worst, leaves three digits to spare.
SAME_EQUATIONS = 1e-9
#: Integrators that step in time must show the order that they claim to this.
ORDER = 0.2


@dataclass(frozen=True)
class Comparison:
    """One line of the table.

    Attributes:
        referee: Who was asked.
        compared: What about.
        cases: How many instants, or steps.
        absolute: Worst difference, [N m], [rad/s^2], [rad] or [J].
        relative: Worst difference relative to the largest value of its case.
        limit: What `relative` had to stay below; None where `note` tells how it was judged.
        seconds: Time of the referee.
        passed: Whether it agreed.
        note: What else was seen.
    """

    referee: str
    compared: str
    cases: int
    absolute: float
    relative: float
    limit: float | None
    seconds: float
    passed: bool
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


class _Judge:
    """Collects differences of one referee on one question."""

    def __init__(self, referee: str, compared: str, limit: float = SAME_EQUATIONS) -> None:
        self._referee, self._compared, self._limit = referee, compared, limit
        self._cases, self._absolute, self._relative, self._seconds = 0, 0.0, 0.0, 0.0

    def hold(self, answer: Callable[[], Array], expected: Array) -> None:
        """Ask for an answer and hold it against ours; NaN is the worst of all."""
        began = time.perf_counter()
        difference = np.abs(answer() - expected).max()
        self._seconds += time.perf_counter() - began
        self._cases += 1
        scale = max(float(np.abs(expected).max()), 1e-300)
        self._absolute = float(np.fmax(self._absolute, difference))
        worst = difference / scale if np.isfinite(difference) else np.inf
        self._relative = max(self._relative, float(worst))

    def verdict(self) -> Comparison:
        passed = self._relative <= self._limit
        return Comparison(
            self._referee,
            self._compared,
            self._cases,
            self._absolute,
            self._relative,
            self._limit,
            self._seconds,
            passed,
        )


def verify_sst(quick: bool = False) -> Iterator[Comparison]:
    """Every installed referee on example 1, on random states and on random SSTs.

    Args:
        quick: Fewer cases, and none that step in time.

    Yields:
        A line of the table as soon as it is known.
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
        yield from _stepped()


def skipped() -> list[MissingExtraError]:
    """What keeps referees from being asked, and how to install it."""
    return referees.all_referees(Parameters())[1]


def verify_chain(chain: ClosedChain, count: int = 20) -> Iterator[Comparison]:
    """Lagrange multipliers on any closed chain, at random configurations in random motion.

    Args:
        chain: The robot.
        count: Number of configurations.

    Yields:
        Lines of the table.

    Raises:
        ClosureError: When the chain cannot be assembled.
    """
    rng = np.random.default_rng(0)
    states = list(_chain_states(chain, count, rng))
    name = lagrange.LagrangeMultipliers.name
    torques = _Judge(name, f"torques, {chain.model.name or 'chain'}")
    back = _Judge(name, f"accelerations, {chain.model.name or 'chain'}")
    for q, va, aa in states:
        tau = chain.compute_torques(q, va, aa)
        torques.hold(lambda: lagrange.torques(chain, q, va, aa), tau)  # noqa: B023 called at once
        ours = chain.compute_accelerations(q, va, tau)
        back.hold(lambda: lagrange.accelerations_by_multipliers(chain, q, va, tau), ours)  # noqa: B023
    yield torques.verdict()
    yield back.verdict()


def _chain_states(
    chain: ClosedChain, count: int, rng: np.random.Generator
) -> Iterator[tuple[Array, Array, Array]]:
    """Assembled configurations away from singularities, rates and accelerations of the motors."""
    start = chain.generic_configuration()
    n = len(chain.actuated)
    found, tries = 0, 0
    while found < count:
        tries += 1
        if tries > 100 * count:
            raise ClosureError("no configurations away from singularities were found", np.inf)
        guess = start + rng.normal(scale=0.3, size=start.shape)
        try:
            q = chain.assemble(guess, fixed=())
        except ClosureError:
            continue
        if chain.condition_number(q) < 1e3:
            found += 1
            yield q, rng.normal(size=n), rng.normal(size=n)


State = tuple[Array, Array, Array, Array | None]


def _loaded(robot: SST, rng: np.random.Generator) -> State:
    return (*random_state(robot, rng), rng.normal(scale=5, size=3))


def _instants(
    name: str, cases: Sequence[tuple[Parameters, Sequence[State]]]
) -> Iterator[Comparison]:
    """Inverse dynamics of every referee."""
    judges: dict[str, _Judge] = {}
    for parameters, states in cases:
        robot = SST(parameters)
        for referee in referees.all_referees(parameters)[0]:
            judge = judges.setdefault(referee.name, _Judge(referee.name, f"torques, {name}"))
            for R, omega, alpha, moment in states:
                q, va, aa = robot.joint_motion(R, omega, alpha)
                tau = robot.compute_torques(q, va, aa, platform_moment=moment)
                judge.hold(lambda: referee.torques(R, omega, alpha, moment), tau)  # noqa: B023
    for judge in judges.values():
        yield judge.verdict()


def _accelerations(robots: Sequence[Parameters], rng: np.random.Generator) -> Iterator[Comparison]:
    """Direct dynamics of those referees that have one."""
    judges: dict[str, _Judge] = {}

    def judge(name: str) -> _Judge:
        what = "accelerations, random SSTs, friction"
        return judges.setdefault(name, _Judge(name, what))

    for parameters in robots:
        robot = SST(parameters)
        R, omega, alpha = random_state(robot, rng)
        q, va, aa = robot.joint_motion(R, omega, alpha)
        tau = robot.compute_torques(q, va, aa)
        for referee in referees.all_referees(parameters)[0]:
            if isinstance(referee, referees.DirectReferee):
                judge(referee.name).hold(lambda: referee.accelerations(R, omega, tau), alpha)  # noqa: B023
        back = robot.compute_accelerations(q, va, tau)
        multipliers = judge(lagrange.LagrangeMultipliers.name)
        multipliers.hold(lambda: lagrange.accelerations(robot, q, va, tau), back)  # noqa: B023
    for found in judges.values():
        yield found.verdict()


def _energy(robot: SST, samples: int) -> Comparison:
    """Work of the motors against kinetic and potential energy along example 1."""
    judge = _Judge("energy", "work of the motors, example 1", 1e-8)  # quadrature of the power
    motion = paper.example_1(robot, np.linspace(0, paper.PERIOD, samples))
    work = robot.kinetic_energy(motion.q, motion.va) + robot.potential_energy(motion.q)
    judge.hold(lambda: energy_error(robot, motion) + work, work)
    return judge.verdict()


# --- referees that step in time -------------------------------------------------------------


def _stepped() -> Iterator[Comparison]:
    """Example 2 by virtual work, Exudyn and MuJoCo, each by its own integrator."""
    robot = SST()
    R, omega, _ = paper_circle(0.0)
    example = paper.example_1(robot, np.linspace(0, paper.PERIOD, 1001))
    torque = example.torque()

    judge = _Judge("virtual work", "path, example 2")
    t = np.linspace(0, paper.PERIOD, 21)
    wanted = paper_circle(t).R
    other = VirtualWork(Parameters())
    judge.hold(lambda: other.simulate(lambda t, R, omega: torque(t), R, omega, t)[0], wanted)
    yield judge.verdict()

    try:
        from .referees import exudyn_engine

        referees.engine("exudyn")
    except MissingExtraError:
        pass
    else:
        quarter, run_in = paper.PERIOD / 4, 30
        expected = paper.example_1(robot, np.linspace(0, quarter, 61)).tau

        def torque_error(steps: int) -> float:
            _, tau = exudyn_engine.stepped_torques(Parameters(), paper_circle, quarter, steps)
            every = steps // 60
            late = slice(run_in, None)  # its first torques miss the motors' accelerations
            return float(np.abs(tau[::every] - expected)[late].max())

        yield _order("Exudyn, time-stepped", "torques, example 1", torque_error, (120, 240, 480))

        def path_error(steps: int) -> float:
            t, path = exudyn_engine.stepped_motion(
                Parameters(), R, omega, torque, paper.PERIOD, steps
            )
            return float(np.abs(path - paper_circle(t).R).max())

        yield _order("Exudyn, time-stepped", "path, example 2", path_error, (250, 500, 1000))

    try:
        from .referees import mujoco_engine

        referees.engine("mujoco")
    except MissingExtraError:
        return

    def compliance(stiffness: float) -> float:
        t, path = mujoco_engine.welded_motion(
            Parameters(), R, omega, torque, paper.PERIOD / 8, stiffness=stiffness
        )
        return float(np.abs(path - paper_circle(t).R).max())

    yield _compliant("MuJoCo, welded", "path, 1/8 of example 2", compliance, (1e4, 1e5, 1e6))


def _order(
    referee: str, compared: str, error: Callable[[int], float], steps: Sequence[int]
) -> Comparison:
    """Second order: half the step, a quarter of the error."""
    began = time.perf_counter()
    errors = [error(n) for n in steps]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    return Comparison(
        referee,
        compared,
        steps[-1],
        errors[-1],
        errors[-1] / errors[0],
        None,
        time.perf_counter() - began,
        bool(np.abs(orders - 2).max() < ORDER),
        f"order {orders[-1]:.2f}, 2 claimed",
    )


def _compliant(
    referee: str, compared: str, error: Callable[[float], float], stiffness: Sequence[float]
) -> Comparison:
    """Ten times the stiffness leaves a tenth of the error, give or take a half."""
    began = time.perf_counter()
    errors = [error(k) for k in stiffness]
    shrink = np.array(errors[:-1]) / errors[1:]
    return Comparison(
        referee,
        compared,
        len(stiffness),
        errors[-1],
        errors[-1] / errors[0],
        None,
        time.perf_counter() - began,
        bool((shrink > 5).all()),
        f"{shrink[-1]:.1f} times less at 10 times the stiffness",
    )


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

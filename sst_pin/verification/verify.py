# SPDX-License-Identifier: BSD-2-Clause
"""Comparison of the dynamics of a closed chain with every referee: `sst-pin verify`."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import ClosureError, SSTError
from ..progress import counted
from .lagrange import LagrangeMultipliers
from .mujoco_tree import MujocoInverse
from .virtual_work import VirtualWork

#: Tolerance for the same equations, relative to the largest force or acceleration. Rounding times
#: the condition numbers of the cases is 1e-12 at worst, a thousandth of it.
SAME_EQUATIONS = 1e-9


class Referee(Protocol):
    """Dynamics of a chain that shares no code with `sst_pin.dynamics`; it takes one sample."""

    name: str

    def torques(self, q: Array, va: Array, aa: Array) -> Array:
        """The smallest motor torques of a motion, shape (motors,)."""
        ...

    def generalized_forces(self, q: Array, va: Array, aa: Array) -> Array:
        """The forces along the coordinates that a motion needs, shape (n,)."""
        ...

    def accelerations(self, q: Array, va: Array, tau: Array) -> Array:
        """Accelerations of the coordinates under motor torques, shape (n,)."""
        ...


REFEREES: tuple[Callable[[ClosedChain], Referee], ...] = (
    VirtualWork,
    LagrangeMultipliers,
    MujocoInverse,
)


class Comparison(NamedTuple):
    """One line of the table: the errors of one result against one referee."""

    referee: str
    compared: str
    cases: int
    absolute: float  #: Worst difference, [N m], [N], [rad/s^2] or [m/s^2].
    relative: float  #: Worst difference relative to the largest value of its case.
    limit: float  #: Of `relative`.
    seconds: float  #: Time of the referee.
    passed: bool


class Differences:
    """The differences from one referee in one quantity."""

    def __init__(self, referee: str, compared: str, limit: float = SAME_EQUATIONS) -> None:
        self._title, self._limit, self._seconds = (referee, compared), limit, 0.0
        self._differences: list[tuple[float, float]] = []  # absolute and relative

    def add(self, answer: Callable[[], Array], expected: Array) -> None:
        """Compute an answer and compare it with ours; NaN counts as the largest error."""
        began = time.perf_counter()
        off = float(np.abs(answer() - expected).max())
        self._seconds += time.perf_counter() - began
        off = off if np.isfinite(off) else np.inf
        self._differences.append((off, off / max(float(np.abs(expected).max()), 1e-300)))

    def comparison(self) -> Comparison:
        """The line of the table."""
        worst, relative = map(max, zip(*self._differences, strict=True))
        line = *self._title, len(self._differences), worst, relative, self._limit
        return Comparison(*line, self._seconds, relative <= self._limit)


def referees_of(chain: ClosedChain) -> tuple[list[Referee], list[SSTError]]:
    """The referees for a chain, and why the others do not apply."""
    available, problems = list[Referee](), list[SSTError]()
    for kind in REFEREES:
        try:
            available.append(kind(chain))
        except SSTError as error:
            problems.append(error)
    return available, problems


def verify_chain(
    chain: ClosedChain, count: int = 20, referees: Sequence[Referee] | None = None
) -> Iterator[Comparison]:
    """Compare the dynamics at random configurations in random motion with each referee."""
    if referees is None:
        referees, _ = referees_of(chain)
    rng, sufficient = np.random.default_rng(0), chain.mobility().sufficient
    what = (*["torques"] * sufficient, "forces along the coordinates", "accelerations")
    tables = [[Differences(referee.name, quantity) for quantity in what] for referee in referees]
    states = counted(_states(chain, count, rng), "verifying", count)
    for q, va, aa in states:
        tau = rng.normal(size=len(chain.motor_names))
        expected = [chain.generalized_forces(q, va, aa)]
        if sufficient:
            tau = chain.compute_torques(q, va, aa)
            expected.insert(0, tau)
        expected.append(chain.compute_accelerations(q, va, tau))
        for referee, row in zip(referees, tables, strict=True):
            answers = [partial(referee.generalized_forces, q, va, aa)]
            if sufficient:
                answers.insert(0, partial(referee.torques, q, va, aa))
            answers.append(partial(referee.accelerations, q, va, tau))
            for differences, answer, ours in zip(row, answers, expected, strict=True):
                differences.add(answer, ours)
    yield from (differences.comparison() for row in tables for differences in row)


def _states(
    chain: ClosedChain, count: int, rng: np.random.Generator
) -> Iterator[tuple[Array, Array, Array]]:
    """Closed configurations away from singularities, with random rates and accelerations."""
    start, model = chain.generic_configuration(), chain.mechanism.model
    n, limit = chain.degrees_of_freedom, max(1e3, float(chain.condition_number(start)))
    samples = 0
    for _ in range(100 * count):
        guess = pin.integrate(model, start, rng.normal(scale=0.3, size=model.nv))
        with suppress(ClosureError):
            q = chain.assemble(guess, fixed=())
            if chain.condition_number(q) < limit:
                yield q, rng.normal(size=n), rng.normal(size=n)
                samples += 1
        if samples == count:
            return
    raise ClosureError("no configurations away from singularities were found", np.inf)


def table(rows: Sequence[Comparison]) -> str:
    """The comparisons as plain text."""
    lines = [("referee", "compared", "cases", "worst abs", "worst rel", "limit", "time", "")]
    for row in rows:
        numbers = f"{row.absolute:.1e}", f"{row.relative:.1e}", f"{row.limit:.0e}"
        last = f"{row.seconds:.2f} s", "ok" if row.passed else "DISAGREES"
        lines.append((row.referee, row.compared, str(row.cases), *numbers, *last))
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )

# SPDX-License-Identifier: BSD-2-Clause
"""Comparisons of referees' answers with ours."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array

#: Tolerance for the same equations, relative to the largest torque or acceleration: rounding
#: times the condition numbers of the cases, 1e-12 at worst, leaves three digits to spare.
SAME_EQUATIONS = 1e-9


@dataclass(frozen=True)
class Comparison:
    """One line of the table: a referee's answers beside ours."""

    referee: str
    compared: str
    #: Number of instants, or of steps.
    cases: int
    #: Worst difference, [N m], [rad/s^2], [rad] or [J].
    absolute: float
    #: Worst difference relative to the largest value of its case.
    relative: float
    #: What `relative` had to stay below; None where `note` tells how it was judged.
    limit: float | None
    #: Time of the referee.
    seconds: float
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

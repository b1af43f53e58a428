# SPDX-License-Identifier: BSD-2-Clause
"""Comparisons of referees' answers with ours."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..arrays import Array

#: Tolerance for the same equations, relative to the largest torque or acceleration: rounding
#: times the condition numbers of the cases, 1e-12 at worst, leaves three digits to spare.
SAME_EQUATIONS = 1e-9


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


class Judge:
    """Collects differences of one referee on one question."""

    def __init__(self, referee: str, compared: str, limit: float = SAME_EQUATIONS) -> None:
        self._referee, self._compared, self._limit = referee, compared, limit
        self._differences: list[float] = []
        self._largest: list[float] = []
        self._seconds = 0.0

    def hold(self, answer: Callable[[], Array], expected: Array) -> None:
        """Ask for an answer and compare it with ours; NaN is the worst of all."""
        began = time.perf_counter()
        difference = float(np.abs(answer() - expected).max())
        self._seconds += time.perf_counter() - began
        self._differences.append(difference if np.isfinite(difference) else np.inf)
        self._largest.append(max(float(np.abs(expected).max()), 1e-300))

    @property
    def cases(self) -> int:
        """Number of cases so far."""
        return len(self._differences)

    def verdict(self) -> Comparison:
        """The line of the table."""
        worst = max(self._differences, default=0.0)
        relative = float(np.max(np.divide(self._differences, self._largest), initial=0.0))
        line = self._referee, self._compared, self.cases, worst, relative, self._limit
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

# SPDX-License-Identifier: BSD-2-Clause
"""Comparison of the dynamics of a closed chain with every referee: `sst-pin verify`."""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import SSTError
from ..identification.base_parameters import random_states
from ..progress import counted
from .lagrange import LagrangeMultipliers
from .mujoco_tree import MujocoInverse

#: Least tolerance for the same equations: rounding is far below it, slips in equations far above.
SAME_EQUATIONS = 1e-9
#: Rounding in the sums and products of one computation, relative to its terms.
_ROUNDING = 1e3 * float(np.finfo(np.float64).eps)
#: With a larger tolerance a comparison shows nothing.
_UNCLEAR = 1e-4
#: What is compared.
_TORQUES = "torques"
_FORCES = "forces along the coordinates"
_ACCELERATIONS = "accelerations"


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


REFEREES: tuple[Callable[[ClosedChain], Referee], ...] = (LagrangeMultipliers, MujocoInverse)


class Comparison(NamedTuple):
    """One line of the table: the errors of one result against one referee."""

    referee: str
    compared: str
    cases: int  #: Cases in which the referee has an answer.
    unclear: int  #: Cases in which it has none, or rounding is too large for a comparison.
    absolute: float  #: Worst difference, [N m], [N], [rad/s^2] or [m/s^2].
    relative: float  #: Worst difference relative to the terms of its case.
    limit: float  #: Of `relative` in this case.
    seconds: float  #: Time of the referee.
    passed: bool  #: Whether no case disagrees.

    @property
    def verdict(self) -> str:
        """The word in the table; "cannot say" if there is no case to compare."""
        if not self.passed:
            return "DISAGREES"
        return "ok" if self.cases else "cannot say"


class _Difference(NamedTuple):
    """The difference in one case: itself, relative to the terms of the case, and its limit."""

    absolute: float
    relative: float
    limit: float


class Differences:
    """The differences from one referee in one quantity."""

    def __init__(self, referee: str, compared: str) -> None:
        self._referee = referee
        self._compared = compared
        self._seconds = 0.0
        self._unclear = 0
        self._differences: list[_Difference] = []

    def add(self, answer: Callable[[], Array], expected: Array, size: float, limit: float) -> None:
        """Compute an answer and compare it with ours.

        `size` is the size of the terms whose sum is the result, `limit` the largest difference
        relative to it.
        """
        began = time.perf_counter()
        try:
            difference = float(np.abs(answer() - expected).max(initial=0.0))
        except (SSTError, np.linalg.LinAlgError):
            difference = np.nan
        self._seconds += time.perf_counter() - began
        if np.isfinite(difference) and limit <= _UNCLEAR:
            relative = difference / max(size, 1e-300)
            self._differences.append(_Difference(difference, relative, limit))
        else:
            self._unclear += 1

    def comparison(self) -> Comparison:
        """The line of the table; its case is the one that comes nearest to its limit."""
        worst = max(
            self._differences,
            key=lambda case: case.relative / case.limit,
            default=_Difference(0.0, 0.0, SAME_EQUATIONS),
        )
        return Comparison(
            referee=self._referee,
            compared=self._compared,
            cases=len(self._differences),
            unclear=self._unclear,
            absolute=max((case.absolute for case in self._differences), default=0.0),
            relative=worst.relative,
            limit=worst.limit,
            seconds=self._seconds,
            passed=bool(worst.relative <= worst.limit),
        )


def referees_of(chain: ClosedChain) -> tuple[list[Referee], list[SSTError]]:
    """The referees for a chain, and why the others do not apply."""
    available = list[Referee]()
    problems = list[SSTError]()
    for kind in REFEREES:
        try:
            available.append(kind(chain))
        except SSTError as error:
            problems.append(error)
    return available, problems


class _Case:
    """The dynamics of a chain in one state, with the sizes of its terms and the limits of errors.

    A result is a sum of forces of all joints. These may cancel, so the errors are relative to the
    sum of their sizes.

    Attributes:
        expected: Our results, by their names.
        sizes: The sizes of their terms.
        limits: The largest errors, relative to the sizes.
    """

    def __init__(
        self, chain: ClosedChain, q: Array, va: Array, aa: Array, tau: Array, *, sufficient: bool
    ) -> None:
        self.q = q
        self.va = va
        self.aa = aa
        self.tau = tau
        J = chain.actuator_jacobian(q)
        self.expected = {_FORCES: chain.generalized_forces(q, va, aa)}
        forces = self._forces(chain)
        self.sizes = {_FORCES: float(forces.max())}
        if sufficient:
            self.tau = chain.compute_torques(q, va, aa)
            self.expected[_TORQUES] = self.tau
            self.sizes[_TORQUES] = float((np.abs(np.linalg.pinv(J.T)) @ forces).max(initial=0.0))
        M = chain.reduced_terms(q, va).inertia
        self.expected[_ACCELERATIONS] = chain.compute_accelerations(q, va, self.tau)
        forces = forces + np.abs(M) @ np.abs(aa) + np.abs(J.T) @ np.abs(self.tau)
        self.sizes[_ACCELERATIONS] = float((np.abs(np.linalg.inv(M)) @ forces).max())
        # Two systems of equations are solved one after the other: for the rates that close the
        # loops, and for their derivatives.
        limit = max(SAME_EQUATIONS, _ROUNDING * float(chain.condition_number(q)) ** 2)
        units = np.sqrt(np.diag(M))
        limits = {_ACCELERATIONS: limit * float(np.linalg.cond(M / np.outer(units, units)))}
        self.limits = dict.fromkeys(self.expected, limit) | limits

    def _forces(self, chain: ClosedChain) -> Array:
        """Sizes of the joint forces along each coordinate, shape (n,)."""
        mechanism = chain.mechanism
        v = chain.joint_rates(self.q, self.va)
        dv = chain.joint_accelerations(self.q, self.va, self.aa)
        model = mechanism.model
        joints = np.abs(pin.rnea(model, model.createData(), self.q, v, dv))
        joints += np.abs(mechanism.friction.forces(v))
        joints += np.abs(mechanism.springs.forces(model, self.q))
        sizes: Array = np.abs(chain.noc(self.q, self.va).L).T @ joints
        return np.maximum(sizes, np.abs(self.expected[_FORCES]))


def verify_chain(
    chain: ClosedChain, count: int = 20, referees: Sequence[Referee] | None = None
) -> Iterator[Comparison]:
    """Compare the dynamics at random configurations in random motion with each referee.

    The states come from `random_states`: within limits, away from singular configurations.
    """
    if referees is None:
        referees, _ = referees_of(chain)
    rng = np.random.default_rng(0)
    sufficient = chain.mobility().sufficient
    compared = [_FORCES, _ACCELERATIONS]
    if sufficient:
        compared.insert(0, _TORQUES)
    # For each referee the differences in each quantity.
    tables: list[dict[str, Differences]] = []
    for referee in referees:
        tables.append({quantity: Differences(referee.name, quantity) for quantity in compared})
    all_q, all_va, all_aa = random_states(chain, count)
    states = zip(all_q, all_va, all_aa, strict=True)
    for q, va, aa in counted(states, "verifying", count):
        tau = rng.normal(size=len(chain.motor_names))
        case = _Case(chain, q, va, aa, tau, sufficient=sufficient)
        for referee, rows in zip(referees, tables, strict=True):
            answers = {
                _TORQUES: partial(referee.torques, q, va, aa),
                _FORCES: partial(referee.generalized_forces, q, va, aa),
                _ACCELERATIONS: partial(referee.accelerations, q, va, case.tau),
            }
            for quantity, differences in rows.items():
                differences.add(
                    answers[quantity],
                    case.expected[quantity],
                    case.sizes[quantity],
                    case.limits[quantity],
                )
    for rows in tables:
        for differences in rows.values():
            yield differences.comparison()


def table(rows: Sequence[Comparison]) -> str:
    """The comparisons as plain text."""
    lines = [("referee", "compared", "cases", "worst abs", "worst rel", "limit", "time", "")]
    for row in rows:
        lines.append(
            (
                row.referee,
                row.compared,
                str(row.cases),
                f"{row.absolute:.1e}",
                f"{row.relative:.1e}",
                f"{row.limit:.0e}",
                f"{row.seconds:.2f} s",
                row.verdict,
            )
        )
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    texts = []
    for line in lines:
        cells = [cell.ljust(width) for cell, width in zip(line, widths, strict=True)]
        texts.append("  ".join(cells).rstrip())
    return "\n".join(texts)

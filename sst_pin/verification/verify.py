# SPDX-License-Identifier: BSD-2-Clause
"""Comparison of the dynamics of a closed chain with every referee: `sst-pin verify`.

`verify_chain` compares torques, forces and accelerations in random states. `_expected` has our
results and the largest errors that rounding can explain, `Differences` collects the errors, and
`table` prints them.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import SSTError
from ..identification.random_states import random_states
from ..progress import counted
from .lagrange import LagrangeMultipliers
from .mujoco_tree import MujocoInverse

#: Smallest limit of a relative error: rounding is far below it, errors of equations are far above.
SAME_EQUATIONS = 1e-9
#: Rounding in the sums and products of one computation, relative to its terms.
_ROUNDING = 1e3 * float(np.finfo(np.float64).eps)
#: A comparison with a larger limit shows nothing.
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
    """One line of the table: one quantity compared with one referee, in all states.

    A case is the quantity in one state.
    """

    referee: str
    compared: str  #: The quantity.
    cases: int  #: Cases that are compared.
    unclear: int  #: Cases without an answer of the referee, or with a limit above `_UNCLEAR`.
    absolute: float  #: Largest difference of all cases, [N m], [N], [rad/s^2] or [m/s^2].
    relative: float  #: Relative error in the case that comes nearest to its limit; see `Expected`.
    limit: float  #: Limit of the relative error in this case.
    seconds: float  #: Time that the referee has taken.
    passed: bool  #: Whether no relative error is above its limit.

    @property
    def verdict(self) -> str:
        """The word in the table; "cannot say" if there is no case to compare."""
        if not self.passed:
            return "DISAGREES"
        return "ok" if self.cases else "cannot say"


class Expected(NamedTuple):
    """Our result for one quantity in one state.

    A result is a sum of forces of all joints. They may cancel, so the relative error is the
    difference divided by the sum of their sizes.
    """

    value: Array
    size: float  #: Sum of the sizes of the terms of the result.
    limit: float  #: Limit of the relative error.


class _Difference(NamedTuple):
    """The difference between a referee's result and ours in one case."""

    absolute: float  #: Largest difference of an entry.
    relative: float  #: The relative error; see `Expected`.
    limit: float  #: Limit of the relative error.


class Differences:
    """The differences from one referee in one quantity."""

    def __init__(self, referee: str, compared: str) -> None:
        self._referee = referee
        self._compared = compared
        self._seconds = 0.0
        self._unclear = 0
        self._differences: list[_Difference] = []

    def add(self, answer: Callable[[], Array], expected: Expected) -> None:
        """Compute an answer of the referee and compare it with ours."""
        began = time.perf_counter()
        try:
            absolute = float(np.abs(answer() - expected.value).max(initial=0.0))
        except (SSTError, np.linalg.LinAlgError):
            absolute = np.nan  # no answer
        self._seconds += time.perf_counter() - began
        if np.isfinite(absolute) and expected.limit <= _UNCLEAR:
            relative = absolute / max(expected.size, 1e-300)
            self._differences.append(_Difference(absolute, relative, expected.limit))
        else:
            self._unclear += 1

    def comparison(self) -> Comparison:
        """The line of the table."""
        # The case that comes nearest to its limit.
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


def _expected(
    chain: ClosedChain, q: Array, va: Array, aa: Array, tau: Array
) -> dict[str, Expected]:
    """Our results in a state, by quantity.

    The accelerations are those under the motor torques `tau`. If torques are compared, `tau` are
    the torques of the motion q, va, aa.
    """
    f = chain.generalized_forces(q, va, aa)
    sizes = np.maximum(_sizes_of_forces(chain, q, va, aa), np.abs(f))
    # Two systems of equations are solved one after the other: for the rates that close the loops,
    # and for their derivatives. Each increases rounding by the condition number.
    limit = max(SAME_EQUATIONS, _ROUNDING * float(chain.condition_number(q)) ** 2)

    # The torques are pinv(J^T) f, and the sizes of their terms |pinv(J^T)| sizes.
    J = chain.actuator_jacobian(q)
    sizes_of_torques = np.abs(np.linalg.pinv(J.T)) @ sizes

    # The accelerations under tau are M^-1 (J^T tau - h), where the forces h = f - M aa do not
    # depend on accelerations. So the terms of J^T tau - h are those of J^T tau, f and M aa. The
    # system with M increases rounding by the condition number of M.
    M = chain.reduced_terms(q, va).inertia
    sizes_with_motors = sizes + np.abs(M) @ np.abs(aa) + np.abs(J.T) @ np.abs(tau)
    sizes_of_accelerations = np.abs(np.linalg.inv(M)) @ sizes_with_motors
    units = np.sqrt(np.diag(M))  # so that the condition number does not depend on units
    condition = float(np.linalg.cond(M / np.outer(units, units)))

    return {
        _TORQUES: Expected(value=tau, size=float(sizes_of_torques.max(initial=0.0)), limit=limit),
        _FORCES: Expected(value=f, size=float(sizes.max()), limit=limit),
        _ACCELERATIONS: Expected(
            value=chain.compute_accelerations(q, va, tau),
            size=float(sizes_of_accelerations.max()),
            limit=limit * condition,
        ),
    }


def _sizes_of_forces(chain: ClosedChain, q: Array, va: Array, aa: Array) -> Array:
    """Sizes of the terms of the generalized forces L^T forces: |L|^T |forces|, shape (n,)."""
    mechanism = chain.mechanism
    model = mechanism.model
    v = chain.joint_rates(q, va)
    dv = chain.joint_accelerations(q, va, aa)
    joints = np.abs(pin.rnea(model, model.createData(), q, v, dv))
    joints += np.abs(mechanism.friction.forces(v))
    joints += np.abs(mechanism.springs.forces(model, q))
    sizes: Array = np.abs(chain.noc(q, va).L).T @ joints
    return sizes


def verify_chain(
    chain: ClosedChain, count: int = 20, referees: Sequence[Referee] | None = None
) -> Iterator[Comparison]:
    """Compare the dynamics at random configurations in random motion with each referee.

    The states come from `random_states`: within limits, away from singular configurations. Torques
    are compared only if the motors suffice for any motion. If they do not, accelerations under
    random torques are compared.
    """
    if referees is None:
        referees, _ = referees_of(chain)
    rng = np.random.default_rng(0)
    sufficient = chain.mobility().sufficient
    compared = [_FORCES, _ACCELERATIONS]
    if sufficient:
        compared.insert(0, _TORQUES)
    # For each referee, a table of the differences in each quantity.
    tables: list[dict[str, Differences]] = []
    for referee in referees:
        tables.append({quantity: Differences(referee.name, quantity) for quantity in compared})
    all_q, all_va, all_aa = random_states(chain, count)
    states = zip(all_q, all_va, all_aa, strict=True)
    for q, va, aa in counted(states, "verifying", count):
        if sufficient:
            tau = chain.compute_torques(q, va, aa)
        else:
            tau = rng.normal(size=len(chain.motor_names))
        expected = _expected(chain, q, va, aa, tau)
        for referee, differences in zip(referees, tables, strict=True):
            answers = {
                _TORQUES: partial(referee.torques, q, va, aa),
                _FORCES: partial(referee.generalized_forces, q, va, aa),
                _ACCELERATIONS: partial(referee.accelerations, q, va, tau),
            }
            for quantity in compared:
                differences[quantity].add(answers[quantity], expected[quantity])
    for differences in tables:
        for quantity in compared:
            yield differences[quantity].comparison()


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

# SPDX-License-Identifier: BSD-2-Clause
"""Where a motion leaves the joint limits of its robot or comes close to a singularity."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, Flags, single_array
from ..closed_chain import ClosedChain
from ..loops.starts import is_closed
from ..model.thresholds import CLOSURE_TOLERANCE
from .moving_robot import require_motion
from .trajectories import Trajectory

#: Condition number of the dependent joints from which a configuration is close to a singularity.
LARGEST_CONDITION = 1e3


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that the machine cannot execute in a motion.

    Attributes:
        problem: A sentence.
        joints: The joints concerned.
        times: Times of the samples concerned, shape (n,), [s]; NaN for a single configuration.
        values: What is out of its limits there, shape (n,): the joint's position, [rad] or [m]; a
            condition number; for a singularity of the first kind of an SST |sin(mu_k)|.
        limits: The lower and the upper one.
        unit: Unit of the value in the text: "rad", "deg" or "m"; "" for a number.
        singular: Whether it is a singularity.
    """

    problem: str
    joints: tuple[str, ...]
    times: Array
    values: Array
    limits: tuple[float, float]
    unit: str = ""
    singular: bool = False

    def __str__(self) -> str:
        low, high = self.limits
        worst = np.maximum(low - self.values, self.values - high).argmax()
        value = self.values[worst]
        shown = np.degrees(value) if self.unit == "deg" else value
        text = f"{self.problem}: {shown:.4g} {self.unit}".rstrip()
        if np.isnan(self.times[worst]):
            return text
        text += f" at t = {self.times[worst]:.6g} s"
        if len(self.times) == 1:
            return text
        first, last = self.times[[0, -1]]
        return f"{text} ({len(self.times)} samples from {first:.6g} to {last:.6g} s)"


#: Problem, joints, values (N,), which of them are at fault, limits, unit, whether singular.
Verdict = tuple[str, tuple[str, ...], Array, Flags, tuple[float, float], str, bool]


def samples_of(chain: ClosedChain, motion: Any) -> tuple[Array, Array]:
    """Times and configurations of a motion, shapes (N,) and (N, nq); NaN for the time of one q."""
    if isinstance(motion, Trajectory):
        require_motion(motion, chain)
        return motion.t, motion.q
    q = single_array("motion", motion, (len(chain.position_names),))
    return np.array([np.nan]), q[None]


def findings(chain: ClosedChain, motion: Any) -> tuple[Finding, ...]:
    """What `ClosedChain.check` finds, one for each verdict with samples at fault."""
    t, q = samples_of(chain, motion)
    return tuple(
        Finding(problem, joints, t[out], values[out], limits, unit, singular)
        for problem, joints, values, out, limits, unit, singular in chain._verdicts(q)
        if out.any()
    )


def over_limits(chain: ClosedChain) -> Array:
    """How far joints may pass their limits by rounding, shape (nq,), infinite for quaternions."""
    sizes = {"rad": 1.0, "m": chain.mechanism.length, "": np.inf}
    return CLOSURE_TOLERANCE * np.array([sizes[unit] for unit in chain.joint_units])


def verdicts(chain: ClosedChain, q: Array) -> Iterable[Verdict]:
    """Joint limits and singularities of any closed chain at configurations, shape (N, nq)."""
    low, high = chain.mechanism.model.lowerPositionLimit, chain.mechanism.model.upperPositionLimit
    out = np.maximum(low - q, q - high) > over_limits(chain)
    yield from outside("limits", chain.position_names, chain.joint_units, q, out, low, high)
    closed = is_closed(chain, q)
    condition = np.ones(len(q))
    condition[closed] = chain.condition_number(q[closed])
    problem = f"close to a singularity, condition number > {LARGEST_CONDITION:g}"
    far, limits = condition > LARGEST_CONDITION, (-np.inf, LARGEST_CONDITION)
    yield problem, chain.coordinates, condition, far, limits, "", True


def outside(
    ends: str,
    names: Sequence[str],
    units: Sequence[str],
    q: Array,
    out: Flags,
    low: Array,
    high: Array,
) -> Iterable[Verdict]:
    """A verdict for each joint that has a unit, which leaves its ends where it is out."""
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        if unit:
            limits = (float(low[i]), float(high[i]))
            first, last = np.degrees(limits) if unit == "deg" else limits
            problem = f"{name} leaves its {ends} of {first:.4g} to {last:.4g} {unit}"
            yield problem, (name,), q[:, i], out[:, i], limits, unit, False

# SPDX-License-Identifier: BSD-2-Clause
"""Finds where a motion leaves joint limits or comes close to a singularity."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, Flags, single_array
from ..engine import Engine
from ..model.mechanism import Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE
from .trajectories import Trajectory, require_motion

#: A configuration with a larger condition number of the dependent joints is close to a singularity.
LARGEST_CONDITION = 1e3


@dataclass(frozen=True, eq=False)
class Finding:
    """A joint beyond its limits, or a singularity, along a motion.

    Attributes:
        problem: A sentence.
        joints: The joints concerned.
        times: Times of the samples concerned, shape (n,), [s]; NaN for a single configuration.
        values: What is beyond its limits there, shape (n,): the joint's position, [rad] or [m]; a
            condition number; for a singularity of the first kind of an SST |sin(mu_k)|.
        limits: The lower and the upper limit.
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


def samples_of(mechanism: Mechanism, motion: Any) -> tuple[Array, Array]:
    """Times (N,) and configurations (N, nq) of a motion; the time of a single q is NaN."""
    if isinstance(motion, Trajectory):
        require_motion(motion, mechanism)
        return motion.t, motion.q
    q = single_array("motion", motion, (mechanism.model.nq,))
    return np.array([np.nan]), q[None]


def over_limits(mechanism: Mechanism) -> Array:
    """Tolerance of the limits for rounding, shape (nq,); infinite for entries without a unit."""
    sizes = {"rad": 1.0, "m": mechanism.length, "": np.inf}
    return CLOSURE_TOLERANCE * np.array([sizes[unit] for unit in mechanism.space.position_units])


def findings(engine: Engine, t: Array, q: Array) -> Iterator[Finding]:
    """Joint limits and singularities of any closed chain at configurations, shape (N, nq)."""
    mechanism = engine.mechanism
    model, space = mechanism.model, mechanism.space
    ends = model.lowerPositionLimit, model.upperPositionLimit
    out = np.maximum(ends[0] - q, q - ends[1]) > over_limits(mechanism)
    yield from outside("limits", space.position_names, space.position_units, t, q, out, ends)
    closed = engine.are_closed(q)
    condition = np.ones(len(q))
    condition[closed] = engine.condition_numbers(q[closed])
    problem = f"close to a singularity, condition number > {LARGEST_CONDITION:g}"
    far, limits = condition > LARGEST_CONDITION, (-np.inf, LARGEST_CONDITION)
    yield from singular(problem, mechanism.coordinate_names, t, condition, far, limits)


def singular(
    problem: str,
    joints: tuple[str, ...],
    t: Array,
    values: Array,
    out: Flags,
    limits: tuple[float, float],
) -> Iterator[Finding]:
    """One finding for all samples where `out` is true; none if there are none."""
    if out.any():
        yield Finding(problem, joints, t[out], values[out], limits, singular=True)


def outside(
    what: str,
    names: Sequence[str],
    units: Sequence[str],
    t: Array,
    q: Array,
    out: Flags,
    ends: tuple[Array, Array],
) -> Iterator[Finding]:
    """A finding for each joint that leaves its range, at samples where `out` is true."""
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        if unit and out[:, i].any():
            limits = (float(ends[0][i]), float(ends[1][i]))
            first, last = np.degrees(limits) if unit == "deg" else limits
            problem = f"{name} leaves its {what} of {first:.4g} to {last:.4g} {unit}"
            yield Finding(problem, (name,), t[out[:, i]], q[out[:, i], i], limits, unit)

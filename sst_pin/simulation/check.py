# SPDX-License-Identifier: BSD-2-Clause
"""Finds where a motion leaves limits of joints, motors or lines, or nears a singularity.

`findings` judges configurations: limits of positions and lengths, and singularities.
`findings_of_motion` judges rates and forces too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, Flags, single_array
from ..engine import Engine
from ..model.conventions import NO_LIMIT
from ..model.mechanism import Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE
from .trajectories import Trajectory, require_motion

#: A configuration with a larger condition number of the dependent joints is close to a singularity.
LARGEST_CONDITION = 1e3
#: A force or a rate may exceed its limit by this part of it, which is rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Finding:
    """A joint, a motor or a line beyond its limits, or a singularity, along a motion.

    Attributes:
        problem: A sentence.
        joints: Names of the joints, lines or coordinates concerned.
        times: Times of the samples concerned, shape (n,), [s]; NaN for a single configuration.
        values: What is beyond its limits there, shape (n,): a position of a joint, [rad] or [m]; a
            rate; a force of the motors on a joint or a line, [N m] or [N]; a length of a line, [m];
            a condition number; for a singularity of the first kind of an SST |sin(mu_k)|.
        limits: The lower and the upper limit.
        unit: Unit of the value in the text, such as "rad", "deg" or "N m"; "" for a number.
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


def findings(engine: Engine, t: Array, q: Array) -> Iterator[Finding]:
    """Joints and lines beyond their limits, and singularities, at configurations (N, nq)."""
    mechanism = engine.mechanism
    model = mechanism.model
    space = mechanism.space
    low = model.lowerPositionLimit
    high = model.upperPositionLimit
    is_outside = np.maximum(low - q, q - high) > limit_tolerances(mechanism)
    names = space.position_names
    yield from outside("limits", names, space.position_units, t, q, is_outside, (low, high))
    yield from _lengths(engine, t, q)
    condition = _condition_numbers(engine, q)
    yield from singular(
        f"close to a singularity, condition number > {LARGEST_CONDITION:g}",
        mechanism.coordinate_names,
        t,
        condition,
        condition > LARGEST_CONDITION,
        (-np.inf, LARGEST_CONDITION),
    )


def findings_of_motion(engine: Engine, motion: Trajectory) -> Iterator[Finding]:
    """Rates of joints and lines, and forces of motors on them, beyond their limits.

    Rates near a singularity are not judged, because `findings` names the singularity.
    """
    mechanism = engine.mechanism
    model = mechanism.model
    space = mechanism.space
    lines = mechanism.lines
    joint_names = space.rate_names
    line_names = [line.name for line in lines.forces]

    efforts = motion.tau @ mechanism.effort_factors.T  # on joints, then on lines
    names = [*joint_names, *line_names]
    units = ["N m" if unit == "rad" else "N" for unit in space.rate_units]
    units += ["N" for _ in line_names]
    limits = _limits(mechanism.effort_limits)
    yield from _beyond("efforts", names, units, motion.t, efforts, limits)

    joint_limits = _limits(model.velocityLimit)
    line_limits = _limits([line.velocity for line in lines.forces])
    if not (np.isfinite(joint_limits).any() or np.isfinite(line_limits).any()):
        return
    is_regular = _condition_numbers(engine, motion.q) <= LARGEST_CONDITION
    t = motion.t[is_regular]
    q = motion.q[is_regular]
    v = engine.joint_rates(q, motion.va[is_regular])
    units = [f"{unit}/s" for unit in space.rate_units]
    yield from _beyond("velocities", joint_names, units, t, v, joint_limits)
    units = ["m/s" for _ in line_names]
    yield from _beyond("velocities", line_names, units, t, engine.line_rates(q, v), line_limits)


def samples_of(mechanism: Mechanism, motion: Any) -> tuple[Array, Array]:
    """Times (N,) and configurations (N, nq) of a motion; the time of a single q is NaN."""
    if isinstance(motion, Trajectory):
        require_motion(motion, mechanism)
        return motion.t, motion.q
    q = single_array("motion", motion, (mechanism.model.nq,))
    return np.array([np.nan]), q[None]


def limit_tolerances(mechanism: Mechanism) -> Array:
    """Tolerance of the limits for rounding, shape (nq,); infinite for entries without a unit."""
    sizes = {"rad": 1.0, "m": mechanism.length, "": np.inf}
    return CLOSURE_TOLERANCE * np.array([sizes[unit] for unit in mechanism.space.position_units])


def outside(
    what: str,
    names: Sequence[str],
    units: Sequence[str],
    t: Array,
    values: Array,
    is_outside: Flags,
    ends: tuple[Array, Array],
) -> Iterator[Finding]:
    """A finding for each column of values that leaves its range, with the samples that do.

    Args:
        what: What the ranges are called in the text, such as "limits" or "arc".
        names: Names of the columns, such as joints.
        units: Units of the columns; columns with the unit "" have no range.
        t: Times, shape (N,).
        values: Shape (N, columns).
        is_outside: Which values are out of their range, shape (N, columns).
        ends: Lower and upper limits, shapes (columns,).
    """
    low, high = ends
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        samples = is_outside[:, i]
        if not unit or not samples.any():
            continue
        limits = (float(low[i]), float(high[i]))
        first, last = np.degrees(limits) if unit == "deg" else limits
        problem = f"{name} leaves its {what} of {first:.4g} to {last:.4g} {unit}"
        yield Finding(problem, (name,), t[samples], values[samples, i], limits, unit)


def singular(
    problem: str,
    joints: tuple[str, ...],
    t: Array,
    values: Array,
    is_singular: Flags,
    limits: tuple[float, float],
) -> Iterator[Finding]:
    """One finding for all samples where `is_singular` is true; none if there are none."""
    if is_singular.any():
        times = t[is_singular]
        yield Finding(problem, joints, times, values[is_singular], limits, singular=True)


def _lengths(engine: Engine, t: Array, q: Array) -> Iterator[Finding]:
    """Lines, such as cylinders, that are shorter or longer than they can be."""
    lines = engine.mechanism.lines.forces
    low = np.array([line.lower for line in lines])
    high = np.array([line.upper for line in lines])
    if not (low.any() or np.isfinite(high).any()):
        return
    lengths = np.array([engine.reference.line_lengths(each) for each in q])
    tolerance = CLOSURE_TOLERANCE * engine.mechanism.length
    is_outside = np.maximum(low - lengths, lengths - high) > tolerance
    names = [line.name for line in lines]
    units = ["m" for _ in lines]
    yield from outside("lengths", names, units, t, lengths, is_outside, (low, high))


def _condition_numbers(engine: Engine, q: Array) -> Array:
    """Condition numbers at configurations, shape (N,); NaN for open loops, which have none."""
    is_closed = engine.loops.are_closed(q)
    condition = np.full(len(q), np.nan)
    condition[is_closed] = engine.loops.condition_numbers(q[is_closed])
    return condition


def _limits(numbers: Sequence[float] | Array) -> Array:
    """Limits of efforts or velocities, infinite where a file has zero or at least `NO_LIMIT`."""
    values = np.array(numbers, dtype=float)
    return np.where((values > 0) & (values < NO_LIMIT), values, np.inf)


def _beyond(
    what: str, names: Sequence[str], units: Sequence[str], t: Array, values: Array, limits: Array
) -> Iterator[Finding]:
    """A finding for each column in which a value, without its sign, is larger than the limit.

    Shapes are those of `outside`; `limits` has shape (columns,).
    """
    is_outside = np.abs(values) > limits * (1 + _ROUNDING)
    yield from outside(what, names, units, t, values, is_outside, (-limits, limits))

# SPDX-License-Identifier: BSD-2-Clause
"""Finds where a motion leaves limits of joints, motors or lines, or nears a singularity."""

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
#: Larger limits are none, as URDF files write them.
FAR = 1e9
#: Rounding of a force that is exactly at its limit.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Finding:
    """A joint, a motor or a line beyond its limits, or a singularity, along a motion.

    Attributes:
        problem: A sentence.
        joints: The joints concerned.
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
    yield from _lengths(engine, t, q)
    closed = engine.loops.are_closed(q)
    condition = np.ones(len(q))
    condition[closed] = engine.loops.condition_numbers(q[closed])
    problem = f"close to a singularity, condition number > {LARGEST_CONDITION:g}"
    far, limits = condition > LARGEST_CONDITION, (-np.inf, LARGEST_CONDITION)
    yield from singular(problem, mechanism.coordinate_names, t, condition, far, limits)


def _lengths(engine: Engine, t: Array, q: Array) -> Iterator[Finding]:
    """Lines that are shorter or longer than they can be."""
    lines = engine.mechanism.lines.forces
    ends = np.array([(line.lower, line.upper) for line in lines]).reshape(-1, 2).T
    if not (ends[0].any() or np.isfinite(ends[1]).any()):
        return
    lengths = np.array([engine.reference.line_lengths(each) for each in q])
    over = CLOSURE_TOLERANCE * engine.mechanism.length
    out = np.maximum(ends[0] - lengths, lengths - ends[1]) > over
    names, units = [line.name for line in lines], ["m"] * len(lines)
    yield from outside("lengths", names, units, t, lengths, out, (ends[0], ends[1]))


def findings_of_motion(engine: Engine, motion: Trajectory) -> Iterator[Finding]:
    """Rates of joints and lines, and forces of motors on them, beyond their limits.

    Near a singularity rates are not judged: the singularity is a finding itself.
    """
    mechanism, tau = engine.mechanism, motion.tau
    model, units = mechanism.model, mechanism.space.rate_units
    forces, names = mechanism.lines.forces, list(mechanism.space.rate_names)
    line_names = [line.name for line in forces]

    efforts = tau @ mechanism.motors.T, tau @ mechanism.lines.motors.T
    of_joints, of_lines = (_limits(x) for x in (model.effortLimit, [x.effort for x in forces]))
    force_units = ["N m" if unit == "rad" else "N" for unit in units]
    yield from _beyond("efforts", names, force_units, motion.t, efforts[0], of_joints)
    yield from _beyond("efforts", line_names, ["N"] * len(forces), motion.t, efforts[1], of_lines)

    of_joints, of_lines = (_limits(x) for x in (model.velocityLimit, [x.velocity for x in forces]))
    if not (np.isfinite(of_joints).any() or np.isfinite(of_lines).any()):
        return
    regular = engine.loops.are_closed(motion.q)
    regular[regular] = engine.loops.condition_numbers(motion.q[regular]) <= LARGEST_CONDITION
    t, q = motion.t[regular], motion.q[regular]
    v = engine.joint_rates(q, motion.va[regular])
    rate_units = [f"{unit}/s" for unit in units]
    yield from _beyond("velocities", names, rate_units, t, v, of_joints)
    rates = engine.line_rates(q, v)
    yield from _beyond("velocities", line_names, ["m/s"] * len(forces), t, rates, of_lines)


def _limits(numbers: Sequence[float] | Array) -> Array:
    """Limits of efforts or velocities; zero, or beyond all machines, is none."""
    values = np.array(numbers, dtype=float)
    return np.where((values > 0) & (values < FAR), values, np.inf)


def _beyond(
    what: str, names: Sequence[str], units: Sequence[str], t: Array, values: Array, limits: Array
) -> Iterator[Finding]:
    """A finding for each value that is larger than its limit, whatever its sign."""
    out = np.abs(values) > limits * (1 + _ROUNDING)
    yield from outside(what, names, units, t, values, out, (-limits, limits))


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
    """A finding for each value that leaves its range, at samples where `out` is true."""
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        if unit and out[:, i].any():
            limits = (float(ends[0][i]), float(ends[1][i]))
            first, last = np.degrees(limits) if unit == "deg" else limits
            problem = f"{name} leaves its {what} of {first:.4g} to {last:.4g} {unit}"
            yield Finding(problem, (name,), t[out[:, i]], q[out[:, i], i], limits, unit)

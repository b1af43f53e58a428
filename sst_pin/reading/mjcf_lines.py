# SPDX-License-Identifier: BSD-2-Clause
"""Spatial tendons of an MJCF as forces along lines between two sites."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..model.checks import Motor, tendon_of
from ..model.conventions import NO_LIMIT
from ..model.lines import LineForce
from .mjcf_compiled import Compiled
from .robot_file import naming


def line_problem(compiled: Compiled, tendon: int) -> str:
    """Why a spatial tendon cannot be a line between two sites; empty if it can."""
    mj = compiled.mj
    kinds = mj.wrap_type[compiled.wraps(tendon)]
    if (kinds != int(compiled.mujoco.mjtWrap.mjWRAP_SITE)).any():
        return "a tendon with pulleys or around geoms is not supported"
    if len(kinds) != 2:
        return f"a tendon through {len(kinds)} sites is not supported; two are"
    if compiled.name("tendon", tendon) in map(compiled.joint_name, range(mj.njnt)):
        return "a joint has this name too; rename one"
    return ""


def lines_of(
    compiled: Compiled,
    motors: Sequence[Motor],
    efforts: Mapping[str, float],
    ropes: Collection[str],
) -> Iterator[LineForce]:
    """Spatial tendons with a spring, a damper, friction or inertia, and those that are motors.

    A tendon that cannot be a line adds a problem to `compiled.problems`, a tendon whose limits are
    ignored a note to `compiled.notes`.

    Args:
        compiled: The model.
        motors: Motors of the robot.
        efforts: The largest forces of motors on tendons, by name.
        ropes: Names of the tendons that are read as ropes; their limits are not ignored.
    """
    mj = compiled.mj
    driven = set[str]()  # names of joints and lines on which motors act
    for motor in motors:
        _, factors = tendon_of(motor)
        driven.update(factors)
    for tendon in range(mj.ntendon):
        name = compiled.name("tendon", tendon)
        force = _force_of(compiled, tendon)
        has_limits = mj.tendon_limited[tendon] and not compiled.disabled("limit")
        is_line = compiled.is_spatial(tendon) and (any(force) or name in driven)
        if not is_line:
            if has_limits and name not in ropes:
                compiled.notes.append(f"tendon {name}: its limits are ignored")
            continue

        problem = line_problem(compiled, tendon) or _dead_band_problem(compiled, tendon, force)
        if problem:
            compiled.problems.append(f"tendon {name}: {problem}")
            continue
        lower = 0.0
        upper = np.inf
        if has_limits:
            lower, upper = mj.tendon_range[tendon]
        yield _line(compiled, tendon, force, (lower, upper), efforts.get(name, np.inf))


class _Force(NamedTuple):
    """Coefficients of the forces of a tendon, without those that a flag disables."""

    stiffness: float
    damping: float
    dry_friction: float
    mass: float


def _force_of(compiled: Compiled, tendon: int) -> _Force:
    """The coefficients of a tendon, zero for a force that a flag disables."""
    mj = compiled.mj
    stiffness = 0.0
    damping = 0.0
    dry_friction = 0.0
    if not compiled.disabled("spring"):
        stiffness = mj.tendon_stiffness[tendon]
    if not compiled.disabled("damper"):
        damping = mj.tendon_damping[tendon]
    if not compiled.disabled("frictionloss"):
        dry_friction = mj.tendon_frictionloss[tendon]
    return _Force(stiffness, damping, dry_friction, compiled.tendon_armature[tendon])


def _dead_band_problem(compiled: Compiled, tendon: int, force: _Force) -> str:
    """Why the dead band of a tendon's spring is not supported; empty if it is.

    A dead band is a range of lengths at which the spring has no force. If it starts at length 0,
    the tendon is a cable, which only pulls.
    """
    shortest, longest = compiled.mj.tendon_lengthspring[tendon]
    if not force.stiffness or shortest == longest:
        return ""
    if shortest > 0:
        return "a springlength with a dead band is supported from 0 only, as a cable"
    if force.damping or force.dry_friction or force.mass:
        text = "damping, frictionloss and armature act on a slack cable too"
        return f"a springlength with a dead band, and {text}; give them to a second tendon"
    return ""


def _line(
    compiled: Compiled,
    tendon: int,
    force: _Force,
    limits: tuple[float, float],
    effort: float,
) -> LineForce:
    """The line of a spatial tendon between two sites.

    `limits` are its least and largest length, [m]; `effort` is the largest force of its motor, [N].
    """
    mj = compiled.mj
    lower, upper = limits
    site_a, site_b = mj.wrap_objid[compiled.wraps(tendon)]
    shortest, longest = mj.tendon_lengthspring[tendon]
    with naming(compiled.source):
        return LineForce(
            compiled.name("site", site_a),
            compiled.name("site", site_b),
            name=compiled.name("tendon", tendon),
            stiffness=force.stiffness,
            rest_length=longest if force.stiffness else 0.0,
            damping=force.damping,
            coulomb_friction=force.dry_friction,
            mass=force.mass,
            lower=max(lower, 0.0),
            upper=upper if upper < NO_LIMIT else np.inf,
            effort=effort,
            pulls_only=bool(force.stiffness and shortest != longest),
        )

# SPDX-License-Identifier: BSD-2-Clause
"""Attributes of the joints of an MJCF: friction, rotors, springs and limits.

A joint of MuJoCo has one number for all its rates, for instance one damping; here each rate of a
joint has its own number. So different numbers of one joint cannot be written.
"""

from collections.abc import Iterator

import numpy as np

from ..arrays import Array
from ..model.conventions import NO_LIMIT
from ..model.mechanism import Mechanism
from .mjcf_attributes import SINGLE
from .mjcf_joints import MjcfJoint
from .urdf_writer import numbers

#: URDF demands a largest velocity; this or a larger one stands for none, [rad/s] or [m/s]. It is
#: the number that `urdf_writer` writes for none.
_FAST = 1e3
#: Entries x, y and z up to this size count as zero in the quaternion at which the spring of a ball
#: is relaxed. They have the rounding of a few products of numbers up to 1, some 1e-16 each.
_REST_ROUNDING = 1e-12


def joint_attributes(mechanism: Mechanism, joint: MjcfJoint) -> dict[str, str]:
    """Friction, rotor, spring and limits of a joint that is no mimic joint."""
    attributes = dict[str, str]()
    for name, numbers_of_rates in _numbers_by_name(mechanism).items():
        values = numbers_of_rates[joint.rates]
        if values.any():
            attributes[name] = numbers(values[:1])
    if joint.kind in SINGLE:
        if "stiffness" in attributes:
            attributes["springref"] = numbers(joint.qpos(mechanism.springs.reference))
        attributes |= _limits(mechanism, joint)
    return attributes


def joint_problems(mechanism: Mechanism, joint: MjcfJoint) -> Iterator[str]:
    """Numbers of a joint that MJCF cannot express."""
    for name, numbers_of_rates in _numbers_by_name(mechanism).items():
        values = numbers_of_rates[joint.rates]
        # `from_mjcf` reads only the damping of a free joint.
        is_refused_for_free = joint.kind == "free" and name != "damping" and values.any()
        if np.ptp(values) or is_refused_for_free:
            yield f"joint {joint.name}: no {name} of single rates of a {joint.kind} joint"
    has_spring = mechanism.springs.stiffness[joint.rates].any()
    if joint.kind == "ball" and has_spring:
        at_rest = joint.qpos(mechanism.springs.reference)  # w, x, y, z
        # Both quaternions [1, 0, 0, 0] and [-1, 0, 0, 0] are the orientation zero.
        if np.abs(at_rest[1:]).max() > _REST_ROUNDING:
            yield f"joint {joint.name}: a spring of a ball can be relaxed at zero only"


def has_velocity_limit(mechanism: Mechanism, joint: MjcfJoint) -> bool:
    """Whether a joint has a largest velocity, which MuJoCo does not have."""
    fastest = mechanism.model.velocityLimit[joint.rates]
    return bool(((fastest > 0) & (fastest < _FAST)).any())


def _numbers_by_name(mechanism: Mechanism) -> dict[str, Array]:
    """Numbers of all rates of a robot, shape (nv,), by their names in an MJCF."""
    return {
        "damping": mechanism.friction.viscous,
        "frictionloss": mechanism.friction.coulomb,
        "armature": mechanism.model.armature,
        "stiffness": mechanism.springs.stiffness,
    }


def _limits(mechanism: Mechanism, joint: MjcfJoint) -> dict[str, str]:
    """Limits of the position and of the force of a hinge or a slide."""
    model = mechanism.model
    limits = dict[str, str]()
    lower = model.lowerPositionLimit[joint.entries]
    upper = model.upperPositionLimit[joint.entries]
    # A continuous joint has two entries, cosine and sine, and no range.
    if len(lower) == 1 and min(abs(lower[0]), abs(upper[0])) < NO_LIMIT:
        limits["range"] = numbers(
            [lower[0].clip(-NO_LIMIT, NO_LIMIT), upper[0].clip(-NO_LIMIT, NO_LIMIT)]
        )
    effort = _effort_of_tendons(mechanism, int(joint.rates[0]))
    if effort:
        limits["actuatorfrcrange"] = numbers([-effort, effort])
    return limits


def _effort_of_tendons(mechanism: Mechanism, rate: int) -> float:
    """The limit of the force on a rate, if a motor acts on it through a tendon; else 0.

    It is 0 for an unlimited force too. A motor acts through a tendon if it acts on several rates,
    or on one by a factor other than 1. The limit of a motor in the joint itself is not written
    here, but with the motor, as its `ctrlrange`.
    """
    factors = mechanism.actuation  # shape (nv, motors)
    is_in_joint = (np.count_nonzero(factors, axis=0) == 1) & (factors.sum(axis=0) == 1)
    limit = float(mechanism.model.upperEffortLimit[rate])
    if factors[rate, ~is_in_joint].any() and 0 < limit < NO_LIMIT:
        return limit
    return 0.0

# SPDX-License-Identifier: BSD-2-Clause
"""Data of a robot for a live page, which computes the robot's motion in the browser.

The keys are the names that the scripts of the page use. `live.js` reads the data of sliders and of
the drawing; `engine.js` and `nonsmooth.js`, in `compiled`, read the state, the scales and the
limits. Matrices are listed column by column, as in WebGL.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..model.conventions import EARTH_GRAVITY
from ..model.mechanism import Mechanism
from ..simulation.check import LARGEST_CONDITION, limit_tolerances
from .curve_sets import torques_of
from .force_shares import moving_mass
from .robot_scene import Scene
from .scene_parts import ForceArrow, TorqueArrow

#: Limits beyond this are no limits, [rad], [m], [N m] or [N]: files write 1e9 or 1e30 for none.
_FAR = 1e6


def live_data(robot: ClosedChain, scene: Scene, q: Array, va: Array) -> dict[str, Any]:
    """All data; the page starts at q and va, shapes (nq,) and (n,)."""
    mechanism = robot.mechanism
    model = mechanism.model
    space = mechanism.space
    # Time constants and forces of the page scale with gravity. A robot without gravity has them
    # as on Earth.
    gravity = float(np.linalg.norm(model.gravity.linear)) or EARTH_GRAVITY
    weight = gravity * moving_mass(model)
    motors = torques_of(robot, np.zeros((1, len(robot.motor_names))))
    motors["limits"] = _motor_limits(mechanism)
    # The end of a motor's slider: the weight as a force, or the weight at half of the robot's
    # length as a torque.
    largest = [weight * (scene.size / 2 if unit == "N m" else 1) for unit in motors["units"]]
    return {
        # The state and the scales of positions and rates.
        "q": q.tolist(),
        "va": va.tolist(),
        "size": scene.size,
        "fall": gravity,  # acceleration of a free fall, [m/s^2]
        "weight": weight,
        "nv": model.nv,
        "scales": [_scale(unit, scene.size) for unit in space.position_units],
        "rate_scales": [_scale(unit, scene.size) for unit in space.rate_units],
        # Sliders and limits.
        "motors": motors,
        "largest": largest,
        "coordinates": list(_coordinates(robot, q, scene.size)),
        "bounds": list(_bounds(robot)),
        "stops": list(_stops(robot, q)),
        "condition": LARGEST_CONDITION,
        # The drawing.
        "bodies": list(model.names),
        "centres": [body.lever.tolist() for body in model.inertias],
        "struts": list(_struts(scene)),
        "arrows": list(_torque_arrows(scene)),
        "touches": list(_contacts(scene)),
        "forces": list(_contact_arrows(scene)),
    }


def _scale(unit: str, size: float) -> float:
    """The typical size of a position or rate: the robot's length for lengths, 1 for angles."""
    return size if unit == "m" else 1.0


def _motor_limits(mechanism: Mechanism) -> list[float | None]:
    """Largest torque or force of each motor if it acts alone, [N m] or [N]; None without a limit.

    A motor acts on rates and lines by factors: the force on each is a factor times the motor's
    torque. Limits are given for the forces on rates and lines. So each of them limits the motor to
    limit / |factor|, and the smallest of these counts.
    """
    motor_limits = list[float | None]()
    for factors in np.abs(mechanism.effort_factors).T:
        motor_limit = np.inf
        for factor, limit in zip(factors, mechanism.effort_limits, strict=True):
            if factor > 0 and 0 < limit < _FAR:  # files write 0, too, for no limit
                motor_limit = min(motor_limit, float(limit / factor))
        motor_limits.append(motor_limit if np.isfinite(motor_limit) else None)
    return motor_limits


def _coordinates(robot: ClosedChain, q: Array, size: float) -> Iterator[dict[str, Any]]:
    """Sliders of the coordinates.

    A slider is of one of three kinds:

    - "position" sets q[i].
    - "angle" sets the cosine q[i] and the sine q[i + 1] of a continuous joint.
    - "rate" sets one of several rates of a joint whose position starts at q[i], for instance of a
      ball. The joint moves while the slider is held.
    """
    model = robot.mechanism.model
    space = robot.mechanism.space
    joint_of_rate = {}
    for joint in list(model.joints)[1:]:
        for k in range(joint.idx_v, joint.idx_v + joint.nv):
            joint_of_rate[k] = joint
    for k in space.rates_of(robot.coordinates).tolist():
        joint = joint_of_rate[k]
        unit = space.rate_units[k]
        # The range of a joint without limits is a turn, or four lengths of the robot.
        half_range = np.pi if unit == "rad" else 2 * size
        if joint.nq == joint.nv:
            kind = "position"
            i = joint.idx_q + (k - joint.idx_v)
            low, high = _ends_of_slider(model, i, float(q[i]), half_range, unit)
        else:
            kind = "angle" if joint.nv == 1 else "rate"
            i = joint.idx_q
            low = -half_range
            high = half_range
        yield {
            "name": space.rate_names[k],
            "unit": unit,
            "kind": kind,
            "i": i,
            "low": low,
            "high": high,
            "scale": _scale(unit, size),
        }


def _ends_of_slider(
    model: pin.Model, i: int, start: float, half_range: float, unit: str
) -> tuple[float, float]:
    """Both ends of the slider of q[i]: the limits of q[i], or a default range.

    The range is extended to `start` if `start` is beyond a limit.
    """
    low = float(model.lowerPositionLimit[i])
    high = float(model.upperPositionLimit[i])
    # The default range is used if there are no limits, and if the limits are wide. A limit is wide
    # if it is not smaller than the whole default range: the slider would be too coarse.
    if max(abs(low), abs(high)) >= 2 * half_range:
        middle = 0.0 if unit == "rad" else start
        low = middle - half_range
        high = middle + half_range
    return min(low, start), max(high, start)


def _stops(robot: ClosedChain, q: Array) -> Iterator[dict[str, Any]]:
    """Stops: limits of hinges and slides, which the simulation of the page does not pass.

    Continuous joints, with a cosine and a sine in q, have no limits. If a joint starts beyond a
    limit, its stop is at the start instead.
    """
    model = robot.mechanism.model
    for joint in list(model.joints)[1:]:
        if joint.nq != 1 or joint.nv != 1:
            continue
        i = joint.idx_q
        low = float(model.lowerPositionLimit[i])
        high = float(model.upperPositionLimit[i])
        if low <= -_FAR and high >= _FAR:
            continue
        # S is the joint's twist for the rate 1: [linear; angular].
        linear, angular = np.split(np.ravel(joint.createData().S), 2)
        is_helical = linear.any() and angular.any()
        if is_helical:
            continue
        is_revolute = not linear.any()
        yield {
            "i": i,
            "body": joint.id,
            "parent": int(model.parents[joint.id]),
            "turns": is_revolute,
            "axis": angular.tolist() if is_revolute else linear.tolist(),
            "low": max(min(low, float(q[i])), -_FAR),
            "high": min(max(high, float(q[i])), _FAR),
        }


def _bounds(robot: ClosedChain) -> Iterator[dict[str, Any]]:
    """Limits of positions about which the page warns, with their tolerances.

    They are the limits of the joints, and of the arcs that joints run on.
    """
    model = robot.mechanism.model
    tolerances = limit_tolerances(robot.mechanism).tolist()
    kinds = [("limits", model.lowerPositionLimit, model.upperPositionLimit)]
    if robot.appearance.arcs is not None:
        lower, upper = robot.appearance.arcs
        kinds.append(("arc", lower, upper))
    for kind, lower, upper in kinds:
        for i, unit in enumerate(robot.position_units):
            low, high = np.clip((lower[i], upper[i]), -_FAR, _FAR).tolist()
            if not unit or (low == -_FAR and high == _FAR):
                continue
            yield {
                "name": robot.position_names[i],
                "unit": unit,
                "i": i,
                "what": kind,
                "low": low - tolerances[i],
                "high": high + tolerances[i],
            }


def _struts(scene: Scene) -> Iterator[dict[str, Any]]:
    """Shapes between two bodies."""
    for strut in scene.struts:
        yield {
            "node": strut.shape.mover,
            "joints": strut.joints,
            "points": strut.points.tolist(),
        }


def _torque_arrows(scene: Scene) -> Iterator[dict[str, Any]]:
    """Arrows of the motors."""
    for arrow in scene.arrows:
        if isinstance(arrow, TorqueArrow):
            yield {
                "node": arrow.shape.node.split("/"),
                "at": _columns(arrow.shape.at),
                "motor": arrow.motor,
                "share": arrow.share,
                "mirror": arrow.mirror,
            }


def _contacts(scene: Scene) -> Iterator[dict[str, Any]]:
    """Places of the contacts."""
    for place in scene.contacts:
        yield {
            "node": place.node,
            "body": place.frame.parentJoint,
            "at": place.frame.placement.translation.tolist(),
            "ground": place.ground.parentJoint,
            "axes": _columns(place.ground.placement.homogeneous),
            "radius": place.radius,
        }


def _contact_arrows(scene: Scene) -> Iterator[dict[str, Any]]:
    """Arrows and marks of the forces of contacts; the start of a mark is None."""
    # Forces of contacts are the last entries of an effort. The force of contact k begins at the
    # entry first_contact + 3 k.
    first_contact = scene.layout.contact(0)
    for arrow in scene.arrows:
        if not isinstance(arrow, TorqueArrow) and arrow.first >= first_contact:
            yield {
                "node": arrow.shape.node.split("/"),
                "at": _columns(arrow.shape.at),
                "touch": (arrow.first - first_contact) // 3,
                "start": arrow.start if isinstance(arrow, ForceArrow) else None,
            }


def _columns(matrix: Array) -> list[float]:
    """The entries of a matrix, column by column."""
    return matrix.T.ravel().tolist()

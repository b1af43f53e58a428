# SPDX-License-Identifier: BSD-2-Clause
"""What a page needs to compute a robot's motion by itself, beside the robot's functions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..arrays import Array
from ..chain.closed_chain import ClosedChain
from ..chain.thresholds import CLOSURE_TOLERANCE
from ..motion.limits import LARGEST_CONDITION
from .panel_curves import torques_of
from .robot_scene import Scene
from .scene_parts import Arrow

#: Limits of an angle that are as wide are none, [rad].
_TURN = 2 * np.pi
#: Limits farther away are none.
_FAR = 1e6
_BOUND = "name", "unit", "i", "what", "low", "high"


def live_data(robot: ClosedChain, scene: Scene, q: Array, va: Array) -> dict[str, Any]:
    """The numbers of a robot, its sliders, limits and drawing, for `live.js`.

    Args:
        robot: Any closed chain.
        scene: Its shapes.
        q: Configuration at first, shape (nq,).
        va: Rates of the coordinates at first, shape (n,).
    """
    mechanism = robot.mechanism
    model, space = mechanism.model, mechanism.space
    fall = float(np.linalg.norm(model.gravity.linear)) or 9.81
    weight = fall * sum(body.mass for body in model.inertias)
    shown = torques_of(robot, np.zeros((1, len(robot.motor_names))))
    return {
        "q": q.tolist(),
        "va": va.tolist(),
        "size": scene.size,
        "fall": fall,
        "motors": shown,
        "largest": [weight * (scene.size / 2 if u == "N m" else 1) for u in shown["units"]],
        "coordinates": list(_coordinates(robot, q, scene.size)),
        "scales": [scene.size if unit == "m" else 1.0 for unit in space.position_units],
        "bounds": list(_bounds(robot)),
        "rate_scales": [scene.size if unit == "m" else 1.0 for unit in space.rate_units],
        "nv": model.nv,
        "condition": LARGEST_CONDITION,
        "bodies": list(model.names),
        "centres": [body.lever.tolist() for body in model.inertias],
        "struts": [
            {"node": strut.shape.mover, "joints": strut.joints, "points": strut.points.tolist()}
            for strut in scene.struts
        ],
        "arrows": [
            {
                "node": arrow.shape.node.split("/"),
                "at": arrow.shape.at.T.ravel().tolist(),
                "motor": arrow.motor,
                "share": arrow.share,
                "mirror": arrow.mirror,
            }
            for arrow in scene.arrows
            if isinstance(arrow, Arrow)
        ],
    }


def _coordinates(robot: ClosedChain, q: Array, size: float) -> Iterator[dict[str, Any]]:
    """Sliders: for a position or an angle without end, else for a rate while they are held."""
    model, space = robot.mechanism.model, robot.mechanism.space
    joints = {k: x for x in list(model.joints)[1:] for k in range(x.idx_v, x.idx_v + x.nv)}
    for k in space.rates_of(robot.coordinates).tolist():
        joint, unit = joints[k], space.rate_units[k]
        way = np.pi if unit == "rad" else 2 * size
        kind, i, low, high = "rate", joint.idx_q, -way, way
        if joint.nq == joint.nv:
            kind, i = "position", joint.idx_q + k - joint.idx_v
            low, high = model.lowerPositionLimit[i], model.upperPositionLimit[i]
            if max(abs(low), abs(high)) >= (_TURN if unit == "rad" else 4 * size):
                middle = 0.0 if unit == "rad" else q[i]
                low, high = middle - way, middle + way
            low, high = min(low, q[i]), max(high, q[i])
        elif (joint.nq, joint.nv) == (2, 1):
            kind = "angle"
        yield {
            "name": space.rate_names[k],
            "unit": unit,
            "kind": kind,
            "i": i,
            "low": float(low),
            "high": float(high),
            "scale": size if unit == "m" else 1.0,
        }


def _bounds(robot: ClosedChain) -> Iterator[dict[str, Any]]:
    """Limits of the joints' positions, and arcs that they run on."""
    model, arcs = robot.mechanism.model, robot.appearance.arcs
    ends = [("limits", model.lowerPositionLimit, model.upperPositionLimit)]
    ends += [] if arcs is None else [("arc", *arcs)]
    units = [*enumerate(zip(robot.position_names, robot.joint_units, strict=True))]
    for what, low, high in ends:
        for i, (name, unit) in units:
            least, most = np.clip((low[i], high[i]), -_FAR, _FAR).tolist()
            if unit and (least, most) != (-_FAR, _FAR):
                end = least - CLOSURE_TOLERANCE, most + CLOSURE_TOLERANCE
                yield dict(zip(_BOUND, (name, unit, i, what, *end), strict=True))

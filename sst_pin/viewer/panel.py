# SPDX-License-Identifier: BSD-2-Clause
"""The HTML page of a robot, and the data for its scripts: curves, warnings, a live robot."""

import base64
import json
from collections.abc import Iterable, Iterator, Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from ..arrays import Array, Flags
from ..closed_chain import ClosedChain
from ..simulation.check import LARGEST_CONDITION, over_limits, samples_of
from ..simulation.energy import motor_powers
from ..simulation.trajectories import Trajectory
from .robot_scene import Scene
from .scene_parts import Arrow, Pull

_WORDS = {
    "N m": "torques",
    "N": "forces",
    "rad": "angles",
    "m": "lengths",
    "rad/s": "rates",
    "m/s": "speeds",
    "W": "powers",
}
#: A slider ignores the limits of an angle if one is at least this far from zero, [rad].
_TURN = 2 * np.pi
#: Limits beyond this are ignored.
_FAR = 1e6


def page(
    commands: Iterable[bytes], panel: dict[str, Any], functions: str = "", served: bool = False
) -> str:
    """HTML that needs no other files, with packed Meshcat commands and the data of the panel.

    `functions` is JavaScript for a page that computes; a served page gets updates from its server.
    """
    packed = [base64.b64encode(command).decode() for command in commands]
    scene = json.dumps({"served": served, "commands": packed, "panel": panel})
    parts = {
        "MESHCAT": (files("meshcat") / "viewer/dist/main.min.js").read_text(encoding="utf-8"),
        "STYLE": _asset("panel.css"),
        "STAGE": _asset("stage.js"),
        "CHART": _asset("chart.js"),
        "PANEL": _asset("panel.js"),
        "LIVE": functions + _asset("live.js") if functions else "const live = null;",
        "SCENE": scene.replace("</", "<\\/"),
    }
    html = _asset("panel.html")
    for name, text in parts.items():
        html = html.replace(f"/*{name}*/", text)
    return html


def _asset(name: str) -> str:
    return (files(__package__) / "assets" / name).read_text(encoding="utf-8")


def curves_of(robot: ClosedChain, motion: Trajectory) -> list[dict[str, Any]]:
    """Sets of curves: torques, angles, rates and powers, see `_set`."""
    motors = robot.motor_names
    symbols = [f"P_{k + 1}" for k in range(len(motors))]
    watts = ["W"] * len(motors)
    return [
        torques_of(robot, motion.tau),
        joints_of(robot, motion.q),
        rates_of(motion),
        _set("powers", "motor ", symbols, motors, watts, motor_powers(robot.engine, motion)),
    ]


def torques_of(robot: ClosedChain, tau: Array) -> dict[str, Any]:
    """The set of the torques, shape (n, motors)."""
    symbols = [f"tau_{k + 1}" for k in range(len(robot.motor_names))]
    units = [unit.replace("Nm", "N m") for unit in robot.motor_units]
    return _set("torques", "motor ", symbols, robot.motor_names, units, tau)


def joints_of(robot: ClosedChain, q: Array) -> dict[str, Any]:
    """The set of the joints that have a unit, for q of shape (n, nq)."""
    units = robot.position_units
    places = [i for i, unit in enumerate(units) if unit]
    names = [robot.position_names[i] for i in places]
    return _set("joints", "joint ", names, names, [units[i] for i in places], q[:, places])


def rates_of(motion: Trajectory) -> dict[str, Any]:
    """The set of the rates of the coordinates."""
    units = [f"{unit}/s" for unit in motion.rate_units]
    return _set("rates", "", motion.coordinates, motion.coordinates, units, motion.va)


def contacts_of(robot: ClosedChain, forces: Array) -> dict[str, Any]:
    """The set of sizes of the forces of contacts, for shape (n, contacts, 3)."""
    names = [str(contact) for contact in robot.mechanism.contacts.points]
    sizes = np.linalg.norm(forces, axis=2)
    return _set("contacts", "contact ", names, names, ["N"] * len(names), sizes)


def forces_of(names: Sequence[str], forces: Array, unique: Flags) -> dict[str, Any]:
    """The set of sizes of the unique forces in joints and closures, for shape (n, count, 3)."""
    shown = [name for name, known in zip(names, unique, strict=True) if known]
    sizes = np.linalg.norm(forces[:, unique], axis=2)
    return _set("reactions", "joint and closure ", shown, shown, ["N"] * len(shown), sizes)


def _set(
    name: str,
    caption: str,
    names: Sequence[str],
    owners: Sequence[str],
    units: Sequence[str],
    values: Array,
) -> dict[str, Any]:
    """A set of curves over time, as `chart.js` expects it.

    Args:
        name: Name of the set, by which the page finds it.
        caption: First words of the caption, before the kinds and units of the curves.
        names: Labels of the curves.
        owners: Motors, joints or closures that the curves are about.
        units: Units of the curves.
        values: Shape (n, curves).
    """
    kinds = ", ".join(f"{_WORDS[unit]} ({unit})" for unit in dict.fromkeys(units))
    return {
        "called": name,
        "what": caption + kinds,
        "names": list(names),
        "owners": list(owners),
        "units": list(units),
        "values": values.tolist(),
    }


def warnings_of(robot: ClosedChain, motion: Trajectory | Array) -> list[str]:
    """Warnings of a motion or configuration: open loops, then findings of `check_limits`."""
    t, q = samples_of(robot.mechanism, motion)
    lines = []
    residuals = np.abs(robot.residual(q)).max(axis=1, initial=0.0)
    residuals[robot.engine.loops.are_closed(q)] = 0.0
    worst = int(residuals.argmax())
    if residuals[worst]:
        when = "" if np.isnan(t[worst]) else f" at t = {t[worst]:.6g} s"
        lines.append(f"the loops are open by {residuals[worst]:.3g} (m or rad){when}")
    return lines + [str(finding) for finding in robot.check_limits(motion)]


def live_data(robot: ClosedChain, scene: Scene, q: Array, va: Array) -> dict[str, Any]:
    """Data of a robot for `live.js`: state, sliders, limits and drawing.

    The page starts at q and va, shapes (nq,) and (n,).
    """
    mechanism = robot.mechanism
    model = mechanism.model
    space = mechanism.space
    gravity = float(np.linalg.norm(model.gravity.linear)) or 9.81
    weight = gravity * sum(body.mass for body in model.inertias)
    motors = torques_of(robot, np.zeros((1, len(robot.motor_names))))
    efforts = np.abs(mechanism.actuation).T @ np.minimum(model.effortLimit, 10 * _FAR)
    motors["limits"] = [x if 0 < x < _FAR else None for x in efforts.tolist()]
    # The largest torque of a slider: the weight of the robot at half of its length.
    first_contact = len(robot.motor_names) + 3 * scene.reactions
    largest = [weight * (scene.size / 2 if u == "N m" else 1) for u in motors["units"]]
    return {
        "q": q.tolist(),
        "va": va.tolist(),
        "size": scene.size,
        "fall": gravity,
        "weight": weight,
        "motors": motors,
        "largest": largest,
        "coordinates": list(_coordinates(robot, q, scene.size)),
        "scales": [scene.size if unit == "m" else 1.0 for unit in space.position_units],
        "bounds": list(_bounds(robot)),
        "stops": list(_stops(robot, q)),
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
        "touches": [
            {
                "node": touch.node,
                "body": touch.frame.parentJoint,
                "at": touch.frame.placement.translation.tolist(),
                "ground": touch.ground.parentJoint,
                "axes": touch.ground.placement.homogeneous.T.ravel().tolist(),
                "radius": touch.radius,
            }
            for touch in scene.touches
        ],
        "forces": [
            {
                "node": arrow.shape.node.split("/"),
                "at": arrow.shape.at.T.ravel().tolist(),
                "touch": (arrow.first - first_contact) // 3,
                "start": arrow.start if isinstance(arrow, Pull) else None,
            }
            for arrow in scene.arrows
            if not isinstance(arrow, Arrow) and arrow.first >= first_contact
        ],
    }


def _coordinates(robot: ClosedChain, q: Array, size: float) -> Iterator[dict[str, Any]]:
    """Sliders of the coordinates.

    The kind of a slider is "position", an entry i of q; "angle", a cosine and a sine from i on; or
    "rate", one of several rates of a joint, which moves while the slider is held.
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
        half_range = np.pi if unit == "rad" else 2 * size
        i = joint.idx_q
        low = -half_range
        high = half_range
        if joint.nq == joint.nv:
            kind = "position"
            i = joint.idx_q + k - joint.idx_v
            low = model.lowerPositionLimit[i]
            high = model.upperPositionLimit[i]
            no_limit = _TURN if unit == "rad" else 4 * size
            if max(abs(low), abs(high)) >= no_limit:
                middle = 0.0 if unit == "rad" else q[i]
                low = middle - half_range
                high = middle + half_range
            # The start is on the slider, even if it is beyond the limits.
            low = min(low, q[i])
            high = max(high, q[i])
        elif joint.nv == 1:
            kind = "angle"
        else:
            kind = "rate"
        yield {
            "name": space.rate_names[k],
            "unit": unit,
            "kind": kind,
            "i": i,
            "low": float(low),
            "high": float(high),
            "scale": size if unit == "m" else 1.0,
        }


def _stops(robot: ClosedChain, q: Array) -> Iterator[dict[str, Any]]:
    """Limits of joints that turn about one axis or slide along one.

    A start beyond a limit moves the limit there.
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
        linear, angular = np.split(np.ravel(joint.createData().S), 2)
        is_revolute = not linear.any()
        if not is_revolute and angular.any():  # a screw
            continue
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
    """Limits of the joints' positions, and of arcs that they run on, with their tolerances."""
    model = robot.mechanism.model
    tolerances = over_limits(robot.mechanism).tolist()
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

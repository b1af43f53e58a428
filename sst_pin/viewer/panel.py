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
from .scene_parts import Arrow

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
    symbols, watts = [f"P_{k + 1}" for k in range(len(motors))], ["W"] * len(motors)
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
    called: str,
    whose: str,
    names: Sequence[str],
    owners: Sequence[str],
    units: Sequence[str],
    values: Array,
) -> dict[str, Any]:
    """Curves, each with a name, a joint and a unit; the entry "what" is the caption."""
    kinds = ", ".join(f"{_WORDS[unit]} ({unit})" for unit in dict.fromkeys(units))
    return {
        "called": called,
        "what": whose + kinds,
        "names": list(names),
        "owners": list(owners),
        "units": list(units),
        "values": values.tolist(),
    }


def warnings_of(robot: ClosedChain, motion: Trajectory | Array) -> list[str]:
    """Warnings for a motion or configuration: open loops, then the findings of `robot.check`."""
    t, q = samples_of(robot.mechanism, motion)
    residuals, lines = np.abs(robot.residual(q)).max(axis=1, initial=0.0), []
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
    model, space = mechanism.model, mechanism.space
    fall = float(np.linalg.norm(model.gravity.linear)) or 9.81
    weight = fall * sum(body.mass for body in model.inertias)
    motors = torques_of(robot, np.zeros((1, len(robot.motor_names))))
    efforts = np.abs(mechanism.motors).T @ np.minimum(model.effortLimit, 10 * _FAR)
    motors["limits"] = [x if 0 < x < _FAR else None for x in efforts.tolist()]
    return {
        "q": q.tolist(),
        "va": va.tolist(),
        "size": scene.size,
        "fall": fall,
        "motors": motors,
        "largest": [weight * (scene.size / 2 if u == "N m" else 1) for u in motors["units"]],
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
    }


def _coordinates(robot: ClosedChain, q: Array, size: float) -> Iterator[dict[str, Any]]:
    """Sliders of the coordinates: a position, an unlimited angle, or a rate while it is held."""
    model, space = robot.mechanism.model, robot.mechanism.space
    joints = {k: x for x in list(model.joints)[1:] for k in range(x.idx_v, x.idx_v + x.nv)}
    for k in space.rates_of(robot.coordinates).tolist():
        joint, unit = joints[k], space.rate_units[k]
        span = np.pi if unit == "rad" else 2 * size
        kind, i, low, high = "rate", joint.idx_q, -span, span
        if joint.nq == joint.nv:
            kind, i = "position", joint.idx_q + k - joint.idx_v
            low, high = model.lowerPositionLimit[i], model.upperPositionLimit[i]
            if max(abs(low), abs(high)) >= (_TURN if unit == "rad" else 4 * size):
                middle = 0.0 if unit == "rad" else q[i]
                low, high = middle - span, middle + span
            low, high = min(low, q[i]), max(high, q[i])
        elif (joint.nq, joint.nv) == (2, 1):
            kind = "angle"
        slider = {"name": space.rate_names[k], "unit": unit, "kind": kind, "i": i}
        scale = size if unit == "m" else 1.0
        yield slider | {"low": float(low), "high": float(high), "scale": scale}


def _stops(robot: ClosedChain, q: Array) -> Iterator[dict[str, Any]]:
    """Limits of joints that turn about one axis or slide along one; a start beyond them is free."""
    model = robot.mechanism.model
    for joint in list(model.joints)[1:]:
        if (joint.nq, joint.nv) != (1, 1):
            continue
        i = joint.idx_q
        axis = np.ravel(joint.createData().S)
        turns = not axis[:3].any()
        low, high = float(model.lowerPositionLimit[i]), float(model.upperPositionLimit[i])
        if (turns or not axis[3:].any()) and (low > -_FAR or high < _FAR):
            yield {
                "i": i,
                "body": joint.id,
                "parent": int(model.parents[joint.id]),
                "turns": turns,
                "axis": axis[3:].tolist() if turns else axis[:3].tolist(),
                "low": max(min(low, float(q[i])), -_FAR),
                "high": min(max(high, float(q[i])), _FAR),
            }


def _bounds(robot: ClosedChain) -> Iterator[dict[str, Any]]:
    """Limits of the joints' positions, and arcs that they run on."""
    model, arcs = robot.mechanism.model, robot.appearance.arcs
    over = over_limits(robot.mechanism).tolist()
    ends = [("limits", model.lowerPositionLimit, model.upperPositionLimit)]
    ends += [] if arcs is None else [("arc", *arcs)]
    for what, low, high in ends:
        for i, (name, unit) in enumerate(
            zip(robot.position_names, robot.position_units, strict=True)
        ):
            least, most = np.clip((low[i], high[i]), -_FAR, _FAR).tolist()
            if unit and (least, most) != (-_FAR, _FAR):
                bound = {"low": least - over[i], "high": most + over[i]}
                yield {"name": name, "unit": unit, "i": i, "what": what} | bound

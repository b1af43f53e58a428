# SPDX-License-Identifier: BSD-2-Clause
"""Reads a YAML file of closures, motors, springs and joints of several axes."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.checks import Motor
from ..model.closures import Closure, Constraint, Coupling, Distance, Rolling
from ..model.contacts import Contact, Rope
from ..model.lines import LineForce
from .cut_joints import CutJoint, cut_joint
from .joint_numbers import LIMITS, JointNumbers
from .problems import numbers, telling, vector
from .urdf import KINDS
from .yaml_content import (
    YamlContent,
    mapping_in,
    name_in,
    number_in,
    numbers_in,
    pair_in,
    repeated,
    shown,
)

_OF_LINES = (
    *("name", "frames", "stiffness", "rest_length", "damping", "preload", "mass"),
    *("lower", "upper", "effort", "velocity"),
    "pulls_only",
)
_OF_CONTACTS = ("frame", "name", "ground", "radius", "friction", "restitution")
_OF_ROPES = ("name", "rope", "length")
_WITH_LENGTH = {"distance": Distance, "rolling": Rolling}


class Cuts(NamedTuple):
    """Content of the YAML file beside a URDF."""

    actuated: tuple[Motor, ...] = ()
    closures: tuple[Constraint, ...] = ()  #: By default frames `closing_NAME_1`, `closing_NAME_2`.
    couplings: tuple[Coupling, ...] = ()
    hinges: tuple[CutJoint, ...] = ()  #: Closures of other YAML files, by places of the joints.
    lines: tuple[LineForce, ...] = ()
    contacts: tuple[Contact | Rope, ...] = ()
    joints: tuple[tuple[str, str], ...] = ()  #: True kinds of joints by name; see `Urdf.tree`.
    numbers: JointNumbers = MappingProxyType({})
    locked: tuple[str, ...] = ()
    brakes: tuple[str, ...] = ()  #: Joints and lines that are held where they are.
    dependent: tuple[str, ...] = ()  #: Joints that closures determine; their `<mimic>` is ignored.
    gravity: Array | None = None  #: In base axes, [m/s^2]; None: the URDF's.
    source: str = ""  #: The YAML, for messages; empty without one.

    @property
    def fixed(self) -> set[str]:
        """Joints that do not move."""
        return {*self.locked, *(name for name, kind in self.joints if kind == "FIXED")}


def parse_cuts(text: str, source: str) -> Cuts:
    """Content of a YAML file in the LAAS schema, with more keys; docs/own_robot.md lists them.

    It has the key `name_mot`; others may be missing. A `loop_closures.yaml` of sw2robot is read as
    well. The error names every problem.
    """
    content = YamlContent(text, source)
    if "closures" in content:
        cuts = _of_scikit_robot(content)
        content.raise_problems()
        return cuts._replace(source=source)
    content.require_known((*_LISTS, *_TABLES, "gravity"))
    content.setdefault("name_mot", None)
    if isinstance(table := content.get("joint_type"), dict) and "joint_name" not in content:
        content |= {"joint_name": [*table], "joint_type": [*table.values()]}
    lists = {key: content.entries(key, parse) for key, parse in _LISTS.items()}
    tables = {key: content.entries(key, parse, dict) for key, parse in _TABLES.items()}
    joints = content.zipped(lists, "joint_name", "joint_type")
    content.problems += [f"joint_name: {j} appears twice" for j in repeated(j for j, _ in joints)]
    closures = list[Constraint]()
    for pair, kind in content.zipped(lists, "closed_loop", "type"):
        with telling(content.problems):
            closures.append(_closure(pair, kind))
    gravity = vector(content.get("gravity"))
    if gravity is None and "gravity" in content:
        text = f"gravity: {shown(content['gravity'])} is not a list of three numbers"
        content.problems.append(text)
    content.raise_problems()
    springs = dict(tables.pop("joint_spring"))
    couplings = tuple(tables.pop("coupling"))
    limits = dict(tables.pop("joint_limit"))
    numbers = {key: dict(pairs) for key, pairs in tables.items()}
    for key in LIMITS:
        numbers[key] = {joint: limit[key] for joint, limit in limits.items() if key in limit}
    for k, key in enumerate(("stiffness", "reference")):
        numbers[key] = {joint: spring[k] for joint, spring in springs.items()}
    return Cuts(
        actuated=tuple(lists["name_mot"]),
        closures=tuple(closures),
        couplings=couplings,
        lines=tuple(lists["line_force"]),
        contacts=tuple(lists["contacts"]),
        joints=tuple(joints),
        numbers=numbers,
        locked=tuple(lists["locked"]),
        brakes=tuple(lists["brakes"]),
        gravity=gravity,
        source=source,
    )


def _motor(value: Any) -> Motor:
    """A joint or a line, or a tendon with its name: `split: {left: 1, right: 1}`."""
    if isinstance(value, dict) and len(value) == 1:
        ((name, shares),) = value.items()
        return {name: {joint: number_in(x) for joint, x in mapping_in(shares).items()}}
    return name_in(value)


def _closure(pair: tuple[str, str], kind: str) -> Constraint:
    kind = {"ball": "3d"}.get(kind.lower(), kind.lower())
    if kind in Closure.KINDS:
        return Closure(*pair, kind)
    word, _, length = kind.partition(" ")
    value = numbers(length, 1)
    if word in _WITH_LENGTH and value is not None and value[0] > 0:
        return _WITH_LENGTH[word](*pair, float(value[0]))
    known = ", ".join([*Closure.KINDS, "ball", *(f"{word} LENGTH" for word in _WITH_LENGTH)])
    raise ValueError(f"type: {kind!r} unknown; known: {known}")


def _coupling(joint: str, value: Any) -> Coupling:
    """The position of a joint by those of others: factors, or coefficients of polynomials."""
    shares = {
        other: [number_in(c) for c in share] if isinstance(share, list) else [0.0, number_in(share)]
        for other, share in mapping_in(value).items()
    }
    if not shares:
        raise ValueError(f"{joint} follows no joint; `locked` holds joints")
    return Coupling(joint, shares)


def _line(value: Any) -> LineForce:
    fields = mapping_in(value, _OF_LINES)
    if "frames" not in fields:
        raise ValueError(f"{shown(value)} has no pair of frames")
    a, b = pair_in(fields["frames"])
    numbers = {key: number_in(fields[key], key) for key in _OF_LINES[2:-1] if key in fields}
    pulls_only = str(fields.get("pulls_only", "false")).lower()
    if pulls_only not in ("true", "false"):
        raise ValueError(f"pulls_only {shown(fields['pulls_only'])} is neither true nor false")
    name = name_in(fields.get("name", f"{a}-{b}"))
    return LineForce(a, b, name=name, pulls_only=pulls_only == "true", **numbers)


def _contact(value: Any) -> Contact | Rope:
    """A contact `{frame: sole, friction: 0.8}` or a rope `{rope: [a, b], length: 1.2}`."""
    fields = mapping_in(value)
    if "rope" in fields:
        fields = mapping_in(value, _OF_ROPES)
        if "length" not in fields:
            raise ValueError(f"{shown(value)} has no length")
        a, b = pair_in(fields["rope"])
        length = number_in(fields["length"], "length")
        return Rope(a, b, length, name=name_in(fields.get("name", f"{a}-{b}")))
    fields = mapping_in(value, _OF_CONTACTS)
    if "frame" not in fields:
        raise ValueError(f"{shown(value)} has no frame and no rope")
    values: dict[str, Any] = {}
    for key in _OF_CONTACTS[3:]:
        if key in fields:
            values[key] = number_in(fields[key], key)
    for key in ("ground", "name"):
        if key in fields:
            values[key] = name_in(fields[key])
    return Contact(name_in(fields["frame"]), **values)


def _spring(joint: str, value: Any) -> tuple[str, list[float]]:
    return joint, numbers_in(value, stiffness=None, reference="0")


def _limit(joint: str, value: Any) -> tuple[str, dict[str, float]]:
    limit = {key: number_in(x, key) for key, x in mapping_in(value, LIMITS).items()}
    if limit.get("lower", -np.inf) > limit.get("upper", np.inf):
        raise ValueError(f"the lower limit of {joint} is above the upper one")
    if negative := [key for key in ("effort", "velocity") if limit.get(key, 0.0) < 0]:
        raise ValueError(f"{negative[0]} of {joint} is negative")
    return joint, limit


def _rotor(joint: str, value: Any) -> tuple[str, float]:
    """The reflected inertia of a rotor."""
    fields = value if isinstance(value, dict) else {"rotor_inertia": value}
    inertia, gear = numbers_in(fields, rotor_inertia=None, gear_ratio="1")
    return joint, inertia * gear**2


def _friction(joint: str, value: Any) -> tuple[str, float]:
    if (number := number_in(value)) < 0:
        raise ValueError(f"{value} of {joint} is negative: it would accelerate the joint")
    return joint, number


def _kind(value: Any) -> str:
    if (kind := name_in(value).upper()) not in KINDS:
        raise ValueError(f"{value!r} unknown; known: {', '.join(KINDS)}")
    return kind


#: Parsers of the entries of lists, and of tables below names of joints, by key.
_LISTS: dict[str, Callable[[Any], Any]] = {
    "closed_loop": pair_in,
    "contacts": _contact,
    "type": name_in,
    "name_mot": _motor,
    "line_force": _line,
    "joint_name": name_in,
    "joint_type": _kind,
    "locked": name_in,
    "brakes": name_in,
}
_TABLES: dict[str, Callable[[str, Any], Any]] = {
    "joint_spring": _spring,
    "joint_limit": _limit,
    "viscous_friction": _friction,
    "coulomb_friction": _friction,
    "armature": _rotor,
    "coupling": _coupling,
}
OF_HINGE = ("link_a", "link_b", "point", "axis")


def _of_scikit_robot(content: YamlContent) -> Cuts:
    """A `loop_closures.yaml`: hinges, by point and axis in base axes at q = 0."""
    content.require_known(("closures", "dependent", "independent"))
    hinges = content.entries("closures", _hinge)
    if not content["closures"]:
        content.problems.append("closures: a list of hinges is needed")
    content.update({key: content.get(key) for key in ("dependent", "independent")})
    dependent, independent = (content.entries(k, name_in) for k in ("dependent", "independent"))
    content.problems += [f"{name}: named twice" for name in repeated(dependent + independent)]
    joints = (hinge._replace(name=f"loop_closure_{k}") for k, hinge in enumerate(hinges, 1))
    return Cuts(tuple(independent), hinges=tuple(joints), dependent=tuple(dependent))


def _hinge(value: Any) -> CutJoint:
    fields = mapping_in(value, OF_HINGE)
    if len(fields) < len(OF_HINGE):
        raise ValueError(f"{shown(value)} needs {', '.join(OF_HINGE)}")
    place = pin.SE3(np.eye(3), _vector(fields, "point"))
    axis, base = _vector(fields, "axis"), ("universe", "universe")
    links = name_in(fields["link_a"]), name_in(fields["link_b"])
    return cut_joint("", "revolute", links, (place, place), (axis, axis), base)


def _vector(fields: Mapping[str, Any], key: str) -> Array:
    value = vector(fields.get(key))
    if value is None or (key == "axis" and not value.any()):
        raise ValueError(f"{key} {shown(fields.get(key))} is not three numbers")
    return value

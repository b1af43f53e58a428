# SPDX-License-Identifier: BSD-2-Clause
"""Reads the YAML file beside a URDF: where loops are cut, motors, springs, kinds of joints.

A URDF is a tree. So each loop of the robot is cut in the URDF, and the YAML has the closures that
the cuts replace. It also has what a URDF cannot say, such as joints of several axes.

Two kinds of files are read. One has the schema that LAAS calls "extended URDF", with more keys. The
other is the `loop_closures.yaml` that the tool sw2robot writes.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.checks import Motor
from ..model.closures import Closure, Constraint, Coupling, Distance, Rolling
from ..model.contacts import Contact, Rope
from ..model.lines import NUMBERS_OF_LINE, LineForce
from ..model.weight_shares import Share
from .cut_joints import CutJoint, Side, cut_joint
from .joint_kinds import KINDS
from .joint_numbers import LIMITS, JointNumbers
from .problems import collecting_problems, numbers, vector
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


class Cuts(NamedTuple):
    """Content of the YAML file beside a URDF."""

    actuated: tuple[Motor, ...] = ()
    #: If there are no closures and no hinges here, the closures that the URDF marks are used.
    closures: tuple[Constraint, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    #: Hinges of a `loop_closures.yaml`, which has points and axes in place of frames.
    hinges: tuple[CutJoint, ...] = ()
    lines: tuple[LineForce, ...] = ()
    contacts: tuple[Contact | Rope, ...] = ()
    #: Kinds of joints that URDF lacks, such as "BALL", by the names of the joints.
    kinds: Mapping[str, str] = MappingProxyType({})
    #: Friction, rotors, limits and springs of joints.
    numbers: JointNumbers = MappingProxyType({})
    #: Joints that are fixed at zero.
    locked: tuple[str, ...] = ()
    #: Joints and lines that are held where they are.
    brakes: tuple[str, ...] = ()
    #: Joints whose position the closures determine, so that their `<mimic>` is ignored.
    dependent: tuple[str, ...] = ()
    #: The argument `weight_shares` of `ClosedChain`. These shares replace those of the URDF.
    weight_shares: Mapping[str, Share] = MappingProxyType({})
    #: In base axes, shape (3,), [m/s^2]; None: the gravity of the URDF.
    gravity: Array | None = None
    #: The YAML, for messages; empty without one.
    source: str = ""

    @property
    def fixed_joints(self) -> set[str]:
        """Names of the joints that do not move: locked joints, and joints of the kind "FIXED"."""
        names = set(self.locked)
        names.update(name for name, kind in self.kinds.items() if kind == "FIXED")
        return names


def parse_cuts(text: str, source: str) -> Cuts:
    """Content of a YAML file: a file in the LAAS schema, or a `loop_closures.yaml` of sw2robot.

    docs/own_robot.md lists the keys of the LAAS schema, with those that are added. The key
    `name_mot` is required; all others are optional.

    Raises:
        DescriptionError: It lists all problems of the file.
    """
    # The functions below that parse one entry raise a ValueError. The content collects these
    # errors as problems.
    content = YamlContent(text, source)
    if "closures" in content and content.keys().isdisjoint(_LAAS_KEYS):
        cuts = _sw2robot_cuts(content)
    else:
        cuts = _laas_cuts(content)
    content.raise_problems()
    return cuts._replace(source=source)


#: Keys of a file in the LAAS schema.
_LAAS_KEYS = (
    "closed_loop",
    "contacts",
    "type",
    "name_mot",
    "line_force",
    "joint_name",
    "joint_type",
    "locked",
    "brakes",
    "joint_spring",
    "joint_limit",
    "viscous_friction",
    "coulomb_friction",
    "armature",
    "coupling",
    "gravity",
    "weight_shares",
)


def _laas_cuts(content: YamlContent) -> Cuts:
    """The cuts of a file in the LAAS schema; problems are added to the content."""
    content.require_known(_LAAS_KEYS)
    content.setdefault("name_mot", None)  # `entries` reports None: the key is required
    _split_joint_types(content)

    # Closures: pairs of frames, and a kind for each pair.
    frames = content.entries("closed_loop", pair_in)
    kinds = content.entries("type", name_in)
    content.require_same_length("closed_loop", "type")
    closures = list[Constraint]()
    for pair, kind in zip(frames, kinds, strict=False):
        with collecting_problems(content.problems):
            closures.append(_closure(pair, kind))

    # True kinds of joints.
    joint_names = content.entries("joint_name", name_in)
    joint_types = content.entries("joint_type", _kind)
    content.require_same_length("joint_name", "joint_type")
    for joint in repeated(joint_names):
        content.problems.append(f"joint_name: {joint} appears twice")

    return Cuts(
        actuated=tuple(content.entries("name_mot", _motor)),
        closures=tuple(closures),
        couplings=tuple(content.table("coupling", _coupling).values()),
        lines=tuple(content.entries("line_force", _line)),
        contacts=tuple(content.entries("contacts", _contact)),
        kinds=dict(zip(joint_names, joint_types, strict=False)),
        numbers=_joint_numbers(content),
        locked=tuple(content.entries("locked", name_in)),
        brakes=tuple(content.entries("brakes", name_in)),
        gravity=_gravity(content),
        weight_shares=content.table("weight_shares", _weight_share),
    )


def _split_joint_types(content: YamlContent) -> None:
    """Replace a mapping `joint_type: {NAME: TYPE}` by the two lists of the LAAS schema."""
    types = content.get("joint_type")
    if isinstance(types, dict) and "joint_name" not in content:
        content["joint_name"] = list(types)
        content["joint_type"] = list(types.values())


def _gravity(content: YamlContent) -> Array | None:
    """The gravity of the file, shape (3,); None if it has none."""
    if "gravity" not in content:
        return None
    gravity = vector(content["gravity"])
    if gravity is None:
        shown_value = shown(content["gravity"])
        content.problems.append(f"gravity: {shown_value} is not a list of three numbers")
    return gravity


def _joint_numbers(content: YamlContent) -> JointNumbers:
    """Friction, rotors, limits and springs, each as a mapping from joints to numbers."""
    by_kind: dict[str, dict[str, float]] = {
        "viscous_friction": content.table("viscous_friction", _friction),
        "coulomb_friction": content.table("coulomb_friction", _friction),
        "armature": content.table("armature", _rotor),
    }
    limits = content.table("joint_limit", _limit)
    for key in LIMITS:
        by_kind[key] = {}
        for joint, limit in limits.items():
            if key in limit:
                by_kind[key][joint] = limit[key]
    springs = content.table("joint_spring", _spring)
    by_kind["stiffness"] = {joint: spring.stiffness for joint, spring in springs.items()}
    by_kind["reference"] = {joint: spring.reference for joint, spring in springs.items()}
    return by_kind


def _motor(value: Any) -> Motor:
    """A motor: the name of a joint or a line, or a tendon that drives several of them.

    A tendon is its name with a factor for each joint or line: `split: {left: 1, right: 1}`.
    """
    if isinstance(value, dict) and len(value) == 1:
        ((tendon, factors),) = value.items()
        numbers_by_name = {name: number_in(x) for name, x in mapping_in(factors).items()}
        return {name_in(tendon): numbers_by_name}
    return name_in(value)


#: Closures whose type has a length after the word, such as "distance 0.3" [m].
_CLOSURES_WITH_LENGTH = {"distance": Distance, "rolling": Rolling}


def _closure(pair: tuple[str, str], kind: str) -> Constraint:
    """A closure of two frames, of a kind such as "6d" or "distance 0.3"."""
    kind = kind.lower()
    if kind == "ball":
        kind = "3d"
    if kind in Closure.KINDS:
        return Closure(*pair, kind)
    word, _, length_text = kind.partition(" ")
    length = numbers(length_text, 1)
    if word in _CLOSURES_WITH_LENGTH and length is not None and length[0] > 0:
        return _CLOSURES_WITH_LENGTH[word](*pair, float(length[0]))
    known = [*Closure.KINDS, "ball", *(f"{word} LENGTH" for word in _CLOSURES_WITH_LENGTH)]
    raise ValueError(f"type: {kind!r} unknown; known: {', '.join(known)}")


def _coupling(joint: str, value: Any) -> Coupling:
    """A joint whose position is a sum of terms, each of the position x of another joint.

    For each of these joints the file has a factor c, the term c x, or the list of the coefficients
    c_0, c_1, ... of a polynomial.
    """
    polynomials = dict[str, list[float]]()
    for other, term in mapping_in(value).items():
        if isinstance(term, list):
            polynomials[other] = [number_in(coefficient) for coefficient in term]
        else:  # a factor
            polynomials[other] = [0.0, number_in(term)]
    if not polynomials:
        raise ValueError(f"{joint} follows no joint; `locked` holds joints")
    return Coupling(joint, polynomials)


#: Keys of an entry of `line_force`.
_LINE_KEYS = ("name", "frames", *NUMBERS_OF_LINE, "pulls_only")


def _line(value: Any) -> LineForce:
    """A force along the line between two frames."""
    fields = mapping_in(value, _LINE_KEYS)
    if "frames" not in fields:
        raise ValueError(f"{shown(value)} has no pair of frames")
    frame_a, frame_b = pair_in(fields["frames"])
    values = dict[str, float]()
    for key in NUMBERS_OF_LINE:
        if key in fields:
            values[key] = number_in(fields[key], key)
    pulls_only = str(fields.get("pulls_only", "false")).lower()
    if pulls_only not in ("true", "false"):
        raise ValueError(f"pulls_only {shown(fields['pulls_only'])} is neither true nor false")
    name = name_in(fields.get("name", f"{frame_a}-{frame_b}"))
    return LineForce(frame_a, frame_b, name=name, pulls_only=pulls_only == "true", **values)


#: Numbers of a contact, and all its keys.
_CONTACT_NUMBERS = ("radius", "friction", "restitution")
_CONTACT_KEYS = ("frame", "name", "ground", *_CONTACT_NUMBERS)


def _contact(value: Any) -> Contact | Rope:
    """A contact `{frame: sole, friction: 0.8}` or a rope `{rope: [a, b], length: 1.2}`."""
    if "rope" in mapping_in(value):
        return _rope(value)
    fields = mapping_in(value, _CONTACT_KEYS)
    if "frame" not in fields:
        raise ValueError(f"{shown(value)} has no frame and no rope")
    values: dict[str, Any] = {}
    for key in _CONTACT_NUMBERS:
        if key in fields:
            values[key] = number_in(fields[key], key)
    for key in ("ground", "name"):
        if key in fields:
            values[key] = name_in(fields[key])
    return Contact(name_in(fields["frame"]), **values)


#: Keys of a rope.
_ROPE_KEYS = ("name", "rope", "length")


def _rope(value: Any) -> Rope:
    """A rope, with the keys `_ROPE_KEYS`."""
    fields = mapping_in(value, _ROPE_KEYS)
    if "length" not in fields:
        raise ValueError(f"{shown(value)} has no length")
    frame_a, frame_b = pair_in(fields["rope"])
    length = number_in(fields["length"], "length")
    name = name_in(fields.get("name", f"{frame_a}-{frame_b}"))
    return Rope(frame_a, frame_b, length, name=name)


class _Spring(NamedTuple):
    """The spring of a joint: its stiffness, and the position where it is relaxed."""

    stiffness: float
    reference: float


def _spring(joint: str, value: Any) -> _Spring:
    """The spring of a joint, from its keys `stiffness` and `reference`."""
    fields = numbers_in(value, required=["stiffness"], defaults={"reference": 0.0})
    return _Spring(fields["stiffness"], fields["reference"])


def _limit(joint: str, value: Any) -> dict[str, float]:
    """The limits of a joint, by the keys of `LIMITS` that the file has."""
    limit = {key: number_in(number, key) for key, number in mapping_in(value, LIMITS).items()}
    if limit.get("lower", -np.inf) > limit.get("upper", np.inf):
        raise ValueError(f"the lower limit of {joint} is above the upper one")
    for key in ("effort", "velocity"):
        if limit.get(key, 0.0) < 0:
            raise ValueError(f"{key} of {joint} is negative")
    return limit


def _rotor(joint: str, value: Any) -> float:
    """The inertia of the rotor of a joint, reflected to the joint by the gear.

    The value is this inertia, or a mapping with `rotor_inertia` and `gear_ratio`. It may be
    negative, because it may be an estimate.
    """
    mapping = value if isinstance(value, dict) else {"rotor_inertia": value}
    fields = numbers_in(mapping, required=["rotor_inertia"], defaults={"gear_ratio": 1.0})
    return fields["rotor_inertia"] * fields["gear_ratio"] ** 2


def _friction(joint: str, value: Any) -> float:
    """A coefficient of friction of a joint."""
    coefficient = number_in(value)
    if coefficient < 0:
        raise ValueError(f"{value} of {joint} is negative: it would accelerate the joint")
    return coefficient


def _weight_share(joint: str, value: Any) -> Share:
    """How much of the weight of a joint's body acts on it; see `model.weight_shares`.

    It is a share, or the list [share, x, y, z] with the offset of the weight in the axes of the
    joint, [m].
    """
    if not isinstance(value, list):
        return number_in(value)
    share_and_offset = [number_in(entry) for entry in value]
    if len(share_and_offset) != 4:
        raise ValueError(f"{shown(value)} is neither a number nor [share, x, y, z]")
    return share_and_offset


def _kind(value: Any) -> str:
    """The true kind of a joint, one of `KINDS`."""
    kind = name_in(value).upper()
    if kind not in KINDS:
        raise ValueError(f"{value!r} unknown; known: {', '.join(KINDS)}")
    return kind


#: Keys of a `loop_closures.yaml`.
_SW2ROBOT_KEYS = ("closures", "dependent", "independent")


def _sw2robot_cuts(content: YamlContent) -> Cuts:
    """The cuts of a `loop_closures.yaml`: hinges, by point and axis in base axes at q = 0."""
    content.require_known(_SW2ROBOT_KEYS)
    hinges = content.entries("closures", _hinge)
    if content["closures"] == []:  # `entries` reports a value that is not a list
        content.problems.append("closures: a list of hinges is needed")
    for key in ("dependent", "independent"):
        content.setdefault(key, None)  # `entries` reports None: the keys are required
    dependent = content.entries("dependent", name_in)
    independent = content.entries("independent", name_in)
    for name in repeated(dependent + independent):
        content.problems.append(f"{name}: named twice")
    # The file has no names of hinges, so they are numbered.
    named_hinges = []
    for number, hinge in enumerate(hinges, 1):
        named_hinges.append(hinge._replace(name=f"loop_closure_{number}"))
    return Cuts(actuated=tuple(independent), hinges=tuple(named_hinges), dependent=tuple(dependent))


#: Keys of a hinge in a `loop_closures.yaml`.
_HINGE_KEYS = ("link_a", "link_b", "point", "axis")


def _hinge(value: Any) -> CutJoint:
    """A hinge of a `loop_closures.yaml`; its name is empty."""
    fields = mapping_in(value, _HINGE_KEYS)
    if len(fields) < len(_HINGE_KEYS):
        raise ValueError(f"{shown(value)} needs {', '.join(_HINGE_KEYS)}")
    # Point and axis are relative to the base for both links.
    placement = pin.SE3(np.eye(3), _vector(fields, "point"))
    axis = _vector(fields, "axis")
    sides = []
    for key in ("link_a", "link_b"):
        link = name_in(fields[key])
        sides.append(Side(link, relative_to="universe", placement=placement, axis=axis))
    return cut_joint("", "revolute", *sides)


def _vector(fields: Mapping[str, Any], key: str) -> Array:
    """The point or the axis of a hinge, shape (3,); an axis must not be zero."""
    value = vector(fields.get(key))
    if value is None:
        raise ValueError(f"{key} {shown(fields.get(key))} is not three numbers")
    if key == "axis" and not value.any():
        raise ValueError(f"{key} {shown(fields.get(key))} is zero: it has no direction")
    return value

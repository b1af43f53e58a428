# SPDX-License-Identifier: BSD-2-Clause
"""What a URDF cannot say: closures, motors, gravity, joints of several axes, from a YAML file."""

import reprlib
from collections import Counter
from collections.abc import Iterator
from itertools import accumulate
from typing import Any, NamedTuple, TypeGuard

import numpy as np
import yaml

from ..arrays import Array
from ..errors import DescriptionError
from ..model.closures import Closure, Constraint, Distance, Rolling
from ..model.lines import LineForce
from . import loop_closures
from .cut_joints import CutJoint
from .problems import numbers, telling, vector
from .urdf import KINDS

_EARTH = ["0", "0", "-9.81"]
_KEYS = ("closed_loop", "type", "name_mot", "line_force", "gravity", "joint_name", "joint_type")
_OF_LINES = ("stiffness", "rest_length", "damping", "preload")
_WITH_LENGTH = {"distance": Distance, "rolling": Rolling}
#: Characters of a YAML at most; that of a robot with 400 joints has a tenth.
_LONGEST = 200_000
#: Depth of brackets in brackets; two are needed.
_DEEPEST = 50
_BRACKETS = {"[": 1, "{": 1, "]": -1, "}": -1}


class Cuts(NamedTuple):
    """What a URDF cannot say: content of the YAML file."""

    closures: tuple[Constraint, ...]  #: By default frames `closing_NAME_1`, `closing_NAME_2`.
    actuated: tuple[str, ...]  #: Names of the motors: joints and lines.
    gravity: Array  #: In base axes, shape (3,), [m/s^2].
    joints: dict[str, str]  #: What joints are in truth, by name; see `Urdf.tree`.
    source: str = ""  #: The YAML, for messages; empty without one.
    forces: tuple[LineForce, ...] = ()
    hinges: tuple[CutJoint, ...] = ()  #: Those of a `loop_closures.yaml`.
    dependent: tuple[str, ...] = ()  #: Joints that follow from the closures; they mimic none.


def parse_cuts(text: str, source: str) -> Cuts:
    """Closures, motors and gravity of a YAML file in the LAAS schema.

    It has the key `name_mot`; others may be missing. A type is a kind of `Closure`, or "distance"
    or "rolling" with a length, as "distance 0.3". `line_force` lists mappings of two `frames` and
    what else a `LineForce` has. The error names every problem found.
    """
    content = _content(text, source)
    if "closures" in content:
        hinges, dependent, independent = loop_closures.parse(content, source)
        gravity = np.array(_EARTH, dtype=float)
        return Cuts((), independent, gravity, {}, source, (), hinges, dependent)
    problems = [f"{key}: unknown; known: {', '.join(_KEYS)}" for key in content if key not in _KEYS]
    content = {**{key: [] for key in _KEYS}, "name_mot": None, "gravity": _EARTH, **content}

    def items(key: str) -> list[Any]:
        if isinstance(content[key], list):
            return content[key]
        problems.append(f"{key}: a list is needed")
        return []

    def names(key: str) -> list[str]:
        no_names = [_shown(name) for name in items(key) if not _is_name(name)]
        problems.extend(f"{key}: {shown} is not a name" for shown in no_names)
        return list(filter(_is_name, items(key)))

    def both(first: str, second: str, things: list[Any], kinds: list[str]) -> list[Any]:
        if len(things) != len(kinds):
            problems.append(f"{first} has {len(things)} entries, {second} has {len(kinds)}")
        return list(zip(things, kinds, strict=False))

    closures, forces = list[Constraint](), list[LineForce]()
    for pair, kind in both("closed_loop", "type", items("closed_loop"), names("type")):
        with telling(problems):
            closures.append(_closure(pair, kind))
    for each in items("line_force"):
        with telling(problems):
            forces.append(_line(each))
    weight = vector(content["gravity"])
    if weight is None:
        problems.append(f"gravity: {_shown(content['gravity'])} is not a list of three numbers")
    joints = both("joint_name", "joint_type", names("joint_name"), names("joint_type"))
    twice = [name for name, count in Counter(name for name, _ in joints).items() if count > 1]
    problems += [f"joint_name: {name} appears twice" for name in twice]
    unknown = sorted({kind for _, kind in joints} - set(KINDS))
    problems += [f"joint_type: {kind!r} unknown; known: {', '.join(KINDS)}" for kind in unknown]
    motors = tuple(names("name_mot"))
    if problems or weight is None:
        raise DescriptionError(source, problems)
    return Cuts(tuple(closures), motors, weight, dict(joints), source, tuple(forces))


def _closure(pair: Any, kind: str) -> Constraint:
    if not _is_pair(pair):
        raise ValueError(f"closed_loop: {_shown(pair)} is not a pair of frame names")
    if kind.lower() in Closure.KINDS:
        return Closure(pair[0], pair[1], kind.lower())
    word, _, length = kind.lower().partition(" ")
    value = numbers(length, 1)
    if word in _WITH_LENGTH and value is not None and value[0] > 0:
        return _WITH_LENGTH[word](pair[0], pair[1], float(value[0]))
    known = ", ".join([*Closure.KINDS, *(f"{word} LENGTH" for word in _WITH_LENGTH)])
    raise ValueError(f"type: {kind!r} unknown; known: {known}")


def _line(given: Any) -> LineForce:
    keys = ("name", "frames", *_OF_LINES)
    frames = given.get("frames") if isinstance(given, dict) else None
    if not _is_pair(frames):
        raise ValueError(f"line_force: {_shown(given)} has no pair of frames")
    problems = [f"{key} unknown; known: {', '.join(keys)}" for key in given if key not in keys]
    values: dict[str, Any] = {"name": given.get("name", f"{frames[0]}-{frames[1]}")}
    if not _is_name(values["name"]):
        problems.append(f"name {_shown(values['name'])} is not a name")
    for key in (key for key in _OF_LINES if key in given):
        if (found := numbers(str(given[key]), 1)) is None:
            problems.append(f"{key} {_shown(given[key])} is not a number")
        else:
            values[key] = float(found[0])
    if not problems:
        with telling(problems):
            return LineForce(frames[0], frames[1], **values)
    raise ValueError(f"line_force {_shown(frames)}: {'; '.join(problems)}")


def _content(text: str, source: str) -> dict[str, Any]:
    """Keys and values of a YAML; scalars are strings, as they stand there."""
    if len(text) > _LONGEST:
        raise DescriptionError(source, [f"more than {_LONGEST} characters"])
    if max(accumulate(_BRACKETS.get(c, 0) for c in text), default=0) > _DEEPEST:  # slow to scan
        raise DescriptionError(source, ["lists are nested too deeply"])
    try:
        loader = yaml.BaseLoader(text)
        node = loader.get_single_node()
        content = loader.construct_document(node) if node is not None else None
    except yaml.YAMLError as error:
        raise DescriptionError(source, [f"not YAML: {error}"]) from None
    except RecursionError:
        raise DescriptionError(source, ["lists are nested too deeply"]) from None
    if not isinstance(node, yaml.MappingNode) or not content:
        raise DescriptionError(source, ["no keys; name_mot is needed"])
    if twice := list(_twice(node)):
        raise DescriptionError(source, [f"{key}: appears twice" for key in twice])
    return dict(content)


def _twice(root: yaml.Node) -> Iterator[str]:
    """Keys that a mapping has twice, at any depth."""
    nodes, seen = [root], set[int]()
    while nodes:
        node = nodes.pop()
        if id(node) in seen or isinstance(node, yaml.ScalarNode):
            continue
        seen.add(id(node))  # aliases lead to it again
        pairs = node.value if isinstance(node, yaml.MappingNode) else []
        counts = Counter(key.value for key, _ in pairs)
        yield from (key for key, count in counts.items() if count > 1)
        nodes += [value for _, value in pairs] or node.value


def _shown(value: Any) -> str:
    """A short form of a value; aliases can make a few lines of YAML a list of lists of lists."""
    short = reprlib.Repr()
    short.maxlevel = 2
    return short.repr(value)


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and bool(value)


def _is_pair(value: Any) -> TypeGuard[list[str]]:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_name, value))

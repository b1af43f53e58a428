# SPDX-License-Identifier: BSD-2-Clause
"""What a URDF cannot say: closures, motors, gravity, joints of several axes, from a YAML file."""

from __future__ import annotations

import reprlib
from collections import Counter
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from ..chain.closures import Closure
from ..errors import DescriptionError
from .problems import numbers
from .urdf import AXES

Array = NDArray[np.float64]

_KEYS = ("closed_loop", "type", "name_mot", "gravity", "joint_name", "joint_type")
#: Of a YAML; that of a robot with 400 joints has a tenth.
_LONGEST = 200_000
#: Of brackets in brackets; two are needed.
_DEEPEST = 50
_BRACKETS = {"[": 1, "{": 1, "]": -1, "}": -1}


class Cuts(NamedTuple):
    """What a URDF cannot say: content of the YAML file.

    Attributes:
        closures: Pairs of frames to be closed.
        actuated: Names of the motors' joints.
        gravity: Acceleration of gravity in base axes, shape (3,), [m/s^2].
        joints: What joints are in truth, by name; see `parse_urdf`.
    """

    closures: tuple[Closure, ...]
    actuated: tuple[str, ...]
    gravity: Array
    joints: dict[str, str]


def parse_cuts(text: str, source: str) -> Cuts:
    """Closures, motors and gravity of a YAML file in the LAAS schema.

    Args:
        text: The YAML with the keys `closed_loop`, `type` and `name_mot`; `gravity` may be missing
            and is then (0, 0, -9.81), `joint_name` and `joint_type` may be missing.
        source: What error messages call it.

    Raises:
        DescriptionError: With every problem found.
    """
    content = _content(text, source)
    problems = [f"{key}: unknown; known: {', '.join(_KEYS)}" for key in content if key not in _KEYS]

    def items(key: str, default: list[Any] | None = None) -> list[Any]:
        value = content.get(key, default)
        if not isinstance(value, list):
            problems.append(f"{key}: a list is needed")
            return []
        return value

    def names(key: str, default: list[Any] | None = None) -> list[str]:
        found = items(key, default)
        problems.extend(
            f"{key}: {_shown(name)} is not a name" for name in found if not _is_name(name)
        )
        return [name for name in found if _is_name(name)]

    pairs, kinds, motors = items("closed_loop"), names("type"), names("name_mot")
    if len(pairs) != len(kinds):
        problems.append(f"closed_loop has {len(pairs)} entries, type has {len(kinds)}")
    closures = []
    for pair, kind in zip(pairs, kinds, strict=False):
        if not (isinstance(pair, list) and len(pair) == 2 and all(map(_is_name, pair))):
            problems.append(f"closed_loop: {_shown(pair)} is not a pair of frame names")
        elif kind.lower() not in Closure.KINDS:
            problems.append(f"type: {kind!r} unknown; known: {', '.join(Closure.KINDS)}")
        else:
            closures.append(Closure(pair[0], pair[1], kind.lower()))
    gravity = _vector(content.get("gravity", ["0", "0", "-9.81"]))
    if gravity is None:
        text = f"{_shown(content['gravity'])} is not a list of three numbers"
        problems.append(f"gravity: {text}")
    named, types = names("joint_name", []), names("joint_type", [])
    if len(named) != len(types):
        problems.append(f"joint_name has {len(named)} entries, joint_type has {len(types)}")
    twice = [name for name, count in Counter(named).items() if count > 1]
    problems += [f"joint_name: {name} stands twice" for name in twice]
    unknown = sorted(set(types) - set(AXES))
    problems += [f"joint_type: {kind!r} unknown; known: {', '.join(AXES)}" for kind in unknown]
    if problems or gravity is None:
        raise DescriptionError(source, problems)
    return Cuts(tuple(closures), tuple(motors), gravity, dict(zip(named, types, strict=True)))


def _content(text: str, source: str) -> dict[str, Any]:
    """Keys and values of a YAML; scalars are strings, as they stand there."""
    if len(text) > _LONGEST:
        raise DescriptionError(source, [f"more than {_LONGEST} characters"])
    if max(accumulate(_BRACKETS.get(c, 0) for c in text), default=0) > _DEEPEST:  # slow to scan
        raise DescriptionError(source, ["lists in lists, too deep"])
    try:
        loader = yaml.BaseLoader(text)
        node = loader.get_single_node()
        content = loader.construct_document(node) if node is not None else None
    except yaml.YAMLError as error:
        raise DescriptionError(source, [f"not YAML: {error}"]) from None
    except RecursionError:
        raise DescriptionError(source, ["lists in lists, too deep"]) from None
    if not isinstance(node, yaml.MappingNode) or not content:
        raise DescriptionError(source, ["no keys; closed_loop, type and name_mot are needed"])
    keys = Counter(key.value for key, _ in node.value)
    if twice := [key for key, count in keys.items() if count > 1]:
        raise DescriptionError(source, [f"{key}: stands twice" for key in twice])
    return dict(content)


def _shown(value: Any) -> str:
    """A value in short: aliases make a list of lists of lists ... out of a few lines."""
    short = reprlib.Repr()
    short.maxlevel = 2
    return short.repr(value)


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and bool(value)


def _vector(value: Any) -> Array | None:
    words = value if isinstance(value, list) and all(map(_is_name, value)) else []
    one = all(numbers(word, 1) is not None for word in words)
    return numbers(" ".join(words), 3) if one else None

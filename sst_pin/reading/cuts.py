# SPDX-License-Identifier: BSD-2-Clause
"""What a URDF cannot say: closures, motors, gravity, joints of several axes, from a YAML file."""

from __future__ import annotations

import reprlib
import warnings
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import yaml
from numpy.typing import NDArray

from ..arrays import names
from ..chain.closures import Closure, Constraint, Coupling, Distance, Rolling
from ..chain.draft import Motor, without_locked
from ..chain.lines import LineForce
from ..errors import DescriptionError, DescriptionWarning, InputError
from ..files import beside
from . import inertias, loop_closures
from .cut_joints import CutJoint
from .described import Described, naming
from .problems import numbers, vector
from .srdf import Srdf
from .text import read_text
from .urdf import KINDS, Urdf, closing_frames

Array = NDArray[np.float64]

_EARTH = np.array([0, 0, -9.81])
_KEYS = ("closed_loop", "type", "name_mot", "line_force", "gravity", "joint_name", "joint_type")
_OF_LINES = ("stiffness", "rest_length", "damping", "preload")
_WITH_LENGTH = {"distance": Distance, "rolling": Rolling}
#: Characters of a YAML at most; that of a robot with 400 joints has a tenth.
_LONGEST = 200_000
#: Depth of brackets in brackets; two are needed.
_DEEPEST = 50
_BRACKETS = {"[": 1, "{": 1, "]": -1, "}": -1}


class Cuts(NamedTuple):
    """What a URDF cannot say: content of the YAML file.

    Attributes:
        closures: What closes the loops; by default frames `closing_NAME_1`, `closing_NAME_2`.
        actuated: Names of the motors: joints and lines.
        gravity: Acceleration of gravity in base axes, shape (3,), [m/s^2].
        joints: What joints are in truth, by name; see `Urdf.tree`.
        source: The YAML, for messages; empty without one.
        forces: Forces along lines.
        hinges: Hinges that close loops, of a `loop_closures.yaml`.
        dependent: Joints whose positions follow from the closures; they mimic none.
    """

    closures: tuple[Constraint, ...]
    actuated: tuple[str, ...]
    gravity: Array
    joints: dict[str, str]
    source: str = ""
    forces: tuple[LineForce, ...] = ()
    hinges: tuple[CutJoint, ...] = ()
    dependent: tuple[str, ...] = ()


def read_urdf(
    path: str | Path | Urdf,
    cuts: str | Path | None = None,
    locked: Sequence[str] = (),
    actuated: Sequence[Motor] | None = None,
    *,
    default: str | Path | None = None,
) -> Described:
    """Read a robot; see `ClosedChain.from_urdf`, whose caller a warning points to."""
    urdf, locked = path if isinstance(path, Urdf) else Urdf.read(path), names("locked", locked)
    found = read_cuts(urdf, cuts, default)
    robot = closed(urdf, found)
    model, closures, motors = robot.model, robot.closures, robot.actuated
    if actuated is None and not found.source and not is_marked(robot):  # an open tree
        followers = {closure.joint for closure in closures if isinstance(closure, Coupling)}
        motors = tuple(name for name in list(model.names)[1:] if name not in followers)
        own = beside(Path(urdf.source), ".yaml").name
        message = f"{urdf.source}: no {own} with closures and motors is beside it; it is read as "
        message += "an open tree with a motor at each joint; actuated= names the motors"
        warnings.warn(message, DescriptionWarning, stacklevel=3)
    if locked:
        with naming(robot.source):
            model = without_locked(model, locked)
        closures = tuple(_held(closures, set(locked), robot.source))
        motors = tuple(name for name in motors if name not in locked)
    srdf = load_poses(urdf, model, {*locked, *found.joints})
    inertias.warn(urdf.root, urdf.source, stacklevel=3)
    motors = motors if actuated is None else actuated
    return robot._replace(model=model, closures=closures, actuated=motors, srdf=srdf)


def read_cuts(urdf: Urdf, path: str | Path | None, default: str | Path | None = None) -> Cuts:
    """Cuts of a URDF: from `path`, the YAML beside it, `default`, or none if the URDF has marks."""
    path = default_cuts(Path(urdf.source)) or default if path is None else path
    if path is None:
        return Cuts((), urdf.marks.independent, urdf.gravity, {})
    return parse_cuts(read_text(path, "YAML of the cuts"), str(path))


def default_cuts(urdf: Path) -> Path | None:
    """The YAML that belongs to a URDF: of its name, or a `loop_closures.yaml` of its package."""
    package = urdf.parent.parent if urdf.parent.name == "urdf" else urdf.parent
    folders = (urdf.parent, package, package / "config")
    paths = [beside(urdf, ".yaml"), *(folder / "loop_closures.yaml" for folder in folders)]
    return next((path for path in paths if path.is_file()), None)


def load_poses(urdf: Urdf, model: pin.Model, held: Collection[str] = ()) -> Srdf | None:
    """Named configurations of a file and of the SRDF beside it; the SRDF, where there is one."""
    for name, values in urdf.poses.items():
        q = pin.neutral(model)
        for joint in (model.joints[j] for j in range(1, model.njoints)):
            own = slice(joint.idx_q, joint.idx_q + joint.nq)
            q[own] = values.get(model.names[joint.id], q[own])
        model.referenceConfigurations[name] = q
    path = beside(Path(urdf.source), ".srdf")
    if not path.is_file():
        return None
    srdf = Srdf(path)
    srdf.load_configurations(model, held)
    return srdf


def closed(urdf: Urdf, cuts: Cuts) -> Described:
    """The tree of a URDF, closed by its cuts, or else by its marks, and by its mimic joints."""
    model, marks = urdf.tree(cuts.joints), urdf.marks
    model.gravity.linear = cuts.gravity
    source = f"{urdf.source} with {cuts.source}" if cuts.source else urdf.source
    closures = cuts.closures
    with naming(source):
        if not closures:
            joints = cuts.hinges or marks.joints
            closures = (*closing_frames(model), *(joint.closure(model) for joint in joints))
    followers = [mimic for mimic in urdf.mimics if mimic.joint not in cuts.dependent]
    closures = (*closures, *marks.gears, *followers)
    return Described(source, model, closures, cuts.actuated, urdf.shapes, forces=cuts.forces)


def is_marked(robot: Described) -> bool:
    """Whether a URDF closes loops by itself, so that it is no open tree."""
    return any(not isinstance(closure, Coupling) for closure in robot.closures) or bool(
        robot.actuated
    )


def _held(closures: Sequence[Constraint], locked: set[str], source: str) -> Iterator[Constraint]:
    """Closures with some joints held at zero."""
    for closure in closures:
        if not isinstance(closure, Coupling):
            yield closure
            continue
        free = {n: c for n, c in closure.polynomials.items() if n not in locked}
        offset = closure.offset
        offset += sum(c[0] for n, c in closure.polynomials.items() if n in locked)
        if closure.joint not in locked:
            yield Coupling(closure.joint, free, offset)
        elif free or offset:
            text = f"locked joint {closure.joint} mimics {', '.join(free) or 'with an offset'}: "
            raise DescriptionError(source, [text + "lock both joints, at zero, or none"])


def parse_cuts(text: str, source: str) -> Cuts:
    """Closures, motors and gravity of a YAML file in the LAAS schema.

    Args:
        text: The YAML with the key `name_mot`; `closed_loop` and `type`, `joint_name` and
            `joint_type` may be missing, and `gravity`, which is then (0, 0, -9.81). A type is a
            kind of `Closure`, or "distance" or "rolling" with a length, as "distance 0.3".
            `line_force` lists mappings of two `frames` and what else a `LineForce` has.
        source: What error messages call it.

    Raises:
        DescriptionError: With every problem found.
    """
    content = _content(text, source)
    if "closures" in content:
        hinges, dependent, independent = loop_closures.parse(content, source)
        return Cuts((), independent, _EARTH, {}, source, (), hinges, dependent)
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

    pairs, kinds, motors = items("closed_loop", []), names("type", []), names("name_mot")
    if len(pairs) != len(kinds):
        problems.append(f"closed_loop has {len(pairs)} entries, type has {len(kinds)}")
    closures: list[Constraint] = []
    for pair, kind in zip(pairs, kinds, strict=False):
        if not (isinstance(pair, list) and len(pair) == 2 and all(map(_is_name, pair))):
            problems.append(f"closed_loop: {_shown(pair)} is not a pair of frame names")
        elif kind.lower() in Closure.KINDS:
            closures.append(Closure(pair[0], pair[1], kind.lower()))
        else:
            word, _, length = kind.lower().partition(" ")
            value = numbers(length, 1)
            if word in _WITH_LENGTH and value is not None and value[0] > 0:
                closures.append(_WITH_LENGTH[word](pair[0], pair[1], float(value[0])))
            else:
                known = ", ".join([*Closure.KINDS, *(f"{word} LENGTH" for word in _WITH_LENGTH)])
                problems.append(f"type: {kind!r} unknown; known: {known}")
    forces = [_line(each, problems) for each in items("line_force", [])]
    gravity = vector(content["gravity"]) if "gravity" in content else _EARTH
    if gravity is None:
        text = f"{_shown(content['gravity'])} is not a list of three numbers"
        problems.append(f"gravity: {text}")
    named, types = names("joint_name", []), names("joint_type", [])
    if len(named) != len(types):
        problems.append(f"joint_name has {len(named)} entries, joint_type has {len(types)}")
    twice = [name for name, count in Counter(named).items() if count > 1]
    problems += [f"joint_name: {name} appears twice" for name in twice]
    unknown = sorted(set(types) - set(KINDS))
    problems += [f"joint_type: {kind!r} unknown; known: {', '.join(KINDS)}" for kind in unknown]
    if problems or gravity is None:
        raise DescriptionError(source, problems)
    joints, lines = dict(zip(named, types, strict=True)), tuple(filter(None, forces))
    return Cuts(tuple(closures), tuple(motors), gravity, joints, source, lines)


def _line(given: Any, problems: list[str]) -> LineForce | None:
    """A force along a line; its problems are added to `problems`."""
    keys = ("name", "frames", *_OF_LINES)
    frames = given.get("frames") if isinstance(given, dict) else None
    if not (isinstance(frames, list) and len(frames) == 2 and all(map(_is_name, frames))):
        problems.append(f"line_force: {_shown(given)} has no pair of frames")
        return None
    own = [f"{key} unknown; known: {', '.join(keys)}" for key in given if key not in keys]
    values: dict[str, Any] = {key: _scalar(given[key]) for key in _OF_LINES if key in given}
    own += [f"{key} {_shown(given[key])} is not a number" for key, x in values.items() if x is None]
    if not _is_name(name := given.get("name", "-".join(frames))):
        own.append(f"name {_shown(name)} is not a name")
    if not own:
        try:
            return LineForce(*frames, name=name, **values)
        except InputError as error:
            own.append(str(error))
    problems += [f"line_force {_shown(frames)}: {text}" for text in own]
    return None


def _scalar(value: Any) -> float | None:
    found = numbers(value, 1) if _is_name(value) else None
    return None if found is None else float(found[0])


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
    keys = Counter(key.value for key, _ in node.value)
    if twice := [key for key, count in keys.items() if count > 1]:
        raise DescriptionError(source, [f"{key}: appears twice" for key in twice])
    return dict(content)


def _shown(value: Any) -> str:
    """A short form of a value; aliases can make a few lines of YAML a list of lists of lists."""
    short = reprlib.Repr()
    short.maxlevel = 2
    return short.repr(value)


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and bool(value)

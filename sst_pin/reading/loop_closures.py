# SPDX-License-Identifier: BSD-2-Clause
"""YAML files of other tools with the joints that close loops.

These are `loop_closures.yaml` of sw2robot and scikit-robot, which is also written, and
`robot_data.yaml` of fusion2URDF. All loops are closed at q = 0.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import DescriptionError
from ..files import as_path, require_ending, text_writer, write_files
from ..model.closures import Closure, Coupling
from ..model.thresholds import RANK_TOLERANCE
from ..model.tree import frame_id
from .cut_joints import CutJoint, cut_joint
from .problems import vector
from .yaml_content import YamlContent, mapping_in, name_in, shown

_OF_HINGE = ("link_a", "link_b", "point", "axis")
#: Closing joints, dependent joints, and those with the motors.
_Parts = tuple[tuple[CutJoint, ...], tuple[str, ...], tuple[str, ...]]


def _of_scikit_robot(content: YamlContent) -> _Parts:
    """A `loop_closures.yaml`: hinges, by point and axis in base axes at q = 0."""
    content.require_known(("closures", "dependent", "independent"))
    hinges = content.entries("closures", _hinge)
    if not content["closures"]:
        content.problems.append("closures: a list of hinges is needed")
    dependent = content.entries("dependent", name_in, required=True)
    independent = content.entries("independent", name_in, required=True)
    counts = Counter(dependent + independent)
    content.problems += [f"{name}: named twice" for name, count in counts.items() if count > 1]
    names = (f"loop_closure_{k}" for k in range(1, len(hinges) + 1))
    joints = (hinge._replace(name=name) for hinge, name in zip(hinges, names, strict=True))
    return tuple(joints), tuple(dependent), tuple(independent)


def _hinge(value: Any) -> CutJoint:
    fields = mapping_in(value, _OF_HINGE)
    if len(fields) < len(_OF_HINGE):
        raise ValueError(f"{shown(value)} needs {', '.join(_OF_HINGE)}")
    place = pin.SE3(np.eye(3), _vector(fields, "point"))
    axis, base = _vector(fields, "axis"), ("universe", "universe")
    links = name_in(fields["link_a"]), name_in(fields["link_b"])
    return cut_joint("", "revolute", links, (place, place), (axis, axis), base)


def _of_fusion(content: YamlContent) -> _Parts:
    """A `robot_data.yaml` of fusion2URDF: joints whose origins are seen from their parents."""

    def is_motor(name: str, value: Any) -> str:
        fields = mapping_in(value)
        return name * (fields.get("passive") == "false" and fields.get("type") != "fixed")

    motors = filter(None, content.entries("joints", is_motor, dict))
    return tuple(content.entries("closing_joints", _closing_joint)), (), tuple(motors)


def _closing_joint(value: Any) -> CutJoint:
    fields = mapping_in(value)
    name, kind, a, b = (_text(fields, key) for key in ("name", "type", "parent", "child"))
    xyz, rpy, axis = (_vector(fields, k) for k in ("origin_xyz_m", "origin_rpy_rad", "axis"))
    place = pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
    return cut_joint(name, kind, (a, b), (place, place), (axis, axis), (a, a))


def _text(fields: Mapping[str, Any], key: str) -> str:
    if key not in fields:
        raise ValueError(f"{shown(fields)} has no {key}")
    return name_in(fields[key])


def _vector(fields: Mapping[str, Any], key: str) -> Array:
    value = vector(fields.get(key))
    if value is None or (key == "axis" and not value.any()):
        raise ValueError(f"{key} {shown(fields.get(key))} is not three numbers")
    return value


#: Readers of other YAML files, by a key that these have.
PARSERS: dict[str, Callable[[YamlContent], _Parts]] = {
    "closures": _of_scikit_robot,
    "closing_joints": _of_fusion,
}


def write_loop_closures(chain: ClosedChain, path: str | Path, force: bool = False) -> None:
    """Write the closures of a robot as `loop_closures.yaml`, for sw2robot and scikit-robot.

    The file has hinges only, each at its place at q = 0. A weld becomes two hinges, and a point
    closure a hinge if the robot turns there about one axis only. Couplings stay in the URDF.
    `independent` are the coordinates of the robot.

    Args:
        chain: A robot whose loops are closed at q = 0.
        path: The file, its ending .yaml or .yml.
        force: Whether an existing file may be replaced.

    Raises:
        DescriptionError: If the loops are open at q = 0, or for what the file cannot say: other
            closures, forces along lines. The message lists all.
        OutputError: If the file cannot be written, or exists.

    Example:
        >>> bars = {"crank": 0.2, "rocker": 0.2, "coupler": 0.3, "ground": 0.3, "point": 0.3}
        >>> chain = sst_pin.robots.four_bar(**bars)  # a parallelogram
        >>> sst_pin.write_loop_closures(chain, "loop_closures.yaml")
        >>> print(open("loop_closures.yaml").readlines()[-1].strip())
        independent: [crank]
    """
    require_ending(path, ".yaml", ".yml")
    mechanism, model = chain.mechanism, chain.mechanism.model
    problems = [f"{line}: a force along a line" for line in mechanism.lines.forces]
    if not chain.engine.are_closed(pin.neutral(model)):
        problems.append("the loops are open at q = 0, where the file gives points and axes")
    hinges = []
    for closure in chain.closures:
        if isinstance(closure, Coupling):
            continue
        found = list(_hinges(chain, closure)) if isinstance(closure, Closure) else []
        if not found:
            problems.append(f"closure {closure}: neither a hinge nor a weld")
        hinges += found
    if problems:
        raise DescriptionError(str(path), problems)
    dependent = [name for name in list(model.names)[1:] if name not in chain.coordinates]
    joints = {"dependent": dependent, "independent": list(chain.coordinates)}
    content = {"closures": hinges, **joints}
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
    write_files({as_path(path): text_writer(text)}, force)


def _hinges(chain: ClosedChain, closure: Closure) -> Iterator[dict[str, Any]]:
    """Hinges that hold what a closure holds; none if no hinges do."""
    model = chain.mechanism.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    ids = [frame_id(model, name) for name in (closure.frame_a, closure.frame_b)]
    (x, _, z), held, place = np.eye(3), closure.held, data.oMf[ids[0]]
    axes = {Closure.KINDS["6d"]: [x, z], Closure.KINDS["hinge"]: [z]}.get(held, [])
    for axis in _only_axis(chain, closure) if held == Closure.KINDS["3d"] else axes:
        links = (model.frames[_link(model, number)].name for number in ids)
        hinge = (*links, place.translation.tolist(), (place.rotation @ axis).tolist())
        yield dict(zip(_OF_HINGE, hinge, strict=True))


def _link(model: pin.Model, frame: int) -> int:
    """The link of a frame."""
    while frame and model.frames[frame].type != pin.FrameType.BODY:
        frame = model.frames[frame].parentFrame
    return frame


def _only_axis(chain: ClosedChain, closure: Closure) -> list[Array]:
    """The axis in frame A about which alone frame B turns relative to it; none if it has more."""
    model, turns = chain.mechanism.model, []
    data = model.createData()
    q = chain.generic_configuration()
    near = chain.assemble(pin.integrate(model, q, np.full(model.nv, 0.1)), fixed=[])
    for at in (q, near):
        pin.framesForwardKinematics(model, data, at)
        R = data.oMf[frame_id(model, closure.frame_a)].rotation
        a, b = (chain.frame_jacobian(at, name)[3:] for name in (closure.frame_a, closure.frame_b))
        turns.append(R.T @ (b - a))
    U, sizes, _ = np.linalg.svd(np.hstack(turns))
    return [U[:, 0]] if sizes[1] < RANK_TOLERANCE * sizes[0] else []

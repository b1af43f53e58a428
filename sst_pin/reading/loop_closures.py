# SPDX-License-Identifier: BSD-2-Clause
"""The file `loop_closures.yaml` of sw2robot and scikit-robot: cut hinges, motors, other joints.

Points and axes of the hinges are in base axes at q = 0, where all loops are closed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml
from numpy.typing import NDArray

from ..chain.closed_chain import ClosedChain
from ..chain.closures import Closure, Coupling
from ..chain.thresholds import CLOSURE_TOLERANCE, RANK_TOLERANCE
from ..chain.tree import frame_id
from ..errors import DescriptionError, OutputError
from ..files import as_path, text_writer, write_files
from .cut_joints import CutJoint, turned
from .problems import vector

Array = NDArray[np.float64]

_KEYS = ("closures", "dependent", "independent")
_OF_HINGE = ("link_a", "link_b", "point", "axis")


def parse(
    content: dict[str, Any], source: str
) -> tuple[tuple[CutJoint, ...], tuple[str, ...], tuple[str, ...]]:
    """Hinges, dependent and independent joints.

    Raises:
        DescriptionError: With every problem found.
    """
    problems = [f"{key}: unknown; known: {', '.join(_KEYS)}" for key in content if key not in _KEYS]
    names: dict[str, Any] = {}
    for key in ("dependent", "independent"):
        names[key] = content.get(key)
        if not isinstance(names[key], list) or not all(isinstance(n, str) for n in names[key]):
            problems.append(f"{key}: a list of joint names is needed")
    if not problems:
        all_names = names["dependent"] + names["independent"]
        twice = [name for name in dict.fromkeys(all_names) if all_names.count(name) > 1]
        problems += [f"{name}: named twice" for name in twice]
    hinges: list[CutJoint] = []
    given = content["closures"]
    for k, hinge in enumerate(given if isinstance(given, list) else []):
        try:
            hinges.append(_hinge(hinge, k))
        except ValueError as caught:
            problems.append(f"closures[{k}]: {caught}")
    if not isinstance(given, list) or not given:
        problems.append("closures: a list of hinges is needed")
    if problems:
        raise DescriptionError(source, problems)
    return tuple(hinges), tuple(names["dependent"]), tuple(names["independent"])


def _hinge(given: Any, k: int) -> CutJoint:
    if not isinstance(given, dict) or set(given) != set(_OF_HINGE):
        raise ValueError(f"needed: {', '.join(_OF_HINGE)}")
    links = given["link_a"], given["link_b"]
    point, axis = vector(given["point"]), vector(given["axis"])
    if point is None or axis is None or not axis.any():
        raise ValueError("point and axis are three numbers each")
    if not all(isinstance(link, str) for link in links) or links[0] == links[1]:
        raise ValueError("link_a and link_b are two names")
    place = turned(pin.SE3(np.eye(3), point), axis, np.eye(3)[2])
    base = ("universe", "universe")
    return CutJoint(f"loop_closure_{k + 1}", "hinge", links, (place, place), base)


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
        >>> row = sst_pin.robots.n_four_bar(1)
        >>> sst_pin.write_loop_closures(row, "loop_closures.yaml")
        >>> print(open("loop_closures.yaml").readlines()[-1].strip())
        independent: [bar_0]
    """
    if as_path(path).suffix.lower() not in (".yaml", ".yml"):
        raise OutputError(path, f"ending {as_path(path).suffix!r} unknown; known: .yaml, .yml")
    mechanism, model = chain.mechanism, chain.mechanism.model
    problems = [f"{line}: a force along a line" for line in mechanism.lines.forces]
    if np.abs(chain.residual(pin.neutral(model))).max(initial=0.0) > CLOSURE_TOLERANCE:
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
    content = yaml.safe_dump(
        {"closures": hinges, **joints}, sort_keys=False, default_flow_style=None
    )
    write_files({as_path(path): text_writer(content)}, force)


def _hinges(chain: ClosedChain, closure: Closure) -> Iterator[dict[str, Any]]:
    """Hinges that hold what a closure holds; none if no hinges do."""
    model = chain.mechanism.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    ids = [frame_id(model, name) for name in (closure.frame_a, closure.frame_b)]
    x, _, z = np.eye(3)
    weld, hinge, point = (Closure.KINDS[kind] for kind in ("6d", "hinge", "3d"))
    axes: list[Array] = {weld: [x, z], hinge: [z]}.get(closure.held, [])
    if closure.held == point:
        axes = _only_axis(chain, closure)
    for axis in axes:
        place = data.oMf[ids[0]]
        links = (model.frames[_link(model, number)].name for number in ids)
        yield {
            **dict(zip(_OF_HINGE, links, strict=False)),
            "point": place.translation.tolist(),
            "axis": (place.rotation @ axis).tolist(),
        }


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

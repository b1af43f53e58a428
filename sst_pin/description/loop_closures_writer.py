# SPDX-License-Identifier: BSD-2-Clause
"""The file `loop_closures.yaml` of sw2robot and scikit-robot, from any chain."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import DescriptionError
from ..files import as_path, require_ending, text_writer, write_files
from ..model.closures import Closure, Coupling
from ..model.thresholds import RANK_TOLERANCE
from ..model.tree import frame_id

#: The axis of a closure is judged at q = 0 and at a second configuration, this step away, [rad] or
#: [m]. The step is far larger than the rounding of axes, and so small that the robot stays in its
#: assembly mode.
_STEP = 0.1


def write_loop_closures(chain: ClosedChain, path: str | Path, force: bool = False) -> None:
    """Write the closures of a robot as `loop_closures.yaml`, for sw2robot and scikit-robot.

    The file has only hinges, each with its point and axis at q = 0. A weld becomes two hinges. A
    point closure becomes a hinge if the robot can rotate there about one axis only. Couplings stay
    in the URDF. `independent` lists the coordinates of the robot.

    Args:
        chain: A robot whose loops are closed at q = 0.
        path: The file, its ending .yaml or .yml.
        force: Whether an existing file may be replaced.

    Raises:
        DescriptionError: If the loops are open at q = 0, or if the robot has other closures or
            forces along lines. The message lists all.
        OutputError: If the file cannot be written, or exists.

    Example:
        >>> bars = {"crank": 0.2, "rocker": 0.2, "coupler": 0.3, "ground": 0.3, "point": 0.3}
        >>> chain = sst_pin.robots.four_bar(**bars)  # a parallelogram
        >>> sst_pin.write_loop_closures(chain, "loop_closures.yaml")
        >>> from pathlib import Path
        >>> print(Path("loop_closures.yaml").read_text().splitlines()[-1].strip())
        independent: [crank]
    """
    require_robot("chain", chain)
    require_ending(path, ".yaml", ".yml")
    mechanism = chain.mechanism
    model = mechanism.model
    problems = [f"{line}: a force along a line" for line in mechanism.lines.forces]
    if not chain.engine.loops.are_closed(pin.neutral(model)):
        problems.append("the loops are open at q = 0, where the file gives points and axes")
    hinges = []
    for closure in chain.closures:
        if isinstance(closure, Coupling):
            continue
        closure_hinges = []
        if isinstance(closure, Closure):
            closure_hinges = _hinges(chain, closure)
        if not closure_hinges:  # no hinges can replace it, or it is a rod, a wheel or a brake
            problems.append(f"closure {closure}: neither a hinge nor a weld")
        hinges += closure_hinges
    if problems:
        raise DescriptionError(str(path), problems)
    independent = list(chain.coordinates)
    dependent = [name for name in list(model.names)[1:] if name not in independent]
    content = {"closures": hinges, "dependent": dependent, "independent": independent}
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
    write_files({as_path(path): text_writer(text)}, force)


def _hinges(chain: ClosedChain, closure: Closure) -> list[dict[str, Any]]:
    """Hinges that leave the same motions as a closure, as entries of the file; empty if none do."""
    model = chain.mechanism.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    frame_a = frame_id(model, closure.frame_a)
    frame_b = frame_id(model, closure.frame_b)
    place = data.oMf[frame_a]
    link_a = model.frames[_link(model, frame_a)].name
    link_b = model.frames[_link(model, frame_b)].name
    hinges = []
    for axis in _hinge_axes(chain, closure):
        hinges.append(
            {
                "link_a": link_a,
                "link_b": link_b,
                "point": place.translation.tolist(),
                "axis": (place.rotation @ axis).tolist(),
            }
        )
    return hinges


def _hinge_axes(chain: ClosedChain, closure: Closure) -> list[Array]:
    """Axes of the hinges that replace a closure, in its frame A."""
    x, _, z = np.eye(3)
    if closure.held == Closure.KINDS["6d"]:
        return [x, z]  # two hinges with different axes hold all rotations
    if closure.held == Closure.KINDS["hinge"]:
        return [z]
    if closure.held == Closure.KINDS["3d"]:
        return _only_axis(chain, closure)
    return []


def _link(model: pin.Model, frame: int) -> int:
    """Index of the link that has a frame; 0 for the base."""
    while frame and model.frames[frame].type != pin.FrameType.BODY:
        frame = model.frames[frame].parentFrame
    return frame


def _only_axis(chain: ClosedChain, closure: Closure) -> list[Array]:
    """An axis in A, if the frames of a closure can rotate about no other one; empty if they can.

    It must be the same axis at two configurations. If the frames do not rotate relative to each
    other at all, every hinge leaves the same motions, and the axis is z.
    """
    model = chain.mechanism.model
    data = model.createData()
    q = chain.generic_configuration()
    near = chain.assemble(pin.integrate(model, q, np.full(model.nv, _STEP)), fixed=[])
    rotations = []
    size = 0.0  # of the angular velocities of both frames
    for configuration in (q, near):
        pin.framesForwardKinematics(model, data, configuration)
        R = data.oMf[frame_id(model, closure.frame_a)].rotation
        angular_a = chain.frame_jacobian(configuration, closure.frame_a)[3:]
        angular_b = chain.frame_jacobian(configuration, closure.frame_b)[3:]
        rotations.append(R.T @ (angular_b - angular_a))
        size += float(np.linalg.norm(angular_a) + np.linalg.norm(angular_b))
    relative = np.hstack(rotations)
    if np.linalg.norm(relative) <= RANK_TOLERANCE * size:  # also without degrees of freedom
        return [np.array([0.0, 0.0, 1.0])]
    # The columns are relative angular velocities in A. All are along one axis if the matrix has
    # rank 1.
    U, singular_values, _ = np.linalg.svd(relative)
    if singular_values[1] < RANK_TOLERANCE * singular_values[0]:
        return [U[:, 0]]
    return []

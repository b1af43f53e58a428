# SPDX-License-Identifier: BSD-2-Clause
"""The file `loop_closures.yaml` of sw2robot and scikit-robot, from any chain."""

from collections.abc import Iterator
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
from ..reading.cuts import OF_HINGE


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
        >>> from pathlib import Path
        >>> print(Path("loop_closures.yaml").read_text().splitlines()[-1].strip())
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
        more = list(_hinges(chain, closure)) if isinstance(closure, Closure) else []
        if not more:
            problems.append(f"closure {closure}: neither a hinge nor a weld")
        hinges += more
    if problems:
        raise DescriptionError(str(path), problems)
    independent = list(chain.coordinates)
    dependent = [name for name in list(model.names)[1:] if name not in independent]
    content = {"closures": hinges, "dependent": dependent, "independent": independent}
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
    write_files({as_path(path): text_writer(text)}, force)


def _hinges(chain: ClosedChain, closure: Closure) -> Iterator[dict[str, Any]]:
    """Hinges that constrain the same freedoms as a closure; none if no hinges do."""
    model = chain.mechanism.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    ids = [frame_id(model, name) for name in (closure.frame_a, closure.frame_b)]
    (x, _, z), kinds, place = np.eye(3), Closure.KINDS, data.oMf[ids[0]]
    axes = {kinds["6d"]: [x, z], kinds["hinge"]: [z]}.get(closure.held, [])
    for axis in _only_axis(chain, closure) if closure.held == kinds["3d"] else axes:
        links = (model.frames[_link(model, number)].name for number in ids)
        hinge = (*links, place.translation.tolist(), (place.rotation @ axis).tolist())
        yield dict(zip(OF_HINGE, hinge, strict=True))


def _link(model: pin.Model, frame: int) -> int:
    while frame and model.frames[frame].type != pin.FrameType.BODY:
        frame = model.frames[frame].parentFrame
    return frame


def _only_axis(chain: ClosedChain, closure: Closure) -> list[Array]:
    """The axis in A about which the frames of a closure turn; none if there are several."""
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

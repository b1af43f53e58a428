# SPDX-License-Identifier: BSD-2-Clause
"""Shows a robot in a browser (Meshcat), as a page in one file, in a notebook, in pictures."""

import sys
from importlib.util import find_spec

from numpy.typing import ArrayLike

from ..arrays import require_flags
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import InputError, MissingExtraError
from ..loops.start import start_of
from ..simulation.nonsmooth_rollout import NonsmoothRollout
from ..simulation.trajectories import Trajectory

#: Packages of the extra `viz` that pages need, and their modules.
_NEEDED = {
    "meshcat": "meshcat",
    "pillow": "PIL",
    "tornado": "tornado",
    "trimesh": "trimesh",
    "u-msgpack-python": "umsgpack",
}
if missing := [package for package, module in _NEEDED.items() if find_spec(module) is None]:
    raise MissingExtraError(", ".join(missing), "viz")

from .viewer import Viewer  # noqa: E402

__all__ = ["Viewer"]


def show(
    viewer: Viewer,
    robot: ClosedChain,
    what: Trajectory | NonsmoothRollout | ArrayLike | None,
    speed: float,
    open_browser: bool,
    ghost: Trajectory | None,
) -> None:
    """Show a motion or a configuration; see `ClosedChain.show`, which has the same arguments."""
    require_robot("robot", robot)
    require_flags(open_browser=open_browser)
    if isinstance(what, (Trajectory, NonsmoothRollout)):
        viewer.play(what, speed=speed, ghost=ghost)
    elif ghost is not None:
        raise InputError("ghost", "only beside a motion")
    else:
        viewer.show(start_of(robot.engine) if what is None else what)
    viewer._require_functions()  # raises the errors of a live page before a browser opens
    if open_browser and "ipykernel" not in sys.modules:
        viewer.open()

# SPDX-License-Identifier: BSD-2-Clause
"""The robot in a browser (Meshcat): live, as a page in one file, as pictures, in a notebook."""

from __future__ import annotations

import sys

from numpy.typing import ArrayLike

from ..chain.closed_chain import ClosedChain
from ..errors import MissingExtraError
from ..motion.trajectories import Trajectory

try:
    import meshcat  # noqa: F401
except ImportError:
    raise MissingExtraError("meshcat", "viz") from None

from .viewer import Viewer

__all__ = ["Viewer", "show"]


def show(
    robot: ClosedChain, what: Trajectory | ArrayLike | None, speed: float, open_browser: bool
) -> Viewer:
    """See `SST.show`."""
    viewer = Viewer(robot)
    if isinstance(what, Trajectory):
        viewer.play(what, speed=speed)
    elif what is not None:
        viewer.show(what)
    if open_browser and "ipykernel" not in sys.modules:
        viewer.open()
    return viewer

# SPDX-License-Identifier: BSD-2-Clause
"""Paths of frames of any closed chain, in the axes of the base."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..chain.appearance import PLATFORM
from ..chain.closed_chain import ClosedChain
from ..chain.tree import frame_id
from ..errors import InputError
from ..motion.moving_robot import require_motion
from ..motion.trajectories import Trajectory
from .curves import legend_above
from .style import COLOURS, Axes

#: A path counts as planar if its distance from a plane is less than this share of its length.
_FLAT = 1e-6


def frame_path(ax: Axes, robot: ClosedChain, motion: Trajectory, frame: str = PLATFORM) -> Axes:
    """Path of a frame's origin, in the axes of the base; a dot where it starts.

    Args:
        ax: Axes with projection "3d", or plane axes for a path parallel to a plane of the base.
        robot: Any closed chain.
        motion: A motion of this robot.
        frame: Name of a frame of `robot.model`, such as a link or an end of a loop.

    Raises:
        UnknownNameError: For a frame that the model does not have.
        InputError: For another robot's motion, or a path in space in plane axes.

    Example:
        >>> ax = plots.frame_path(ax, chain, motion, "platform")
        >>> ax.get_xlabel(), ax.get_ylabel()
        ('$x_0$ (m)', '$z_0$ (m)')
    """
    points = points_of(robot, motion, frame)
    shown = [0, 1, 2] if ax.name == "3d" else plane_of(points)
    if shown is None:
        raise InputError("ax", f"the path of {frame} lies in no plane: give axes with 3d")
    ax.plot(*points[:, shown].T, color=COLOURS[0], label=frame)
    ax.plot(*points[:1, shown].T, "o", color="black", markersize=3)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    half = 0.55 * float(np.ptp(points, axis=0).max()) or 0.5
    names = [f"${letter}_0$ (m)" for letter in "xyz"]
    if ax.name != "3d":
        ax.set_aspect("equal", adjustable="datalim")
        ax.set(xlabel=names[shown[0]], ylabel=names[shown[1]])
        legend_above(ax)
        return ax
    ax.set_box_aspect((1, 1, 1), zoom=0.9)
    ax.view_init(elev=28, azim=-52)
    for i, axis in enumerate((ax.xaxis, ax.yaxis, ax.zaxis)):
        getattr(ax, f"set_{'xyz'[i]}lim")(middle[i] - half, middle[i] + half)
        axis.set_major_locator(mpl.ticker.MaxNLocator(3, prune="both"))
        axis.set_pane_color((1, 1, 1, 0))
        axis.set_rotate_label(False)  # along its axis it may run into the numbers
        axis.set_label_text(names[i], rotation=90 if i == 2 else 0)
        axis.set_tick_params(pad=3 if i == 2 else 0)
        axis.labelpad = 8 if i == 2 else 4
    ax.legend(loc="lower left", bbox_to_anchor=(0.1, 0.97))
    return ax


def points_of(robot: ClosedChain, motion: Trajectory, frame: str) -> Array:
    """Positions of the origin of a frame in the axes of the base, shape (N, 3), [m].

    Raises:
        UnknownNameError: For a frame that the model does not have.
        InputError: For another robot's motion.
    """
    require_motion(motion, robot)
    model = robot.mechanism.model
    number, data = frame_id(model, frame), model.createData()
    points = np.empty((len(motion), 3))
    for point, q in zip(points, motion.q, strict=True):
        pin.forwardKinematics(model, data, q)
        point[:] = pin.updateFramePlacement(model, data, number).translation
    return points


def plane_of(points: Array) -> list[int] | None:
    """The two axes of the base that points are drawn in; None where they need all three."""
    ranges = np.ptp(points, axis=0)
    flattest = int(ranges.argmin())
    if ranges[flattest] > _FLAT * ranges.max():
        return None
    return [i for i in range(3) if i != flattest]

# SPDX-License-Identifier: BSD-2-Clause
"""Whole pages: several axes with what one wants to see of a motion or of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..errors import InputError
from ..motion.trajectories import Trajectory, require_motion
from ..sst.robot import SST
from ..sst.workspace import Workspace
from .motions import CURVES
from .sphere import paths_on_sphere
from .style import style
from .workspace import condition_colourbar, workspace_legend, workspace_map, workspace_on_sphere

Array = NDArray[np.float64]

#: What a page can show of a motion.
SUBJECTS = ("path", *CURVES)
#: What it shows when nothing is asked for.
SUMMARY = ("path", "torques", "joints", "rates", "energy", "condition")


def motion_page(robot: SST, motion: Trajectory, subjects: Sequence[str] = SUMMARY) -> Figure:
    """A page about a motion, two axes in a row, and below them what `robot.check` finds.

    Args:
        robot: The SST.
        motion: Of that robot, with more than one sample.
        subjects: Of `SUBJECTS`, in the order of the page.

    Raises:
        InputError: For a subject that is none, or a motion of another robot.
    """
    require_motion(motion, robot.position_names)
    names = [] if isinstance(subjects, str) or not isinstance(subjects, Sequence) else subjects
    if not names or not all(name in list(SUBJECTS) for name in names):
        raise InputError("subjects", f"{subjects!r}, expected some of {', '.join(SUBJECTS)}")
    columns = min(len(subjects), 2)
    rows = -(-len(subjects) // columns)
    with style():
        figure = Figure(figsize=(3.6 * columns, 2.9 * rows), layout="constrained")
        for place, subject in enumerate(subjects, 1):
            if subject == "path":
                ax = figure.add_subplot(rows, columns, place, projection="3d")
                paths_on_sphere(ax, robot, [("path", motion)])
                ax.set_box_aspect((1, 1, 1), zoom=1.0)
            else:
                CURVES[subject](figure.add_subplot(rows, columns, place), robot, motion)
        if found := robot.check(motion):
            width = 65 * columns  # characters
            lines = [line for f in found for line in wrap(f"Warning: {f}", width)]
            figure.supxlabel("\n".join(lines), x=0.02, ha="left", size=7, color="#B00020")
    return figure


def workspace_page(
    robot: SST,
    at_psi: Workspace,
    over_rolls: Workspace,
    path: tuple[str, Array] | None = None,
) -> Figure:
    """Both maps of a robot, the first as a sphere too, and what their signs mean.

    Args:
        robot: The SST.
        at_psi: Its workspace at one roll of the star.
        over_rolls: Its workspace over the whole turn.
        path: Label and directions of s along a motion, shape (N, 3).
    """
    label, s = path or (None, None)
    psi = f"{np.degrees(at_psi.psi.flat[0]):g}°".replace("-", "\N{MINUS SIGN}")
    with style():
        figure = Figure(figsize=(7.2, 7.0), layout="constrained")
        axes = figure.subplots(2, 2)
        for ax, draw, workspace, title in (
            (axes[0, 0], workspace_map, at_psi, rf"(a) at $\psi$ = {psi}"),
            (axes[0, 1], workspace_map, over_rolls, r"(b) at the best $\psi$"),
            (axes[1, 0], workspace_on_sphere, at_psi, "(c) as (a), on the sphere"),
        ):
            draw(ax, robot, workspace, s).set_title(title)
        axes[1, 1].set_axis_off()
        condition_colourbar(axes[1, 1].inset_axes((0.0, 0.82, 1.0, 0.06)))
        handles = [*workspace_legend(at_psi, label), *workspace_legend(over_rolls, label)]
        once = {handle.get_label(): handle for handle in handles}
        axes[1, 1].legend(
            handles=list(once.values()), loc="upper center", bbox_to_anchor=(0.5, 0.6)
        )
    return figure

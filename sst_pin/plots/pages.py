# SPDX-License-Identifier: BSD-2-Clause
"""Pages with several axes about a motion or a workspace."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from textwrap import wrap
from typing import cast

import numpy as np
from matplotlib.figure import Figure

from ..arrays import Array
from ..chain.appearance import PLATFORM
from ..chain.closed_chain import ClosedChain
from ..errors import InputError
from ..motion.moving_robot import require_motion
from ..motion.trajectories import Trajectory
from ..sst.robot import SST
from ..sst.workspace import WorkspaceMap
from .frame_paths import frame_path, plane_of, points_of
from .motions import CURVES, Panel, panels
from .sphere import paths_on_sphere
from .style import Axes, StyledFigure, style
from .workspace_maps import (
    condition_colourbar,
    workspace_legend,
    workspace_map,
    workspace_on_sphere,
)

#: What a page can show of a motion.
SUBJECTS = ("path", *CURVES)
#: What it shows by default.
SUMMARY = ("path", "torques", "joints", "rates", "energy", "condition")


def motion_page(
    robot: ClosedChain,
    motion: Trajectory,
    subjects: Sequence[str] | None = None,
    frame: str | None = None,
) -> Figure:
    """A page about a motion, two axes in a row, lettered; below them what `check` finds.

    A subject takes several axes where units differ
    or more than nine curves are to be told apart.

    Args:
        robot: Any closed chain.
        motion: A motion of this robot, with more than one sample.
        subjects: Some of `SUBJECTS`, in the order of the page; all but power by default, the path
            only for an SST or a given frame.
        frame: Frame whose path is drawn, in the axes of the base. By default `platform`; for an
            SST the path of E on its sphere.

    Raises:
        InputError: For an unknown subject, or a motion of another robot.
        UnknownNameError: For a frame that the model does not have.

    Example:
        >>> page = plots.motion_page(chain, motion, ["torques", "path"], frame="platform")
        >>> page.savefig("page.pdf")
    """
    require_motion(motion, robot)
    if len(motion) < 2:
        raise InputError("motion", "has one sample; a curve needs at least two")
    if subjects is None:
        subjects = summary_of(robot, frame)
    names = [] if isinstance(subjects, str) or not isinstance(subjects, Sequence) else subjects
    if not names or not all(name in SUBJECTS for name in names):
        raise InputError("subjects", f"{subjects!r}, expected some of {', '.join(SUBJECTS)}")
    with style():
        parts = [part for name in names for part in _parts(name, robot, motion, frame)]
        columns = min(len(parts), 2)
        rows = -(-len(parts) // columns)
        longest = max(map(len, (*motion.joint_names, *motion.actuated)))
        width = 3.6 if longest < 16 else 4.8  # so that legends of long names have two columns
        figure = StyledFigure(figsize=(width * columns, 2.9 * rows), layout="constrained")
        for place, (projection, draw) in enumerate(parts, 1):
            ax = draw(figure.add_subplot(rows, columns, place, projection=projection))
            if len(parts) > 1:
                _letter(ax, place)
        if found := robot.check(motion):
            lines = [line for f in found for line in wrap(f"Warning: {f}", 65 * columns)]
            figure.supxlabel("\n".join(lines), x=0.02, ha="left", size=7, color="#B00020")
    return figure


def summary_of(robot: ClosedChain, frame: str | None = None) -> tuple[str, ...]:
    """Subjects of a `motion_page` by default.

    Args:
        robot: Any closed chain.
        frame: Name of the frame whose path is drawn; None for no path.

    Example:
        >>> plots.summary_of(chain)
        ('torques', 'joints', 'rates', 'energy', 'condition')
    """
    known = frame is not None or robot.appearance.spherical
    return SUMMARY if known else SUMMARY[1:]


def _parts(
    subject: str, robot: ClosedChain, motion: Trajectory, frame: str | None
) -> Iterator[tuple[str | None, Panel]]:
    """Projection and content of each pair of axes that a subject takes."""
    if subject != "path":
        yield from ((None, panel) for panel in panels(subject, robot, motion))
        return
    shown = robot.appearance
    if frame is None and shown.spherical:
        star = cast(SST, robot)  # only an SST is drawn on a sphere
        yield "3d", lambda ax: paths_on_sphere(ax, star, [("path", motion)])
        return
    if frame is None and shown.point is None:
        known = ", ".join(dict.fromkeys(f.name for f in robot.mechanism.model.frames))
        problem = f"name the frame whose path is drawn: frame= (--frame) one of {known}"
        raise InputError("frame", problem)
    name = frame or PLATFORM
    flat = plane_of(points_of(robot, motion, name)) is not None
    yield None if flat else "3d", lambda ax: frame_path(ax, robot, motion, name)


def _letter(ax: Axes, place: int) -> None:
    """(a), (b), ... at the upper left, (aa) after (z)."""
    letter = "abcdefghijklmnopqrstuvwxyz"[(place - 1) % 26] * (1 + (place - 1) // 26)
    if ax.name == "3d":
        ax.set_title(f"({letter})", loc="left", size="medium")
    else:
        at = {"xytext": (-10, 7), "textcoords": "offset points"}
        ax.annotate(f"({letter})", (0, 1), xycoords="axes fraction", ha="right", **at)


def workspace_page(
    robot: SST,
    at_psi: WorkspaceMap,
    over_rolls: WorkspaceMap,
    path: tuple[str, Array] | None = None,
) -> Figure:
    """Both maps of a robot, a sphere with the first map, and a legend.

    Args:
        robot: The SST.
        at_psi: Its workspace at one roll angle psi.
        over_rolls: Its workspace over all psi.
        path: Label and directions of s along a motion, shape (N, 3).

    Example:
        >>> at_psi = sst_pin.sst.workspace.workspace_at(robot, rings=9, spokes=24)
        >>> over_rolls = sst_pin.sst.workspace.workspace_over_rolls(robot, 6, rings=9, spokes=24)
        >>> plots.workspace_page(robot, at_psi, over_rolls).savefig("workspace.png")
    """
    label, s = path or (None, None)
    psi = f"{np.degrees(at_psi.psi.flat[0]):g}°".replace("-", "\N{MINUS SIGN}")
    with style():
        figure = StyledFigure(figsize=(7.2, 7.0), layout="constrained")
        axes = figure.subplots(2, 2)
        for ax, draw, workspace, title in (
            (axes[0, 0], workspace_map, at_psi, rf"(a) at $\psi$ = {psi}"),
            (axes[0, 1], workspace_map, over_rolls, r"(b) at the best $\psi$"),
            (axes[1, 0], workspace_on_sphere, at_psi, "(c) as (a), on the sphere"),
        ):
            draw(ax, robot, workspace, s, colourbar=False).set_title(title)
        axes[1, 1].set_axis_off()
        condition_colourbar(axes[1, 1].inset_axes((0.0, 0.82, 1.0, 0.06)))
        handles = [*workspace_legend(at_psi, label), *workspace_legend(over_rolls, label)]
        once = {handle.get_label(): handle for handle in handles}
        axes[1, 1].legend(
            handles=list(once.values()), loc="upper center", bbox_to_anchor=(0.5, 0.6)
        )
    return figure

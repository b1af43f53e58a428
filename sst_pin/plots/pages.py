# SPDX-License-Identifier: BSD-2-Clause
"""A page with several plots of a motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from string import ascii_lowercase
from textwrap import wrap
from typing import NamedTuple, cast

from matplotlib.figure import Figure

from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import InputError
from ..model.appearance import PLATFORM
from ..simulation.trajectories import Trajectory, require_motion
from ..sst.robot import SST
from .motions import SUBJECTS_OVER_TIME, panels
from .space import frame_path, origins_of, paths_on_sphere, plane_of
from .style import Axes, StyledFigure, style

#: Subjects of a page about a motion.
SUBJECTS = ("path", *SUBJECTS_OVER_TIME)


def motion_page(
    robot: ClosedChain,
    motion: Trajectory,
    subjects: Sequence[str] | None = None,
    frame: str | None = None,
) -> Figure:
    """A page of plots of a motion, two in each row, marked (a), (b), ...

    A subject has several plots if its curves differ in units, or if there are more than six. Below
    the plots are the findings of `ClosedChain.check_limits`.

    Args:
        robot: Any closed chain.
        motion: A motion of this robot, with more than one sample.
        subjects: Some of `SUBJECTS`, in the order of the page. By default all but power; the path
            only for an SST or a given frame, torques only for a robot with motors.
        frame: Frame whose path is drawn, in the axes of the base. By default `platform`; for an
            SST the path of E on its sphere.

    Raises:
        InputError: For an unknown subject, one that has nothing to show, or a motion of another
            robot.
        UnknownNameError: For a frame that the model does not have.

    Example:
        >>> page = plots.motion_page(chain, motion, ["torques", "path"], frame="platform")
        >>> page.savefig("page.pdf")
    """
    require_robot("robot", robot)
    require_motion(motion, robot.mechanism)
    if len(motion) < 2:
        raise InputError("motion", "has one sample; a curve needs at least two")
    names = _checked_subjects(robot, summary_of(robot, frame) if subjects is None else subjects)
    with style():
        panels_of_page = list[_Panel]()
        for name in names:
            panels_of_page += _panels_of(name, robot, motion, frame)
        columns = min(len(panels_of_page), 2)
        rows = math.ceil(len(panels_of_page) / columns)
        longest_name = max(len(name) for name in (*motion.joint_names, *motion.motor_names))
        width = 3.6 if longest_name < 16 else 4.8  # wide enough for a legend of two columns
        figure = StyledFigure(figsize=(width * columns, 2.9 * rows), layout="constrained")
        for number, panel in enumerate(panels_of_page, 1):
            ax = figure.add_subplot(rows, columns, number, projection=panel.projection)
            panel.draw(ax)
            if len(panels_of_page) > 1:
                _add_letter(ax, number)
        lines = []
        for finding in robot.check_limits(motion):
            lines += wrap(f"Warning: {finding}", 65 * columns)
        if lines:
            figure.supxlabel("\n".join(lines), x=0.02, ha="left", size=7, color="#B00020")
    return figure


def _checked_subjects(robot: ClosedChain, subjects: Sequence[str]) -> Sequence[str]:
    """The subjects, if they are some of `SUBJECTS` that this robot has."""
    is_list = isinstance(subjects, Sequence) and not isinstance(subjects, str)
    if not is_list or not subjects or not all(name in SUBJECTS for name in subjects):
        raise InputError("subjects", f"{subjects!r}, expected some of {', '.join(SUBJECTS)}")
    if not robot.motor_names:
        need_motors = sorted({"torques", "power"}.intersection(subjects))
        if need_motors:
            raise InputError("subjects", f"{' and '.join(need_motors)} of a robot without motors")
    return subjects


def summary_of(robot: ClosedChain, frame: str | None = None) -> tuple[str, ...]:
    """Default subjects of a `motion_page`; `frame` is the frame of its path, or None."""
    is_default = {
        "path": frame is not None or robot.appearance.spherical,
        "torques": bool(robot.motor_names),
        "power": False,
    }
    return tuple(subject for subject in SUBJECTS if is_default.get(subject, True))


class _Panel(NamedTuple):
    """The content of one plot."""

    draw: Callable[[Axes], Axes]
    projection: str | None = None  #: "3d", or None for 2-D axes.


def _panels_of(
    subject: str, robot: ClosedChain, motion: Trajectory, frame: str | None
) -> list[_Panel]:
    """The panels of a subject."""
    if subject != "path":
        return [_Panel(draw) for draw in panels(subject, robot, motion)]
    appearance = robot.appearance
    if frame is None and appearance.spherical:
        star = cast(SST, robot)  # only an SST is drawn on a sphere
        return [_Panel(lambda ax: paths_on_sphere(ax, star, [("path", motion)]), "3d")]
    if frame is None and appearance.point is None:
        names = ", ".join(dict.fromkeys(f.name for f in robot.mechanism.model.frames))
        raise InputError("frame", f"name the frame of the path: frame= (--frame) one of {names}")
    name = frame or PLATFORM
    is_planar = plane_of(origins_of(robot, motion, name)) is not None
    return [_Panel(lambda ax: frame_path(ax, robot, motion, name), None if is_planar else "3d")]


def _add_letter(ax: Axes, number: int) -> None:
    """Write (a), (b), ... at the upper left, (aa) after (z); `number` begins at 1."""
    repeats, k = divmod(number - 1, 26)
    letter = ascii_lowercase[k]
    for _ in range(repeats):
        letter += ascii_lowercase[k]
    if ax.name == "3d":
        ax.set_title(f"({letter})", loc="left", size="medium")
    else:
        at = {"xytext": (-10, 7), "textcoords": "offset points"}
        ax.annotate(f"({letter})", (0, 1), xycoords="axes fraction", ha="right", **at)

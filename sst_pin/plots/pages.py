# SPDX-License-Identifier: BSD-2-Clause
"""Pages with several axes: a motion, loads, measured torques."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from textwrap import wrap
from typing import cast

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from ..arrays import finite_array
from ..closed_chain import ClosedChain
from ..description.colours import HUES
from ..engine import require_robot
from ..errors import InputError
from ..model.appearance import PLATFORM
from ..simulation.bearing_loads import Load, Loads
from ..simulation.trajectories import Trajectory, require_motion
from ..sst.robot import SST
from .curves import label, legend_above, zero_line
from .motions import CURVES, panels
from .space import frame_path, origins_of, paths_on_sphere, plane_of
from .style import Axes, StyledFigure, style

#: Subjects of a page about a motion.
SUBJECTS = ("path", *CURVES)


def motion_page(
    robot: ClosedChain,
    motion: Trajectory,
    subjects: Sequence[str] | None = None,
    frame: str | None = None,
) -> Figure:
    """A page of plots of a motion, two in each row, with letters; below them the check's findings.

    A subject has several plots if units differ or more than six curves would share one.

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
    if subjects is None:
        subjects = summary_of(robot, frame)
    names = [] if isinstance(subjects, str) or not isinstance(subjects, Sequence) else subjects
    if not names or not all(name in SUBJECTS for name in names):
        raise InputError("subjects", f"{subjects!r}, expected some of {', '.join(SUBJECTS)}")
    if not robot.motor_names:
        of_motors = sorted({"torques", "power"}.intersection(names))
        if of_motors:
            raise InputError("subjects", f"{' and '.join(of_motors)} of a robot without motors")
    with style():
        parts: list[tuple[str | None, Callable[[Axes], Axes]]] = []
        for name in names:
            parts += _parts(name, robot, motion, frame)
        columns = min(len(parts), 2)
        rows = -(-len(parts) // columns)  # rounded up
        longest = max(map(len, (*motion.joint_names, *motion.motor_names)))
        width = 3.6 if longest < 16 else 4.8  # so that legends of long names have two columns
        figure = StyledFigure(figsize=(width * columns, 2.9 * rows), layout="constrained")
        for place, (projection, draw) in enumerate(parts, 1):
            ax = draw(figure.add_subplot(rows, columns, place, projection=projection))
            if len(parts) > 1:
                _letter(ax, place)
        lines = []
        for finding in robot.check_limits(motion):
            lines += wrap(f"Warning: {finding}", 65 * columns)
        if lines:
            figure.supxlabel("\n".join(lines), x=0.02, ha="left", size=7, color="#B00020")
    return figure


def summary_of(robot: ClosedChain, frame: str | None = None) -> tuple[str, ...]:
    """Default subjects of a `motion_page`; `frame` is the frame of its path, or None."""
    known = {
        "path": frame is not None or robot.appearance.spherical,
        "torques": bool(robot.motor_names),
        "power": False,
    }
    return tuple(subject for subject in SUBJECTS if known.get(subject, True))


def _parts(
    subject: str, robot: ClosedChain, motion: Trajectory, frame: str | None
) -> Iterator[tuple[str | None, Callable[[Axes], Axes]]]:
    """Projection and content of each pair of axes that a subject takes."""
    if subject != "path":
        yield from ((None, panel) for panel in panels(subject, robot, motion))
        return
    appearance = robot.appearance
    if frame is None and appearance.spherical:
        star = cast(SST, robot)  # only an SST is drawn on a sphere
        yield "3d", lambda ax: paths_on_sphere(ax, star, [("path", motion)])
        return
    if frame is None and appearance.point is None:
        known = ", ".join(dict.fromkeys(f.name for f in robot.mechanism.model.frames))
        raise InputError("frame", f"name the frame of the path: frame= (--frame) one of {known}")
    name = frame or PLATFORM
    flat = plane_of(origins_of(robot, motion, name)) is not None
    yield None if flat else "3d", lambda ax: frame_path(ax, robot, motion, name)


def _letter(ax: Axes, place: int) -> None:
    """(a), (b), ... at the upper left, (aa) after (z)."""
    letter = "abcdefghijklmnopqrstuvwxyz"[(place - 1) % 26] * (1 + (place - 1) // 26)
    if ax.name == "3d":
        ax.set_title(f"({letter})", loc="left", size="medium")
    else:
        at = {"xytext": (-10, 7), "textcoords": "offset points"}
        ax.annotate(f"({letter})", (0, 1), xycoords="axes fraction", ha="right", **at)


#: Units of loads.
_LOADS = {"force": "N", "moment": "N m"}
#: Loads that are smaller than this part of the largest are rounding.
_NO_LOAD = 1e-9


def loads_page(loads: Loads) -> Figure:
    """Bars of the peak forces and moments of joints and closures along a motion.

    The inner bar is the root mean square. The numbers are the direction at the peak, x, y, z in the
    axes of the wrench; letters in front say which components are unique, if not all are. Hatched
    bars come from stiffnesses.

    Args:
        loads: Table of `ClosedChain.loads`.

    Raises:
        InputError: For anything else.
    """
    if not isinstance(loads, Loads):
        raise InputError("loads", f"a table of loads is needed, not {type(loads).__name__}")
    largest = np.nanmax([row.peak for row in loads.rows] + [0.0])
    figure = StyledFigure(figsize=(7, 1 + 0.12 * len(loads.rows)), layout="constrained")
    with style():
        for kind, ax in zip(_LOADS, figure.subplots(1, 2, sharey=True), strict=True):
            rows = [row for row in loads.rows if row.kind == kind]
            unit, prefix = _unit(rows)
            _bars(ax, rows, _NO_LOAD * largest, unit)
            ax.xaxis.set_major_locator(MaxNLocator(4))
            ax.set_xlabel(f"{kind} ({prefix}{_LOADS[kind]})")
    return figure


def _unit(rows: list[Load]) -> tuple[float, str]:
    """The unit of a kind of loads, in N or N m, and its prefix: large loads in kN or MN."""
    largest = np.nanmax([row.peak for row in rows] + [0.0])
    if largest >= 1e7:
        return 1e6, "M"
    if largest >= 1e4:
        return 1e3, "k"
    return 1.0, ""


def _direction(row: Load) -> str:
    """The direction of the peak, with the letters of its components if not all are unique."""
    numbers = [f"{round(x, 2) + 0.0:.2f}" for x in (row.x, row.y, row.z) if np.isfinite(x)]
    letters = "" if len(row.components) == 3 else f"{row.components}: "
    return letters + ", ".join(numbers)


def _bars(ax: Axes, rows: list[Load], zero: float, unit: float) -> None:
    """Bars for one kind of loads, in units of `unit`; those up to `zero` count as zero."""
    labelled = set()
    for y, row in enumerate(rows):
        if np.isnan(row.peak):
            text = "not unique"
        elif row.peak <= zero:
            text = "0"
        else:
            # A load that is not determined, but of which all components are known, got them from
            # stiffnesses.
            soft = not row.determined and len(row.components) == 3
            what = "peak, from stiffnesses" if soft else "peak"
            hatch = "/////" if soft else ""
            outline = {"facecolor": "white", "edgecolor": HUES[0], "linewidth": 0.8}
            for size, name, width, look in (
                (row.peak, what, 0.7, outline | {"hatch": hatch}),
                (row.rms, "root mean square", 0.35, {"color": HUES[1]}),
            ):
                ax.barh(y, size / unit, width, label=None if name in labelled else name, **look)
                labelled.add(name)
            text = _direction(row)
        at = (row.peak / unit if row.peak > zero else 0.0, y)
        ax.annotate(text, at, (3, 0), textcoords="offset points", va="center", fontsize=6)
    ax.set_yticks(range(len(rows)), [label(row.name) for row in rows])
    ax.set(xlim=(0, 1.5 * ax.dataLim.x1 if labelled else 1), ylim=(len(rows) - 0.5, -0.5))
    if labelled:
        legend_above(ax)


def torques_page(motion: Trajectory, predicted: ArrayLike) -> Figure:
    """Measured torques of the motors, predicted ones, and the difference, a row for each motor.

    Args:
        motion: A motion with measured torques.
        predicted: Torques for it, as of `identification.predicted_torques`, shape (N, motors).

    Raises:
        InputError: If the shapes differ, or for a motion without motors.
    """
    tau = finite_array("predicted", predicted, (motion.tau.shape[1],))
    if tau.shape != motion.tau.shape:
        raise InputError("predicted", f"shape {tau.shape}, expected {motion.tau.shape}")
    if not motion.motor_names:
        raise InputError("motion", "has no motors")
    count = len(motion.motor_names)
    figure = StyledFigure(figsize=(7, 0.6 + 1.2 * count), layout="constrained")
    with style():
        rows = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        for k, ax in enumerate(rows):
            measured = motion.tau[:, k]
            computed = tau[:, k]
            unit = motion.torque_units[k].replace("Nm", "N m")
            zero_line(ax)
            ax.plot(motion.t, measured, color=HUES[0], label="measured")
            ax.plot(motion.t, computed, color=HUES[1], linestyle="--", label="predicted")
            ax.plot(motion.t, measured - computed, color="black", linewidth=0.6, label="difference")
            ax.set_ylabel(f"{label(motion.motor_names[k])} ({unit})")
        rows[-1].set_xlabel("time (s)")
        legend_above(rows[0], columns=3)
    return figure

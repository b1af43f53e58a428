# SPDX-License-Identifier: BSD-2-Clause
"""Drawings in space: paths of frames, paths on the sphere of an SST, an SST in a pose."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pinocchio as pin
from scipy.spatial import geometric_slerp

from ..arrays import Array, single_array
from ..closed_chain import ClosedChain
from ..description.colours import LEG_COLOURS
from ..engine import require_robot
from ..errors import InputError
from ..model.appearance import PLATFORM
from ..model.tree import frame_id
from ..simulation.trajectories import Trajectory, require_motion
from ..sst.kinematics import legs_of_joints
from ..sst.robot import SST
from .curves import legend_above
from .style import Axes

#: A path is planar if its extent along one axis of the base is at most this part of its largest.
_PLANAR = 1e-6
#: Margin around the sphere, as a share of its radius.
_MARGIN = 0.15
#: Line styles of the paths; the wanted path is drawn first, below the others.
PATHS: tuple[dict[str, Any], ...] = (
    {"color": "0.8", "linewidth": 4},
    {"color": LEG_COLOURS[0], "linewidth": 1.2},
    {"color": LEG_COLOURS[1], "linewidth": 1.2, "linestyle": (0, (4, 4))},
)


def frame_path(ax: Axes, robot: ClosedChain, motion: Trajectory, frame: str = PLATFORM) -> Axes:
    """Path of a frame's origin, in the axes of the base; a dot where it starts.

    Args:
        ax: Axes with projection "3d", or 2-D axes for a path parallel to a plane of the base.
        robot: Any closed chain.
        motion: A motion of this robot.
        frame: Name of a frame of `robot.model`, such as a link or an end of a loop.

    Raises:
        UnknownNameError: For a frame that the model does not have.
        InputError: For another robot's motion, or a spatial path in 2-D axes.

    Example:
        >>> ax = plots.frame_path(ax, chain, motion, "platform")
        >>> ax.get_xlabel(), ax.get_ylabel()
        ('$x_0$ (m)', '$z_0$ (m)')
    """
    require_robot("robot", robot)
    points = origins_of(robot, motion, frame)
    axes_of_base = [0, 1, 2] if ax.name == "3d" else plane_of(points)
    if axes_of_base is None:
        raise InputError("ax", f"the path of {frame} lies in no plane: give axes with 3d")
    ax.plot(*points[:, axes_of_base].T, color=LEG_COLOURS[0], label=frame)
    ax.plot(*points[:1, axes_of_base].T, "o", color="black", markersize=3)
    if ax.name == "3d":
        _set_space_around(ax, points)
        ax.legend(loc="lower left", bbox_to_anchor=(0.1, 0.97))
    else:
        names = [f"${'xyz'[i]}_0$ (m)" for i in axes_of_base]
        ax.set_aspect("equal", adjustable="datalim")
        ax.set(xlabel=names[0], ylabel=names[1])
        legend_above(ax)
    return ax


def _set_space_around(ax: Axes, points: Array) -> None:
    """Set view, limits and labels of 3-D axes: a cube around points, shape (N, 3)."""
    ax.set_box_aspect((1, 1, 1), zoom=0.9)
    ax.view_init(elev=28, azim=-52)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    half_edge = 0.55 * float(np.ptp(points, axis=0).max()) or 0.5  # 0.5 m for a point that rests
    ends = np.stack([middle - half_edge, middle + half_edge], axis=1)
    ax.set(xlim=ends[0], ylim=ends[1], zlim=ends[2])
    for axis, letter in _labelled_axes(ax):
        axis.set_major_locator(mpl.ticker.MaxNLocator(3, prune="both"))
        axis.set_tick_params(pad=3 if letter == "z" else 0)
        axis.labelpad = 8 if letter == "z" else 4


def origins_of(robot: ClosedChain, motion: Trajectory, frame: str) -> Array:
    """Positions of the origin of a frame in the axes of the base, shape (N, 3), [m]."""
    require_motion(motion, robot.mechanism)
    model = robot.mechanism.model
    number = frame_id(model, frame)
    data = model.createData()
    points = np.empty((len(motion), 3))
    for point, q in zip(points, motion.q, strict=True):
        pin.forwardKinematics(model, data, q)
        point[:] = pin.updateFramePlacement(model, data, number).translation
    return points


def plane_of(points: Array) -> list[int] | None:
    """The two axes of the base, 0 to 2, whose plane is parallel to the points; None without one."""
    ranges = np.ptp(points, axis=0)
    flattest = int(ranges.argmin())
    if ranges[flattest] > _PLANAR * ranges.max():
        return None
    return [i for i in range(3) if i != flattest]


def paths_on_sphere(
    ax: Axes, robot: SST, motions: Sequence[tuple[str, Trajectory]], radius: float | None = None
) -> Axes:
    """Paths of E on the sphere of the star, with the base triangle on this sphere (Figs. 9, 11).

    Args:
        ax: Axes with projection "3d".
        robot: The SST.
        motions: Label and motion of each path. If there are several, the first one is the wanted
            path.
        radius: Radius of the sphere, [m]; the star's by default.

    Raises:
        InputError: For another robot's motion.

    Example:
        >>> t = np.linspace(0, 0.1, 21)
        >>> motion = robot.trajectory(t, *robot.joint_motion(*sst_pin.paper_circle(t)))
        >>> ax = Figure().add_subplot(projection="3d")
        >>> plots.paths_on_sphere(ax, robot, [("circle", motion)]).get_zlabel()
        '$z_0$ (m)'
    """
    _require_sst(robot)
    motions_with_labels = list[tuple[str, Trajectory]]()
    try:
        for label, motion in motions:
            motions_with_labels.append((label, motion))
    except (TypeError, ValueError):
        raise InputError("motions", "pairs of a label and a motion are needed") from None
    for _, motion in motions_with_labels:
        require_motion(motion, robot.mechanism)
    radius = robot.star_radius if radius is None else radius
    _draw_triangle(ax, robot, radius, "v")
    styles = PATHS if len(motions_with_labels) > 1 else PATHS[1:]
    directions = [robot.geometry.R_0[:, :, 0]]  # v_1, v_2, v_3
    for (label, motion), look in zip(motions_with_labels, styles, strict=False):
        s = robot.platform_orientation(motion.q)[:, :, 0]  # from O to E
        ax.plot(*(radius * s).T, label=label, zorder=10, **look)
        directions.append(s)
    # A dot at the start of the last path.
    ax.plot(*(radius * s[:1]).T, "o", color="black", markersize=3, zorder=11)
    if len(motions_with_labels) > 1:
        ax.legend(loc="upper left", bbox_to_anchor=(-0.05, 1.0), handlelength=2.6)
    _equal_space(ax, robot, radius, np.concatenate(directions))
    return ax


def _require_sst(robot: SST) -> None:
    if not isinstance(robot, SST):
        raise InputError("robot", f"a {type(robot).__name__}; this figure is for an SST")


def robot_pose(ax: Axes, robot: SST, q: Array, radii: tuple[float, float] | None = None) -> Axes:
    """A line drawing of the robot: base triangle, actuator links, the star's arcs.

    Args:
        ax: Axes with projection "3d".
        robot: The SST.
        q: Joint coordinates, shape (9,).
        radii: Radii of the base sphere and of the star's arcs, [m]. By default the star has its
            own, and the base has 7/8 of it, as in the paper.

    Example:
        >>> figure = Figure()
        >>> ax = plots.robot_pose(figure.add_subplot(projection="3d"), robot, robot.home)
        >>> figure.savefig("home.png")
    """
    _require_sst(robot)
    base, star = radii or (7 / 8 * robot.star_radius, robot.star_radius)
    _draw_triangle(ax, robot, base, "P")
    legs = legs_of_joints(robot.geometry, single_array("q", q, (9,)))
    for k, colour in enumerate(LEG_COLOURS):
        # The link from O to the base sphere, and the carriage from there to the star, at R_k.
        carriage = np.outer((base, star), legs.u[k])
        ax.plot(*np.vstack([np.zeros(3), carriage[0]]).T, color=colour, linewidth=2.5)
        ax.plot(*carriage.T, color=colour, linewidth=6, solid_capstyle="butt")
        # The arc from E through R_k: a quarter circle in the plane with the normal n_k, in which
        # -n_k x s is the direction from E towards R_k.
        angles = np.linspace(0, np.pi / 2, 60)
        s = legs.s[k]
        towards_R = -np.cross(legs.n[k], s)
        arc = star * (np.outer(np.cos(angles), s) + np.outer(np.sin(angles), towards_R))
        ax.plot(*arc.T, color=colour, linewidth=1.8)
        # The label is beside the plane of the arc, so that the arc does not cross it.
        beside = 1.12 * carriage[1] + 0.2 * star * legs.n[k]
        ax.text(*beside, f"$R_{k + 1}$", color=colour, ha="center", va="center")
    E = star * legs.s[0]
    ax.plot([E[0]], [E[1]], [E[2]], "o", color="black", markersize=4)
    ax.text(*(E + star / 8 * np.array((1, -1, 0))), "$E$", ha="center", va="center")
    _equal_space(ax, robot, star, robot.geometry.R_0[:, :, 0])
    ax.set_axis_off()
    ax.set_box_aspect((1, 1, 1), zoom=1.05)
    return ax


def _draw_triangle(ax: Axes, robot: SST, radius: float, letter: str) -> None:
    """Draw the base triangle on a sphere about O, with a net of arcs that shows the curvature.

    `letter` names the corners: "v" for the directions v_k, "P" for the points P_k.
    """
    v = robot.geometry.R_0[:, :, 0]
    share = np.linspace(0, 1, 60)
    for k in range(3):
        here = v[k]
        there = v[(k + 1) % 3]
        opposite = v[(k + 2) % 3]
        side = geometric_slerp(here, there, share)
        # Arcs of the net from each tenth point of the side to the opposite corner.
        for point in side[10:-5:10]:
            net_arc = radius * geometric_slerp(point, opposite, share)
            ax.plot(*net_arc.T, color="0.88", linewidth=0.4)
        ax.plot(*(radius * side).T, color="0.35", linewidth=1.0)
        ax.plot(*np.vstack([np.zeros(3), radius * here]).T, color="0.75", linewidth=0.5)
        name = rf"$\mathbf{{v}}_{k + 1}$" if letter == "v" else f"${letter}_{k + 1}$"
        ax.text(*(1.13 * radius * here), name, color="0.25", ha="center", va="center")


def _equal_space(ax: Axes, robot: SST, radius: float, s: Array) -> None:
    """Set view and limits of 3-D axes with equal scales, for a sphere about O.

    The axes show only the octant x, y, z > 0 of the paper if the directions s, shape (N, 3), stay
    within it, up to a margin.
    """
    in_octant = s.min() > -_MARGIN
    lowest = -_MARGIN if in_octant else -1 - _MARGIN
    limits = np.array((lowest, 1 + _MARGIN)) * radius
    # The step between the numbers at an axis: 1, 2 or 5 times a power of ten. With less than 1 /
    # 2.7 of the radius the numbers would overlap.
    least_step = radius / 2.7
    power = 10 ** np.floor(np.log10(least_step))
    step = min(factor * power for factor in (1, 2, 5, 10) if factor * power >= least_step)
    if not in_octant:  # the axes are about twice as long
        step *= 2
    ax.set(xlim=limits, ylim=limits, zlim=limits)
    ax.set_box_aspect((1, 1, 1), zoom=0.84)
    # The camera stands in the quadrant of x and y in which the base triangle's centre is.
    x, y, _ = robot.geometry.R_0[:, :, 0].sum(axis=0)
    quadrant = np.floor(np.degrees(np.arctan2(y, x)) / 90)
    ax.view_init(elev=28, azim=float(90 * quadrant + 38))
    for axis, _ in _labelled_axes(ax):
        axis.labelpad = 5
        axis.set_major_locator(mpl.ticker.MultipleLocator(step))
    ax.grid(False)


def _labelled_axes(ax: Axes) -> Iterator[tuple[Any, str]]:
    """Label the axes of a 3-D drawing x, y, z of the base; yield each axis with its letter."""
    for axis, letter in zip((ax.xaxis, ax.yaxis, ax.zaxis), "xyz", strict=True):
        axis.set_pane_color((1, 1, 1, 0))
        axis.set_rotate_label(False)  # a rotated label may be upside down or cover the numbers
        axis.set_label_text(f"${letter}_0$ (m)", rotation=90 if letter == "z" else 0)
        yield axis, letter

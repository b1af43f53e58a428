# SPDX-License-Identifier: BSD-2-Clause
"""Figures (matplotlib): functions draw into axes that they are given and hand them back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MissingExtraError
from ..files import Writer
from ..kinematics import legs_of_joints
from ..paper import angles_off_path
from ..sst import SST
from ..trajectories import Trajectory

try:
    import matplotlib as mpl
    from matplotlib.figure import Figure
except ImportError:
    raise MissingExtraError("matplotlib", "plot") from None

Array = NDArray[np.float64]
Axes = Any

#: Colours and dashes of legs 1, 2, 3, told apart without colour too (Okabe and Ito).
COLOURS = ("#0072B2", "#D55E00", "#009E73")
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.5, 1)))

_STYLE: dict[Any, Any] = {
    "font.family": "serif",
    "font.serif": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
    "font.size": 9,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "svg.hashsalt": "sst_pin",  # the same figure is the same file
    "savefig.dpi": 300,
}


def style() -> AbstractContextManager[None]:
    """The look of the figures, for a `with` statement."""
    context: AbstractContextManager[None] = mpl.rc_context(_STYLE)
    return context


def figure_writers(figure: Figure, stem: str) -> dict[str, Writer]:
    """Writers of a figure as PNG and SVG, by file name."""

    def writer(kind: str, metadata: Mapping[str, None]) -> Writer:
        def write(file: Any) -> None:
            with style():
                figure.savefig(file, format=kind, metadata=metadata)

        return write

    return {f"{stem}.png": writer("png", {}), f"{stem}.svg": writer("svg", {"Date": None})}


def motor_torques(ax: Axes, motion: Trajectory) -> Axes:
    """Torques of three motors against time (Fig. 10).

    Args:
        ax: Plane axes.
        motion: Of an SST.
    """
    for k in range(3):
        label = rf"$\tau_{k + 1}$"
        ax.plot(motion.t, motion.tau[:, k], color=COLOURS[k], linestyle=DASHES[k], label=label)
    ax.axhline(0, color="0.7", linewidth=0.5, zorder=0)
    ax.set(xlabel="time (s)", ylabel="motor torque (N m)", xlim=(motion.t[0], motion.t[-1]))
    ax.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), handlelength=2.6)
    return ax


def paths_on_sphere(
    ax: Axes, robot: SST, motions: Sequence[tuple[str, Trajectory]], radius: float = 0.4
) -> Axes:
    """Paths of E on the sphere of the star, over the base triangle's patch (Figs. 9, 11).

    Args:
        ax: Axes with projection "3d".
        robot: The SST.
        motions: Label and motion of each path; of several, the first is the wanted one.
        radius: Of the star's arcs, [m].
    """
    _patch(ax, robot, radius, "v")
    looks = _PATHS if len(motions) > 1 else _PATHS[1:]
    for (label, motion), look in zip(motions, looks, strict=False):
        E = radius * robot.platform_orientation(motion.q)[:, :, 0]
        ax.plot(*E.T, label=label, zorder=10, **look)
    ax.plot(*E[:1].T, "o", color="black", markersize=3, zorder=11)
    if len(motions) > 1:
        ax.legend(loc="upper left", bbox_to_anchor=(-0.05, 1.0), handlelength=2.6)
    _equal_space(ax, radius)
    return ax


#: The wanted path under the others, then those.
_PATHS: tuple[dict[str, Any], ...] = (
    {"color": "0.8", "linewidth": 4},
    {"color": COLOURS[0], "linewidth": 1.2},
    {"color": COLOURS[1], "linewidth": 1.2, "linestyle": (0, (4, 4))},
)


def path_errors(ax: Axes, errors: Sequence[tuple[str, Array, Array]]) -> Axes:
    """Angle between simulated and wanted axis s against time, logarithmic (Fig. 11).

    Args:
        ax: Plane axes.
        errors: Label, times [s] and angles [rad] of each motion.
    """
    for (label, t, error), look in zip(errors, _PATHS[1:], strict=False):
        seen = error > 0  # an exact zero has no place on the axis
        ax.semilogy(t[seen], error[seen], label=label, **look)
    ax.set(xlabel="time (s)", ylabel="angle off the path (rad)", xlim=(t[0], t[-1]))
    ax.legend()
    return ax


def robot_pose(ax: Axes, robot: SST, q: Array, radii: tuple[float, float] = (0.35, 0.4)) -> Axes:
    """A line drawing of the robot: base triangle, actuator links, the star's arcs.

    Args:
        ax: Axes with projection "3d".
        robot: The SST.
        q: Joint coordinates, shape (9,).
        radii: Of the base sphere and of the star's arcs, [m].
    """
    base, star = radii
    _patch(ax, robot, base, "P")
    legs = legs_of_joints(robot.geometry, q)
    for k in range(3):
        colour = COLOURS[k]
        carriage = np.outer((base, star), legs.u[k])
        ax.plot(*np.vstack([np.zeros(3), carriage[0]]).T, color=colour, linewidth=2.5)
        ax.plot(*carriage.T, color=colour, linewidth=6, solid_capstyle="butt")
        # The arc from E through R_k, a quarter circle in the plane with normal n_k.
        angles = np.linspace(0, np.pi / 2, 60)[:, None]
        s = legs.s[k]
        arc = star * (np.cos(angles) * s - np.sin(angles) * np.cross(legs.n[k], s))
        ax.plot(*arc.T, color=colour, linewidth=1.8)
        # Beside the arc: towards neither of its ends.
        beside = 1.12 * carriage[1] + 0.08 * legs.n[k]
        ax.text(*beside, f"$R_{k + 1}$", color=colour, ha="center", va="center")
    E = star * legs.s[0]
    ax.plot(*E[:, None], "o", color="black", markersize=4)
    ax.text(*(E + 0.05 * np.array((1, -1, 0))), "$E$", ha="center", va="center")
    _equal_space(ax, star)
    ax.set_axis_off()
    ax.set_box_aspect((1, 1, 1), zoom=1.05)
    return ax


def _patch(ax: Axes, robot: SST, radius: float, letter: str) -> None:
    """The base triangle on a sphere about O, with a fine net that shows its curvature."""
    v = robot.geometry.R_0[:, :, 0]

    def arc(start: Array, end: Array) -> Array:
        side = np.arccos(np.clip(start @ end, -1, 1))
        share = np.linspace(0, side, 60)[:, None]
        points: Array = (np.sin(side - share) * start + np.sin(share) * end) / np.sin(side)
        return radius * points

    for k in range(3):
        here, there, opposite = v[k], v[(k + 1) % 3], v[(k + 2) % 3]
        side = arc(here, there)
        for point in side[10:-5:10]:
            ax.plot(*arc(point / radius, opposite).T, color="0.88", linewidth=0.4)
        ax.plot(*side.T, color="0.35", linewidth=1.0)
        ax.plot(*np.vstack([np.zeros(3), radius * here]).T, color="0.75", linewidth=0.5)
        name = rf"$\mathbf{{v}}_{k + 1}$" if letter == "v" else f"${letter}_{k + 1}$"
        ax.text(*(1.13 * radius * here), name, color="0.25", ha="center", va="center")


def _equal_space(ax: Axes, radius: float) -> None:
    """A sphere that looks like one, axes with units."""
    limits = (-0.15 * radius, 1.15 * radius)
    ax.set(xlim=limits, ylim=limits, zlim=limits)
    ax.set_box_aspect((1, 1, 1), zoom=0.9)
    ax.view_init(elev=28, azim=38)
    ax.set(xlabel="$x_0$ (m)", ylabel="$y_0$ (m)", zlabel="$z_0$ (m)")
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.set_pane_color((1, 1, 1, 0))
        axis.set_major_locator(mpl.ticker.MultipleLocator(0.1 if radius < 0.5 else radius / 4))
    ax.grid(False)


def paper_figures(
    robot: SST, example: Trajectory, exact: Trajectory, rounded: Trajectory
) -> dict[str, Writer]:
    """Figures 9, 10 and 11 of the paper as PNG and SVG, by file name.

    Args:
        robot: The paper's.
        example: Example 1.
        exact: Example 2 from the exact initial state.
        rounded: Example 2 from the initial state as printed.
    """
    files: dict[str, Writer] = {}
    with style():
        size = (3.5, 3.3)
        figure = Figure(figsize=size, layout="constrained")
        paths_on_sphere(figure.add_subplot(projection="3d"), robot, [("path", example)])
        files |= figure_writers(figure, "figure_09_path")

        figure = Figure(figsize=(3.5, 2.5), layout="constrained")
        motor_torques(figure.add_subplot(), example)
        files |= figure_writers(figure, "figure_10_torques")

        figure = Figure(figsize=(7.0, 3.2), layout="constrained")
        motions = [("exact start", exact), ("printed start", rounded)]
        left = figure.add_subplot(1, 2, 1, projection="3d")
        paths_on_sphere(left, robot, [("wanted path", example), *motions])
        errors = [
            (label, motion.t, angles_off_path(robot, example, motion)) for label, motion in motions
        ]
        path_errors(figure.add_subplot(1, 2, 2), errors)
        files |= figure_writers(figure, "figure_11_direct_dynamics")
    return files

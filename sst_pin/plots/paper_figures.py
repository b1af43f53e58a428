# SPDX-License-Identifier: BSD-2-Clause
"""Figures 9, 10 and 11 of the paper, and the picture in the README of a description."""

from matplotlib.figure import Figure

from ..description.parameters import Parameters
from ..files import Writer
from ..simulation.trajectories import Trajectory
from ..sst.paper import angles_off_path
from ..sst.robot import SST
from .motions import motor_torques
from .space import PATHS, paths_on_sphere, robot_pose
from .style import Axes, figure_writer, style


def paper_figures(
    robot: SST, example: Trajectory, exact: Trajectory, rounded: Trajectory
) -> dict[str, Writer]:
    """Figures 9, 10 and 11 of the paper as PNG and SVG, by file name.

    `example` is example 1. `exact` and `rounded` are example 2: the motions from the exact initial
    state and from that printed in the paper.
    """
    motions = [("exact start", exact), ("printed start", rounded)]
    with style():
        path = Figure(figsize=(3.5, 3.3), layout="constrained")
        torques = Figure(figsize=(3.5, 2.5), layout="constrained")
        direct = Figure(figsize=(7.0, 3.2), layout="constrained")
        paths_on_sphere(path.add_subplot(projection="3d"), robot, [("path", example)])
        motor_torques(torques.add_subplot(), example)
        left = direct.add_subplot(1, 2, 1, projection="3d")
        paths_on_sphere(left, robot, [("wanted path", example), *motions])
        _path_errors(direct.add_subplot(1, 2, 2), robot, example, motions)
    figures = {
        "figure_09_path": path,
        "figure_10_torques": torques,
        "figure_11_direct_dynamics": direct,
    }
    files = {}
    for stem, figure in figures.items():
        for name in (f"{stem}.png", f"{stem}.svg"):
            files[name] = figure_writer(figure, name)
    return files


def _path_errors(
    ax: Axes, robot: SST, wanted: Trajectory, motions: list[tuple[str, Trajectory]]
) -> None:
    """Draw the angle between the axis s and the wanted axis over time, on a logarithmic scale."""
    for (label, motion), look in zip(motions, PATHS[1:], strict=True):
        error = angles_off_path(robot, wanted, motion)
        is_shown = error > 0  # an exact zero has no place on the axis
        ax.semilogy(motion.t[is_shown], error[is_shown], label=label, **look)
    ax.set(xlabel="time (s)", ylabel="angle off the path (rad)", xlim=wanted.t[[0, -1]])
    ax.legend()


def picture_writers(p: Parameters) -> dict[str, Writer]:
    """Writer of `sst.png`, an SST in its home pose, by file name."""
    robot = SST(p)
    with style():
        figure = Figure(figsize=(4, 4), layout="constrained")
        axes = figure.add_subplot(projection="3d")
        robot_pose(axes, robot, robot.home, (p.base_radius, p.star_radius))
    return {"sst.png": figure_writer(figure, "sst.png")}

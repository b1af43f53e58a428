# SPDX-License-Identifier: BSD-2-Clause
"""Figures 9, 10 and 11 of the paper, and the picture in the README of a description."""

from __future__ import annotations

from matplotlib.figure import Figure

from ..description.parameters import Parameters
from ..files import Writer
from ..motion.trajectories import Trajectory
from ..sst.paper import angles_off_path
from ..sst.robot import SST
from .motions import motor_torques, path_errors
from .sphere import paths_on_sphere, robot_pose
from .style import figure_writer, figure_writers, style


def paper_figures(
    robot: SST, example: Trajectory, exact: Trajectory, rounded: Trajectory
) -> dict[str, Writer]:
    """Figures 9, 10 and 11 of the paper as PNG and SVG, by file name.

    Args:
        robot: The paper's.
        example: Example 1.
        exact: Example 2 from the exact initial state.
        rounded: Example 2 from the initial state as printed.

    Example:
        >>> from sst_pin.sst import paper
        >>> circle = paper.example_1(robot, np.linspace(0, 0.1, 11))
        >>> sorted(plots.paper_figures(robot, circle, circle, circle))[0]
        'figure_09_path.png'
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


def picture_writers(p: Parameters) -> dict[str, Writer]:
    """Writer of `sst.png`, an SST in its home pose, by file name."""
    robot = SST(p)
    with style():
        figure = Figure(figsize=(4, 4), layout="constrained")
        axes = figure.add_subplot(projection="3d")
        robot_pose(axes, robot, robot.home, (p.base_radius, p.star_radius))
    return {"sst.png": figure_writer(figure, "sst.png")}

# SPDX-License-Identifier: BSD-2-Clause
"""The picture in the README of a description."""

from __future__ import annotations

from matplotlib.figure import Figure

from ..description.parameters import Parameters
from ..files import Writer
from ..sst.robot import SST
from .sphere import robot_pose
from .style import figure_writer, style


def picture_writers(p: Parameters) -> dict[str, Writer]:
    """Writer of `sst.png`, an SST in its home pose, by file name."""
    robot = SST(p)
    with style():
        figure = Figure(figsize=(4, 4), layout="constrained")
        axes = figure.add_subplot(projection="3d")
        robot_pose(axes, robot, robot.home, (p.base_radius, p.star_radius))
    return {"sst.png": figure_writer(figure, "sst.png")}

# SPDX-License-Identifier: BSD-2-Clause
"""Draw docs/robot.png: the paper's robot on its circle, and the torques along it."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from sst_pin import SST, plots
from sst_pin.files import write_files
from sst_pin.paper import PERIOD, example_1

FOLDER = Path(__file__).resolve().parents[1] / "docs"


def main() -> None:
    robot = SST()
    motion = example_1(robot, np.linspace(0, PERIOD, 401))
    with plots.style():
        figure = Figure(figsize=(7.5, 3.4), layout="constrained")
        left = figure.add_subplot(1, 2, 1, projection="3d")
        plots.robot_pose(left, robot, motion.q[70])
        E = 0.4 * robot.platform_orientation(motion.q)[:, :, 0]
        left.plot(*E.T, color="0.3", linewidth=0.8, linestyle=(0, (2, 1)))
        plots.motor_torques(figure.add_subplot(1, 2, 2), motion)
        figures = plots.figure_writers(figure, "robot")
    write_files({FOLDER / "robot.png": figures["robot.png"]}, force=True)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: BSD-2-Clause
"""Draw docs/motion.gif and docs/motion.png: the paper's robot in motion, with its torques."""

from pathlib import Path

import numpy as np

from sst_pin import SST
from sst_pin.files import write_files
from sst_pin.sst.paper import PERIOD, example_1
from sst_pin.viewer import Viewer

FOLDER = Path(__file__).resolve().parents[2] / "docs"


def main() -> None:
    robot = SST()
    viewer = Viewer(robot, axes=True)
    viewer.play(example_1(robot, np.linspace(0, PERIOD, 181)), title="Example 1: the circle")
    names = ("motion.gif", "motion.png")
    write_files({FOLDER / name: viewer.writer(name) for name in names}, force=True)


if __name__ == "__main__":
    main()

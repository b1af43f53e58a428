# SPDX-License-Identifier: BSD-2-Clause
"""Write examples/figure_eight.csv, a motion that is not the paper's; --check only compares.

E draws an eight about the isotropic pose while the star turns about its axis, from rest to rest.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from sst_pin import SST
from sst_pin.files import read_table, table_writer, write_files

PATH = Path(__file__).resolve().parents[2] / "examples" / "figure_eight.csv"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="exit 1 when the file is not current")
    check = parser.parse_args().check
    t = np.linspace(0, 2, 201)
    x = t / t[-1]
    phase = 2 * np.pi * x**3 * (10 - 15 * x + 6 * x**2)  # starts and ends without a jerk
    robot = SST()
    home = robot.platform_orientation(robot.home)
    angles = np.column_stack([0.3 * np.sin(phase), 0.25 * np.sin(phase), 0.15 * np.sin(2 * phase)])
    R = Rotation.from_matrix(home) * Rotation.from_rotvec(angles)  # about the star's s, y and z
    x, y, z, w = R.as_quat(canonical=True).T
    values = np.column_stack([t, w, x, y, z]).round(12)
    if check:
        # Other processors may differ in the last digit of a sine.
        return not np.allclose(read_table(PATH).values, values, rtol=0, atol=2e-12)
    writer = table_writer(("t_s", "qw", "qx", "qy", "qz"), values)
    write_files({PATH: writer}, force=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

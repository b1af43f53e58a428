# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin torques`: inverse dynamics of a motion file."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from ..sst.motion_files import read_motion
from .common import Commands, add_output, add_strict, add_urdf, refuses, robot_of, save


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "torques",
        _run,
        "Motor torques of a motion: t_s with qw, qx, qy, qz, or theta, phi, psi, or gamma_1..3 "
        "(angles end in _rad or _deg).",
    )
    add_urdf(parser)
    parser.add_argument("motion", type=Path, metavar="MOTION.csv")
    add_output(parser, "TORQUES.csv")
    add_strict(parser)


def _run(arguments: argparse.Namespace) -> int:
    robot = robot_of(arguments)
    motion = read_motion(robot, arguments.motion)
    if refuses(robot, motion, arguments):
        return 1
    save(motion, arguments)
    peaks = ", ".join(f"{value:.4g}" for value in np.abs(motion.tau).max(axis=0))
    print(f"{len(motion)} samples, peak torques {peaks} N m -> {arguments.output}")
    return 0

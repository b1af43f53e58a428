# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin torques`: inverse dynamics of a motion file."""

from __future__ import annotations

import argparse

import numpy as np

from ..motion.motion_files import read_motion
from ..summaries import listed
from .common import (
    Commands,
    add_input,
    add_output,
    add_robot,
    add_strict,
    refuses,
    robot_of,
    save,
    say,
    source_of,
)


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "torques",
        _run,
        "Compute the motor torques of a motion (inverse dynamics). The columns of the file: for "
        "an SST t_s and qw, qx, qy, qz, or theta, phi, psi, or gamma_1..3 (names of angles end in "
        "_rad or _deg); for any --robot t_s and one column for each coordinate, such as crank_rad, "
        "crank_deg, slide_m.",
    )
    add_robot(parser)
    add_input(parser, "motion", "motion")
    add_output(parser, "TORQUES.csv")
    add_strict(parser)


def _run(arguments: argparse.Namespace) -> int:
    robot, source = robot_of(arguments), source_of(arguments.motion)
    motion = read_motion(robot, source)
    if refuses(robot, motion, arguments):
        return 1
    save(motion, arguments)
    peaks = np.abs(motion.tau).max(axis=0)
    units = dict.fromkeys(unit.replace("Nm", "N m") for unit in motion.torque_units)
    if len(units) == 1 and len(peaks) <= 3:
        told = f"{', '.join(f'{peak:.4g}' for peak in peaks)} {next(iter(units))}"
    else:
        found = zip(motion.actuated, peaks, motion.torque_units, strict=True)
        told = listed([f"{name} {p:.4g} {u.replace('Nm', 'N m')}" for name, p, u in found])
    say(f"{len(motion)} samples, peak torques {told} -> {arguments.output}", arguments)
    start = zip(motion.joint_names, motion.q[0], strict=True)
    say(f"  starts at {listed([f'{name} {x:.4g}' for name, x in start])}", arguments)
    return 0

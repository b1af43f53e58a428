# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin simulate`: direct dynamics of a torque file."""

from __future__ import annotations

import argparse

from ..files import read_table
from ..motion.motion_files import read_start, read_torques
from .common import (
    Commands,
    add_input,
    add_output,
    add_robot,
    add_strict,
    named_numbers,
    progress_bar,
    refuses,
    remark,
    robot_of,
    save,
    say,
    source_of,
)

#: Exit code of a motion that stops before the last time; the motion until then is written.
CUT_SHORT = 3


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "simulate",
        _run,
        "Compute the motion for given torques (direct dynamics). The columns of the file are t_s, "
        "tau_1_Nm, tau_2_Nm, .. (tau_1_N for a linear motor). The motion starts at the state in "
        "the first row, if the file has columns for it (gamma_1_rad, .., gamma_1_rad_s, ..: the "
        "names of the joints). Otherwise give the start by --q0 and --va0. Exit code 3: the "
        "simulation stopped before a singularity.",
    )
    add_robot(parser)
    add_input(parser, "torques", "torques")
    add_output(parser, "MOTION.csv")
    add_strict(parser)
    parser.add_argument(
        "--q0",
        type=named_numbers,
        metavar="JOINT=X,..",
        help="initial positions of joints, at least of the coordinates, rad or m",
    )
    parser.add_argument(
        "--va0",
        type=named_numbers,
        metavar="JOINT=V,..",
        help="initial rates of the coordinates, rad/s or m/s (default with --q0: 0)",
    )


def _run(arguments: argparse.Namespace) -> int:
    robot = robot_of(arguments)
    table = read_table(source_of(arguments.torques))
    tau, t = read_torques(robot, table), table.column("t_s")
    q0, va0 = read_start(robot, table, arguments.q0, arguments.va0)
    with progress_bar("simulating", t[0], t[-1]) as progress:
        motion = robot.simulate(tau, q0, va0, t, progress=progress)
    if refuses(robot, motion, arguments):
        return 1
    save(motion, arguments)
    text = f"{len(motion)} samples to t = {motion.t[-1]:g} s -> {arguments.output}{remark(motion)}"
    say(text, arguments)
    return CUT_SHORT if motion.stopped else 0

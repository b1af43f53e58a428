# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin loads`: what the joints and closures carry along a motion."""

from __future__ import annotations

import argparse

import numpy as np

from ..files import text_writer
from ..motion.motion_files import read_motion
from .common import (
    Commands,
    add_input,
    add_output,
    add_robot,
    add_strict,
    refuses,
    robot_of,
    say,
    source_of,
    write,
)


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "loads",
        _run,
        "Compute peak and mean forces and moments of each joint and closure along a motion, and "
        "say which are not unique. The motion file is as for torques.",
    )
    add_robot(parser)
    add_input(parser, "motion", "motion")
    add_output(
        parser, "LOADS.csv", "table, .csv, or figure, .png, .svg or .pdf; - writes the table"
    )
    add_strict(parser)


def _run(arguments: argparse.Namespace) -> int:
    robot, source = robot_of(arguments), source_of(arguments.motion)
    motion = read_motion(robot, source)
    if refuses(robot, motion, arguments):
        return 1
    loads, output = robot.loads(motion), arguments.output
    writer = text_writer(loads.csv)
    if output.suffix.lower() in (".png", ".svg", ".pdf"):
        from .. import plots  # needs the extra `plot`

        writer = plots.figure_writer(plots.loads_page(loads), output)
    write({output: writer}, arguments)
    forces = [row for row in loads.rows if row.kind == "force"]
    known = [row for row in forces if np.isfinite(row.peak)]
    told = f"{len(forces) - len(known)} of {len(forces)} forces are not unique"
    if known:
        worst = max(known, key=lambda row: row.peak)
        told = f"largest force {worst.peak:.4g} N in {worst.name} at {worst.time:.4g} s, {told}"
    say(f"{len(motion)} samples, {told} -> {arguments.output}", arguments)
    return 0

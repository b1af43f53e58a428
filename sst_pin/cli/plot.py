# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin plot`: figures of a motion."""

from __future__ import annotations

import argparse

from ..errors import FileFormatError
from ..motion.motion_files import load_motion
from .common import (
    Commands,
    add_figure,
    add_input,
    add_robot,
    add_strict,
    output_name,
    refuses,
    robot_of,
    say,
    source_of,
    write,
)

#: `plots.SUBJECTS`, without importing matplotlib.
SUBJECTS = ("path", "torques", "joints", "rates", "power", "energy", "condition")


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "plot",
        _run,
        "Draw figures of a motion. The file is an output of `torques` or `simulate`, or an input "
        "of `torques`.",
    )
    add_robot(parser)
    add_input(parser, "motion", "motion")
    add_figure(parser)
    add_strict(parser)
    parser.add_argument(
        "--what",
        type=_subjects,
        metavar="A,B,..",
        help=f"one or more of {', '.join(SUBJECTS)} (default: all except power; path only for an "
        "SST, or with --frame)",
    )
    parser.add_argument(
        "--frame",
        metavar="NAME",
        help="draw the path of this frame in the axes of the base (default: platform; for an SST "
        "the path of E on its sphere)",
    )


def _subjects(text: str) -> tuple[str, ...]:
    subjects = tuple(part.strip() for part in text.split(","))
    unknown = [subject for subject in subjects if subject not in SUBJECTS]
    if unknown:
        raise argparse.ArgumentTypeError(
            f"{unknown[0]!r} unknown; known: {', '.join(SUBJECTS)}, separated by commas"
        )
    return subjects


def _run(arguments: argparse.Namespace) -> int:
    from .. import plots  # needs the extra `plot`

    name = output_name(arguments.output, ".png")
    plots.require_ending(name)
    robot = robot_of(arguments)
    motion = load_motion(robot, source_of(arguments.motion))
    if len(motion) < 2:
        raise FileFormatError(arguments.motion, "has one sample; a curve needs at least two")
    if refuses(robot, motion, arguments):
        return 1
    figure = plots.motion_page(robot, motion, arguments.what, arguments.frame)
    write({arguments.output: plots.figure_writer(figure, name)}, arguments)
    what = ", ".join(arguments.what or plots.summary_of(robot, arguments.frame))
    say(f"{what} of {len(motion)} samples -> {arguments.output}", arguments)
    return 0

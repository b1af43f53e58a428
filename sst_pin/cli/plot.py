# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin plot`: figures of a motion."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import FileFormatError
from ..files import write_files
from ..sst.motion_files import load_motion
from .common import Commands, add_figure, add_strict, add_urdf, refuses, robot_of

#: As in `plots.SUBJECTS`, which needs matplotlib.
SUBJECTS = ("path", "torques", "joints", "rates", "power", "energy", "condition")


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "plot",
        _run,
        "Figures of a motion: what `torques` or `simulate` wrote, or a motion of the star.",
    )
    add_urdf(parser)
    parser.add_argument("motion", type=Path, metavar="MOTION.csv")
    add_figure(parser)
    add_strict(parser)
    parser.add_argument(
        "--what",
        type=_subjects,
        metavar="A,B,..",
        help=f"of {', '.join(SUBJECTS)} (default: a page of all but power)",
    )


def _subjects(text: str) -> tuple[str, ...]:
    subjects = tuple(part.strip() for part in text.split(","))
    unknown = [subject for subject in subjects if subject not in SUBJECTS]
    if unknown:
        raise argparse.ArgumentTypeError(
            f"{unknown[0]!r} unknown; known: {', '.join(SUBJECTS)}, joined by commas"
        )
    return subjects


def _run(arguments: argparse.Namespace) -> int:
    from .. import plots  # needs the extra `plot`

    plots.require_ending(arguments.output)
    robot = robot_of(arguments)
    motion = load_motion(robot, arguments.motion)
    if len(motion) < 2:
        raise FileFormatError(arguments.motion, "one sample; a curve needs two at least")
    if refuses(robot, motion, arguments):
        return 1
    subjects = arguments.what or [s for s in SUBJECTS if s != "power"]
    figure = plots.motion_page(robot, motion, subjects)
    files = {arguments.output: plots.figure_writer(figure, arguments.output)}
    write_files(files, arguments.force)
    print(f"{', '.join(subjects)} of {len(motion)} samples -> {arguments.output}")
    return 0

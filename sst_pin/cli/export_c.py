# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin export-c`: the dynamics of a robot as C for its controller."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import InputError, MissingExtraError
from ..files import write_files
from .common import Commands, add_force, add_urdf, chain_of, robot_of


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "export-c",
        _run,
        "Write the dynamics of a robot as C for its controller: header, source, the robot's "
        "numbers and an example.",
    )
    add_urdf(parser)
    parser.add_argument(
        "paths",
        type=Path,
        nargs="*",
        metavar="[ROBOT] [FOLDER]",
        help="URDF beside its YAML, or MJCF, an SST by default; the folder may be named by -o",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="made if missing")
    parser.add_argument(
        "--precision",
        choices=["double", "single"],
        default="double",
        help="single: float, for controllers that compute it faster",
    )
    add_force(parser)


def _run(arguments: argparse.Namespace) -> None:
    paths = [*arguments.paths, *([arguments.output] if arguments.output else [])]
    if not 1 <= len(paths) <= 2:
        raise InputError("export-c", "takes a folder, and before it a robot or none")
    robot_file, folder = (None, *paths)[-2:]
    try:
        from ..compiled import export
    except ImportError:
        raise MissingExtraError("casadi", "compile") from None
    robot = chain_of(robot_file) if robot_file else robot_of(arguments)
    written = export.c_files(robot, folder, arguments.precision)
    write_files(written, arguments.force, folder=folder)
    print(f"{', '.join(path.name for path in written)} in {folder}")

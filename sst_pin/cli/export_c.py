# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin export-c`: the dynamics of a robot as C code for its controller."""

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
        "Write the dynamics of a robot as C code for its controller: header, source with the "
        "parameters of the robot, and an example.",
    )
    add_urdf(parser)
    parser.add_argument(
        "paths",
        type=Path,
        nargs="*",
        metavar="[ROBOT] [FOLDER]",
        help="a URDF with its YAML beside it, or an MJCF (default: the paper's SST); then the "
        "folder, unless -o names it",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FOLDER", help="created if it does not exist"
    )
    parser.add_argument(
        "--precision",
        choices=["double", "single"],
        default="double",
        help="double or float (default: double)",
    )
    add_force(parser)


def _run(arguments: argparse.Namespace) -> None:
    paths = [*arguments.paths, *([arguments.output] if arguments.output else [])]
    if not 1 <= len(paths) <= 2:
        raise InputError("export-c", "give a folder, and optionally a robot before it")
    robot_file, folder = (None, *paths)[-2:]
    try:
        from ..compiled import export
    except ImportError:
        raise MissingExtraError("casadi", "compile") from None
    robot = chain_of(robot_file) if robot_file else robot_of(arguments)
    written = export.c_files(robot, folder, arguments.precision)
    write_files(written, arguments.force, folder=folder)
    print(f"{', '.join(path.name for path in written)} in {folder}")

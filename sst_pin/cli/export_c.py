# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin export-c`: the dynamics of a robot as C code for its controller."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import InputError, MissingExtraError
from ..files import write_files
from .common import Commands, add_force, add_robot, misplaced, robot_of


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "export-c",
        _run,
        "Write the dynamics of a robot as C code for its controller: header, source with the "
        "parameters of the robot, and an example.",
    )
    add_robot(parser)
    parser.add_argument("folder", type=Path, nargs="?", metavar="FOLDER", help="the folder, or -o")
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
    given = [path for path in (arguments.folder, arguments.output) if path is not None]
    if len(given) != 1:
        raise InputError("export-c", f"give one folder{misplaced([*map(str, given)])}")
    (folder,) = given
    try:
        from ..compiled import export
    except ImportError:
        raise MissingExtraError("casadi", "compile") from None
    robot = robot_of(arguments)
    written = export.c_files(robot, folder, arguments.precision)
    write_files(written, arguments.force, folder=folder)
    print(f"{', '.join(path.name for path in written)} in {folder}")

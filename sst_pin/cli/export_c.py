# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin export-c`: the dynamics of a robot as C for its controller."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..files import write_files
from ..sst.export import c_files
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
        "robot", type=Path, nargs="?", help="URDF beside its YAML, or MJCF; an SST by default"
    )
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument(
        "--precision",
        choices=["double", "single"],
        default="double",
        help="single: float, for controllers that compute it faster",
    )
    add_force(parser)


def _run(arguments: argparse.Namespace) -> None:
    if arguments.robot is None and arguments.precision == "double":
        written = c_files(robot_of(arguments), arguments.folder)
    else:
        from ..compiled import export

        robot = chain_of(arguments.robot) if arguments.robot else robot_of(arguments)
        written = export.c_files(robot, arguments.folder, arguments.precision)
    write_files(written, arguments.force)
    print(f"{', '.join(path.name for path in written)} in {arguments.folder}")

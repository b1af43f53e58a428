# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin validate`: every problem of a robot description."""

from __future__ import annotations

import argparse
from pathlib import Path

from .common import Commands


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "validate", _run, "List all problems of a URDF or MJCF and of its closures."
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="a URDF or an MJCF (.xml, .mjcf)")
    parser.add_argument(
        "--cuts",
        type=Path,
        metavar="YAML",
        help="of a URDF: closures and motors (default: the YAML with the name of FILE)",
    )


def _run(arguments: argparse.Namespace) -> int:
    from ..validation import examine

    problems, summary = examine(arguments.file, arguments.cuts)
    for problem in problems:
        print(problem)
    errors = sum(problem.severity == "error" for problem in problems)
    if errors:
        print(f"{errors} error(s), {len(problems) - errors} warning(s)")
        return 1
    found = f"{len(problems)} warning(s), no errors" if problems else "no problems found"
    print(f"{found}\n{summary}")
    return 0

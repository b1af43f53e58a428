# SPDX-License-Identifier: BSD-2-Clause
"""The command `sst-pin`: one module for each of its commands."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence

from ..errors import SingularityWarning, SSTError
from . import (
    describe,
    export_c,
    info,
    paper,
    plot,
    show,
    simulate,
    torques,
    validate,
    verify,
    workspace,
)
from .common import Commands, Parser, version_of

#: In the order of the help text.
COMMANDS = (
    paper,
    torques,
    simulate,
    show,
    plot,
    workspace,
    describe,
    verify,
    validate,
    export_c,
    info,
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        argv: Arguments; those of the process by default.

    Returns:
        The exit code: 0; 1 when referees disagree or a description has errors; 2 after one line
        that says what is wrong.
    """
    parser = Parser(
        prog="sst-pin", description="Dynamics of the SST spherical parallel manipulator."
    )
    parser.add_argument("--version", action="version", version=version_of("sst-pin"))
    commands = Commands(parser)
    for command in COMMANDS:
        command.add_to(commands)
    arguments = parser.parse_args(argv)
    try:
        with warnings.catch_warnings():
            # A motion that stops early is told on standard output, once.
            warnings.simplefilter("ignore", SingularityWarning)
            return arguments.run(arguments) or 0
    except SSTError as error:
        print(f"sst-pin: error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("sst-pin: interrupted", file=sys.stderr)
        return 130

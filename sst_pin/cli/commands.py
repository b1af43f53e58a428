# SPDX-License-Identifier: BSD-2-Clause
"""All commands, and what answers the arguments."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence

from ..errors import DescriptionWarning, SingularityWarning, SSTError
from ..version import __version__
from . import (
    compile as compile_,
)
from . import (
    describe,
    export_c,
    identify,
    info,
    loads,
    paper_command,
    plot,
    show,
    simulate,
    torques,
    validate,
    verify_command,
    workspace_command,
)
from .common import Commands, Parser

#: In the order of the help text.
COMMANDS = (
    paper_command,
    torques,
    loads,
    simulate,
    show,
    plot,
    workspace_command,
    describe,
    verify_command,
    validate,
    identify,
    export_c,
    compile_,
    info,
)


def _warn(message: Warning | str, *_: object, **__: object) -> None:
    """Print a warning in one line."""
    print(f"sst-pin: warning: {message}", file=sys.stderr)


def run(argv: Sequence[str] | None) -> int:
    """Run the command that the arguments ask for; see `main`."""
    parser = Parser(
        prog="sst-pin",
        description="Dynamics of closed-chain robots: torques, simulation, figures, checks.",
    )
    parser.set_defaults(run=None)
    parser.add_argument("--version", action="version", version=__version__)
    commands = Commands(parser)
    for command in COMMANDS:
        command.add_to(commands)
    arguments = parser.parse_args(argv)
    if arguments.run is None:
        print(parser.format_help(), end="")
        return 0
    try:
        with warnings.catch_warnings():
            # A motion that stops early is told on standard output, once.
            warnings.simplefilter("ignore", SingularityWarning)
            warnings.simplefilter("always", DescriptionWarning)  # each command says it again
            warnings.showwarning = _warn
            return arguments.run(arguments) or 0
    except SSTError as error:
        print(f"sst-pin: error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2

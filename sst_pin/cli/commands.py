# SPDX-License-Identifier: BSD-2-Clause
"""All commands, and what answers the arguments."""

import warnings
from collections.abc import Sequence

from ..errors import DescriptionWarning, SingularityWarning, SSTError
from ..version import __version__
from . import common, identify, motion_commands, robot_commands, show, sst_commands

#: Each adds a command, in the order of the help text.
COMMANDS = (
    sst_commands.add_paper,
    motion_commands.add_torques,
    motion_commands.add_simulate,
    show.add_show,
    motion_commands.add_plot,
    sst_commands.add_describe,
    robot_commands.add_verify,
    robot_commands.add_validate,
    identify.add_identify,
    robot_commands.add_compile,
)


def run(argv: Sequence[str] | None) -> int:
    """Run the command that the arguments ask for; see `main`."""
    parser = common.Parser(
        prog="sst-pin",
        description="Dynamics of closed-chain robots: torques, simulation, figures, checks.",
    )
    parser.set_defaults(run=None)
    parser.add_argument("--version", action="version", version=__version__)
    commands = common.Commands(parser)
    for add in COMMANDS:
        add(commands)
    arguments = parser.parse_args(argv)
    if arguments.run is None:
        print(parser.format_help(), end="")
        return 0
    try:
        with warnings.catch_warnings():
            # A motion that stops early is told on standard output, once.
            warnings.simplefilter("ignore", SingularityWarning)
            warnings.simplefilter("always", DescriptionWarning)  # each command says it again
            warnings.showwarning = lambda message, *_, **__: common.tell("warning", message)
            return arguments.run(arguments) or 0
    except SSTError as error:
        common.tell("error", " ".join(str(error).split()))
        return 2

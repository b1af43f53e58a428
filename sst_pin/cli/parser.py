# SPDX-License-Identifier: BSD-2-Clause
"""Parsers of the command line.

Only `gallery` imports Pinocchio, when it is called. It is not called for --help, which stays quick.
"""

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

#: Arguments of `ArgumentParser.add_argument`.
Option: TypeAlias = tuple[list[str], dict[str, Any]]


class Command:
    """A command of `sst-pin`."""

    def __init__(
        self, usage: str, module: str, text: str, *options: Option, more: str = ""
    ) -> None:
        """Describe a command.

        Args:
            usage: Its name and its most important arguments, as the help shows them.
            module: The module of `cli` that has a function with the name of the command.
            text: What the command does, in a few words.
            options: Its options and arguments, by `option`.
            more: Further lines of the help.
        """
        self.name = usage.partition(" ")[0]
        self.usage = usage
        self.module = module
        self.text = text
        self.options = options
        self.more = more


def option(spec: str, text: str, kind: Callable[[str], Any] = str, **how: Any) -> Option:
    """An option such as "-o, --output FILE", a flag such as "--all", an argument "file FILE".

    Args:
        spec: The names and, unless it is a flag, the value as the help shows it.
        text: What it means, for the help.
        kind: The function that reads the value.
        how: Other arguments of `ArgumentParser.add_argument`.
    """
    if " " not in spec:
        return [spec], {"help": text, "action": "store_true", **how}
    names, _, metavar = spec.rpartition(" ")
    return names.split(", "), {"help": text, "metavar": metavar, "type": kind, **how}


class Parser(argparse.ArgumentParser):
    """A parser whose help fits on a screen and whose errors are one line."""

    def __init__(self, **how: Any) -> None:
        super().__init__(add_help=False, formatter_class=_Help, **how)
        # A word that begins with "-" is a value, and not an option, if it matches this pattern. The
        # pattern of argparse matches single numbers only, and not the list in --gravity -1,0,0.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; `error` needs the words for its hint."""
        self._words = sys.argv[1:] if args is None else list(args)
        return super().parse_known_args(args, namespace)

    def add(self, options: Sequence[Option]) -> None:
        """Add options in one group, with --help."""
        group = self.add_argument_group("options")
        group.add_argument("-h", "--help", action="help", help="show this help")
        for names, how in options:
            group.add_argument(*names, **how)

    def add_commands(self, commands: Sequence[Command]) -> None:
        """Add a parser for each command."""
        parsers = self.add_subparsers(title="commands", metavar="COMMAND", parser_class=Parser)
        for command in commands:
            parser = parsers.add_parser(
                command.name,
                prog=f"sst-pin {command.name}",
                usage=f"sst-pin {command.usage} [OPTIONS]",
                help=command.text,
                description=f"{command.text}\n{command.more}",
            )
            parser.set_defaults(command=command)
            parser.add(command.options)

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print a text. Unlike argparse, raise errors of writing, for instance to a closed pipe."""
        if message:
            (file or sys.stderr).write(message)

    def error(self, message: str) -> NoReturn:
        """Leave with exit code 2."""
        self.exit(2, f"{self.prog}: error: {message}{hint_for_robot(self._words)}\n")


class _Help(argparse.RawDescriptionHelpFormatter):
    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=24, width=80)

    def _format_action_invocation(self, action: argparse.Action) -> str:
        """The names of an option and its value, printed once: `-o, --output FILE`."""
        if not action.option_strings or action.nargs == 0:
            return super()._format_action_invocation(action)
        return f"{', '.join(action.option_strings)} {action.metavar}"


def gallery() -> list[str]:
    """Names of robots without a file: the SST and the gallery."""
    from .. import robots

    # Robots are functions, which have names in lower case. `GalleryRobot` is a class.
    return ["sst", *(name for name in robots.__all__ if name.islower())]


def names_robot(word: str) -> bool:
    """Whether a word is a file of a robot, or a name of the gallery and no file."""
    endings = (".urdf", ".sdf", ".xml", ".mjcf")
    return word.lower().endswith(endings) or (word in gallery() and not Path(word).exists())


def hint_for_robot(words: Sequence[str]) -> str:
    """A hint for an error message if a robot stands in the place of another argument.

    Options are skipped, and so are words after options, which may be their values.
    """
    previous = ""
    for word in words:
        is_argument = not previous.startswith("-") and not word.startswith("-")
        if is_argument and names_robot(word):
            return f"; did you mean --robot {word}?"
        previous = word
    return ""


def numbers(text: str) -> list[float]:
    """Numbers, separated by commas."""
    return [float(word) for word in text.split(",")]


def directions(text: str) -> list[list[float]]:
    """Several lists of numbers, separated by blanks."""
    return [numbers(part) for part in text.split()]


def named_numbers(text: str) -> dict[str, float]:
    """Numbers by name, for instance "crank=0.1,slide=0.2"; a name must not stand twice."""
    pairs = [part.rpartition("=") for part in text.split(",")]
    try:
        values = {name.strip(): float(value) for name, _, value in pairs}
    except ValueError:
        values = {}
    if len(values) < len(pairs) or "" in values:
        raise argparse.ArgumentTypeError(f"{text!r} does not have the form crank=0.1,slide=0.2")
    return values


def words(text: str) -> list[str]:
    """Words, separated by commas."""
    return [word.strip() for word in text.split(",")]

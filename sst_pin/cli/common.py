# SPDX-License-Identifier: BSD-2-Clause
"""What several commands share: options, progress, saving."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ..chain.closed_chain import ClosedChain
from ..motion.trajectories import Trajectory
from ..sst.robot import SST

Array = NDArray[np.float64]


class Parser(argparse.ArgumentParser):
    """An argument parser that says what is wrong in one line; the usage is in --help."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        # What begins like a negative number is a value, as in --gamma -0.1,0.2,0.3.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        """Leave with exit code 2."""
        self.exit(2, f"{self.prog}: error: {message}\n")


class Commands:
    """Where each command adds its parser."""

    def __init__(self, parser: Parser) -> None:
        self._parsers = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=Parser)

    def add(self, name: str, run: Callable[[argparse.Namespace], int | None], text: str) -> Parser:
        """A parser of a command, without options yet."""
        parser = self._parsers.add_parser(name, help=text, description=text)
        parser.set_defaults(run=run)
        return parser


def add_urdf(parser: argparse._ActionsContainer) -> None:
    """The option --urdf; `robot_of` reads it."""
    parser.add_argument(
        "--urdf", type=Path, metavar="FILE", help="an edited URDF; the paper's robot by default"
    )


def robot_of(arguments: argparse.Namespace) -> SST:
    """The robot that the options ask for."""
    return SST() if arguments.urdf is None else SST.from_urdf(arguments.urdf)


def chain_of(path: Path) -> ClosedChain:
    """Any robot: an MJCF by its suffix .xml, else a URDF beside its YAML."""
    if path.suffix == ".xml":
        return ClosedChain.from_mjcf(path)
    return ClosedChain.from_urdf(path)


def triple(text: str) -> Array:
    """Three numbers of an option, for argparse."""
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise argparse.ArgumentTypeError(f"{text!r} is not three numbers like 0.1,0.2,0.3")
    return numbers


def add_strict(parser: Parser) -> None:
    """The option --strict; `refuses` obeys it."""
    parser.add_argument(
        "--strict",
        action="store_true",
        help="a motion that the machine cannot take is an error: no files, exit code 1",
    )


def refuses(robot: SST, motion: Trajectory, arguments: argparse.Namespace) -> bool:
    """Say what the machine cannot take of a motion; whether that ends the command."""
    found = robot.check(motion)
    for finding in found:
        kind = "error" if arguments.strict else "warning"
        print(f"sst-pin: {kind}: {finding}", file=sys.stderr)
    return bool(found) and arguments.strict


def add_force(parser: Parser) -> None:
    """The option --force, for commands that write files."""
    parser.add_argument("--force", action="store_true", help="replace files that are there")


def add_output(parser: Parser, metavar: str) -> None:
    """The options --output and --force; `save` obeys them."""
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar=metavar, help="ends in .csv or .npz"
    )
    add_force(parser)


def add_figure(parser: Parser) -> None:
    """The options --output and --force of commands that draw."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="FIGURE",
        help="ends in .png, .svg or .pdf",
    )
    add_force(parser)


def save(motion: Trajectory, arguments: argparse.Namespace) -> None:
    """Write a motion where the options say."""
    motion.save(arguments.output, arguments.force)


def remark(motion: Trajectory) -> str:
    """Why a motion ended early, for the end of a line; else nothing."""
    return f"\n  {motion.stopped}" if motion.stopped else ""


@contextmanager
def progress_bar(what: str, start: float, end: float) -> Iterator[Callable[[float], None]]:
    """A bar over simulated time, shown when it takes more than two seconds."""
    with tqdm(
        total=round(end - start, 9),
        desc=what,
        unit="s",
        delay=2,
        leave=False,
        bar_format="{desc} {percentage:3.0f}% |{bar}| {n:.3g}/{total:.3g} s of motion",
    ) as bar:

        def reach(t: float) -> None:
            bar.update(max(t - start - bar.n, 0))

        yield reach


def version_of(package: str) -> str:
    """Its installed version, or that there is none."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "(not installed)"

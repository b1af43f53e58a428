# SPDX-License-Identifier: BSD-2-Clause
"""Options, progress bar and output of several commands."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ..chain.closed_chain import ClosedChain
from ..errors import MissingExtraError
from ..files import Writer, write_files
from ..motion import motion_files as any_motion_files
from ..motion.limits import beyond_limits
from ..motion.trajectories import Trajectory
from ..sst import motion_files
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
        self._parsers = parser.add_subparsers(metavar="COMMAND", parser_class=Parser)

    def add(self, name: str, run: Callable[[argparse.Namespace], int | None], text: str) -> Parser:
        """A parser of a command, without options yet."""
        parser = self._parsers.add_parser(name, help=text, description=text)
        parser.set_defaults(run=run)
        return parser


def add_urdf(parser: argparse._ActionsContainer) -> None:
    """The option --urdf; `robot_of` reads it."""
    parser.add_argument(
        "--urdf", type=Path, metavar="FILE", help="edited URDF of an SST (default: the paper's)"
    )


def robot_of(arguments: argparse.Namespace) -> SST:
    """The robot that the options ask for."""
    return SST() if arguments.urdf is None else SST.from_urdf(arguments.urdf)


def add_robot(parser: Parser) -> None:
    """The options --robot and --urdf; `any_robot_of` reads them."""
    options = parser.add_mutually_exclusive_group()
    options.add_argument(
        "--robot",
        type=Path,
        metavar="FILE",
        help="any robot: a URDF with its YAML beside it, or an MJCF",
    )
    add_urdf(options)


def any_robot_of(arguments: argparse.Namespace) -> ClosedChain:
    """The robot that --robot or --urdf asks for."""
    return robot_of(arguments) if arguments.robot is None else chain_of(arguments.robot)


def chain_of(path: Path) -> ClosedChain:
    """Any robot: an MJCF by its suffix .xml or .mjcf, else a URDF beside its YAML."""
    from ..reading.text import is_mjcf

    if is_mjcf(path):
        return ClosedChain.from_mjcf(path)
    return ClosedChain.from_urdf(path)


def source_of(path: Path) -> Path | BinaryIO:
    """A file, or standard input for `-`."""
    return sys.stdin.buffer if str(path) == "-" else path


def motion_in(robot: ClosedChain, path: Path) -> Trajectory:
    """The motion in a file or in standard input, its torques computed where it has none."""
    if isinstance(robot, SST):
        return motion_files.load_motion(robot, source_of(path))
    return any_motion_files.load_motion(robot, source_of(path))


def require_extras(**packages: str) -> None:
    """Refuse a job whose packages are missing; name all of them.

    Args:
        packages: The package that each extra brings.

    Raises:
        MissingExtraError: With every extra that is missing.
    """
    missing = {extra: name for extra, name in packages.items() if find_spec(name) is None}
    if missing:
        raise MissingExtraError(", ".join(missing.values()), ",".join(missing))


def named_numbers(text: str) -> dict[str, float]:
    """Numbers by name of an option, for argparse."""
    pairs = [part.rpartition("=") for part in text.split(",")]
    try:
        numbers = {name.strip(): float(value) for name, _, value in pairs}
    except ValueError:
        numbers = {}
    if len(numbers) != len(pairs) or "" in numbers or not np.isfinite([*numbers.values()]).all():
        raise argparse.ArgumentTypeError(f"{text!r} does not have the form crank=0.1,slide=0.2")
    return numbers


def triple(text: str) -> Array:
    """Three numbers of an option, for argparse."""
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise argparse.ArgumentTypeError(f"{text!r} is not three numbers such as 0.1,0.2,0.3")
    return numbers


def add_strict(parser: Parser) -> None:
    """The option --strict; `refuses` obeys it."""
    parser.add_argument(
        "--strict",
        action="store_true",
        help="if the machine cannot execute the motion, write nothing; exit code 1",
    )


def refuses(robot: ClosedChain, motion: Trajectory, arguments: argparse.Namespace) -> bool:
    """Print where the machine cannot execute a motion; whether this ends the command."""
    found: Sequence[object] = (
        robot.check(motion) if isinstance(robot, SST) else beyond_limits(robot, motion.q, motion.t)
    )
    for finding in found:
        kind = "error" if arguments.strict else "warning"
        print(f"sst-pin: {kind}: {finding}", file=sys.stderr)
    return bool(found) and arguments.strict


def add_force(parser: Parser) -> None:
    """The option --force, for commands that write files."""
    parser.add_argument("--force", action="store_true", help="replace existing files")


def add_output(parser: Parser, metavar: str) -> None:
    """The options --output and --force; `save` obeys them."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar=metavar,
        help="output file, .csv or .npz; - writes CSV to standard output",
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
        help="output file, .png, .svg or .pdf; - writes PNG to standard output",
    )
    add_force(parser)


def output_name(path: Path, ending: str) -> Path:
    """The name whose ending tells the format; standard output has one format."""
    return Path(f"standard output{ending}") if str(path) == "-" else path


def write(files: Mapping[Path, Writer], arguments: argparse.Namespace) -> None:
    """Write files, and to standard output what goes to `-`."""
    write_files({p: w for p, w in files.items() if str(p) != "-"}, arguments.force)
    for path, writer in files.items():
        if str(path) == "-":
            writer(sys.stdout.buffer)


def say(text: str, arguments: argparse.Namespace) -> None:
    """What was done: on standard output, unless that holds the result."""
    print(text, file=sys.stderr if str(arguments.output) == "-" else sys.stdout)


def save(motion: Trajectory, arguments: argparse.Namespace) -> None:
    """Write a motion where the options say."""
    name = output_name(arguments.output, ".csv")
    write({arguments.output: motion.writer(name)}, arguments)


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

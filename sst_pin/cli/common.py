# SPDX-License-Identifier: BSD-2-Clause
"""Options, progress bar and output of several commands."""

import argparse
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
from tqdm import tqdm

from .. import robots
from ..arrays import Array
from ..closed_chain import ClosedChain
from ..description.folder import YAML_PATH
from ..description.frames import JOINT_NAMES
from ..errors import InputError, MissingExtraError
from ..files import Writer, write_files
from ..reading import Urdf, is_mjcf, read_urdf
from ..simulation.trajectories import Trajectory
from ..sst.robot import SST

#: Endings of files that describe a robot.
_ROBOT_FILES = {".urdf", ".sdf", ".xml", ".mjcf"}


class Parser(argparse.ArgumentParser):
    """An argument parser that says what is wrong in one line; the usage is in --help."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        # What begins like a negative number is a value, as in --gravity -1,0,0.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; keep the words for the message of an error."""
        self._words = sys.argv[1:] if args is None else list(args)
        return super().parse_known_args(args, namespace)

    def option(self, spec: str, text: str, kind: Callable[[str], Any] = str, **how: Any) -> None:
        """An option such as "--psi DEG", without value "--all"; an argument such as "file FILE"."""
        name, _, metavar = spec.partition(" ")
        value = {"metavar": metavar, "type": kind} if metavar else {"action": "store_true"}
        self.add_argument(name, help=text, **value, **how)

    def add_input(self, name: str, what: str) -> None:
        """The argument for a table; `source_of` reads it."""
        self.option(f"{name} {name.upper()}.csv", f"the {what}; - means standard input", Path)

    def add_output(
        self, metavar: str, text: str = "output file, .csv or .npz; - writes CSV"
    ) -> None:
        """The options --output and --force; `save` and `write` obey them."""
        what = f"{text} to standard output"
        self.add_argument("-o", "--output", type=Path, required=True, metavar=metavar, help=what)
        self.add_force()

    def add_figure(self) -> None:
        """The options --output and --force of commands that draw."""
        self.add_output("FIGURE", "output file, .png, .svg or .pdf; - writes PNG")

    def add_folder(self, *names: str, **how: Any) -> None:
        """The option --output of commands that write a folder, perhaps by further names."""
        default = f" (default: {how['default']})" if "default" in how else ""
        text, names = f"created if it does not exist{default}", ("-o", "--output", *names)
        self.add_argument(*names, type=Path, metavar="FOLDER", help=text, **how)

    def add_force(self) -> None:
        """The option --force, for commands that write files."""
        self.option("--force", "replace existing files")

    def add_strict(self) -> None:
        """The option --strict; `refuses` obeys it."""
        text = "if the machine cannot execute the motion, write nothing; exit code 1"
        self.option("--strict", text)

    def error(self, message: str) -> NoReturn:
        """Leave with exit code 2."""
        self.exit(2, f"{self.prog}: error: {message}{misplaced(self._words)}\n")


class Commands:
    """The parsers of all commands."""

    def __init__(self, parser: Parser) -> None:
        self._parsers = parser.add_subparsers(metavar="COMMAND", parser_class=Parser)

    def add(
        self,
        name: str,
        run: Callable[[argparse.Namespace], int | None],
        text: str,
        *,
        robot: bool = True,
    ) -> Parser:
        """A parser of a command, with --robot unless it needs none; see `robot_of`, `sst_of`."""
        parser = self._parsers.add_parser(name, help=text, description=text)
        parser.set_defaults(run=run)
        if robot:
            parser.option(
                "--robot ROBOT",
                "a URDF with its YAML beside it, an SDF or MJCF, or a name of the gallery, "
                "such as delta (default: the SST of the paper)",
            )
        return parser


def robot_of(arguments: argparse.Namespace) -> ClosedChain:
    """The robot that --robot names; a file with the joints of an SST is an SST."""
    name = arguments.robot
    if name is None or name in _gallery():
        return SST() if name in (None, "sst") else getattr(robots, name)()
    path = Path(name)
    if not path.suffix and not path.exists():
        close = get_close_matches(name.lower(), _gallery(), 1)
        near = "".join(f"; did you mean {x}?" for x in close)
        names = ", ".join(_gallery())
        raise InputError("--robot", f"{name!r} is neither a file nor one of {names}{near}")
    if is_mjcf(path):
        return ClosedChain.from_mjcf(path)
    urdf = Urdf.read(path)
    if set(JOINT_NAMES) <= set(urdf.joint_names):
        return SST._of_file(read_urdf(urdf, default=YAML_PATH))
    return ClosedChain._of_file(read_urdf(urdf))


def sst_of(arguments: argparse.Namespace) -> SST:
    """The SST that --robot names; refuses another robot."""
    name = arguments.robot
    if name in (None, "sst"):
        return SST()
    if name in _gallery():
        raise InputError("--robot", f"{name} is not an SST, which this command needs")
    return (SST.from_mjcf if is_mjcf(Path(name)) else SST.from_urdf)(name)


def _gallery() -> list[str]:
    return ["sst", *(name for name in robots.__all__ if name.islower())]


def misplaced(words: Sequence[str]) -> str:
    """The end of an error message when a robot stands in the place of another argument."""
    for before, word in zip(["", *words], words, strict=False):
        if before != "--robot" and names_robot(word):
            return f"; did you mean --robot {word}?"
    return ""


def names_robot(word: str) -> bool:
    """Whether a word is a file of a robot, or a name of the gallery and no file."""
    return Path(word).suffix.lower() in _ROBOT_FILES or in_gallery(word)


def in_gallery(word: str) -> bool:
    """Whether a word is a name of the gallery and no file."""
    return word in _gallery() and not Path(word).exists()


def source_of(path: Path) -> Path | BinaryIO:
    """A file, or standard input for `-`; refuses a robot."""
    if hint := misplaced([str(path)]):
        raise InputError(str(path), f"is a robot, not a table{hint}")
    return sys.stdin.buffer if str(path) == "-" else path


def require_extras(**packages: str) -> None:
    """Refuse a job whose packages are missing; name all of them and the extras that bring them."""
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


def number(
    what: str, allowed: Callable[[float], bool], kind: Callable[[str], float] = float
) -> Callable[[str], float]:
    """A function that reads a number of an option, for argparse; `kind` is float or int."""

    def read(text: str) -> float:
        try:
            value = kind(text) if kind is float or text.isdecimal() else math.nan
        except ValueError:
            value = math.nan
        if not allowed(value):
            raise argparse.ArgumentTypeError(f"{text!r} is not {what}")
        return value

    return read


POSITIVE = number("a positive number", lambda x: 0 < x < math.inf)


def triple(text: str) -> Array:
    """Three numbers of an option, for argparse."""
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise argparse.ArgumentTypeError(f"{text!r} is not three numbers such as 0.1,0.2,0.3")
    return numbers


def refuses(robot: ClosedChain, motion: Trajectory, arguments: argparse.Namespace) -> bool:
    """Print where the machine cannot execute a motion; whether this ends the command."""
    return told(robot.check(motion), arguments)


def told(findings: Sequence[object], arguments: argparse.Namespace) -> bool:
    """Print what speaks against a motion; whether this ends the command."""
    for finding in findings:
        tell("error" if arguments.strict else "warning", finding)
    return bool(findings) and arguments.strict


def tell(kind: str, message: object) -> None:
    """Print an error or a warning in one line."""
    print(f"sst-pin: {kind}: {message}", file=sys.stderr)


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
    """Print a message: to standard output, or to standard error if that holds the result."""
    print(text, file=sys.stderr if str(arguments.output) == "-" else sys.stdout)


def save(motion: Trajectory, arguments: argparse.Namespace) -> None:
    """Write a motion where the options say."""
    name = output_name(arguments.output, ".csv")
    write({arguments.output: motion.writer(name)}, arguments)


def remark(motion: Trajectory) -> str:
    """The reason of a motion that ended early, for the end of a line; else nothing."""
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

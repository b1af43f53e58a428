# SPDX-License-Identifier: BSD-2-Clause
"""What several commands share: the robot, the input and the output that their options name."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import BinaryIO

from .. import robots
from ..closed_chain import ClosedChain
from ..description.folder import YAML_PATH
from ..description.frames import JOINT_NAMES
from ..errors import InputError, MissingExtraError
from ..files import Writer, write_files
from ..reading import Urdf, is_mjcf, read_urdf
from ..simulation.motion_files import TableReader, load_motion
from ..simulation.trajectories import Trajectory
from ..sst.robot import SST
from ..sst.star_tables import star_motion
from . import ClosedStream
from .commands import tell
from .parser import gallery, hint_for_robot


def robot_of(arguments: argparse.Namespace) -> ClosedChain:
    """The robot that --robot names: of the gallery, or of a file; by default an SST.

    A URDF that has all joints of an SST gives an `SST`.
    """
    name = arguments.robot
    names = gallery()
    model = arguments.model
    if model is not None and (name is None or name in names or is_mjcf(Path(name))):
        raise InputError("--model", "only for an SDF; name it by --robot")
    if name is None or name == "sst":
        return SST()
    if name in names:
        robot: ClosedChain = getattr(robots, name)()
        return robot
    path = Path(name)
    if not path.suffix and not path.exists():
        text = f"{name!r} is neither a file nor one of {', '.join(names)}"
        similar = get_close_matches(name.lower(), names, 1)
        if similar:
            text += f"; did you mean {similar[0]}?"
        raise InputError("--robot", text)
    if is_mjcf(path):
        return ClosedChain.from_mjcf(path)
    urdf = Urdf.read(path, model)
    if set(JOINT_NAMES) <= set(urdf.joint_names):
        return SST.from_description(read_urdf(urdf, default=YAML_PATH))
    return ClosedChain.from_description(read_urdf(urdf))


def table_reader(robot: ClosedChain) -> TableReader | None:
    """A reader of motion tables that only an SST has, or None."""
    return partial(star_motion, robot) if isinstance(robot, SST) else None


def motion_of(robot: ClosedChain, path: Path) -> Trajectory:
    """The motion of a robot in a file, or in the standard input."""
    return load_motion(robot.engine, source_of(path), table_reader(robot))


def sst_of(arguments: argparse.Namespace) -> SST:
    """The SST that --robot names.

    Raises:
        InputError: For a robot of the gallery, or with --model.
        SSTError: If the file does not have an SST.
    """
    name = arguments.robot
    if name in (None, "sst"):
        return SST()
    if name in gallery():
        raise InputError("--robot", f"{name} is not an SST, which this command needs")
    if getattr(arguments, "model", None) is not None:
        raise InputError("--model", "not for the folder of an SST; write the model to a file .xml")
    if is_mjcf(Path(name)):
        return SST.from_mjcf(name)
    return SST.from_urdf(name)


def source_of(path: Path) -> Path | BinaryIO:
    """A file, or standard input for `-`; an InputError for a robot instead of a table."""
    hint = hint_for_robot([str(path)])
    if hint:
        raise InputError(str(path), f"is a robot, not a table{hint}")
    return sys.stdin.buffer if str(path) == "-" else path


def require_extras(**packages: str) -> None:
    """Raise a MissingExtraError if packages are missing.

    `packages` are keyword arguments: the name of an extra, and as value one of its packages.
    """
    missing = {extra: name for extra, name in packages.items() if find_spec(name) is None}
    if missing:
        raise MissingExtraError(", ".join(missing.values()), ",".join(missing))


def print_findings(findings: Sequence[object], arguments: argparse.Namespace) -> bool:
    """Print warnings about a motion; True if the command must stop because of them."""
    for finding in findings:
        tell("error" if arguments.strict else "warning", finding)
    return bool(findings) and arguments.strict


def output_name(path: Path, ending: str) -> Path:
    """The file name whose ending selects the format; standard output has the format `ending`."""
    return Path(f"standard output{ending}") if str(path) == "-" else path


def write(files: Mapping[Path, Writer], arguments: argparse.Namespace) -> None:
    """Write files; the name `-` means standard output."""
    on_disk = {path: writer for path, writer in files.items() if str(path) != "-"}
    write_files(on_disk, arguments.force)
    for path, writer in files.items():
        if path not in on_disk:
            writer(sys.stdout.buffer)


def say(text: str, arguments: argparse.Namespace) -> None:
    """Print a message.

    It goes to standard output, or to standard error if standard output gets the result.
    """
    stream = sys.stderr if str(arguments.output) == "-" else sys.stdout
    if not isinstance(stream, ClosedStream):
        print(text, file=stream)


def save(motion: Trajectory, arguments: argparse.Namespace) -> None:
    """Write a motion to the output that the options name."""
    name = output_name(arguments.output, ".csv")
    write({arguments.output: motion.writer(name)}, arguments)


def early_end(motion: Trajectory) -> str:
    """Why a motion ended early, as the end of a line; empty if it did not."""
    return f"\n  {motion.stopped}" if motion.stopped else ""

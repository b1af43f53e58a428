# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin plot`: figures of a motion."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import FileFormatError
from ..files import read_table, write_files
from ..motion.trajectories import Trajectory
from ..sst.motion_files import read_motion
from ..sst.robot import SST
from .common import Commands, add_figure, add_urdf, robot_of

#: As in `plots.SUBJECTS`, which needs matplotlib.
SUBJECTS = ("path", "torques", "joints", "rates", "power", "energy", "condition")


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "plot",
        _run,
        "Figures of a motion: what `torques` or `simulate` wrote, or a motion of the star.",
    )
    add_urdf(parser)
    parser.add_argument("motion", type=Path, metavar="MOTION.csv")
    add_figure(parser)
    parser.add_argument(
        "--what",
        type=_subjects,
        metavar="A,B,..",
        help=f"of {', '.join(SUBJECTS)} (default: a page of all but power)",
    )


def _subjects(text: str) -> tuple[str, ...]:
    subjects = tuple(part.strip() for part in text.split(","))
    unknown = [subject for subject in subjects if subject not in SUBJECTS]
    if unknown:
        raise argparse.ArgumentTypeError(
            f"{unknown[0]!r} unknown; known: {', '.join(SUBJECTS)}, joined by commas"
        )
    return subjects


def _run(arguments: argparse.Namespace) -> None:
    from .. import plots  # needs the extra `plot`

    plots.require_ending(arguments.output)
    robot = robot_of(arguments)
    motion = _motion(robot, arguments.motion)
    subjects = arguments.what or [s for s in SUBJECTS if s != "power"]
    figure = plots.motion_page(robot, motion, subjects)
    files = {arguments.output: plots.figure_writer(figure, arguments.output)}
    write_files(files, arguments.force)
    print(f"{', '.join(subjects)} of {len(motion)} samples -> {arguments.output}")


def _motion(robot: SST, path: Path) -> Trajectory:
    """A motion with its torques as it stands, else one whose torques are still to be found."""
    whole = {f"{name}_rad" for name in robot.joint_names} | {"tau_1_Nm"}
    if path.suffix.lower() != ".npz" and not whole <= set(read_table(path).columns):
        return read_motion(robot, path)
    motion = Trajectory.load(path)
    if motion.joint_names != tuple(robot.joint_names):
        raise FileFormatError(path, f"a motion of another robot: {', '.join(motion.joint_names)}")
    if len(motion) < 2:
        raise FileFormatError(path, "one sample; a curve needs two at least")
    return motion

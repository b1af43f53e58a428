# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin show`: the robot in motion in a browser, on a page, in pictures."""

from __future__ import annotations

import argparse
import threading
import webbrowser
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..files import read_table, write_files
from ..motion.trajectories import Trajectory
from ..sst.motion_files import read_motion
from ..sst.paper import PERIOD, example_1
from ..sst.robot import SST
from .common import Commands, Parser, add_force, add_urdf, robot_of


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser: Parser = commands.add(
        "show",
        _run,
        "Play a motion in the browser until Ctrl-C, with its torques; example 1 of the paper "
        "without a file. With --html, --png or --gif it writes files instead.",
    )
    add_urdf(parser)
    parser.add_argument(
        "motion", type=Path, nargs="?", metavar="MOTION.csv", help="as for `torques`, or its output"
    )
    parser.add_argument(
        "--speed",
        type=_positive,
        metavar="S",
        help="1 is true speed, the default for a file; the example is played at 0.1",
    )
    for kind, text in (
        ("html", "one page that needs no network"),
        ("png", "a picture; needs Chromium"),
        ("gif", "an animation; needs Chromium"),
    ):
        parser.add_argument(f"--{kind}", type=Path, metavar="FILE", help=f"write {text}")
    parser.add_argument("--axes", action="store_true", help="show the joint axes e_1..9")
    parser.add_argument("--frames", action="store_true", help="show the frames {0k}..{3k}, {E}")
    parser.add_argument(
        "--interactive", action="store_true", help="move the robot by hand; takes no motion"
    )
    parser.add_argument("--no-open", action="store_true", help="print the URL, open no browser")
    parser.add_argument("--host", default="127.0.0.1", help="listen there; this machine alone")
    parser.add_argument("--port", type=int, default=0, help="listen there; any that is free")
    add_force(parser)


def _positive(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not (0 < number < np.inf):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return number


def _run(arguments: argparse.Namespace) -> None:
    robot = robot_of(arguments)
    if arguments.interactive:
        from ..viewer.interactive import Interactive  # needs the extra `interactive`

        with Interactive(robot, arguments.host, arguments.port) as page:
            _wait(page.url, arguments.no_open)
        return
    from ..viewer import Viewer  # needs the extra `viz`

    if arguments.motion is None:
        motion, speed = example_1(robot, np.linspace(0, PERIOD, 201)), 0.1
        title = "Example 1: the circle"
    else:
        motion, speed = _motion(robot, arguments.motion), 1.0
        title = arguments.motion.name
    with Viewer(robot, axes=arguments.axes, frames=arguments.frames) as viewer:
        viewer.play(motion, speed=arguments.speed or speed, title=title)
        wanted = [arguments.html, arguments.png, arguments.gif]
        files = {path: viewer.writer(path) for path in wanted if path is not None}
        if files:
            write_files(files, arguments.force)
            print(f"{title}, {motion.t[-1] - motion.t[0]:g} s -> {', '.join(map(str, files))}")
        else:
            url = viewer.serve(arguments.host, arguments.port)
            _wait(url, arguments.no_open)


def _motion(robot: SST, path: Path) -> Trajectory:
    """What `torques` has written as it stands there, or the torques of a motion."""
    if path.suffix.lower() == ".npz":
        return Trajectory.load(path)
    whole = {"mu_1_rad", "tau_1_Nm"} <= set(read_table(path).columns)
    return Trajectory.load(path) if whole else read_motion(robot, path)


def _wait(url: str, no_open: bool) -> None:
    """Until Ctrl-C."""
    print(f"{url}  (Ctrl-C ends)", flush=True)
    if not no_open:
        webbrowser.open(url)
    with suppress(KeyboardInterrupt):
        threading.Event().wait()

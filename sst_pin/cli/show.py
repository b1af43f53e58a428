# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin show`: the robot in motion in a browser, on a page, in pictures."""

from __future__ import annotations

import argparse
import threading
import webbrowser
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..errors import InputError, OutputError
from ..files import write_files
from ..sst.motion_files import load_motion
from ..sst.paper import PERIOD, example_1
from .common import Commands, Parser, add_force, add_strict, add_urdf, refuses, robot_of


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
        help="1 is real time, the default for a file; the example is played at 0.1",
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
    parser.add_argument("--port", type=_port, default=0, help="listen there; any that is free")
    add_force(parser)
    add_strict(parser)


def _positive(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not (0 < number < np.inf):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return number


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port, a whole number up to 65535")
    return int(text)


def _run(arguments: argparse.Namespace) -> int:
    robot = robot_of(arguments)
    if arguments.interactive:
        for name in ("motion", "speed", "html", "png", "gif", "axes", "frames", "strict"):
            if getattr(arguments, name):
                raise InputError("--interactive", f"moves the robot by hand and takes no {name}")
        from ..viewer.interactive import Interactive  # needs the extra `interactive`

        with Interactive(robot, arguments.host, arguments.port) as page:
            _wait(page.url, arguments.no_open)
        return 0
    from ..viewer import Viewer  # needs the extra `viz`

    if arguments.motion is None:
        motion, speed = example_1(robot, np.linspace(0, PERIOD, 201)), 0.1
        title = "Example 1: the circle"
    else:
        motion, speed = load_motion(robot, arguments.motion), 1.0
        title = arguments.motion.name
    if refuses(robot, motion, arguments):
        return 1
    with Viewer(robot, axes=arguments.axes, frames=arguments.frames) as viewer:
        viewer.play(motion, speed=arguments.speed or speed, title=title)
        wanted = [(f".{kind}", getattr(arguments, kind)) for kind in ("html", "png", "gif")]
        for ending, path in wanted:
            if path is not None and path.suffix.lower() != ending:
                raise OutputError(path, f"the ending should be {ending}")
        files = {path: viewer.writer(path) for _, path in wanted if path is not None}
        if files:
            write_files(files, arguments.force)
            print(f"{title}, {motion.t[-1] - motion.t[0]:g} s -> {', '.join(map(str, files))}")
        else:
            url = viewer.serve(arguments.host, arguments.port)
            _wait(url, arguments.no_open)
    return 0


def _wait(url: str, no_open: bool) -> None:
    """Until Ctrl-C."""
    print(f"{url}  (Ctrl-C ends)", flush=True)
    if not no_open:
        webbrowser.open(url)
    with suppress(KeyboardInterrupt):
        threading.Event().wait()

# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin show`: animations of a robot in a browser, as a page, as pictures."""

import argparse
import threading
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ..closed_chain import ClosedChain
from ..errors import InputError, OutputError
from ..files import write_files
from ..loops.starts import start_of
from ..simulation.motion_files import load_motion
from ..simulation.trajectories import Trajectory
from ..sst.paper import PERIOD, example_1
from ..sst.robot import SST
from . import common

_PORT = common.number("a port, a whole number up to 65535", lambda n: n <= 65535, int)


def add_show(commands: common.Commands) -> None:
    """Animations of a robot."""
    parser = commands.add(
        "show",
        _run,
        "Play a motion and its torques in the browser until Ctrl-C. Without a file, show example 1 "
        "of the paper, or with --robot one configuration of the robot. With --html, --png or "
        "--gif, write files instead.",
    )
    text = "input or output of `torques`, or output of `simulate`; - means standard input"
    parser.option("motion MOTION", text, Path, nargs="?")
    text = "a second motion, such as the planned one, which a translucent robot plays beside it"
    parser.option("--ghost FILE", text, Path)
    text = "speed of the animation; 1 is real time (default: 1 for a file, 0.1 for the example)"
    parser.option("--speed S", text, common.POSITIVE)
    for kind, text in (
        ("html", "one page that needs no network"),
        ("png", "a picture; needs Chromium"),
        ("gif", "an animation; needs Chromium"),
    ):
        parser.option(f"--{kind} FILE", f"write {text}", Path)
    parser.option("--axes", "show the axes of the joints")
    parser.option("--frame NAME", "draw the path of this frame (default: platform; E of an SST)")
    parser.option("--frames", "show frames: of an SST {0k}..{3k}, {E}; of closures")
    parser.option("--reactions", "show the forces in joints and closures")
    parser.option("--skeleton", "draw joints, lines and masses instead of shapes")
    parser.option(
        "--live",
        "a page that also computes: sliders, dragging, simulation; robots other than the SST "
        "need CasADi",
    )
    parser.option("--no-open", "print the URL, open no browser")
    parser.option(
        "--host HOST", "address of the server (default: this machine only)", default="127.0.0.1"
    )
    parser.option("--port PORT", "port of the server (default: any free port)", _PORT, default=0)
    parser.add_force()
    parser.add_strict()


def _run(arguments: argparse.Namespace) -> int:
    looks: dict[str, Any] = {"axes": arguments.axes, "frames": arguments.frames}
    looks["visual_model"] = pin.GeometryModel() if arguments.skeleton else None
    from ..viewer import Viewer  # needs the extra `viz`

    robot, motion, speed, title = _asked_for(arguments)
    wanted = [(f".{kind}", getattr(arguments, kind)) for kind in ("html", "png", "gif")]
    for ending, path in wanted:
        if path is not None and path.suffix.lower() != ending:
            raise OutputError(path, f"the ending should be {ending}")
    looks |= {name: getattr(arguments, name) for name in ("frame", "reactions", "live")}
    if arguments.ghost is not None and motion is None:
        raise InputError("--ghost", "only beside a motion")
    ghost = arguments.ghost and load_motion(robot, common.source_of(arguments.ghost))
    with Viewer(robot, **looks) as viewer:
        if motion is None:
            viewer.show(start_of(robot))
        else:
            viewer.play(motion, speed=arguments.speed or speed, ghost=ghost, title=title)
        if common.told(viewer.warnings, arguments):
            return 1
        files = {path: viewer.writer(path) for _, path in wanted if path is not None}
        if files:
            write_files(files, arguments.force)
            length = "" if motion is None else f", {motion.t[-1] - motion.t[0]:g} s"
            print(f"{title}{length} -> {', '.join(map(str, files))}")
        else:
            url = viewer.serve(arguments.host, arguments.port)
            print(f"{url}  (Ctrl-C ends)", flush=True)
            if not arguments.no_open:
                webbrowser.open(url)
            with suppress(KeyboardInterrupt):
                threading.Event().wait()
    return 0


def _asked_for(arguments: argparse.Namespace) -> tuple[ClosedChain, Trajectory | None, float, str]:
    """Robot, motion, speed and title."""
    path, robot = arguments.motion, common.robot_of(arguments)
    if path is not None:
        return robot, load_motion(robot, common.source_of(path)), 1.0, path.name
    if arguments.robot is None:
        example = example_1(SST(), np.linspace(0, PERIOD, 201))
        return robot, example, 0.1, "Example 1: the circle"
    return robot, None, 1.0, robot.mechanism.model.name

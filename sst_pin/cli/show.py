# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin show`: animations of a robot in a browser, as a page, as pictures."""

import argparse
import threading
import webbrowser
from contextlib import suppress
from typing import Any

import numpy as np
import pinocchio as pin

from ..closed_chain import ClosedChain
from ..errors import InputError, OutputError
from ..files import write_files
from ..loops.start import start_of
from ..simulation.trajectories import Trajectory
from ..sst.paper import PERIOD, example_1
from ..sst.robot import SST
from . import common


def show(arguments: argparse.Namespace) -> int:
    """Animations of a robot."""
    looks: dict[str, Any] = {"axes": arguments.axes, "frames": arguments.frames}
    looks["visual_model"] = pin.GeometryModel() if arguments.skeleton else None
    from ..viewer import Viewer  # needs the extra `viz`

    robot, motion, speed, title = _asked_for(arguments)
    kinds = (kind for kind in ("html", "png", "gif") if getattr(arguments, kind) is not None)
    outputs = {f".{kind}": getattr(arguments, kind) for kind in kinds}
    for ending, path in outputs.items():
        if path.suffix.lower() != ending:
            raise OutputError(path, f"the ending should be {ending}")
    looks |= {name: getattr(arguments, name) for name in ("frame", "reactions", "live")}
    if arguments.ghost is not None and motion is None:
        raise InputError("--ghost", "only beside a motion")
    ghost = arguments.ghost and common.motion_of(robot, arguments.ghost)
    speed = speed if arguments.speed is None else arguments.speed
    with Viewer(robot, **looks) as viewer:
        if motion is None:
            viewer.show(start_of(robot.engine))
        else:
            viewer.play(motion, speed=speed, ghost=ghost, title=title)
        if common.refuses(viewer.warnings, arguments):
            return 1
        if files := {path: viewer.writer(path) for path in outputs.values()}:
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
    path, robot = arguments.motion, common.robot_of(arguments)
    if path is not None:
        return robot, common.motion_of(robot, path), 1.0, path.name
    if arguments.robot is None:
        example = example_1(SST(), np.linspace(0, PERIOD, 201))
        return robot, example, 0.1, "Example 1: the circle"
    return robot, None, 1.0, robot.mechanism.model.name

# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin torques`, `simulate`, `plot` and `show`: from a motion or its torques.

The commands return their exit codes: 0, 1 if findings stop them (with --strict), or `CUT_SHORT`.
"""

import argparse
import threading
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..closed_chain import ClosedChain
from ..errors import FileFormatError, InputError, OutputError
from ..files import write_files
from ..loops.start import start_of
from ..simulation.motion_columns import printed_units
from ..simulation.motion_files import motion_table, read_motion, read_start, read_torques
from ..simulation.trajectories import Trajectory
from ..sst.paper import PERIOD, example_1
from ..sst.robot import SST
from ..summaries import listed
from . import common

#: Exit code for a motion that stops early; the part before the stop is written.
CUT_SHORT = 3


def torques(arguments: argparse.Namespace) -> int:
    """Inverse dynamics of a motion file."""
    robot = common.robot_of(arguments)
    source = common.source_of(arguments.motion)
    motion = read_motion(robot.engine, source, common.table_reader(robot))
    must_stop = common.print_findings(robot.check_limits(motion), arguments)
    if must_stop:
        return 1
    common.save(motion, arguments)
    peaks = np.abs(motion.tau).max(axis=0)
    units = printed_units(motion.torque_units)
    if len(set(units)) == 1 and len(peaks) <= 3:
        shown = f"{', '.join(f'{peak:.4g}' for peak in peaks)} {units[0]}"
    else:
        peaks_of_motors = zip(motion.motor_names, peaks, units, strict=True)
        shown = listed([f"{name} {peak:.4g} {unit}" for name, peak, unit in peaks_of_motors])
    common.say(f"{len(motion)} samples, peak torques {shown} -> {arguments.output}", arguments)
    start = zip(motion.joint_names, motion.q[0], strict=True)
    common.say(f"  starts at {listed([f'{name} {x:.4g}' for name, x in start])}", arguments)
    return 0


def simulate(arguments: argparse.Namespace) -> int:
    """Direct dynamics of a torque file."""
    robot = common.robot_of(arguments)
    table = motion_table(robot.mechanism, common.source_of(arguments.torques))
    tau = read_torques(robot.mechanism, table)
    t = table.column("t_s")
    if len(t) < 2:
        raise FileFormatError(table.path, "one row; a simulation needs at least two times")
    q0, va0 = read_start(robot.engine, table, arguments.q0, arguments.va0)
    motion = robot.simulate(tau, q0, va0, t)
    must_stop = common.print_findings(robot.check_limits(motion), arguments)
    if must_stop:
        return 1
    common.save(motion, arguments)
    text = f"{len(motion)} samples to t = {motion.t[-1]:g} s -> {arguments.output}"
    common.say(text + common.early_end(motion), arguments)
    return CUT_SHORT if motion.stopped else 0


def plot(arguments: argparse.Namespace) -> int:
    """Figures of a motion."""
    from .. import plots  # needs the extra `plot`

    name = common.output_name(arguments.output, ".png")
    plots.picture_kind(name)
    robot = common.robot_of(arguments)
    motion = common.motion_of(robot, arguments.motion)
    if len(motion) < 2:
        raise FileFormatError(arguments.motion, "has one sample; a curve needs at least two")
    must_stop = common.print_findings(robot.check_limits(motion), arguments)
    if must_stop:
        return 1
    figure = plots.motion_page(robot, motion, arguments.what, arguments.frame)
    common.write({arguments.output: plots.figure_writer(figure, name)}, arguments)
    what = ", ".join(arguments.what or plots.summary_of(robot, arguments.frame))
    common.say(f"{what} of {len(motion)} samples -> {arguments.output}", arguments)
    return 0


def show(arguments: argparse.Namespace) -> int:
    """Animations of a robot: in a browser, as a page, or as pictures."""
    from ..viewer import Viewer  # needs the extra `viz`

    robot, motion, default_speed, title = _scene(arguments)
    outputs = _outputs(arguments)
    ghost = None
    if arguments.ghost is not None:
        if motion is None:
            raise InputError("--ghost", "only beside a motion")
        ghost = common.motion_of(robot, arguments.ghost)
    speed = default_speed if arguments.speed is None else arguments.speed

    # The page.
    viewer = Viewer(
        robot,
        # An empty model has no shapes: the robot is drawn as a skeleton. None: its own shapes.
        visual_model=pin.GeometryModel() if arguments.skeleton else None,
        axes=arguments.axes,
        frames=arguments.frames,
        frame=arguments.frame,
        reactions=arguments.reactions,
        live=arguments.live,
    )
    with viewer:
        if motion is None:
            viewer.show(start_of(robot.engine))
        else:
            viewer.play(motion, speed=speed, ghost=ghost, title=title)
        must_stop = common.print_findings(viewer.warnings, arguments)
        if must_stop:
            return 1
        if outputs:
            write_files({path: viewer.writer(path) for path in outputs}, arguments.force)
            length = "" if motion is None else f", {motion.t[-1] - motion.t[0]:g} s"
            print(f"{title}{length} -> {', '.join(map(str, outputs))}")
        else:
            url = viewer.serve(arguments.host, arguments.port)
            print(f"{url}  (Ctrl-C ends)", flush=True)
            if not arguments.no_open:
                webbrowser.open(url)
            with suppress(KeyboardInterrupt):
                threading.Event().wait()
    return 0


def _outputs(arguments: argparse.Namespace) -> list[Path]:
    """The files that the options name; a wrong ending is refused."""
    outputs = []
    for kind in ("html", "png", "gif"):
        path = vars(arguments)[kind]
        if path is None:
            continue
        if path.suffix.lower() != f".{kind}":
            raise OutputError(path, f"the ending should be .{kind}")
        outputs.append(path)
    return outputs


class _Scene(NamedTuple):
    """What `show` shows."""

    robot: ClosedChain
    motion: Trajectory | None  #: None for a robot that stands still.
    speed: float  #: Default speed of the animation; 1 is real time.
    title: str


def _scene(arguments: argparse.Namespace) -> _Scene:
    """The robot and the motion that the options name.

    Without a motion, a robot that --robot names stands still. Without both, it is the paper's
    example 1, at a tenth of its speed.
    """
    path = arguments.motion
    robot = common.robot_of(arguments)
    if path is not None:
        return _Scene(robot, common.motion_of(robot, path), 1.0, path.name)
    if arguments.robot is None:
        assert isinstance(robot, SST)  # `robot_of` makes one if there is no --robot
        example = example_1(robot, np.linspace(0, PERIOD, 201))
        return _Scene(robot, example, 0.1, "Example 1: the circle")
    return _Scene(robot, None, 1.0, robot.mechanism.model.name)

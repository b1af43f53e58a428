# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin torques`, `simulate` and `plot`: from a motion or its torques."""

import argparse

import numpy as np

from ..errors import FileFormatError
from ..simulation.motion_files import motion_table, read_motion, read_start, read_torques
from ..summaries import listed
from . import common

#: Exit code of a motion that stops before the last time; the motion until then is written.
CUT_SHORT = 3


def torques(arguments: argparse.Namespace) -> int:
    """Inverse dynamics of a motion file."""
    robot, source = common.robot_of(arguments), common.source_of(arguments.motion)
    motion = read_motion(robot.engine, source, common.table_reader(robot))
    if common.refuses(robot.check(motion), arguments):
        return 1
    common.save(motion, arguments)
    peaks = np.abs(motion.tau).max(axis=0)
    units = [unit.replace("Nm", "N m") for unit in motion.torque_units]
    if len(set(units)) == 1 and len(peaks) <= 3:
        shown = f"{', '.join(f'{peak:.4g}' for peak in peaks)} {units[0]}"
    else:
        rows = zip(motion.actuated, peaks, units, strict=True)
        shown = listed([f"{name} {peak:.4g} {unit}" for name, peak, unit in rows])
    common.say(f"{len(motion)} samples, peak torques {shown} -> {arguments.output}", arguments)
    start = zip(motion.joint_names, motion.q[0], strict=True)
    common.say(f"  starts at {listed([f'{name} {x:.4g}' for name, x in start])}", arguments)
    return 0


def simulate(arguments: argparse.Namespace) -> int:
    """Direct dynamics of a torque file."""
    robot = common.robot_of(arguments)
    table = motion_table(robot.mechanism, common.source_of(arguments.torques))
    tau, t = read_torques(robot.mechanism, table), table.column("t_s")
    if len(t) < 2:
        raise FileFormatError(table.path, "one row; a simulation needs at least two times")
    q0, va0 = read_start(robot.engine, table, arguments.q0, arguments.va0)
    motion = robot.simulate(tau, q0, va0, t)
    if common.refuses(robot.check(motion), arguments):
        return 1
    common.save(motion, arguments)
    text = f"{len(motion)} samples to t = {motion.t[-1]:g} s -> {arguments.output}"
    common.say(text + common.remark(motion), arguments)
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
    if common.refuses(robot.check(motion), arguments):
        return 1
    figure = plots.motion_page(robot, motion, arguments.what, arguments.frame)
    common.write({arguments.output: plots.figure_writer(figure, name)}, arguments)
    what = ", ".join(arguments.what or plots.summary_of(robot, arguments.frame))
    common.say(f"{what} of {len(motion)} samples -> {arguments.output}", arguments)
    return 0

# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin torques`, `simulate` and `plot`: from a motion or its torques."""

import argparse

import numpy as np

from ..errors import FileFormatError
from ..simulation.motion_files import (
    load_motion,
    motion_table,
    read_motion,
    read_start,
    read_torques,
)
from ..summaries import listed
from . import common

#: Exit code of a motion that stops before the last time; the motion until then is written.
CUT_SHORT = 3
#: `plots.SUBJECTS`, without importing matplotlib.
SUBJECTS = ("path", "torques", "joints", "rates", "power", "energy", "condition")


def add_torques(commands: common.Commands) -> None:
    """Inverse dynamics of a motion file."""
    parser = commands.add(
        "torques",
        _torques,
        "Compute the motor torques of a motion (inverse dynamics). The columns of the file: for "
        "an SST t_s and qw, qx, qy, qz, or theta, phi, psi, or gamma_1..3 (names of angles end in "
        "_rad or _deg); for any --robot t_s and one column for each coordinate, such as crank_rad, "
        "crank_deg, slide_m.",
    )
    parser.add_input("motion", "motion")
    parser.add_output("TORQUES.csv")
    parser.add_strict()


def _torques(arguments: argparse.Namespace) -> int:
    robot, source = common.robot_of(arguments), common.source_of(arguments.motion)
    motion = read_motion(robot, source)
    if common.refuses(robot, motion, arguments):
        return 1
    common.save(motion, arguments)
    peaks = np.abs(motion.tau).max(axis=0)
    units = [unit.replace("Nm", "N m") for unit in motion.torque_units]
    if len(set(units)) == 1 and len(peaks) <= 3:
        told = f"{', '.join(f'{peak:.4g}' for peak in peaks)} {units[0]}"
    else:
        found = zip(motion.actuated, peaks, units, strict=True)
        told = listed([f"{name} {peak:.4g} {unit}" for name, peak, unit in found])
    common.say(f"{len(motion)} samples, peak torques {told} -> {arguments.output}", arguments)
    start = zip(motion.joint_names, motion.q[0], strict=True)
    common.say(f"  starts at {listed([f'{name} {x:.4g}' for name, x in start])}", arguments)
    return 0


def add_simulate(commands: common.Commands) -> None:
    """Direct dynamics of a torque file."""
    parser = commands.add(
        "simulate",
        _simulate,
        "Compute the motion for given torques (direct dynamics). The columns of the file are t_s, "
        "tau_1_Nm, tau_2_Nm, .. (tau_1_N for a linear motor). The motion starts at the state in "
        "the first row, if the file has columns for it (gamma_1_rad, .., gamma_1_rad_s, ..: the "
        "names of the joints). Otherwise give the start by --q0 and --va0. Exit code 3: the "
        "simulation stopped before a singularity.",
    )
    parser.add_input("torques", "torques")
    parser.add_output("MOTION.csv")
    parser.add_strict()
    text = "initial positions of joints, at least of the coordinates, rad or m"
    parser.option("--q0 JOINT=X,..", text, common.named_numbers)
    text = "initial rates of the coordinates, rad/s or m/s (default with --q0: 0)"
    parser.option("--va0 JOINT=V,..", text, common.named_numbers)


def _simulate(arguments: argparse.Namespace) -> int:
    robot = common.robot_of(arguments)
    table = motion_table(robot, common.source_of(arguments.torques))
    tau, t = read_torques(robot, table), table.column("t_s")
    if len(t) < 2:
        raise FileFormatError(table.path, "one row; a simulation needs at least two times")
    q0, va0 = read_start(robot, table, arguments.q0, arguments.va0)
    with common.progress_bar("simulating", t[0], t[-1]) as progress:
        motion = robot.simulate(tau, q0, va0, t, progress=progress)
    if common.refuses(robot, motion, arguments):
        return 1
    common.save(motion, arguments)
    reached = f"{len(motion)} samples to t = {motion.t[-1]:g} s -> {arguments.output}"
    common.say(reached + common.remark(motion), arguments)
    return CUT_SHORT if motion.stopped else 0


def add_plot(commands: common.Commands) -> None:
    """Figures of a motion."""
    parser = commands.add(
        "plot",
        _plot,
        "Draw figures of a motion. The file is an output of `torques` or `simulate`, or an input "
        "of `torques`.",
    )
    parser.add_input("motion", "motion")
    parser.add_figure()
    parser.add_strict()
    parser.option(
        "--what A,B,..",
        f"one or more of {', '.join(SUBJECTS)} (default: all except power; path only for an "
        "SST, or with --frame)",
        _subjects,
    )
    parser.option(
        "--frame NAME",
        "draw the path of this frame in the axes of the base (default: platform; for an SST "
        "the path of E on its sphere)",
    )


def _subjects(text: str) -> tuple[str, ...]:
    subjects = tuple(part.strip() for part in text.split(","))
    unknown = [subject for subject in subjects if subject not in SUBJECTS]
    if unknown:
        raise argparse.ArgumentTypeError(
            f"{unknown[0]!r} unknown; known: {', '.join(SUBJECTS)}, separated by commas"
        )
    return subjects


def _plot(arguments: argparse.Namespace) -> int:
    from .. import plots  # needs the extra `plot`

    name = common.output_name(arguments.output, ".png")
    plots.picture_kind(name)
    robot = common.robot_of(arguments)
    motion = load_motion(robot, common.source_of(arguments.motion))
    if len(motion) < 2:
        raise FileFormatError(arguments.motion, "has one sample; a curve needs at least two")
    if common.refuses(robot, motion, arguments):
        return 1
    figure = plots.motion_page(robot, motion, arguments.what, arguments.frame)
    common.write({arguments.output: plots.figure_writer(figure, name)}, arguments)
    what = ", ".join(arguments.what or plots.summary_of(robot, arguments.frame))
    common.say(f"{what} of {len(motion)} samples -> {arguments.output}", arguments)
    return 0

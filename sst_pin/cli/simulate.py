# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin simulate`: direct dynamics of a torque file."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError, InputError
from ..files import Table, read_table
from ..motion.motion_files import read_start, read_torques
from ..sst.robot import SST
from .common import (
    Commands,
    add_output,
    add_robot,
    add_strict,
    any_robot_of,
    named_numbers,
    progress_bar,
    refuses,
    remark,
    save,
    say,
    source_of,
    triple,
)

Array = NDArray[np.float64]

#: Exit code of a motion that stops before the last time; the motion until then is written.
CUT_SHORT = 3


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "simulate",
        _run,
        "Compute the motion for given torques (direct dynamics). The columns of the file are t_s, "
        "tau_1_Nm, tau_2_Nm, .. (tau_1_N for a linear motor). The motion starts at the state in "
        "the first row, if the file has columns for it (gamma_1_rad, .., gamma_1_rad_s, ..; with "
        "--robot the names of its joints). Otherwise give the start by --gamma and --gamma-dot, "
        "or with --robot by --q0 and --va0. Exit code 3: the simulation stopped before a "
        "singularity.",
    )
    add_robot(parser)
    parser.add_argument(
        "torques", type=Path, metavar="TORQUES.csv", help="the torques; - means standard input"
    )
    add_output(parser, "MOTION.csv")
    add_strict(parser)
    parser.add_argument(
        "--gamma", type=triple, metavar="G1,G2,G3", help="initial motor angles of an SST, rad"
    )
    parser.add_argument(
        "--gamma-dot", type=triple, metavar="W1,W2,W3", help="initial motor rates of an SST, rad/s"
    )
    parser.add_argument(
        "--q0",
        type=named_numbers,
        metavar="JOINT=X,..",
        help="initial positions of the joints of a --robot, at least of its coordinates, rad or m",
    )
    parser.add_argument(
        "--va0",
        type=named_numbers,
        metavar="JOINT=V,..",
        help="initial rates of the coordinates of a --robot, rad/s or m/s (default with --q0: 0)",
    )


def _run(arguments: argparse.Namespace) -> int:
    robot = any_robot_of(arguments)
    table = read_table(source_of(arguments.torques))
    tau, t = read_torques(robot, table), table.column("t_s")
    if isinstance(robot, SST):
        _refuse(arguments, ("q0", "va0"), "needs --robot; for an SST use --gamma and --gamma-dot")
        q0, va0 = _start(robot, table, arguments)
    else:
        _refuse(arguments, ("gamma", "gamma_dot"), "is for an SST; with --robot use --q0 and --va0")
        q0, va0 = read_start(robot, table, arguments.q0, arguments.va0)
    with progress_bar("simulating", t[0], t[-1]) as progress:
        motion = robot.simulate(tau, q0, va0, t, progress=progress)
    if refuses(robot, motion, arguments):
        return 1
    save(motion, arguments)
    text = f"{len(motion)} samples to t = {motion.t[-1]:g} s -> {arguments.output}{remark(motion)}"
    say(text, arguments)
    return CUT_SHORT if motion.stopped else 0


def _refuse(arguments: argparse.Namespace, names: tuple[str, str], why: str) -> None:
    for name in names:
        if getattr(arguments, name) is not None:
            raise InputError(f"--{name.replace('_', '-')}", why)


def _start(robot: SST, table: Table, arguments: argparse.Namespace) -> tuple[Array, Array]:
    """Joint coordinates and motor rates at the start."""

    def start(option: Array | None, columns: list[str], flag: str) -> Array:
        if option is not None:
            return option
        if not set(columns) <= set(table.columns):
            raise FileFormatError(
                table.path,
                f"no columns {', '.join(columns)} for the initial state; add them or give {flag}",
            )
        return table.select(columns)[0]

    names = [f"gamma_{k}_rad" for k in (1, 2, 3)]
    gamma = start(arguments.gamma, names, "--gamma G1,G2,G3")
    rates = start(arguments.gamma_dot, [f"{n}_s" for n in names], "--gamma-dot W1,W2,W3")
    return robot.forward_kinematics(gamma, near=_near(robot, table, arguments)), rates


def _near(robot: SST, table: Table, arguments: argparse.Namespace) -> Array:
    """Which assembly: that of the file's first row where it has one, else that next to home."""
    names = [f"{name}_rad" for name in robot.joint_names]
    if arguments.gamma is None and set(names) <= set(table.columns):
        return table.select(names)[0]
    return robot.home

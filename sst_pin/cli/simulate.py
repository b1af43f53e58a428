# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin simulate`: direct dynamics of a torque file."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..description import MOTOR_NAMES
from ..errors import FileFormatError
from ..files import Table, read_table
from ..motion.trajectories import Trajectory
from ..sst.robot import SST
from .common import (
    Commands,
    add_output,
    add_strict,
    add_urdf,
    progress_bar,
    refuses,
    remark,
    robot_of,
    save,
    triple,
)

Array = NDArray[np.float64]


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "simulate",
        _run,
        "Motion under given torques: t_s with tau_1_Nm, tau_2_Nm, tau_3_Nm. It starts from the "
        "first row where that has gamma_1_rad.. and gamma_1_rad_s.., else from --gamma.",
    )
    add_urdf(parser)
    parser.add_argument("torques", type=Path, metavar="TORQUES.csv")
    add_output(parser, "MOTION.csv")
    add_strict(parser)
    parser.add_argument(
        "--gamma", type=triple, metavar="G1,G2,G3", help="motor angles at the start, rad"
    )
    parser.add_argument(
        "--gamma-dot", type=triple, metavar="W1,W2,W3", help="motor rates at the start, rad/s"
    )


def _run(arguments: argparse.Namespace) -> int:
    robot = robot_of(arguments)
    table = read_table(arguments.torques)
    tau = table.select(["tau_1_Nm", "tau_2_Nm", "tau_3_Nm"])
    t = table.column("t_s")

    def start(name: str, option: Array | None, columns: list[str], flag: str) -> Array:
        if option is not None:
            return option
        if not set(columns) <= set(table.columns):
            raise FileFormatError(
                table.path, f"no columns {', '.join(columns)} to start from; give {flag}"
            )
        return table.select(columns)[0]

    names = [f"gamma_{k}_rad" for k in (1, 2, 3)]
    gamma = start("gamma", arguments.gamma, names, "--gamma G1,G2,G3")
    rates = start("rates", arguments.gamma_dot, [f"{n}_s" for n in names], "--gamma-dot W1,W2,W3")
    q0 = robot.forward_kinematics(gamma, near=_near(robot, table, arguments))
    unknown = np.zeros((len(t), 3))
    given = Trajectory(
        t, np.zeros((len(t), 9)), unknown, unknown, tau, robot.joint_names, MOTOR_NAMES
    )
    with progress_bar("simulating", t[0], t[-1]) as progress:
        motion = robot.simulate(given, q0, rates, t, progress=progress)
    if refuses(robot, motion, arguments):
        return 1
    save(motion, arguments)
    print(f"{len(motion)} samples to t = {motion.t[-1]:g} s -> {arguments.output}{remark(motion)}")
    return 0


def _near(robot: SST, table: Table, arguments: argparse.Namespace) -> Array:
    """Which assembly: that of the file's first row where it has one, else that next to home."""
    names = [f"{name}_rad" for name in robot.joint_names]
    if arguments.gamma is None and set(names) <= set(table.columns):
        return table.select(names)[0]
    return robot.home

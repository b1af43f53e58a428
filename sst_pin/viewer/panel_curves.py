# SPDX-License-Identifier: BSD-2-Clause
"""Curves over time beside the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..arrays import Array
from ..chain.closed_chain import ClosedChain
from ..motion.energy import motor_powers
from ..motion.trajectories import Trajectory

_WORDS = {
    "N m": "torques",
    "N": "forces",
    "rad": "angles",
    "m": "lengths",
    "rad/s": "rates",
    "m/s": "speeds",
    "W": "powers",
}


def motor_units(robot: ClosedChain) -> list[str]:
    """Unit of each motor's torque or force, "N m" or "N"."""
    return [unit.replace("Nm", "N m") for unit in robot.motor_units]


def curves_of(robot: ClosedChain, motion: Trajectory) -> list[dict[str, Any]]:
    """Sets of curves: torques, angles, rates and powers.

    Returns:
        For each set: its name `called`; `what` is drawn, with units; for each curve its name, its
        joint (`owners`) and its unit; `values`, sample after sample.
    """
    numbers = range(1, len(robot.motor_names) + 1)
    powers = motor_powers(robot, motion)
    owners = list(robot.motor_names)
    rates = [f"{unit}/s" for unit in motion.rate_units]
    watts = ["W" for _ in numbers]
    return [
        torques_of(robot, motion.tau),
        joints_of(robot, motion.q),
        _set("rates", "", motion.coordinates, motion.coordinates, rates, motion.va),
        _set("powers", "motor ", [f"P_{k}" for k in numbers], owners, watts, powers),
    ]


def torques_of(robot: ClosedChain, tau: Array) -> dict[str, Any]:
    """The set of the torques, see `curves_of`; tau of shape (n, motors)."""
    names = [f"tau_{k + 1}" for k in range(len(robot.motor_names))]
    return _set("torques", "motor ", names, robot.motor_names, motor_units(robot), tau)


def joints_of(robot: ClosedChain, q: Array) -> dict[str, Any]:
    """The set of the joints that have a unit, see `curves_of`; q of shape (n, nq)."""
    units = robot.joint_units
    places = [i for i, unit in enumerate(units) if unit]
    names = [robot.position_names[i] for i in places]
    return _set("joints", "joint ", names, names, [units[i] for i in places], q[:, places])


def _set(
    called: str,
    whose: str,
    names: Sequence[str],
    owners: Sequence[str],
    units: Sequence[str],
    values: Array,
) -> dict[str, Any]:
    kinds = ", ".join(f"{_WORDS[unit]} ({unit})" for unit in dict.fromkeys(units))
    return {
        "called": called,
        "what": whose + kinds,
        "names": list(names),
        "owners": list(owners),
        "units": list(units),
        "values": values.tolist(),
    }

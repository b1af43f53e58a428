# SPDX-License-Identifier: BSD-2-Clause
"""Sets of curves over time below the scene of a page: torques, angles, rates, powers, forces.

Each set is a dict with the keys that `chart.js` reads. Arrays have one row for each sample.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Array, Flags
from ..closed_chain import ClosedChain
from ..simulation.energy import motor_powers
from ..simulation.motion_columns import printed_units
from ..simulation.trajectories import Trajectory

#: Words for the units of curves.
_WORDS = {
    "N m": "torques",
    "N": "forces",
    "rad": "angles",
    "m": "lengths",
    "rad/s": "rates",
    "m/s": "speeds",
    "W": "powers",
}


def _curve_set(
    name: str,
    caption: str,
    names: Sequence[str],
    owners: Sequence[str],
    units: Sequence[str],
    values: Array,
) -> dict[str, Any]:
    """A set of curves over time, as `chart.js` expects it.

    Args:
        name: Name of the set, by which the page finds it.
        caption: First words of the caption, before the kinds and units of the curves.
        names: Labels of the curves.
        owners: Motors, joints or closures that the curves are about.
        units: Units of the curves.
        values: Shape (n, curves).
    """
    kinds = ", ".join(f"{_WORDS[unit]} ({unit})" for unit in dict.fromkeys(units))
    return {
        "called": name,
        "what": caption + kinds,
        "names": list(names),
        "owners": list(owners),
        "units": list(units),
        "values": values.tolist(),
    }


def curves_of(robot: ClosedChain, motion: Trajectory) -> list[dict[str, Any]]:
    """Sets of curves of a motion: torques, angles, rates and powers."""
    motors = robot.motor_names
    symbols = [f"P_{k + 1}" for k in range(len(motors))]
    watts = ["W"] * len(motors)
    return [
        torques_of(robot, motion.tau),
        joints_of(robot, motion.q),
        rates_of(motion),
        _curve_set("powers", "motor ", symbols, motors, watts, motor_powers(robot.engine, motion)),
    ]


def torques_of(robot: ClosedChain, tau: Array) -> dict[str, Any]:
    """The set of the torques, shape (n, motors)."""
    symbols = [f"tau_{k + 1}" for k in range(len(robot.motor_names))]
    units = printed_units(robot.motor_units)
    return _curve_set("torques", "motor ", symbols, robot.motor_names, units, tau)


def joints_of(robot: ClosedChain, q: Array) -> dict[str, Any]:
    """The set of the joints that have a unit, for q of shape (n, nq)."""
    units = robot.position_units  # "rad", "m" or "": texts have them as they are
    places = [i for i, unit in enumerate(units) if unit]
    names = [robot.position_names[i] for i in places]
    return _curve_set("joints", "joint ", names, names, [units[i] for i in places], q[:, places])


def rates_of(motion: Trajectory) -> dict[str, Any]:
    """The set of the rates of the coordinates."""
    units = [f"{unit}/s" for unit in motion.rate_units]
    return _curve_set("rates", "", motion.coordinates, motion.coordinates, units, motion.va)


def contacts_of(robot: ClosedChain, forces: Array) -> dict[str, Any]:
    """The set of sizes of the forces of contacts, for shape (n, contacts, 3)."""
    names = [str(contact) for contact in robot.mechanism.contacts.points]
    sizes = np.linalg.norm(forces, axis=2)
    return _curve_set("contacts", "contact ", names, names, ["N"] * len(names), sizes)


def forces_of(names: Sequence[str], forces: Array, is_drawn: Flags) -> dict[str, Any]:
    """The set of sizes of forces in joints and closures.

    Args:
        names: Names of all joints and closures.
        forces: Their forces, shape (n, count, 3).
        is_drawn: The forces that have a curve, shape (count,).
    """
    shown = [names[k] for k in np.flatnonzero(is_drawn).tolist()]
    sizes = np.linalg.norm(forces[:, is_drawn], axis=2)
    return _curve_set("reactions", "joint and closure ", shown, shown, ["N"] * len(shown), sizes)

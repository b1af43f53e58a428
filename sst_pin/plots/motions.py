# SPDX-License-Identifier: BSD-2-Clause
"""Curves of a motion against time, for any closed chain."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..chain.closed_chain import ClosedChain
from ..motion.energy import energy_balance as balance_of
from ..motion.energy import motor_powers
from ..motion.trajectories import Trajectory
from . import curves
from .curves import Curves
from .sphere import PATHS
from .style import Axes

_ALL: dict[str, Any] = {"color": "black", "linewidth": 1.8}
_FRICTION: dict[str, Any] = {"color": "#CC79A7", "linestyle": (0, (3, 1, 1, 1)), "linewidth": 1.8}


def motor_torques(ax: Axes, motion: Trajectory, motors: Sequence[str] | None = None) -> Axes:
    """Torques or forces of the motors over time (Fig. 10).

    Args:
        ax: 2-D axes.
        motion: A motion of any closed chain.
        motors: Names of motors; all by default.

    Raises:
        UnknownNameError: For an unknown name.
        InputError: If some values are torques and others are forces.

    Example:
        >>> plots.motor_torques(ax, motion).get_ylabel()
        'motor torque (N m)'
    """
    found = _torques(motion).pick(motors)
    unit = found.unit()
    numbers = [curves.number(name) for name in found.names]
    if all(numbers) and len(set(numbers)) == len(numbers):
        labels = [rf"$\tau_{curves.subscript(k)}$" for k in numbers]
    else:
        labels = [curves.label(name) for name in found.names]
    curves.draw(ax, motion.t, found, labels)
    return curves.finish(ax, motion.t, curves.FORCE[unit], zero=True)


def joint_angles(ax: Axes, motion: Trajectory, joints: Sequence[str] | None = None) -> Axes:
    """Positions of joints over time: angles in degrees, or displacements in metres.

    A continuous joint, which is a cosine and a sine in q, is drawn as one angle.

    Args:
        ax: 2-D axes.
        motion: A motion of any closed chain.
        joints: Names of entries of q; all by default.

    Raises:
        UnknownNameError: For an unknown name.
        InputError: If some values are angles and others are not.

    Example:
        >>> plots.joint_angles(ax, motion, ["crank", "rocker"]).get_ylabel()
        'joint angle (deg)'
    """
    found = _positions(motion).pick(joints)
    unit = found.unit()
    curves.draw(ax, motion.t, found, [curves.label(name) for name in found.names])
    return curves.finish(ax, motion.t, curves.POSITION[unit])


def joint_rates(
    ax: Axes, robot: ClosedChain, motion: Trajectory, joints: Sequence[str] | None = None
) -> Axes:
    """Rates of joints over time.

    Args:
        ax: 2-D axes.
        robot: Any closed chain.
        motion: A motion of this robot.
        joints: Names of rates; all by default.

    Raises:
        UnknownNameError: For an unknown name.
        InputError: If some joints are revolute and others are prismatic.

    Example:
        >>> plots.joint_rates(ax, chain, motion).get_ylabel()
        'joint rate (rad/s)'
    """
    found = _rates(robot, motion).pick(joints)
    unit = found.unit()
    curves.draw(ax, motion.t, found, [curves.label(name, r"\dot") for name in found.names])
    return curves.finish(ax, motion.t, curves.RATE[unit], zero=True)


def powers(
    ax: Axes, robot: ClosedChain, motion: Trajectory, motors: Sequence[str] | None = None
) -> Axes:
    """Power of each motor, of all motors together, and of friction, over time.

    Args:
        ax: 2-D axes.
        robot: Any closed chain.
        motion: A motion of this robot.
        motors: Names of motors with their own curves; all by default.

    Raises:
        UnknownNameError: For an unknown name.

    Example:
        >>> plots.powers(ax, chain, motion).get_ylabel()
        'power (W)'
    """
    power = motor_powers(robot, motion)
    found = _powers(motion, power).pick(motors)
    numbers = [curves.number(name) for name in found.names]
    labels = [
        f"motor {k}" if k else curves.label(n) for k, n in zip(numbers, found.names, strict=True)
    ]
    curves.draw(ax, motion.t, found, labels)
    ax.plot(motion.t, power.sum(axis=1), label="all motors", **_ALL)
    if not robot.friction.none:
        lost = robot.friction_power(motion.q, motion.va)
        ax.plot(motion.t, lost, label="friction", **_FRICTION)
    return curves.finish(ax, motion.t, "power (W)", zero=True)


def energy_balance(ax: Axes, robot: ClosedChain, motion: Trajectory) -> Axes:
    """Change of the energies, work, and their difference (residual) since the start, over time.

    Args:
        ax: 2-D axes.
        robot: Any closed chain.
        motion: A motion of this robot without external loads.

    Example:
        >>> plots.energy_balance(ax, chain, motion).get_ylabel()
        'energy since start (J)'
    """
    balance = balance_of(robot, motion)
    names = ("kinetic", "potential", "work of motors")
    values = np.stack([balance.kinetic, balance.potential, balance.motors], axis=1)
    curves.draw(ax, motion.t, Curves(names, ("J",) * 3, values), names)
    if not robot.friction.none:
        ax.plot(motion.t, balance.friction, label="work of friction", **_FRICTION)
    worst = np.abs(balance.error).max()
    label = rf"residual $\leq$ {upper_bound(worst)} J"
    ax.plot(motion.t, balance.error, color="black", linewidth=0.8, label=label)
    return curves.finish(ax, motion.t, "energy since start (J)")


def condition_number(ax: Axes, robot: ClosedChain, motion: Trajectory) -> Axes:
    """Distance from singularities over time: 1 is best, infinite at a singularity.

    The curves are those of `robot.singularity_measures`. For any closed chain, it is the condition
    number of the columns of Phi for the dependent joints, without units. For an SST there are two:
    the condition number of A (second kind) and 1 / min |sin(mu_k)| (first kind).

    Args:
        ax: 2-D axes.
        robot: Any closed chain.
        motion: A motion of this robot.

    Example:
        >>> plots.condition_number(ax, chain, motion).get_ylabel()
        'condition number (1)'
    """
    found = robot.singularity_measures(motion.q)
    names, values = tuple(found), np.stack([*found.values()], axis=1)
    labels = [curves.formula(name) for name in names]
    curves.draw(ax, motion.t, Curves(names, ("",) * len(names), values), labels)
    if values.max() > max(20, 10 * values.min()):
        ax.set_yscale("log")
    return curves.finish(ax, motion.t, "condition number (1)")


def path_errors(ax: Axes, errors: Sequence[tuple[str, Array, Array]]) -> Axes:
    """Angle between simulated and desired axis s over time, logarithmic (Fig. 11).

    Args:
        ax: 2-D axes.
        errors: Label, times [s] and angles [rad] of each motion.

    Example:
        >>> t = np.array([0, 1, 2])
        >>> plots.path_errors(ax, [("simulated", t, np.array([0, 1e-9, 3e-9]))]).get_yscale()
        'log'
    """
    for (label, t, error), look in zip(errors, PATHS[1:], strict=False):
        seen = error > 0  # an exact zero has no place on the axis
        ax.semilogy(t[seen], error[seen], label=label, **look)
    ax.set(xlabel="time (s)", ylabel="angle off the path (rad)", xlim=(t[0], t[-1]))
    ax.legend()
    return ax


def _torques(motion: Trajectory) -> Curves:
    return Curves(motion.actuated, motion.torque_units, motion.tau)


def _powers(motion: Trajectory, power: Array) -> Curves:
    return Curves(motion.actuated, ("W",) * len(motion.actuated), power)


def _positions(motion: Trajectory) -> Curves:
    """Positions, angles in degrees; a cosine and a sine become one angle."""
    names, units, columns = [], [], []
    values = iter(zip(motion.joint_names, motion.units, motion.q.T, strict=True))
    for name, unit, column in values:
        if not unit and name.endswith("_cos"):
            _, _, sine = next(values)
            names.append(name.removesuffix("_cos"))
            units.append("rad")
            columns.append(np.degrees(np.unwrap(np.arctan2(sine, column))))
        else:
            names.append(name)
            units.append(unit)
            columns.append(np.degrees(column) if unit == "rad" else column)
    return Curves(tuple(names), tuple(units), np.stack(columns, axis=1))


def _rates(robot: ClosedChain, motion: Trajectory) -> Curves:
    space = robot.mechanism.space
    return Curves(space.rate_names, space.rate_units, robot.joint_rates(motion.q, motion.va))


def upper_bound(value: float) -> str:
    """An upper bound with one digit, in TeX."""
    if value == 0:
        return "$0$"
    exponent = int(np.floor(np.log10(value)))
    digit = int(np.ceil(value / 10.0**exponent))
    return rf"${digit}\times 10^{{{exponent}}}$" if digit < 10 else rf"$10^{{{exponent + 1}}}$"


#: Draws into axes.
Panel = Callable[[Axes], Axes]


def panels(subject: str, robot: ClosedChain, motion: Trajectory) -> Iterator[Panel]:
    """Functions that draw a subject, each into one pair of axes.

    Args:
        subject: A key of `CURVES`.
        robot: Any closed chain.
        motion: A motion of this robot.
    """
    draw, found = CURVES[subject], _PARTS.get(subject)
    if found is None:
        yield lambda ax: draw(ax, robot, motion, None)
        return
    for names in found(robot, motion).panels():
        yield lambda ax, names=names: draw(ax, robot, motion, names)  # type: ignore[misc]


#: What draws each kind of curve, by the name it has on the command line.
CURVES: dict[str, Callable[[Axes, ClosedChain, Trajectory, Sequence[str] | None], Axes]] = {
    "torques": lambda ax, robot, motion, names: motor_torques(ax, motion, names),
    "joints": lambda ax, robot, motion, names: joint_angles(ax, motion, names),
    "rates": joint_rates,
    "power": powers,
    "energy": lambda ax, robot, motion, names: energy_balance(ax, robot, motion),
    "condition": lambda ax, robot, motion, names: condition_number(ax, robot, motion),
}
_PARTS: dict[str, Callable[[ClosedChain, Trajectory], Curves]] = {
    "torques": lambda robot, motion: _torques(motion),
    "joints": lambda robot, motion: _positions(motion),
    "rates": _rates,
    "power": lambda robot, motion: _powers(motion, motion.tau),
}

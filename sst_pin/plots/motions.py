# SPDX-License-Identifier: BSD-2-Clause
"""Curves of a motion against time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..motion.energy import energy_balance as balance_of
from ..motion.trajectories import Trajectory
from ..sst.robot import SST
from .sphere import PATHS
from .style import COLOURS, DASHES, Axes

Array = NDArray[np.float64]

#: Above the axes, where no curve is covered.
_ABOVE: dict[str, Any] = {
    "loc": "lower center",
    "bbox_to_anchor": (0.5, 1.0),
    "borderaxespad": 0.3,
    "handlelength": 2.4,
    "columnspacing": 1.2,
}


def motor_torques(ax: Axes, motion: Trajectory) -> Axes:
    """Torques of three motors against time (Fig. 10).

    Args:
        ax: Plane axes.
        motion: Of an SST.
    """
    for k in range(3):
        label = rf"$\tau_{k + 1}$"
        ax.plot(motion.t, motion.tau[:, k], color=COLOURS[k], linestyle=DASHES[k], label=label)
    _zero(ax)
    _time(ax, motion, "motor torque (N m)")
    ax.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), handlelength=2.6)
    return ax


def joint_angles(ax: Axes, motion: Trajectory) -> Axes:
    """Angles of all nine joints against time.

    Args:
        ax: Plane axes.
        motion: Of an SST.
    """
    _nine_joints(ax, motion.t, np.degrees(motion.q), "")
    _time(ax, motion, "joint angle (deg)")
    return ax


def joint_rates(ax: Axes, robot: SST, motion: Trajectory) -> Axes:
    """Rates of all nine joints against time.

    Args:
        ax: Plane axes.
        robot: The SST.
        motion: Of that robot.
    """
    _nine_joints(ax, motion.t, robot.joint_rates(motion.q, motion.va), r"\dot")
    _zero(ax)
    _time(ax, motion, "joint rate (rad/s)")
    return ax


def powers(ax: Axes, robot: SST, motion: Trajectory) -> Axes:
    """Power of each motor, of all three, and of friction where there is any, against time.

    Args:
        ax: Plane axes.
        robot: The SST.
        motion: Of that robot.
    """
    power = motion.tau * motion.va
    for k in range(3):
        label = rf"$\tau_{k + 1}\,\dot\gamma_{k + 1}$"
        ax.plot(motion.t, power[:, k], color=COLOURS[k], linestyle=DASHES[k], label=label)
    ax.plot(motion.t, power.sum(axis=1), color="black", linewidth=1.6, label="all motors")
    if not robot.friction.none:
        lost = robot.friction_power(motion.q, motion.va)
        ax.plot(motion.t, lost, color="#CC79A7", linestyle=(0, (3, 1, 1, 1)), label="friction")
    _zero(ax)
    _time(ax, motion, "power (W)")
    ax.legend(ncols=3, **_ABOVE)
    return ax


def energy_balance(ax: Axes, robot: SST, motion: Trajectory) -> Axes:
    """Energies gained and work done since the start, and what they leave, against time.

    Args:
        ax: Plane axes.
        robot: The SST.
        motion: Of that robot, without external loads.
    """
    balance = balance_of(robot, motion)
    curves = (
        ("kinetic", balance.kinetic, COLOURS[0], DASHES[0]),
        ("potential", balance.potential, COLOURS[1], DASHES[1]),
        ("work of motors", balance.motors, COLOURS[2], DASHES[2]),
        ("work of friction", balance.friction, "#CC79A7", (0, (3, 1, 1, 1))),
    )
    for label, energy, colour, dashes in curves if not robot.friction.none else curves[:3]:
        ax.plot(motion.t, energy, color=colour, linestyle=dashes, label=label)
    worst = np.abs(balance.error).max()
    label = rf"residual $\leq$ {upper_bound(worst)} J"
    ax.plot(motion.t, balance.error, color="black", linewidth=0.8, label=label)
    _time(ax, motion, "energy since start (J)")
    ax.legend(ncols=2, **_ABOVE)
    return ax


def condition_number(ax: Axes, robot: SST, motion: Trajectory) -> Axes:
    """Nearness to the singularities of both kinds against time.

    The condition number of A tells of the second kind, 1 / min |sin(mu_k)| of the first; both are 1
    at their best and grow without bound.

    Args:
        ax: Plane axes.
        robot: The SST.
        motion: Of that robot.
    """
    found = robot.singularities(motion.q)
    with np.errstate(divide="ignore"):
        first, second = 1 / found.first_kind, found.condition_number
    label = r"$\mathrm{cond}\,A$"
    ax.plot(motion.t, second, color=COLOURS[0], linestyle=DASHES[0], label=label)
    label = r"$1\,/\min\,|\sin\mu_k|$"
    ax.plot(motion.t, first, color=COLOURS[1], linestyle=DASHES[1], label=label)
    if max(second.max(), first.max()) > 20:
        ax.set_yscale("log")
    _time(ax, motion, "condition number (1)")
    ax.legend(ncols=2, **_ABOVE)
    return ax


def path_errors(ax: Axes, errors: Sequence[tuple[str, Array, Array]]) -> Axes:
    """Angle between simulated and wanted axis s against time, logarithmic (Fig. 11).

    Args:
        ax: Plane axes.
        errors: Label, times [s] and angles [rad] of each motion.
    """
    for (label, t, error), look in zip(errors, PATHS[1:], strict=False):
        seen = error > 0  # an exact zero has no place on the axis
        ax.semilogy(t[seen], error[seen], label=label, **look)
    ax.set(xlabel="time (s)", ylabel="angle off the path (rad)", xlim=(t[0], t[-1]))
    ax.legend()
    return ax


def _nine_joints(ax: Axes, t: Array, values: Array, accent: str) -> None:
    """Legs by colour, kinds of joint by dashes."""
    for i in range(9):
        joint, leg = i % 3, i // 3
        letter = (r"\gamma", r"\mu", r"\beta")[joint]
        name = f"{accent}{letter}_{leg + 1}" if accent else f"{letter}_{leg + 1}"
        ax.plot(t, values[:, i], color=COLOURS[leg], linestyle=DASHES[joint], label=f"${name}$")
    # The legend's columns are the legs.
    ax.legend(ncols=3, **_ABOVE)


def _zero(ax: Axes) -> None:
    ax.axhline(0, color="0.7", linewidth=0.5, zorder=0)


def _time(ax: Axes, motion: Trajectory, what: str) -> None:
    ax.set(xlabel="time (s)", ylabel=what, xlim=(motion.t[0], motion.t[-1]))


def upper_bound(value: float) -> str:
    """An upper bound with one digit, as mathematics."""
    if value == 0:
        return "$0$"
    exponent = int(np.floor(np.log10(value)))
    digit = int(np.ceil(value / 10.0**exponent))
    return rf"${digit}\times 10^{{{exponent}}}$" if digit < 10 else rf"$10^{{{exponent + 1}}}$"


#: What draws each kind of curve, by the name it has on the command line.
CURVES: dict[str, Callable[[Axes, SST, Trajectory], Axes]] = {
    "torques": lambda ax, robot, motion: motor_torques(ax, motion),
    "joints": lambda ax, robot, motion: joint_angles(ax, motion),
    "rates": joint_rates,
    "power": powers,
    "energy": energy_balance,
    "condition": condition_number,
}

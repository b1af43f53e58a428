# SPDX-License-Identifier: BSD-2-Clause
"""Curves of a motion against time, for any closed chain.

The public functions draw one subject into 2-D axes `ax`, and return these. `robot` is any closed
chain, `motion` is a motion of this robot, `motors` and `joints` name the curves to draw, by default
all. They raise an InputError for the motion of another robot and for curves of several units, and
an UnknownNameError for an unknown name. `style` has an example. `panels` divides a subject for a
page.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..arrays import require_instance
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..simulation.energy import energy_balance as balance_of
from ..simulation.energy import motor_powers
from ..simulation.trajectories import Trajectory, require_motion
from . import curves
from .curves import Curves, StyledCurve
from .style import Axes

#: Matplotlib options of curves that do not belong to a motor or a joint.
_ALL: dict[str, Any] = {"color": "black", "linewidth": 1.8}
_RESIDUAL: dict[str, Any] = {"color": "black", "linewidth": 0.8}
_FRICTION: dict[str, Any] = {"color": "#CC79A7", "linestyle": (0, (3, 1, 1, 1)), "linewidth": 1.8}


def motor_torques(ax: Axes, motion: Trajectory, motors: Sequence[str] | None = None) -> Axes:
    """Torques or forces of the motors over time (Fig. 10)."""
    selection = _torques(motion).pick(motors)
    digits = [curves.digits_of(name) for name in selection.names]
    if all(digits) and len(set(digits)) == len(digits):
        labels = [rf"$\tau_{curves.subscript(k)}$" for k in digits]
    else:
        labels = [curves.label(name) for name in selection.names]
    return curves.draw(ax, motion.t, selection, labels, curves.FORCE[selection.unit()], zero=True)


def joint_angles(ax: Axes, motion: Trajectory, joints: Sequence[str] | None = None) -> Axes:
    """Positions of joints over time: angles in degrees, or displacements in metres.

    A continuous joint, which is a cosine and a sine in q, is drawn as one angle.
    """
    selection = _positions(motion).pick(joints)
    labels = [curves.label(name) for name in selection.names]
    return curves.draw(ax, motion.t, selection, labels, curves.POSITION[selection.unit()])


def joint_rates(
    ax: Axes, robot: ClosedChain, motion: Trajectory, joints: Sequence[str] | None = None
) -> Axes:
    """Rates of joints over time."""
    require_robot("robot", robot)
    selection = _rates(robot, motion).pick(joints)
    labels = [curves.label(name, r"\dot") for name in selection.names]
    return curves.draw(ax, motion.t, selection, labels, curves.RATE[selection.unit()], zero=True)


def powers(
    ax: Axes, robot: ClosedChain, motion: Trajectory, motors: Sequence[str] | None = None
) -> Axes:
    """Power of each motor, of all motors together, and of friction, over time."""
    require_robot("robot", robot)
    all_powers = _powers(robot, motion)
    selection = all_powers.pick(motors)
    labels = []
    for name in selection.names:
        digits = curves.digits_of(name)
        labels.append(f"motor {digits}" if digits else curves.label(name))
    others = [StyledCurve(all_powers.values.sum(axis=1), "all motors", _ALL)]
    if not robot.friction.none:
        friction = robot.friction_power(motion.q, motion.va)
        others.append(StyledCurve(friction, "friction", _FRICTION))
    return curves.draw(ax, motion.t, selection, labels, "power (W)", others=others, zero=True)


def energy_balance(ax: Axes, robot: ClosedChain, motion: Trajectory) -> Axes:
    """Change of both energies since the start, work since the start, and the residual, over time.

    The residual is the change of energy minus the work: the numerical error of the motion.
    """
    require_robot("robot", robot)
    balance = balance_of(robot.engine, motion)
    names = ("kinetic", "potential", "work of motors")
    values = np.stack([balance.kinetic, balance.potential, balance.motors], axis=1)
    selection = Curves(names, ("J", "J", "J"), values)
    others = []
    if not robot.friction.none:
        others.append(StyledCurve(balance.friction, "work of friction", _FRICTION))
    label = rf"residual $\leq$ {upper_bound(np.abs(balance.error).max())} J"
    others.append(StyledCurve(balance.error, label, _RESIDUAL))
    return curves.draw(ax, motion.t, selection, names, "energy since start (J)", others=others)


def condition_number(ax: Axes, robot: ClosedChain, motion: Trajectory) -> Axes:
    """Distance from singularities over time: 1 is best, infinite at a singularity.

    The curves are the measures of `robot.singularity_measures`. A closed chain has one: the
    condition number of the columns of Phi for the dependent joints, without units. An SST has two
    others: the condition number of A (second kind) and 1 / min |sin(mu_k)| (first kind).
    """
    require_robot("robot", robot)
    require_motion(motion, robot.mechanism)
    measures = robot.singularity_measures(motion.q)
    names = tuple(measures)
    values = np.stack([*measures.values()], axis=1)
    if values.max() > max(20, 10 * values.min()):  # more than a decade, and large
        ax.set_yscale("log")
    selection = Curves(names, ("",) * len(names), values)
    labels = [curves.formula(name) for name in names]
    return curves.draw(ax, motion.t, selection, labels, "condition number (1)", columns=1)


def _torques(motion: Trajectory) -> Curves:
    """Torques of all motors."""
    require_instance("motion", motion, Trajectory)
    return Curves(motion.motor_names, motion.torque_units, motion.tau)


def _powers(robot: ClosedChain, motion: Trajectory) -> Curves:
    """Powers of all motors."""
    require_motion(motion, robot.mechanism)
    units = ("W",) * len(motion.motor_names)
    return Curves(motion.motor_names, units, motor_powers(robot.engine, motion))


def _positions(motion: Trajectory) -> Curves:
    """Positions of all joints. The cosine and the sine of a joint become one angle.

    Curves of the unit "rad" have values in degrees, as the label of their axes says.
    """
    require_instance("motion", motion, Trajectory)
    names = []
    units = []
    columns = []
    for k, (name, unit) in enumerate(zip(motion.joint_names, motion.units, strict=True)):
        if not unit and name.endswith("_cos"):  # the sine of the joint is the next column
            angle = np.unwrap(np.arctan2(motion.q[:, k + 1], motion.q[:, k]))
            names.append(name.removesuffix("_cos"))
            units.append("rad")
            columns.append(np.degrees(angle))
        elif not unit and name.endswith("_sin") and motion.joint_names[k - 1].endswith("_cos"):
            continue
        else:
            names.append(name)
            units.append(unit)
            columns.append(np.degrees(motion.q[:, k]) if unit == "rad" else motion.q[:, k])
    return Curves(tuple(names), tuple(units), np.stack(columns, axis=1))


def _rates(robot: ClosedChain, motion: Trajectory) -> Curves:
    """Rates of all joints."""
    require_motion(motion, robot.mechanism)
    space = robot.mechanism.space
    return Curves(space.rate_names, space.rate_units, robot.joint_rates(motion.q, motion.va))


def upper_bound(value: float) -> str:
    """The least number with one digit that is not smaller, in TeX: 0.0023 gives 3e-3."""
    if value == 0:
        return "$0$"
    exponent = int(np.floor(np.log10(value)))
    digit = int(np.ceil(value / 10.0**exponent))
    return rf"${digit}\times 10^{{{exponent}}}$" if digit < 10 else rf"$10^{{{exponent + 1}}}$"


#: Subjects of curves over time.
SUBJECTS_OVER_TIME = ("torques", "joints", "rates", "power", "energy", "condition")


def panels(subject: str, robot: ClosedChain, motion: Trajectory) -> list[Callable[[Axes], Axes]]:
    """Functions that draw a subject, one of `SUBJECTS_OVER_TIME`, each into one pair of axes.

    Curves of several units, or more than fit into one pair of axes, are divided.
    """
    if subject == "torques":
        return _divided(_torques(motion), lambda names, ax: motor_torques(ax, motion, names))
    if subject == "joints":
        return _divided(_positions(motion), lambda names, ax: joint_angles(ax, motion, names))
    if subject == "rates":
        all_rates = _rates(robot, motion)
        return _divided(all_rates, lambda names, ax: joint_rates(ax, robot, motion, names))
    if subject == "power":
        return _divided(_powers(robot, motion), lambda names, ax: powers(ax, robot, motion, names))
    if subject == "energy":
        return [lambda ax: energy_balance(ax, robot, motion)]
    return [lambda ax: condition_number(ax, robot, motion)]


def _divided(
    all_curves: Curves, draw: Callable[[Sequence[str], Axes], Axes]
) -> list[Callable[[Axes], Axes]]:
    """For each pair of axes, a function that draws its curves; `draw` gets their names."""
    return [partial(draw, names) for names in all_curves.panels()]

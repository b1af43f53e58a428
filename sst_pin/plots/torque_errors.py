# SPDX-License-Identifier: BSD-2-Clause
"""Measured torques beside predicted ones."""

from __future__ import annotations

from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ..arrays import finite_array
from ..description.colours import HUES
from ..errors import InputError
from ..motion.trajectories import Trajectory
from .curves import label, legend_above
from .style import StyledFigure, style

_UNITS = {"Nm": "N m", "N": "N"}


def torques_page(motion: Trajectory, predicted: ArrayLike) -> Figure:
    """Measured torques of the motors, predicted ones, and the difference, a row for each motor.

    Args:
        motion: A motion with measured torques.
        predicted: Torques for it, as of `identification.predicted_torques`, shape (N, motors).

    Raises:
        InputError: If the shapes differ.

    Example:
        >>> page = plots.torques_page(motion, 0.9 * motion.tau)
        >>> len(page.axes) == motion.tau.shape[1]
        True
    """
    tau = finite_array("predicted", predicted, (motion.tau.shape[1],))
    if tau.shape != motion.tau.shape:
        raise InputError("predicted", f"shape {tau.shape}, expected {motion.tau.shape}")
    names, units, count = motion.actuated, motion.torque_units, tau.shape[1]
    figure = StyledFigure(figsize=(7, 0.6 + 1.2 * count), layout="constrained")
    with style():
        rows = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        for ax, name, unit, measured, told in zip(
            rows, names, units, motion.tau.T, tau.T, strict=True
        ):
            ax.axhline(0, color="0.7", linewidth=0.5, zorder=0)
            ax.plot(motion.t, measured, color=HUES[0], label="measured")
            ax.plot(motion.t, told, color=HUES[1], linestyle="--", label="predicted")
            ax.plot(motion.t, measured - told, color="black", linewidth=0.6, label="difference")
            ax.set_ylabel(f"{label(name)} ({_UNITS[unit]})")
        rows[-1].set_xlabel("time (s)")
        legend_above(rows[0])
    return figure

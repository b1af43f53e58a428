# SPDX-License-Identifier: BSD-2-Clause
"""A page of measured and predicted torques."""

from __future__ import annotations

from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ..arrays import require_instance
from ..description.colours import HUES
from ..errors import InputError
from ..simulation.motion_columns import printed_units
from ..simulation.samples import rows_of_samples
from ..simulation.trajectories import Trajectory
from .curves import label, legend_above, zero_line
from .style import StyledFigure, style


def torques_page(motion: Trajectory, predicted: ArrayLike) -> Figure:
    """Measured and predicted torques over time and their difference, in one plot for each motor.

    Args:
        motion: A motion with measured torques.
        predicted: Predicted torques of this motion, shape (N, motors), for instance those of
            `identification.predicted_torques`.

    Raises:
        InputError: If the shapes differ, or for a motion without motors.
    """
    require_instance("motion", motion, Trajectory)
    tau = rows_of_samples("predicted", predicted, (len(motion), len(motion.motor_names)))
    if not motion.motor_names:
        raise InputError("motion", "has no motors")
    count = len(motion.motor_names)
    figure = StyledFigure(figsize=(7, 0.6 + 1.2 * count), layout="constrained")
    with style():
        plots = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        units = printed_units(motion.torque_units)
        for k, ax in enumerate(plots):
            measured = motion.tau[:, k]
            computed = tau[:, k]
            zero_line(ax)
            ax.plot(motion.t, measured, color=HUES[0], label="measured")
            ax.plot(motion.t, computed, color=HUES[1], linestyle="--", label="predicted")
            ax.plot(motion.t, measured - computed, color="black", linewidth=0.6, label="difference")
            ax.set_ylabel(f"{label(motion.motor_names[k])} ({units[k]})")
        plots[-1].set_xlabel("time (s)")
        legend_above(plots[0], columns=3)
    return figure

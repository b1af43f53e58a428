# SPDX-License-Identifier: BSD-2-Clause
"""Torques that identified parameters predict, and the report of an identification."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..simulation.motion_columns import printed_units
from ..simulation.trajectories import Trajectory, require_motion
from .estimation import INTERVAL, Estimate, require_estimate
from .filters import decimated
from .measurements import MeasuredMotion


def predicted_torques(chain: ClosedChain, theta: ArrayLike, motion: Trajectory) -> Array:
    """Motor torques that dynamic parameters predict for a motion, shape (N, motors).

    If there are more motors than coordinates, the torques with the smallest norm are returned.

    Args:
        chain: The robot.
        theta: The dynamic parameters in the order of the columns of `torque_regressor`, shape
            (p,). The last ones are the torque offsets of the motors.
        motion: A motion of the robot.
    """
    require_robot("chain", chain)
    require_motion(motion, chain.mechanism)
    Y = chain.torque_regressor(motion.q, motion.va, motion.aa)  # shape (N, n, p)
    forces = Y @ finite_array("theta", theta, (Y.shape[-1],))  # along the coordinates, (N, n)
    # The smallest solution of J^T tau = forces, with the Jacobian J of the motors, (N, motors, n).
    torques_of_forces = np.linalg.pinv(chain.actuator_jacobian(motion.q).mT)
    return np.asarray((torques_of_forces @ forces[..., None])[..., 0])


def report(chain: ClosedChain, found: Estimate, theta: ArrayLike, unseen: Trajectory) -> str:
    """An estimate as Markdown: values with intervals, what is not supported, errors elsewhere.

    Args:
        chain: The robot.
        found: The estimate.
        theta: The dynamic parameters that were chosen, such as `consistent_parameters`.
        unseen: A motion with measured torques that the estimate has not seen.
    """
    require_robot("chain", chain)
    require_motion(unseen, chain.mechanism, "unseen")
    require_estimate(chain, found)
    lines = [
        f"# Dynamic parameters of {chain.mechanism.model.name}",
        "",
        f"{len(found.base)} combinations of {len(found.base.considered)} parameters, of which "
        f"{int(found.supported.sum())} differ from zero by more than their intervals of "
        f"{INTERVAL:.1%}.",
        "",
        *_motor_table(chain, found, predicted_torques(chain, theta, unseen), unseen.tau),
        "",
        *_value_table(found),
    ]
    if found.base.unseen:
        lines += ["", f"Not identifiable: {', '.join(found.base.unseen)}."]
    if isinstance(unseen, MeasuredMotion) and unseen.replaced:
        counts = ", ".join(f"{name} {count}" for name, count in unseen.replaced.items())
        lines += ["", f"Outliers of the log that were replaced: {counts}."]
    return "\n".join([*lines, ""])


def _motor_table(chain: ClosedChain, found: Estimate, predicted: Array, tau: Array) -> list[str]:
    """Lines of a table with the noise and the error of each motor.

    Errors are root mean squares over the unseen motion, filtered as in the estimate.
    """
    error = _root_mean_square(decimated(predicted - tau, found.decimate))
    size = _root_mean_square(decimated(tau, found.decimate))
    lines = [
        "| motor | noise of the estimate | error in the unseen motion | relative |",
        "|---|---|---|---|",
    ]
    units = printed_units(chain.motor_units)
    for k, motor in enumerate(chain.motor_names):
        unit = units[k]
        noise = f"{found.noise[k]:.3g} {unit}"
        # A motor whose measured torque is always zero has no relative error.
        relative = f"{error[k] / size[k]:.3f}" if size[k] > 0 else ""
        lines.append(f"| {motor} | {noise} | {error[k]:.3g} {unit} | {relative} |")
    return lines


def _root_mean_square(values: Array) -> Array:
    """Root mean square of each column."""
    return np.sqrt(np.mean(np.square(values), axis=0))


def _value_table(found: Estimate) -> list[str]:
    """Lines of a table with the value and the interval of each combination."""
    lines = [f"| combination | value | interval ({INTERVAL:.1%}) | |", "|---|---|---|---|"]
    intervals = found.intervals()
    supported = found.supported
    for k, name in enumerate(found.base.names):
        remark = "" if supported[k] else "not supported"
        lines.append(f"| {name} | {found.values[k]:.5g} | {intervals[k]:.2g} | {remark} |")
    return lines

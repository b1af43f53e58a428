# SPDX-License-Identifier: BSD-2-Clause
"""Lengths that winches must set, so that stretched cables have their tensions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, one_or_each
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import InputError
from ..summaries import listed

#: A tension down to minus this part of the largest tension is rounding of zero.
_SLACK = 1e-9


def unstretched_lengths(
    chain: ClosedChain, q: ArrayLike, tau: ArrayLike, stiffness_times_length: ArrayLike
) -> Array:
    """Lengths of the cables without tension, shape (..., motors), [m].

    A cable with the tension T between two points at the distance l has the length l0 without
    tension: T = k (l - l0) / l0, so l0 = l k / (k + T). A winch that is controlled by position must
    unwind l0. Cables have no mass and do not sag.

    Args:
        chain: The robot; each motor acts on one line alone.
        q: Configurations, shape (..., nq).
        tau: Motor torques, shape (..., motors). All cables must pull: for these torques use
            `limits=` of `compute_torques`.
        stiffness_times_length: k, the stiffness of 1 m of each cable (Young's modulus times the
            area of the section), positive, () or shape (motors,), [N].

    Raises:
        InputError: If a motor acts on a joint or on several lines, or a cable would push.

    Example:
        >>> rod = sst_pin.robots.four_bar()
        >>> rope = sst_pin.LineForce("universe", "rocker_pin", name="rope")
        >>> winch = sst_pin.ClosedChain(rod.model, rod.closures, [{"rope": -1.0}], lines=[rope])
        >>> length = winch.line_lengths(rod.home)
        >>> l0 = sst_pin.control.unstretched_lengths(winch, rod.home, [50.0], 5000.0)
        >>> bool(np.allclose(length / l0, 1.01))
        True
    """
    require_robot("chain", chain)
    mechanism = chain.mechanism
    motors = len(chain.motor_names)
    line_of = mechanism.motor_lines
    others = [chain.motor_names[k] for k in np.flatnonzero(line_of < 0)]
    if others:
        raise InputError("chain", f"the motors {listed(others)} are no cables: each acts on a line")
    stiffness = one_or_each("stiffness_times_length", stiffness_times_length, motors)
    torques = finite_array("tau", tau, (motors,))
    # The force in a line is its factor times the torque of its motor. A positive force pushes.
    factors = mechanism.lines.actuation[line_of, np.arange(motors)]
    tensions = -torques * factors
    least = -_SLACK * np.abs(tensions).max(initial=0.0)
    pushes = (tensions < least).reshape(-1, motors).any(axis=0)  # in any configuration
    if pushes.any():
        names = [chain.motor_names[k] for k in np.flatnonzero(pushes)]
        raise InputError(
            "tau",
            f"the cables {listed(names)} would push with up to {-tensions.min():.4g} N; "
            "compute_torques(..., limits=) finds torques with which all cables pull",
        )
    lengths = chain.line_lengths(q)[..., line_of]
    try:
        return np.asarray(lengths * stiffness / (stiffness + tensions))
    except ValueError:
        shapes = f"{lengths.shape[:-1]} and {tensions.shape[:-1]}"
        problem = f"the leading axes of q and tau, {shapes}, do not broadcast"
        raise InputError("tau", problem) from None

# SPDX-License-Identifier: BSD-2-Clause
"""What an estimate says, and what it does not, as Markdown."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array
from ..chain.closed_chain import ClosedChain
from ..motion.trajectories import Trajectory
from .estimation import Estimate
from .measurements import decimated


def predicted_torques(chain: ClosedChain, theta: ArrayLike, motion: Trajectory) -> Array:
    """Motor torques of a motion by given dynamic parameters, the smallest ones.

    Args:
        chain: The robot.
        theta: All dynamic parameters, offsets of motors among them, shape (p,).
        motion: A motion of the robot.

    Returns:
        Shape (N, motors).

    Example:
        >>> chain = sst_pin.robots.five_bar()
        >>> t = np.linspace(0, 1, 11)
        >>> x = chain.home[[0, 2]] + 0.1 * np.sin(t)[:, None]
        >>> motion = sst_pin.coordinate_motion(chain, t, x)
        >>> tau = sst_pin.identification.predicted_torques(chain, chain.dynamic_parameters, motion)
        >>> bool(np.allclose(tau, motion.tau))
        True
    """
    Y = chain.torque_regressor(motion.q, motion.va, motion.aa)
    forces = Y @ finite_array("theta", np.asarray(theta), (Y.shape[-1],))
    back = np.linalg.pinv(chain.actuator_jacobian(motion.q).swapaxes(-1, -2))
    return np.asarray((back @ forces[..., None])[..., 0])


def report(chain: ClosedChain, found: Estimate, theta: ArrayLike, unseen: Trajectory) -> str:
    """An estimate as Markdown: values with intervals, what is not supported, errors elsewhere.

    Args:
        chain: The robot.
        found: The estimate.
        theta: The dynamic parameters that were chosen, such as `consistent_parameters`.
        unseen: A motion with measured torques that the estimate has not seen.

    Example:
        >>> chain = sst_pin.robots.five_bar()
        >>> base = sst_pin.identification.base_parameters(chain)
        >>> q, va, aa = sst_pin.identification.random_states(chain, 50)
        >>> tau = chain.compute_torques(q, va, aa)
        >>> found = sst_pin.identification.estimate(chain, base, q, va, aa, tau)
        >>> unseen = chain.trajectory(np.arange(50.0), q, va, aa)
        >>> text = sst_pin.identification.report(chain, found, chain.dynamic_parameters, unseen)
        >>> print(text.splitlines()[0])
        # Dynamic parameters of five_bar
    """
    errors = decimated(predicted_torques(chain, theta, unseen) - unseen.tau, found.decimate)
    size = np.sqrt(np.mean(np.square(decimated(unseen.tau, found.decimate)), axis=0))
    error = np.sqrt(np.mean(errors**2, axis=0))
    motors = zip(chain.motor_names, chain.motor_units, found.noise, error, size, strict=True)
    lines = [
        f"# Dynamic parameters of {chain.mechanism.model.name}",
        "",
        f"{len(found.base)} combinations of {len(found.base.considered)} parameters, of which "
        f"{int(found.supported.sum())} differ from zero by more than three standard deviations.",
        "",
        "| motor | noise of the estimate | error in the unseen motion | relative |",
        "|---|---|---|---|",
        *(f"| {n} | {s:.3g} {u} | {e:.3g} {u} | {e / a:.3f} |" for n, u, s, e, a in motors),
        "",
        "| combination | value | three standard deviations | |",
        "|---|---|---|---|",
    ]
    rows = zip(found.base.names, found.values, found.deviations, found.supported, strict=True)
    for name, value, deviation, ok in rows:
        told = "" if ok else "not supported"
        lines.append(f"| {name} | {value:.5g} | {3 * deviation:.2g} | {told} |")
    if found.base.unseen:
        lines += ["", f"Seen in no motion: {', '.join(found.base.unseen)}."]
    return "\n".join([*lines, ""])

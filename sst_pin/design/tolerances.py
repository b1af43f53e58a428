# SPDX-License-Identifier: BSD-2-Clause
"""What tolerances of a drawing do to poses, torques and the clearance to singularities."""

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import filter as fitting

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, positive_number
from ..closed_chain import ClosedChain
from ..errors import UnknownNameError
from ..simulation.trajectories import Trajectory
from ..summaries import Summary


@dataclass(frozen=True, repr=False, eq=False)
class Tolerances(Summary):
    """Standard deviations along a motion, and what each tolerance contributes.

    Attributes:
        names: The parameters with a tolerance.
        t: Times of the motion, shape (N,), [s].
        pose: Of the frame's pose, [linear; angular] in base axes, shape (N, 6), [m], [rad].
        torques: Of the motor torques, shape (N, motors).
        clearance: Of `clearance`, shape (N,).
        shares: Part of the variance that each tolerance contributes, mean over the motion, shape
            (names,): of "position", "orientation", "torques" and "clearance".
    """

    names: tuple[str, ...]
    t: Array
    pose: Array
    torques: Array
    clearance: Array
    shares: Mapping[str, Array]

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        def row(numbers: list[str]) -> str:
            return "".join(f"{x:>13}" for x in numbers)

        parts = self.pose[:, :3], self.pose[:, 3:], self.torques, self.clearance
        largest = row([f"{np.max(x, initial=0.0):.3g}" for x in parts])
        rows = [("", row(list(self.shares))), ("largest deviation", largest)]
        for name, each in zip(self.names, zip(*self.shares.values(), strict=True), strict=True):
            rows.append((name, row([f"{100 * x:.1f} %" for x in each])))
        return f"{len(self.names)} tolerances, parts of the variance", rows


def tolerances(
    chain: ClosedChain, motion: Trajectory, deviations: Mapping[str, float], frame: str
) -> Tolerances:
    """Standard deviations of pose, torques and clearance, to first order, for a motion.

    The positions of the coordinates, their rates and accelerations are exact; all tolerances are
    independent.

    Args:
        chain: The robot.
        motion: A motion of the robot.
        deviations: Standard deviations of `design_parameters`, [m], [rad] or [kg], by their names;
            a pattern stands for all parameters that it fits, each with a tolerance of its own.
        frame: Name of the frame whose pose counts.

    Raises:
        UnknownNameError: For an unknown parameter or frame.
        InputError: If the loops do not close with a parameter changed alone.

    Example:
        >>> motion = chain.simulate([0], chain.home, [0], np.linspace(0, 0.1, 3))
        >>> result = sst_pin.design.tolerances(chain, motion, {"*.length": 1e-4}, "platform")
        >>> result.shares["position"].round(2)
        array([0.33, 0.26, 0.42])
    """
    sizes: dict[str, float] = {}
    for pattern, value in deviations.items():
        known = chain.design_parameters
        names = [pattern] if pattern in known else fitting(known, pattern)
        if not names:
            raise UnknownNameError("design parameter", pattern, list(known))
        sizes |= dict.fromkeys(names, positive_number(pattern, value, or_zero=True))
    d = chain.design_derivatives(motion.q, motion.va, motion.aa, list(sizes), frame=frame)
    s = np.array(list(sizes.values()))
    _, slopes = _clearance(chain, motion.q, d.L)
    parts = {
        "position": d.pose[:, :3] * s,
        "orientation": d.pose[:, 3:] * s,
        "torques": d.torques * s,
        "clearance": slopes[:, None] * s,
    }
    variances = {name: (part**2).sum(axis=(0, 1)) for name, part in parts.items()}
    shares = {name: x / (x.sum() or 1.0) for name, x in variances.items()}
    position, orientation, torques, clear = (
        np.linalg.norm(part, axis=-1) for part in parts.values()
    )
    pose = np.hstack([position, orientation])
    return Tolerances(tuple(sizes), motion.t, pose, torques, clear[:, 0], shares)


def clearance(chain: ClosedChain, q: ArrayLike) -> Array:
    """How far configurations are from a singularity of the dependent joints, shape (...).

    It is 1 over the largest singular value of L, free of units: 0 at a singularity, at most 1.
    """
    return _clearance(chain, np.asarray(q, dtype=float), None)[0]


def _clearance(chain: ClosedChain, q: Array, by_L: Array | None) -> tuple[Array, Array]:
    """The clearance, and its derivatives from those of L, shape (..., nv, n, names)."""
    units = chain.mechanism.rate_scale
    of_coordinates = units[chain.mechanism.coordinates]
    rates = chain.joint_rates(q[..., None, :], np.diag(of_coordinates))
    U, size, Vt = np.linalg.svd(np.swapaxes(rates, -1, -2) / units[:, None])
    slopes = np.zeros((*size.shape[:-1], 0))
    if by_L is not None:
        left, right = U[..., 0] / units, Vt[..., 0, :] * of_coordinates
        rise = np.einsum("...v,...vnp,...n->...p", left, by_L, right)
        slopes = -rise / size[..., :1] ** 2
    return 1 / size[..., 0], slopes

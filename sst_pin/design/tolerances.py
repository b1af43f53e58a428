# SPDX-License-Identifier: BSD-2-Clause
"""The effect of tolerances on poses, torques and the distance from singularities.

`tolerances` computes the effect along a motion, `clearance` the distance from singularities.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, matching_names, positive_number
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import InputError
from ..simulation.trajectories import Trajectory, require_motion
from ..summaries import Summary


@dataclass(frozen=True, repr=False, eq=False)
class Tolerances(Summary):
    """Standard deviations along a motion, and the share of each tolerance in them.

    Attributes:
        names: The parameters with a tolerance.
        t: Times of the motion, shape (N,), [s].
        pose: Deviation of the frame's pose, [linear; angular], base axes, shape (N, 6), [m], [rad].
        torques: Deviation of the motor torques, shape (N, motors).
        clearance: Deviation of `clearance`, shape (N,).
        shares: For "position", "orientation", "torques" and "clearance": the share of each
            tolerance in the variance summed over the motion, shape (names,).
    """

    names: tuple[str, ...]
    t: Array
    pose: Array
    torques: Array
    clearance: Array
    shares: Mapping[str, Array]

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        parts = self.pose[:, :3], self.pose[:, 3:], self.torques, self.clearance
        rows = [("", list(self.shares))]
        rows.append(("largest deviation", [f"{part.max():.3g}" for part in parts]))
        for k, name in enumerate(self.names):
            rows.append((name, [f"{100 * share[k]:.1f} %" for share in self.shares.values()]))
        table = [(name, "".join(f"{x:>13}" for x in cells)) for name, cells in rows]
        return f"{len(self.names)} tolerances, parts of the variance", table


def tolerances(
    chain: ClosedChain, motion: Trajectory, deviations: Mapping[str, float], frame: str
) -> Tolerances:
    """Standard deviations of pose, torques and clearance, to first order, for a motion.

    The positions of the coordinates, their rates and accelerations are exact; all tolerances are
    independent.

    Args:
        chain: The robot.
        motion: A motion of the robot.
        deviations: Standard deviations of `design_parameters`, [m], [rad] or [kg], by name or
            pattern; each parameter that matches a pattern gets its own independent tolerance.
        frame: Name of the frame whose pose is considered.

    Raises:
        UnknownNameError: For an unknown parameter or frame.
        InputError: If the loops do not close with a parameter changed alone, or for the motion of
            another robot.

    Example:
        >>> motion = chain.simulate([0], chain.home, [0], np.linspace(0, 0.1, 3))
        >>> result = sst_pin.design.tolerances(chain, motion, {"*.length": 1e-4}, "platform")
        >>> result.shares["position"].round(2)
        array([0.33, 0.26, 0.42])
    """
    require_robot("chain", chain)
    require_motion(motion, chain.mechanism)
    if not isinstance(deviations, Mapping):
        raise InputError("deviations", f"{deviations!r}: a mapping of names to numbers is needed")
    sizes = dict[str, float]()
    known = chain.design_parameters
    for pattern, value in deviations.items():
        names = matching_names("design parameter", str(pattern), known)
        sizes |= dict.fromkeys(names, positive_number(pattern, value, or_zero=True))

    # Derivatives of each subject by the parameters, shape (N, components, parameters).
    d = chain.design_derivatives(motion.q, motion.va, motion.aa, list(sizes), frame=frame)
    derivatives = {
        "position": d.pose[:, :3],
        "orientation": d.pose[:, 3:],
        "torques": d.torques,
        "clearance": _clearance_derivatives(chain, motion.q, d.L)[:, None],
    }

    # The tolerances are independent, so their variances add up.
    deviation_of_each = np.array(list(sizes.values()))
    shares = dict[str, Array]()
    totals = dict[str, Array]()  # standard deviations, shape (N, components)
    for subject, derivative in derivatives.items():
        contributions = derivative * deviation_of_each
        variances = (contributions**2).sum(axis=(0, 1))  # summed over times and components
        shares[subject] = variances / (variances.sum() or 1.0)
        totals[subject] = np.linalg.norm(contributions, axis=-1)
    return Tolerances(
        names=tuple(sizes),
        t=motion.t,
        pose=np.hstack([totals["position"], totals["orientation"]]),
        torques=totals["torques"],
        clearance=totals["clearance"][:, 0],
        shares=shares,
    )


def _clearance_derivatives(chain: ClosedChain, q: Array, L_derivatives: Array) -> Array:
    """Derivatives of 1 / s by the p parameters, with the largest singular value s of L, (N, p).

    With its singular vectors u and v, L v = s u, ds = u^T dL v and d(1 / s) = -ds / s^2. The sign
    does not matter for variances. `L_derivatives` has the shape (N, nv, n, p).
    """
    L, units = _free_of_units(chain, q)
    U, s, Vt = np.linalg.svd(L)
    u = U[..., 0]
    v = Vt[..., 0, :]
    dL = L_derivatives / units[..., None]
    s_derivatives = np.einsum("tv,tvnp,tn->tp", u, dL, v)  # u^T dL v for each time t, parameter p
    return np.asarray(s_derivatives / s[:, :1] ** 2)


def clearance(chain: ClosedChain, q: ArrayLike) -> Array:
    """How far configurations are from a singularity of the dependent joints, shape (...).

    It is 1 over the largest singular value of L, free of units: 0 at a singularity, where rates of
    dependent joints grow without bound, and at most 1, since L contains an identity.
    """
    require_robot("chain", chain)
    L, _ = _free_of_units(chain, finite_array("q", q, (chain.mechanism.model.nq,)))
    return np.asarray(1 / np.linalg.norm(L, 2, axis=(-2, -1)))


def _free_of_units(chain: ClosedChain, q: Array) -> tuple[Array, Array]:
    """L without units, shape (..., nv, n), and the units of its entries, shape (nv, n)."""
    rates = chain.mechanism.rate_scale
    units = rates[:, None] / rates[chain.mechanism.coordinates]
    L = np.swapaxes(chain.joint_rates(q[..., None, :], np.eye(units.shape[1])), -1, -2)
    return L / units, units

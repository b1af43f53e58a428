# SPDX-License-Identifier: BSD-2-Clause
"""Forces and accelerations of a frame in a pose that the motor torques allow.

J is the Jacobian of the frame, J_a the Jacobian of the motors, both by the rates of the
coordinates. A force w on the frame gives the forces J^T w along the coordinates, and torques tau
give J_a^T tau. So w acts like the torques G w, where G is the smallest solution of J_a^T G = J^T.
A frame that exerts w needs these torques. The acceleration of the frame is A tau plus the one
without torques, which is due to gravity and rates.

An ellipsoid shows what all torques with sum (tau_k / limit_k)^2 <= 1 give, a polytope what all
torques within the limits give. With `turning`, moments replace forces, and angular accelerations
replace linear ones.

T. Yoshikawa, Manipulability of robotic mechanisms, Int. J. Robotics Research 4(2), 1985; P.
Chiacchio et al., Force polytope and force ellipsoid for redundant manipulators, J. Robotic Systems
14(8), 1997.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, of_samples, require_flags, single_array
from ..closed_chain import ClosedChain
from ..dynamics.torque_sharing import finite_limits
from ..engine import require_robot
from ..errors import ActuationError, InputError, SingularConfigurationError
from ..model.thresholds import RANK_TOLERANCE, UNSUPPLIED
from ..summaries import listed
from .convex_sets import corners_of_inequalities, hull
from .motor_limits import factors_of_sums, motors_of, part_of, sums_of


class Ellipsoid(NamedTuple):
    """All points `center` + sum of x_k `sizes`_k `axes`_k with |x| <= 1, in base axes.

    Attributes:
        center: Shape (..., 3).
        sizes: Half of its length along each axis, the largest first, shape (..., 3); infinite where
            the structure carries all forces, 0 where the frame cannot accelerate.
        axes: Orthonormal directions, in rows, shape (..., 3, 3).
    """

    center: Array
    sizes: Array
    axes: Array


def force_ellipsoid(
    chain: ClosedChain, q: ArrayLike, frame: str, torques: ArrayLike, *, turning: bool = False
) -> Ellipsoid:
    """Forces that a frame can exert with torques for which sum (tau_k / limit_k)^2 <= 1.

    Gravity is ignored: the torques that hold the robot against it are not counted.

    Args:
        chain: A robot whose motors hold all coordinates.
        q: Configurations, shape (..., nq).
        frame: Name of a frame.
        torques: Largest torque of each motor, shape () or (motors,).
        turning: Whether to return moments instead of forces at the origin of the frame.

    Returns:
        Forces, [N], or moments, [N m]; the center is zero.

    Raises:
        ActuationError: Where a force of the frame moves a coordinate that no motor holds.

    Example:
        >>> lift = sst_pin.robots.five_bar()
        >>> ellipsoid = sst_pin.force_ellipsoid(lift, lift.home, "platform", 1.0)
        >>> ellipsoid.sizes.round(2), ellipsoid.axes.shape
        (array([  inf, 14.28, 10.2 ]), (3, 3))
    """
    require_robot("chain", chain)
    largest = _largest_torques(chain, torques)
    G = _map_of_forces(chain, q, frame, turning, largest).G
    s, axes = _singular_values(G.mT)
    # A force f along axis k takes torques of the size s_k |f|, in multiples of the largest torques.
    # This is at most 1, so that the ellipsoid has the size 1 / s_k. The largest size is the last.
    with np.errstate(divide="ignore"):
        sizes = np.where(s > RANK_TOLERANCE * s[..., :1], 1 / s, np.inf)
    return Ellipsoid(np.zeros(sizes.shape), sizes[..., ::-1], axes[..., ::-1, :])


def force_polytope(
    chain: ClosedChain, q: ArrayLike, frame: str, torques: ArrayLike, *, turning: bool = False
) -> Array:
    """Corners of the set of forces that a frame can exert while the motors also hold the weight.

    Directions in which the frame cannot move are left out: there the structure carries the forces.
    Surplus motors help with any preload within their limits. Arguments as in `force_ellipsoid`,
    but q is one configuration at rest, shape (nq,), and torques may be least and largest ones,
    shape (motors, 2).

    Returns:
        Shape (corners, 3), in base axes, [N] or [N m]; corners in a plane are in order around it.

    Raises:
        ActuationError: If the motors have nothing to spare at q, or a force of the frame moves a
            coordinate that no motor holds.
        InputError: For a frame that cannot translate, or with `turning` cannot rotate.
        SingularConfigurationError: If a force along a motion of the frame needs no torques.

    Example:
        >>> lift = sst_pin.robots.five_bar()
        >>> sst_pin.force_polytope(lift, lift.home, "platform", 1.0).shape
        (4, 3)
    """
    require_robot("chain", chain)
    single = single_array("q", q, (chain.mechanism.model.nq,))
    limits = finite_limits(torques, len(chain.motor_names), "torques")
    # The parts of the limits that holding the robot takes, as sums that no preload changes: see
    # `motor_limits`. The motors keep their limits if all sums are between -1 and 1.
    zero = np.zeros(chain.degrees_of_freedom)
    factors = factors_of_sums(chain.preload_directions(single), limits)
    sums = sums_of(factors, part_of(chain.compute_torques(single, zero, zero), limits))
    if np.abs(sums).max() >= 1:
        names = listed(motors_of(chain, factors[np.abs(sums).argmax()]))  # of the largest sum
        raise ActuationError(f"no torque to spare in {names} when the motors hold the robot")

    # Let x be the components of a force along the directions in which the frame can move. The force
    # changes the sums by C x. A part changes by 2 / (largest - least) for each unit of a torque.
    force_map = _map_of_forces(chain, single, frame, turning)
    directions = _range(force_map.J)  # in rows
    if not len(directions):
        kind = "turn" if turning else "translate"
        raise InputError("frame", f"{frame} cannot {kind}: the structure carries all forces on it")
    torques_of_x = force_map.G @ directions.T
    parts_of_x = 2 / np.ptp(limits, axis=1)[:, None] * torques_of_x
    C = sums_of(factors, parts_of_x.T).T  # `sums_of` takes the parts for each component in a row
    if np.linalg.matrix_rank(C, RANK_TOLERANCE * np.abs(C).max(initial=0.0)) < len(directions):
        raise SingularConfigurationError("forces of the frame take no torques", np.inf)

    # The sums stay between -1 and 1: C x <= 1 - sums, and -C x <= 1 + sums.
    A = np.vstack([C, -C])
    b = np.concatenate([1 - sums, 1 + sums])
    return corners_of_inequalities(A, b) @ directions


def acceleration_ellipsoid(
    chain: ClosedChain,
    q: ArrayLike,
    frame: str,
    torques: ArrayLike,
    *,
    va: ArrayLike | None = None,
    turning: bool = False,
) -> Ellipsoid:
    """Accelerations of a frame by torques for which sum (tau_k / limit_k)^2 <= 1.

    Arguments as in `force_ellipsoid`, and the rates `va` of the coordinates, shape (..., n), zero
    by default; `turning` means angular accelerations.

    Returns:
        Accelerations, [m/s^2] or [rad/s^2]; the center is the acceleration without torques.
    """
    require_robot("chain", chain)
    center, A = _accelerations_by_torques(chain, q, va, frame, turning)
    sizes, axes = _singular_values(A * _largest_torques(chain, torques))
    return Ellipsoid(center, sizes, axes)


def acceleration_polytope(
    chain: ClosedChain,
    q: ArrayLike,
    frame: str,
    torques: ArrayLike,
    *,
    va: ArrayLike | None = None,
    turning: bool = False,
) -> Array:
    """Corners of the set of accelerations of a frame that the motor torques allow.

    Arguments as in `acceleration_ellipsoid`, but q and va are one state, shapes (nq,) and (n,), and
    torques may be least and largest ones, shape (motors, 2). The robot has at most 16 motors.

    Returns:
        Shape (corners, 3), in base axes, [m/s^2] or [rad/s^2]; corners in a plane are in order.
    """
    require_robot("chain", chain)
    single = single_array("q", q, (chain.mechanism.model.nq,))
    limits = finite_limits(torques, len(chain.motor_names), "torques")
    if len(limits) > 16:
        raise InputError("chain", f"{len(limits)} motors have too many corners")
    center, A = _accelerations_by_torques(chain, single, va, frame, turning)
    torques_at_corners = np.array(list(product(*limits)))  # all combinations of least and largest
    # Components along the directions in which torques accelerate the frame.
    directions = _range(A)  # in rows
    components = torques_at_corners @ A.T @ directions.T
    return hull(components) @ directions + center


def _largest_torques(chain: ClosedChain, torques: ArrayLike) -> Array:
    """Largest torques, shape (motors,); limits that differ in both directions are refused."""
    limits = finite_limits(torques, len(chain.motor_names), "torques")
    if not (limits[:, 0] == -limits[:, 1]).all():
        raise InputError("torques", "an ellipsoid has the same limits in both directions")
    return np.asarray(limits[:, 1])


def _jacobian(chain: ClosedChain, q: ArrayLike, frame: str) -> Array:
    """The frame's Jacobian, shape (..., 6, n); entries that are only rounding are zero."""
    mechanism = chain.mechanism
    J = chain.frame_jacobian(q, frame)
    units = np.repeat([mechanism.length, 1.0], 3)[:, None]
    sizes = np.abs(J) / units * mechanism.rate_scale[mechanism.coordinates]
    return np.where(sizes > RANK_TOLERANCE * sizes.max(axis=(-1, -2), keepdims=True), J, 0)


def _rows(turning: bool) -> slice:
    """The angular rows of a frame's Jacobian with `turning`, or else the linear rows."""
    require_flags(turning=turning)
    return slice(3, 6) if turning else slice(0, 3)


def torques_of_wrenches(chain: ClosedChain, q: ArrayLike, frame: str) -> Array:
    """G, shape (..., motors, 6): a wrench w on the frame acts like the torques G w."""
    return np.asarray(np.linalg.pinv(chain.actuator_jacobian(q).mT) @ _jacobian(chain, q, frame).mT)


class _MapOfForces(NamedTuple):
    """G for forces or moments w on a frame, which act like the torques G w; see the module.

    Attributes:
        G: Torques in multiples of unit torques, by w, shape (..., motors, 3).
        J: Linear or angular rows of the frame's Jacobian, shape (..., 3, n).
    """

    G: Array
    J: Array


def _map_of_forces(
    chain: ClosedChain,
    q: ArrayLike,
    frame: str,
    turning: bool,
    unit_torques: Array | float = 1.0,
) -> _MapOfForces:
    """G and J of a frame, for unit torques of the motors, shape (motors,) or ().

    G gives the torques whose multiples of the unit torques have the least sum of squares. Forces
    that move coordinates which no motor holds are refused.
    """
    mechanism = chain.mechanism
    J = _jacobian(chain, q, frame)[..., _rows(turning), :]
    # Forces along the coordinates by multiples of the unit torques, shape (..., n, motors).
    J_a_T = (chain.actuator_jacobian(q) * np.reshape(unit_torques, (-1, 1))).mT
    G = np.asarray(np.linalg.pinv(J_a_T) @ J.mT)
    # What the motors do not supply of the forces along the coordinates, free of units.
    units = mechanism.rate_scale[mechanism.coordinates, None]
    forces = np.abs(J.mT) * units
    unsupplied = np.abs(J.mT - J_a_T @ G) * units
    is_unsupplied = unsupplied > UNSUPPLIED * forces.max(axis=(-1, -2), keepdims=True)
    if is_unsupplied.any():
        loose = is_unsupplied.any(axis=-1)  # coordinates of each configuration, (..., n)
        names = [mechanism.coordinate_rate_names[k] for k in np.argwhere(loose)[:, -1]]
        problem = f"no motor holds {listed(list(dict.fromkeys(names)))}"
        error = ActuationError(f"{problem}, which a force on {frame} moves")
        raise of_samples(error, loose.any(axis=-1))
    return _MapOfForces(G, J)


def _accelerations_by_torques(
    chain: ClosedChain, q: ArrayLike, va: ArrayLike | None, frame: str, turning: bool
) -> tuple[Array, Array]:
    """The acceleration of a frame without torques, (..., 3), and A by torques, (..., 3, motors)."""
    n = chain.degrees_of_freedom
    motors = len(chain.motor_names)
    configurations = finite_array("q", q, (chain.mechanism.model.nq,))
    rates = np.zeros(n) if va is None else finite_array("va", va, (n,))
    tau = np.vstack([np.zeros(motors), np.eye(motors)])  # no torques, then one of each motor
    aa = chain.compute_accelerations(configurations[..., None, :], rates[..., None, :], tau)
    rows = _rows(turning)
    J = _jacobian(chain, configurations, frame)[..., rows, :]
    drift = chain.frame_drift(configurations, rates, frame)[..., rows]
    without_torques = drift + (J @ aa[..., 0, :, None])[..., 0]
    by_torques = J @ (aa[..., 1:, :] - aa[..., :1, :]).mT
    return without_torques, by_torques


def _singular_values(A: Array) -> tuple[Array, Array]:
    """Three singular values of matrices (..., 3, k), the largest first, and directions in rows.

    For k < 3 the last singular values are zero.
    """
    U, sizes, _ = np.linalg.svd(A)
    missing = np.zeros((*sizes.shape[:-1], 3 - sizes.shape[-1]))
    return np.concatenate([sizes, missing], axis=-1), U.mT


def _range(columns: Array) -> Array:
    """Orthonormal directions of the range of a matrix, (3, n), in rows."""
    from scipy.linalg import orth

    return np.asarray(orth(columns, RANK_TOLERANCE).T)

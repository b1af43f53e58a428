# SPDX-License-Identifier: BSD-2-Clause
"""Forces and accelerations of a frame in a pose, within the torques of the motors.

With the Jacobian J of the frame and that of the motors J_a, a force w of the frame takes torques
G w, the smallest with J_a^T G = J^T. Torques tau accelerate the frame by A tau beside what weight
and rates do. T. Yoshikawa, Manipulability of robotic mechanisms, Int. J. Robotics Research 4(2),
1985; P. Chiacchio et al., Force polytope and force ellipsoid for redundant manipulators, J. Robotic
Systems 14(8), 1997.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, name_samples, single_array
from ..closed_chain import ClosedChain
from ..dynamics.torque_sharing import limits_of_each
from ..errors import ActuationError, InputError, SingularConfigurationError
from ..model.thresholds import RANK_TOLERANCE, UNSUPPLIED
from ..summaries import listed


class Ellipsoid(NamedTuple):
    """All points `center` + sum of x_k `sizes`_k `axes`_k with |x| <= 1, in base axes.

    Attributes:
        center: Shape (..., 3).
        sizes: Half of its length along each axis, the largest first, shape (..., 3); infinite where
            the structure bears all forces, 0 where the frame cannot accelerate.
        axes: Orthonormal directions, in rows, shape (..., 3, 3).

    Example:
        See `force_ellipsoid`.
    """

    center: Array
    sizes: Array
    axes: Array


def force_ellipsoid(
    chain: ClosedChain, q: ArrayLike, frame: str, torques: ArrayLike, *, turning: bool = False
) -> Ellipsoid:
    """Forces that a frame can exert with torques whose squares, over their limits, sum up to one.

    Weights are not counted: these are forces beside those that hold the robot.

    Args:
        chain: A robot whose motors hold all coordinates.
        q: Configurations, shape (..., nq).
        frame: Name of a frame.
        torques: Largest torque of each motor, shape () or (motors,).
        turning: Whether moments are meant, instead of forces on the origin of the frame.

    Returns:
        Forces, [N], or moments, [N m]; the center is zero.

    Raises:
        ActuationError: Where a force of the frame moves a coordinate that no motor holds.
        InputError: For limits that are not positive.
        UnknownNameError: For an unknown frame.
        ClosureError, SingularConfigurationError: As `frame_jacobian`.

    Example:
        >>> lift = sst_pin.robots.five_bar()
        >>> found = sst_pin.force_ellipsoid(lift, lift.home, "platform", 1.0)
        >>> found.sizes.round(2), found.axes.shape
        (array([  inf, 14.28, 10.2 ]), (3, 3))
    """
    G = _supplied(chain, q, frame, turning) / _sizes(chain, torques)[:, None]
    s, axes = _stretches(G.mT)
    with np.errstate(divide="ignore"):
        sizes = np.where(s > RANK_TOLERANCE * s[..., :1], 1 / s, np.inf)
    return Ellipsoid(np.zeros(sizes.shape), sizes[..., ::-1], axes[..., ::-1, :])


def force_polytope(
    chain: ClosedChain, q: ArrayLike, frame: str, torques: ArrayLike, *, turning: bool = False
) -> Array:
    """Corners of all forces that a frame can exert while the motors also hold the weight.

    Directions in which the frame cannot move are left out: there the structure bears the forces.
    With more motors than freedoms, the smallest torques count. Arguments as in `force_ellipsoid`,
    but q is one configuration at rest, shape (nq,), and torques may be least and largest ones,
    shape (motors, 2).

    Returns:
        Shape (corners, 3), in base axes, [N] or [N m]; in a plane one after the other.

    Raises:
        ActuationError: If the motors have nothing to spare at q, or a force of the frame moves a
            coordinate that no motor holds.
        InputError: For limits that are none, or a frame that cannot move so.
        SingularConfigurationError: Where a motor needs no torque for a force.

    Example:
        >>> lift = sst_pin.robots.five_bar()
        >>> sst_pin.force_polytope(lift, lift.home, "platform", 1.0).shape
        (4, 3)
    """
    from scipy.spatial import HalfspaceIntersection

    single = single_array("q", q, (chain.mechanism.model.nq,))
    rest = np.zeros(chain.degrees_of_freedom)
    hold, bounds = chain.compute_torques(single, rest, rest), _bounds(chain, torques)
    room = np.concatenate([bounds[:, 1] - hold, hold - bounds[:, 0]])
    if room.min() <= 0:
        motor = chain.motor_names[int(room.argmin()) % len(hold)]
        raise ActuationError(f"motor {motor} has no torque to spare when it holds the robot")
    G = _supplied(chain, single, frame, turning)
    moving = _range(_jacobian(chain, single, frame, turning))
    if not len(moving):
        raise InputError("frame", f"{frame} cannot move so: the structure bears what acts on it")
    rows = np.vstack([G, -G]) @ moving.T
    if np.linalg.matrix_rank(rows, RANK_TOLERANCE * np.abs(rows).max(initial=0.0)) < len(moving):
        raise SingularConfigurationError("forces of the frame take no torques", np.inf)
    if len(moving) == 1:
        ends = room / np.where(rows[:, 0] > 0, rows[:, 0], np.nan)
        back = room / np.where(rows[:, 0] < 0, rows[:, 0], np.nan)
        return np.array([[np.nanmax(back)], [np.nanmin(ends)]]) @ moving
    found = HalfspaceIntersection(np.column_stack([rows, -room]), np.zeros(len(moving)))
    return hull(found.intersections) @ moving


def acceleration_ellipsoid(
    chain: ClosedChain,
    q: ArrayLike,
    frame: str,
    torques: ArrayLike,
    *,
    va: ArrayLike | None = None,
    turning: bool = False,
) -> Ellipsoid:
    """Accelerations of a frame by torques whose squares, over their limits, sum up to one.

    Arguments as in `force_ellipsoid`, and the rates `va` of the coordinates, shape (..., n), zero
    by default; `turning` means angular accelerations.

    Returns:
        Accelerations, [m/s^2] or [rad/s^2]; the center is that without torques.

    Raises:
        InputError: For limits that are not positive.
        UnknownNameError: For an unknown frame.
        ClosureError, SingularConfigurationError: As `compute_accelerations`.

    Example:
        >>> lift = sst_pin.robots.five_bar()
        >>> found = sst_pin.acceleration_ellipsoid(lift, lift.home, "platform", 1.0)
        >>> found.sizes.shape
        (3,)
    """
    center, A = _accelerations_by_torques(chain, q, va, frame, turning)
    return Ellipsoid(center, *_stretches(A * _sizes(chain, torques)))


def acceleration_polytope(
    chain: ClosedChain,
    q: ArrayLike,
    frame: str,
    torques: ArrayLike,
    *,
    va: ArrayLike | None = None,
    turning: bool = False,
) -> Array:
    """Corners of all accelerations of a frame within the torques of the motors, 16 at most.

    Arguments as in `acceleration_ellipsoid`, but q and va are one state, shapes (nq,) and (n,), and
    torques may be least and largest ones, shape (motors, 2).

    Returns:
        Shape (corners, 3), in base axes, [m/s^2] or [rad/s^2]; in a plane one after the other.

    Raises:
        InputError: For limits that are none.

    Example:
        >>> lift = sst_pin.robots.five_bar()
        >>> sst_pin.acceleration_polytope(lift, lift.home, "platform", 1.0).shape
        (4, 3)
    """
    single = single_array("q", q, (chain.mechanism.model.nq,))
    bounds = _bounds(chain, torques)
    if len(bounds) > 16:
        raise InputError("chain", f"{len(bounds)} motors have too many corners")
    center, A = _accelerations_by_torques(chain, single, va, frame, turning)
    moving = _range(A)
    return hull(np.array(list(product(*bounds))) @ A.T @ moving.T) @ moving + center


def _bounds(chain: ClosedChain, torques: ArrayLike) -> Array:
    """Least and largest torques, shape (motors, 2)."""
    return limits_of_each("torques", torques, len(chain.motor_names))


def _sizes(chain: ClosedChain, torques: ArrayLike) -> Array:
    """Largest torques, shape (motors,)."""
    bounds = _bounds(chain, torques)
    if not (bounds[:, 0] == -bounds[:, 1]).all():
        raise InputError("torques", "an ellipsoid has the same limits in both directions")
    return np.asarray(bounds[:, 1])


def _jacobian(chain: ClosedChain, q: ArrayLike, frame: str, turning: bool) -> Array:
    """Rows of the frame's Jacobian, shape (..., 3, n), without what is rounding beside others."""
    mechanism, J = chain.mechanism, chain.frame_jacobian(q, frame)
    units = np.repeat([mechanism.length, 1.0], 3)[:, None]
    sizes = np.abs(J) / units * mechanism.rate_scale[mechanism.coordinates]
    sound = sizes > RANK_TOLERANCE * sizes.max(axis=(-1, -2), keepdims=True)
    return np.where(sound, J, 0)[..., 3 * turning : 3 * turning + 3, :]


def torques_of_forces(chain: ClosedChain, q: ArrayLike, frame: str, turning: bool) -> Array:
    """G: forces w of a frame take the torques G w, shape (..., motors, 3)."""
    J = _jacobian(chain, q, frame, turning)
    return np.asarray(np.linalg.pinv(chain.actuator_jacobian(q).mT) @ J.mT)


def _supplied(chain: ClosedChain, q: ArrayLike, frame: str, turning: bool) -> Array:
    """G as `torques_of_forces`, where the motors hold the coordinates that the forces move."""
    mechanism, G = chain.mechanism, torques_of_forces(chain, q, frame, turning)
    units = mechanism.rate_scale[mechanism.coordinates, None]
    forces = _jacobian(chain, q, frame, turning).mT * units
    left = np.abs(forces - chain.actuator_jacobian(q).mT @ G * units)
    over = left > UNSUPPLIED * np.abs(forces).max(axis=(-1, -2), keepdims=True)
    if over.any():
        moved = over.any(axis=-1)
        names = [mechanism.coordinate_rate_names[k] for k in np.argwhere(moved)[:, -1]]
        error = ActuationError(
            f"no motor holds {listed(list(dict.fromkeys(names)))}, which a force on {frame} moves"
        )
        name_samples(error, np.flatnonzero(moved.any(axis=-1)).tolist(), moved.shape[:-1])
        raise error
    return G


def _accelerations_by_torques(
    chain: ClosedChain, q: ArrayLike, va: ArrayLike | None, frame: str, turning: bool
) -> tuple[Array, Array]:
    """Accelerations of a frame without torques, shape (..., 3), and by each, (..., 3, motors)."""
    n, motors = chain.degrees_of_freedom, len(chain.motor_names)
    configurations = finite_array("q", q, (chain.mechanism.model.nq,))
    rates = np.zeros(n) if va is None else finite_array("va", va, (n,))
    tau = np.vstack([np.zeros(motors), np.eye(motors)])
    aa = chain.compute_accelerations(configurations[..., None, :], rates[..., None, :], tau)
    J = _jacobian(chain, configurations, frame, turning)
    free = chain.frame_drift(configurations, rates, frame)[..., 3 * turning : 3 * turning + 3]
    center = free + np.einsum("...ij,...j->...i", J, aa[..., 0, :])
    return center, J @ (aa[..., 1:, :] - aa[..., :1, :]).mT


def _stretches(A: Array) -> tuple[Array, Array]:
    """Three singular values of matrices (..., 3, k), the largest first, and directions in rows."""
    U, sizes, _ = np.linalg.svd(A)
    missing = np.zeros((*sizes.shape[:-1], 3 - sizes.shape[-1]))
    return np.concatenate([sizes, missing], axis=-1), U.mT


def _range(columns: Array) -> Array:
    """Orthonormal directions of the range of a matrix, (3, n), in rows."""
    U, s, _ = np.linalg.svd(columns)
    return np.asarray(U[:, : int((s > RANK_TOLERANCE * s.max(initial=0.0)).sum())].T)


def hull(points: Array) -> Array:
    """Corners of the convex hull of points, (N, k): the ends of a line, in a plane all around.

    They begin with the first of the points that is a corner.
    """
    from scipy.spatial import ConvexHull

    if points.shape[1] == 0:
        return points[:1]
    if points.shape[1] == 1:
        return np.array([points.min(axis=0), points.max(axis=0)])
    around = ConvexHull(points).vertices
    return np.asarray(points[np.roll(around, -int(around.argmin()))])

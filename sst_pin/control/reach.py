# SPDX-License-Identifier: BSD-2-Clause
"""Poses that a frame reaches, with the conditioning there and the torques that hold them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Flags, finite_array, single_array
from ..closed_chain import ClosedChain
from ..dynamics.torque_sharing import finite_limits, within_limits
from ..engine import require_robot
from ..errors import InputError, warn_caller
from ..files import as_path, table_writer, write_files
from ..loops.frame_guide import FrameGuide
from ..loops.start import start_of
from ..model.thresholds import RANK_TOLERANCE
from ..simulation.motion_columns import columns_of
from ..summaries import Summary
from .motor_limits import largest_part
from .pose_abilities import torques_of_wrenches
from .pose_grid import PoseGrid, grid_axes
from .reach_search import REACHED, REASONS, reached_from


@dataclass(frozen=True, eq=False, repr=False)
class ReachMap(Summary):
    """The poses on a grid of N by M that a frame reaches.

    Where a pose is not reached, numbers are NaN.

    Attributes:
        axes: Names of the two components that change along the grid.
        values: Their values, shapes (N,) and (M,), [m] or [rad].
        poses: Homogeneous matrices of the wanted poses of the frame, shape (N, M, 4, 4). Positions
            are ignored if none of x, y, z is named, orientations if no angle is named.
        why: 0 for a pose that is reached; else the reason, shape (N, M): 1 for joint limits, 2
            singular, 3 out of reach, 4 cut off from the start by such poses.
        q: Configurations, shape (N, M, nq).
        condition: Condition number of the map from rates of the motors to the velocity of the frame
            in the components named, free of units, shape (N, M); very large at a singularity.
        torque: The smallest torques within the limits that hold the pose, shape (N, M, motors),
            [N m] or [N]; if there are none, those with the smallest largest excess.
        used: The largest part of a motor's limits that holding the pose needs with the best
            preload, shape (N, M); above 1 the motors cannot hold it.
        columns: Names of torques and joints in a file, with units.
    """

    axes: tuple[str, str]
    values: tuple[Array, Array]
    poses: Array
    why: NDArray[np.int8]
    q: Array
    condition: Array
    torque: Array
    used: Array
    columns: tuple[str, ...]

    @property
    def reached(self) -> Flags:
        """Which poses are reached, shape (N, M)."""
        return self.why == REACHED

    @property
    def area(self) -> float:
        """Area of the poses that are reached, [m^2], [m rad] or [rad^2]."""
        from scipy.integrate import trapezoid

        rows = trapezoid(self.reached.astype(float), self.values[1])
        return float(trapezoid(rows, self.values[0]))

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write a .csv, one row for each pose."""
        first, second = np.meshgrid(*self.values, indexing="ij")
        numbers = np.stack([first, second, self.why, self.condition, self.used], axis=-1)
        rows = np.concatenate([numbers, self.torque, self.q], axis=-1)
        names = [f"{axis}_{'m' if axis in 'xyz' else 'rad'}" for axis in self.axes]
        names += ["why", "condition", "used", *self.columns]
        write_files({as_path(path): table_writer(names, rows.reshape(-1, len(names)))}, force)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """Rows of the printed map."""
        rows = []
        for axis, values in zip(self.axes, self.values, strict=True):
            unit = "m" if axis in "xyz" else "rad"
            rows.append((axis, f"{values[0]:.4g} to {values[-1]:.4g} {unit}, {len(values)} values"))
        for code, reason in enumerate(REASONS):
            count = int((self.why == code).sum())
            if count:
                rows.append((reason, str(count)))
        too_weak = int((self.used > 1).sum())
        if too_weak:
            rows.append(("the motors cannot hold", str(too_weak)))
        return f"ReachMap of {self.why.size} poses", rows


def reach_map(
    chain: ClosedChain,
    frame: str,
    torques: ArrayLike = 1.0,
    *,
    x: ArrayLike | None = None,
    y: ArrayLike | None = None,
    z: ArrayLike | None = None,
    roll: ArrayLike | None = None,
    pitch: ArrayLike | None = None,
    yaw: ArrayLike | None = None,
    rotation: ArrayLike | None = None,
    wrench: ArrayLike | None = None,
    start: ArrayLike | None = None,
) -> ReachMap:
    """Poses on a grid that a frame reaches, with the conditioning and the holding torques there.

    The frame moves from the start to neighbouring poses, one after the other. So all poses are in
    the assembly mode and working mode of the start, and none lies beyond a singular configuration
    or a limit that `ClosedChain.check_limits` knows. If one of x, y, z is given, the position of
    the frame is prescribed; its other components stay as at the start. If one of roll, pitch, yaw
    is given, the orientation is prescribed; the other angles are 0. If the frame then has degrees
    of freedom left, the joints move least, and the map depends on the path to each pose.

    All three angles of a prescribed orientation count. For instance, a frame behind a universal
    joint with the axes x and y has the orientations R_x R_y, whose yaw is 0 only where roll or
    pitch is 0. So on a grid of roll and pitch it reaches only a cross. A warning says so. Then take
    the joints as the grid: `assemble` closes the loops for a batch of coordinates, and
    `frame_placement` has the poses.

    Args:
        chain: A robot whose motors hold all coordinates.
        frame: Name of a frame.
        torques: Largest torque of each motor, shape () or (motors,), or least and largest ones,
            shape (motors, 2), [N m] or [N]; by default 1.
        x: Position of the frame's origin in the base, [m]: a number, or values of the grid,
            increasing. Two of the six are grids.
        y: As x.
        z: As x.
        roll: About the x axis of the base, [rad]. The orientation of the frame is R_z(yaw)
            R_y(pitch) R_x(roll) `rotation`.
        pitch: About the y axis.
        yaw: About the z axis.
        rotation: Orientation of the frame where the angles are 0, shape (3, 3); by default that at
            the start.
        wrench: [force; moment] on the frame at its origin, in base axes, [N] and [N m], such as the
            weight of what it carries; none by default.
        start: A guess of all joints, shape (nq,), that selects the modes; by default `home`.

    Raises:
        InputError: If not exactly two components are grids, if the start is beyond joint limits, or
            if the frame cannot move along the grid.
        ActuationError: If the motors cannot hold the robot.
        ClosureError: If the start cannot be assembled.

    Warns:
        RuntimeWarning: If the frame cannot leave most of the poses that it reaches along both axes
            of the grid, so that other poses are out of reach for any size of the robot.

    Example:
        >>> lift = sst_pin.robots.five_bar()
        >>> poses = sst_pin.reach_map(lift, "platform", 2.0, x=[-0.05, 0.05], y=[0.0, 0.1, 0.2])
        >>> poses.why
        array([[2, 0, 3],
               [2, 0, 3]], dtype=int8)
        >>> poses.condition[:, 1].round(2)
        array([3.03, 3.03])
    """
    require_robot("chain", chain)
    # The grid, and the numbers that do not change along it.
    prescribed = dict[str, Array]()
    components = {"x": x, "y": y, "z": z, "roll": roll, "pitch": pitch, "yaw": yaw}
    for name, value in components.items():
        if value is not None:
            prescribed[name] = finite_array(name, value, ())
    grid = PoseGrid(prescribed, grid_axes(prescribed))
    limits = finite_limits(torques, len(chain.motor_names), "torques")
    load = single_array("wrench", np.zeros(6) if wrench is None else wrench, (6,))

    # The start.
    if not np.isin(chain.mechanism.coordinates, chain.mechanism.driven).all():
        # Coordinates without motors may be dependent in poses that the motors hold: take others.
        chain = chain.with_coordinates(None)
    guess = start_of(chain.engine) if start is None else start
    q_start = chain.assemble(single_array("start", guess, (chain.mechanism.model.nq,)))
    zero_rates = np.zeros(chain.degrees_of_freedom)
    # This call raises an ActuationError if the motors do not hold all coordinates.
    chain.compute_torques(q_start, zero_rates, zero_rates)
    # The prescribed twist of the frame at the start is A_start times the rates of the motors.
    A_start = _motion_by_motors(chain, q_start, frame, grid)
    guide = _motor_guide(chain, frame, grid)
    start_pose = guide.pose(q_start)
    if rotation is None:
        orientation_at_zero = start_pose.rotation
    else:
        orientation_at_zero = single_array("rotation", rotation, (3, 3))
    _require_motion(A_start, grid.tangents_at(start_pose, orientation_at_zero), grid)

    # The poses that are reached.
    poses = grid.poses(start_pose.translation, orientation_at_zero)
    start_point = grid.point_of(start_pose, orientation_at_zero)
    why, q = reached_from(q_start, start_point, poses, chain, guide)
    reached = why == REACHED
    q_reached = q[reached]

    # Conditioning and holding torques there.
    A = _motion_by_motors(chain, q_reached, frame, grid)
    _warn_of_thin_map(A, grid.tangents()[reached], grid)
    holding = _holding(chain, q_reached, frame, load, limits)
    motors = columns_of("tau", chain.motor_names, chain.motor_units)
    joints = columns_of("q", chain.position_names, chain.position_units)
    return ReachMap(
        axes=grid.axes,
        values=grid.values,
        poses=poses,
        why=why,
        q=q,
        condition=_on_grid(reached, _conditions(A)),
        torque=_on_grid(reached, holding.torques),
        used=_on_grid(reached, holding.used),
        columns=(*motors, *joints),
    )


class _Holding(NamedTuple):
    """Torques that hold some poses; see `ReachMap`."""

    torques: Array  #: Shape (N, motors).
    used: Array  #: Shape (N,).


def _holding(chain: ClosedChain, q: Array, frame: str, load: Array, limits: Array) -> _Holding:
    """Torques that hold configurations, shape (N, nq), with a wrench on the frame, shape (6,)."""
    at_rest = np.zeros(chain.degrees_of_freedom)
    tau = chain.compute_torques(q, at_rest, at_rest)
    G = torques_of_wrenches(chain, q, frame)
    tau = tau - load @ G.mT  # the wrench w on the frame replaces the torques G w
    preloads = chain.preload_directions(q)
    torques = np.empty(tau.shape)
    for k in range(len(tau)):
        torques[k] = within_limits(tau[k], preloads[k], limits)
    return _Holding(torques, used=largest_part(tau, preloads, limits))


def _on_grid(reached: Flags, values: Array) -> Array:
    """Values of the poses that are reached, on the grid; NaN elsewhere."""
    on_grid = np.full((*reached.shape, *values.shape[1:]), np.nan)
    on_grid[reached] = values
    return on_grid


def _motion_by_motors(chain: ClosedChain, q: Array, frame: str, grid: PoseGrid) -> Array:
    """A, shape (..., c, motors): the frame's c prescribed velocities are A times the motors' rates.

    Both are free of units: lengths are divided by the robot's length, rates of motors by
    `motor_scale`. Before this division A is the transpose of G, where a wrench w on the frame takes
    the torques G w: the wrench and the torques have the same power.
    """
    mechanism = chain.mechanism
    units = np.repeat([mechanism.length, 1.0], 3)[:, None]
    A = torques_of_wrenches(chain, q, frame).mT * mechanism.motor_scale / units
    return A[..., grid.is_prescribed, :]


def _motor_guide(chain: ClosedChain, frame: str, grid: PoseGrid) -> FrameGuide:
    """A guide that moves the frame along prescribed components by the motors."""
    mechanism = chain.mechanism
    unit_rates = np.eye(mechanism.model.nv)

    def motor_rates(q: Array) -> Array:
        """The motors' rates by the rates of all joints, free of units, shape (motors, nv)."""
        on_lines = chain.engine.line_rates(q, unit_rates) @ mechanism.lines.actuation
        per_unit = mechanism.rate_scale / mechanism.motor_scale[:, None]
        return np.asarray((mechanism.actuation + on_lines).T * per_unit)

    return FrameGuide(
        mechanism,
        chain.generic_configuration(),
        frame,
        grid.with_position,
        grid.with_orientation,
        drives=motor_rates,
    )


def _require_motion(A: Array, tangents: Array, grid: PoseGrid) -> None:
    """Refuse a frame that cannot move along both axes of the grid from the start.

    A and the tangents of the grid, shape (c, 2), are those at the start.
    """
    for k, axis in enumerate(grid.axes):
        if _is_stuck(A, tangents[:, [k]]):
            others = ", ".join(name for name in grid.names if name != axis)
            problem = f"at the start the motors cannot move the frame along it with {others} fixed"
            cause = "the robot has fewer freedoms or motors, or the start is singular"
            if grid.with_orientation:
                cause += ", or the angles are not from the orientation at the start: rotation="
            raise InputError(axis, f"{problem}: {cause}")


def _is_stuck(A: Array, directions: Array) -> Flags:
    """Whether there is a direction along which the motors cannot move the frame, shape (...).

    A has shape (..., c, motors). The k directions are columns, shape (..., c, k). A direction d is
    a motion of the motors if it is in the range of A: d = A A^+ d. Tangents of a `PoseGrid` have
    entries of size 1, linear or angular, so that the residual has no unit. It is 0 or about 1 but
    for rounding; the limit lies between.
    """
    residual = directions - A @ (np.linalg.pinv(A, rcond=RANK_TOLERANCE) @ directions)
    return np.asarray(np.abs(residual).max(axis=(-2, -1)) > np.sqrt(RANK_TOLERANCE))


def _warn_of_thin_map(A: Array, tangents: Array, grid: PoseGrid) -> None:
    """Warn if the frame cannot move along both axes of the grid in the majority of reached poses.

    Args:
        A: `_motion_by_motors` at the poses that are reached, shape (k, c, motors).
        tangents: Directions along both axes there, shape (k, c, 2).
        grid: The grid.
    """
    is_stuck = _is_stuck(A, tangents)
    if is_stuck.sum() > len(is_stuck) / 2:
        warn_caller(
            f"at {is_stuck.sum()} of {len(is_stuck)} poses that are reached the frame cannot move "
            f"along both {grid.axes[0]} and {grid.axes[1]} with {', '.join(grid.names)} "
            "prescribed, so the map "
            "holds only some lines of the grid; take the joints as the grid: assemble(...) for a "
            "batch of coordinates, then frame_placement",
            RuntimeWarning,
        )


def _conditions(A: Array) -> Array:
    """Condition numbers of matrices, shape (N, c, motors); very large where one loses rank.

    Directions in which the frame moves in no pose do not count, such as rotations about x and y of
    a planar robot. If r is the largest rank of all matrices, the result is the first singular value
    divided by the r-th one.
    """
    s = np.linalg.svd(A, compute_uv=False)
    largest_rank = (s > RANK_TOLERANCE * s[:, :1]).sum(axis=1).max(initial=1)
    with np.errstate(divide="ignore"):
        return np.asarray(s[:, 0] / s[:, largest_rank - 1])

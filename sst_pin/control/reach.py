# SPDX-License-Identifier: BSD-2-Clause
"""Poses that a frame reaches, with the conditioning there and the torques that hold them."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Flags, finite_array, single_array
from ..closed_chain import ClosedChain
from ..dynamics.torque_sharing import finite_limits, within_limits
from ..errors import InputError, warn_caller
from ..files import as_path, table_writer, write_files
from ..loops.frame_guide import FrameGuide
from ..loops.start import start_of
from ..model.thresholds import RANK_TOLERANCE
from ..progress import counted
from ..simulation.motion_columns import columns_of
from ..summaries import listed
from .motor_limits import largest_part
from .pose_abilities import torques_of_wrenches

#: Codes of `ReachMap.why`.
REASONS = ("reached", "joint limits", "singular", "out of reach", "cut off")
_REACHED, _LIMITS, _SINGULAR, _OUT, _CUT_OFF = range(len(REASONS))
_AXES = ("x", "y", "z", "roll", "pitch", "yaw")
#: Number of grid points that are tried from the start; the shortest step, as a part of a path.
_FIRST, _SHORTEST = 4, 2**-6


@dataclass(frozen=True, eq=False)
class ReachMap:
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
        return self.why == _REACHED

    @property
    def area(self) -> float:
        """Area of the poses that are reached, [m^2], [m rad] or [rad^2]."""
        from scipy.integrate import trapezoid

        rows = trapezoid(self.reached.astype(float), self.values[1])
        return float(trapezoid(rows, self.values[0]))

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write a .csv, one row for each pose."""
        grid = np.meshgrid(*self.values, indexing="ij")
        columns = [x[..., None] for x in (*grid, self.why, self.condition, self.used)]
        rows = np.concatenate([*columns, self.torque, self.q], axis=-1)
        names = [f"{axis}_{'m' if axis in 'xyz' else 'rad'}" for axis in self.axes]
        names += ["why", "condition", "used", *self.columns]
        write_files({as_path(path): table_writer(names, rows.reshape(-1, len(names)))}, force)


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

    All three angles of a prescribed orientation count, and rotations about y and then about x are
    others than about x and then about y. So a frame behind a universal joint whose first axis is x
    reaches only the poses where roll or pitch is 0. A warning says when a map is such a cross. Then
    take the joints as the grid: `assemble` closes the loops for a batch of coordinates, and
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
    components = dict(zip(_AXES, (x, y, z, roll, pitch, yaw), strict=True))
    named = {name: finite_array(name, v, ()) for name, v in components.items() if v is not None}
    axes = _grid_axes(named)
    if not np.isin(chain.mechanism.coordinates, chain.mechanism.driven).all():
        # coordinates without motors may have dead points where the motors have none
        chain = chain.with_coordinates(None)
    mechanism = chain.mechanism
    limits = finite_limits(torques, len(chain.motor_names), "torques")
    push = single_array("wrench", np.zeros(6) if wrench is None else wrench, (6,))
    guess = start_of(chain.engine) if start is None else start
    home = chain.assemble(single_array("start", guess, (mechanism.model.nq,)))
    rest = np.zeros(chain.degrees_of_freedom)
    chain.compute_torques(home, rest, rest)  # refuses motors that hold less than all
    counted = np.repeat([not named.keys().isdisjoint(_AXES[k : k + 3]) for k in (0, 3)], 3)
    guide = _motor_guide(chain, frame, counted)
    zero = guide.pose(home).rotation if rotation is None else rotation
    zero = single_array("rotation", zero, (3, 3))
    units = np.repeat([mechanism.length, 1.0], 3)[:, None]
    ratio = (mechanism.motor_scale / units)[counted]
    first = torques_of_wrenches(chain, home, frame).mT[counted] * ratio
    _require_motion(first, np.array(_AXES)[counted], axes)
    poses, nearest = _poses(guide.pose(home), zero, named, axes)
    why, q = _flood(chain, guide, home, poses, nearest)
    reached = q[why == _REACHED]
    A = torques_of_wrenches(chain, reached, frame).mT
    directions = _directions(named, axes)[why == _REACHED][:, counted]
    _warn_of_thin_map(A[:, counted] * ratio, directions, axes, np.array(_AXES)[counted])
    tau = chain.compute_torques(reached, rest, rest) - push @ A
    directions = chain.preload_directions(reached)
    pairs = zip(tau, directions, strict=True)
    holding = np.array([within_limits(*each, limits) for each in pairs]).reshape(tau.shape)
    used = largest_part(tau, directions, limits)
    results = _conditions(A[:, counted] * ratio), holding, used
    condition, torque, used = (_on_grid(why == _REACHED, values) for values in results)
    motors = columns_of("tau", chain.motor_names, chain.motor_units)
    columns = *motors, *columns_of("q", chain.position_names, chain.position_units)
    values = named[axes[0]], named[axes[1]]
    return ReachMap(axes, values, poses, why, q, condition, torque, used, columns)


def _on_grid(reached: Flags, values: Array) -> Array:
    """Values of the poses that are reached on the grid, NaN elsewhere."""
    grid = np.full((*reached.shape, *values.shape[1:]), np.nan)
    grid[reached] = values
    return grid


def _grid_axes(named: dict[str, Array]) -> tuple[str, str]:
    """The two components that are grids."""
    axes = tuple(name for name, v in named.items() if v.ndim)
    if len(axes) != 2 or any(named[axis].ndim != 1 for axis in axes):
        raise InputError(", ".join(_AXES), "exactly two of them must be arrays, of shape (N,)")
    for axis in axes:
        if len(named[axis]) < 2 or (np.diff(named[axis]) <= 0).any():
            raise InputError(axis, "a grid has two values or more, increasing")
    return axes[0], axes[1]


def _motor_guide(chain: ClosedChain, frame: str, counted: Flags) -> FrameGuide:
    """A guide of the frame's components that count, driven by the motors."""
    mechanism, each = chain.mechanism, np.eye(chain.mechanism.model.nv)

    def motor_rates(q: Array) -> Array:
        """Rates of the motors by those of all joints, free of units."""
        on_lines = chain.engine.line_rates(q, each) @ mechanism.lines.motors
        per_unit = mechanism.rate_scale / mechanism.motor_scale[:, None]
        return np.asarray((mechanism.motors + on_lines).T * per_unit)

    generic, (position, _, _, orientation, _, _) = chain.generic_configuration(), map(bool, counted)
    return FrameGuide(mechanism, generic, frame, position, orientation, motor_rates)


def _require_motion(A: Array, counted: NDArray[np.str_], axes: Sequence[str]) -> None:
    """Refuse a frame that cannot move along the grid from the start."""
    rest = np.eye(len(A)) - A @ np.linalg.pinv(A, rcond=RANK_TOLERANCE)
    for axis in axes:
        if np.abs(rest[:, counted == axis]).max() > np.sqrt(RANK_TOLERANCE):
            others = ", ".join(counted[counted != axis])
            problem = f"at the start the motors cannot move the frame along it with {others} fixed"
            cause = "the robot has fewer freedoms or motors, or the start is singular"
            raise InputError(axis, f"{problem}: {cause}")


def _directions(named: dict[str, Array], axes: tuple[str, str]) -> Array:
    """Twists [linear; angular] along both axes of the grid at its poses, shape (N, M, 6, 2)."""
    mesh = np.meshgrid(*(named[axis] for axis in axes), indexing="ij")
    angles = {name: named.get(name, np.zeros(())) for name in ("pitch", "yaw")}
    angles |= {axis: values for axis, values in zip(axes, mesh, strict=True) if axis in angles}
    pitch, yaw = (np.broadcast_to(angles[name], mesh[0].shape) for name in ("pitch", "yaw"))
    zero = np.zeros(mesh[0].shape)
    one = np.ones(mesh[0].shape)
    # The orientation is R_z(yaw) R_y(pitch) R_x(roll).
    about = {
        "roll": [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)],
        "pitch": [-np.sin(yaw), np.cos(yaw), zero],
        "yaw": [zero, zero, one],
    }
    twists = np.zeros((*mesh[0].shape, 6, 2))
    for k, axis in enumerate(axes):
        if axis in about:
            twists[..., 3:, k] = np.stack(about[axis], axis=-1)
        else:
            twists[..., _AXES.index(axis), k] = 1.0
    return twists


def _warn_of_thin_map(
    A: Array, directions: Array, axes: tuple[str, str], counted: NDArray[np.str_]
) -> None:
    """Warn if at most poses that are reached the frame cannot move along both axes of the grid.

    A maps rates of the motors to the components that count, free of units, shape (k, c, motors);
    directions have shape (k, c, 2).
    """
    left = directions - A @ (np.linalg.pinv(A, rcond=RANK_TOLERANCE) @ directions)
    stuck = np.abs(left).max(axis=(1, 2)) > np.sqrt(RANK_TOLERANCE)
    if stuck.sum() > len(stuck) / 2:
        warn_caller(
            f"at {stuck.sum()} of {len(stuck)} poses that are reached the frame cannot move along "
            f"both {axes[0]} and {axes[1]} with {', '.join(counted)} prescribed, so the map holds "
            "only some lines of the grid; take the joints as the grid: assemble(...) for a batch "
            "of coordinates, then frame_placement",
            RuntimeWarning,
        )


def _poses(
    start: pin.SE3, zero: Array, named: dict[str, Array], axes: tuple[str, str]
) -> tuple[Array, Array]:
    """Poses of the grid, shape (N, M, 4, 4), and where the start is on it, in steps."""
    grid = dict(zip(axes, np.meshgrid(*(named[axis] for axis in axes), indexing="ij"), strict=True))
    here = dict(zip(_AXES, [*start.translation, *np.zeros(3)], strict=True)) | named | grid
    numbers = np.stack(np.broadcast_arrays(*(here[axis] for axis in _AXES)), axis=-1)
    rows = numbers.reshape(-1, 6)
    poses = [pin.SE3(pin.rpy.rpyToMatrix(x[3:]) @ zero, x[:3]).homogeneous for x in rows]
    angles = pin.rpy.matrixToRpy(start.rotation @ zero.T)
    begin = dict(zip(_AXES, [*start.translation, *angles], strict=True))
    places = [np.interp(begin[axis], named[axis], np.arange(len(named[axis]))) for axis in axes]
    return np.reshape(poses, (*numbers.shape[:2], 4, 4)), np.array(places)


def _flood(
    chain: ClosedChain, guide: FrameGuide, home: Array, poses: Array, nearest: Array
) -> tuple[NDArray[np.int8], Array]:
    """Reasons and configurations of all poses, found from neighbour to neighbour."""
    shape = poses.shape[:2]

    def beyond(q: Array) -> list[str]:
        """Joints outside their limits."""
        return [name for f in chain.check_limits(q) if not f.singular for name in f.joints]

    if joints := beyond(home):
        raise InputError("start", f"outside the limits of {listed(joints)}")
    why = np.full(shape, _CUT_OFF, dtype=np.int8)
    q = np.full((*shape, len(home)), np.nan)
    far = np.linalg.norm(np.indices(shape) - nearest[:, None, None], axis=0)
    first = np.argsort(far, axis=None, kind="stable")[:_FIRST]
    queue = deque((home, divmod(int(k), shape[1])) for k in first)
    left = iter(lambda: queue.popleft() if queue else None, None)
    for before, point in counted(left, "reach_map, poses tried"):
        if why[point] == _REACHED:
            continue
        end = guide.follow(before, pin.SE3(poses[point]), _SHORTEST)
        reason = _SINGULAR if end.singular else _OUT if end.missed else _LIMITS
        if not end.missed and not beyond(end.q):
            reason, q[point] = _REACHED, end.q
            i, j = point
            around = (i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)
            queue += [(end.q, (a, b)) for a, b in around if 0 <= a < shape[0] and 0 <= b < shape[1]]
        why[point] = min(why[point], reason)
    return why, q


def _conditions(A: Array) -> Array:
    """Condition numbers of matrices, shape (N, k, motors); very large where one loses rank."""
    s = np.linalg.svd(A, compute_uv=False)
    rank = (s > RANK_TOLERANCE * s[:, :1]).sum(axis=1).max(initial=1)
    with np.errstate(divide="ignore"):
        return np.asarray(s[:, 0] / s[:, rank - 1])

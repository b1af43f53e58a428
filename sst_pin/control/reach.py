# SPDX-License-Identifier: BSD-2-Clause
"""Poses that a frame reaches, with the conditioning there and the torques that hold them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
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

#: Words for the codes of `ReachMap.why`.
REASONS = ("reached", "joint limits", "singular", "out of reach", "cut off")
_REACHED = 0
_LIMITS = 1
_SINGULAR = 2
_OUT = 3
_CUT_OFF = 4
#: Components of a pose, in the order of a twist [linear; angular].
_AXES = ("x", "y", "z", "roll", "pitch", "yaw")
#: Number of grid points that are tried from the start.
_FIRST = 4
#: The shortest step to a pose, as a part of the path to it.
_SHORTEST = 2**-6


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
        first, second = np.meshgrid(*self.values, indexing="ij")
        numbers = np.stack([first, second, self.why, self.condition, self.used], axis=-1)
        rows = np.concatenate([numbers, self.torque, self.q], axis=-1)
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
    prescribed = dict[str, Array]()  # a number or a grid for each component that is given
    components = {"x": x, "y": y, "z": z, "roll": roll, "pitch": pitch, "yaw": yaw}
    for name, value in components.items():
        if value is not None:
            prescribed[name] = finite_array(name, value, ())
    axes = _grid_axes(prescribed)
    if not np.isin(chain.mechanism.coordinates, chain.mechanism.driven).all():
        # coordinates without motors may have dead points where the motors have none
        chain = chain.with_coordinates(None)
    mechanism = chain.mechanism
    limits = finite_limits(torques, len(chain.motor_names), "torques")
    load = single_array("wrench", np.zeros(6) if wrench is None else wrench, (6,))
    guess = start_of(chain.engine) if start is None else start
    q_start = chain.assemble(single_array("start", guess, (mechanism.model.nq,)))
    zero_rates = np.zeros(chain.degrees_of_freedom)
    chain.compute_torques(q_start, zero_rates, zero_rates)  # refuses motors that hold less than all

    # The position or the orientation is prescribed as a whole: components of the twist that count.
    with_position = not prescribed.keys().isdisjoint(_AXES[:3])
    with_orientation = not prescribed.keys().isdisjoint(_AXES[3:])
    is_prescribed = np.repeat([with_position, with_orientation], 3)
    names = np.array(_AXES)[is_prescribed]
    guide = _motor_guide(chain, frame, with_position, with_orientation)
    start_pose = guide.pose(q_start)
    zero = start_pose.rotation if rotation is None else single_array("rotation", rotation, (3, 3))

    # A maps rates of the motors to prescribed components, free of units. G w are the torques with
    # the same effect as a wrench w on the frame: their power is the same, so A is the transpose of
    # G. Motors that hold w give -G w.
    units = np.repeat([mechanism.length, 1.0], 3)[:, None]
    ratio = (mechanism.motor_scale / units)[is_prescribed]
    A_start = torques_of_wrenches(chain, q_start, frame).mT[is_prescribed] * ratio
    _require_motion(A_start, names, axes)

    poses, start_place = _poses(start_pose, zero, prescribed, axes)
    why, q = _flood(chain, guide, q_start, poses, start_place)
    reached = why == _REACHED
    G_T = torques_of_wrenches(chain, q[reached], frame).mT
    A = G_T[:, is_prescribed] * ratio
    directions = _directions(prescribed, axes)[reached][:, is_prescribed]
    _warn_of_thin_map(A, directions, axes, names)

    # Torques that hold the poses, with the preload that keeps them within the limits.
    # The rows of load @ G_T are G w.
    tau = chain.compute_torques(q[reached], zero_rates, zero_rates) - load @ G_T
    preloads = chain.preload_directions(q[reached])
    holding = np.empty(tau.shape)
    for k in range(len(tau)):
        holding[k] = within_limits(tau[k], preloads[k], limits)
    motors = columns_of("tau", chain.motor_names, chain.motor_units)
    joints = columns_of("q", chain.position_names, chain.position_units)
    return ReachMap(
        axes=axes,
        values=(prescribed[axes[0]], prescribed[axes[1]]),
        poses=poses,
        why=why,
        q=q,
        condition=_on_grid(reached, _conditions(A)),
        torque=_on_grid(reached, holding),
        used=_on_grid(reached, largest_part(tau, preloads, limits)),
        columns=(*motors, *joints),
    )


def _on_grid(reached: Flags, values: Array) -> Array:
    """Values of the poses that are reached on the grid, NaN elsewhere."""
    grid = np.full((*reached.shape, *values.shape[1:]), np.nan)
    grid[reached] = values
    return grid


def _grid_axes(prescribed: Mapping[str, Array]) -> tuple[str, str]:
    """The two components that are grids."""
    axes = [name for name, values in prescribed.items() if values.ndim > 0]
    if len(axes) != 2 or any(prescribed[axis].ndim != 1 for axis in axes):
        raise InputError(", ".join(_AXES), "exactly two of them must be arrays, of shape (N,)")
    for axis in axes:
        if len(prescribed[axis]) < 2 or (np.diff(prescribed[axis]) <= 0).any():
            raise InputError(axis, "a grid has two values or more, increasing")
    return axes[0], axes[1]


def _motor_guide(
    chain: ClosedChain, frame: str, with_position: bool, with_orientation: bool
) -> FrameGuide:
    """A guide that moves the frame's position or orientation by the motors."""
    mechanism = chain.mechanism
    unit_rates = np.eye(mechanism.model.nv)

    def motor_rates(q: Array) -> Array:
        """Derivatives of the motors' rates by the rates of all joints, free of units."""
        on_lines = chain.engine.line_rates(q, unit_rates) @ mechanism.lines.actuation
        per_unit = mechanism.rate_scale / mechanism.motor_scale[:, None]
        return np.asarray((mechanism.actuation + on_lines).T * per_unit)

    generic = chain.generic_configuration()
    return FrameGuide(mechanism, generic, frame, with_position, with_orientation, motor_rates)


def _require_motion(A: Array, names: NDArray[np.str_], axes: Sequence[str]) -> None:
    """Refuse a frame that cannot move along the grid from the start.

    A maps rates of the motors to the prescribed components, whose names are given.
    """
    for axis in axes:
        if _is_stuck(A, np.eye(len(A))[:, names == axis]):
            others = ", ".join(names[names != axis])
            problem = f"at the start the motors cannot move the frame along it with {others} fixed"
            cause = "the robot has fewer freedoms or motors, or the start is singular"
            raise InputError(axis, f"{problem}: {cause}")


def _is_stuck(A: Array, directions: Array) -> Flags:
    """Whether no rates of the motors give one of the directions, which are in columns, shape (...).

    A has shape (..., c, motors), directions have (..., c, k). Each direction is only linear or only
    angular, so that its unit does not matter.
    """
    residual = directions - A @ (np.linalg.pinv(A, rcond=RANK_TOLERANCE) @ directions)
    return np.asarray(np.abs(residual).max(axis=(-2, -1)) > np.sqrt(RANK_TOLERANCE))


def _directions(prescribed: Mapping[str, Array], axes: tuple[str, str]) -> Array:
    """Twists [linear; angular] along both axes of the grid at its poses, shape (N, M, 6, 2)."""
    grid = _meshes(prescribed, axes)
    shape = grid[axes[0]].shape
    angles = {"pitch": np.zeros(shape), "yaw": np.zeros(shape)}
    for name in angles:
        if name in grid:
            angles[name] = grid[name]
        elif name in prescribed:
            angles[name] = np.full(shape, prescribed[name])
    pitch = angles["pitch"]
    yaw = angles["yaw"]
    zero = np.zeros(shape)
    one = np.ones(shape)
    # The orientation is R_z(yaw) R_y(pitch) R_x(roll).
    rotation_axes = {
        "roll": [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)],
        "pitch": [-np.sin(yaw), np.cos(yaw), zero],
        "yaw": [zero, zero, one],
    }
    twists = np.zeros((*shape, 6, 2))
    for k, axis in enumerate(axes):
        if axis in rotation_axes:
            twists[..., 3:, k] = np.stack(rotation_axes[axis], axis=-1)
        else:
            twists[..., _AXES.index(axis), k] = 1.0
    return twists


def _meshes(prescribed: Mapping[str, Array], axes: tuple[str, str]) -> dict[str, Array]:
    """The values of both axes on the grid, each of shape (N, M)."""
    first, second = np.meshgrid(prescribed[axes[0]], prescribed[axes[1]], indexing="ij")
    return {axes[0]: first, axes[1]: second}


def _warn_of_thin_map(
    A: Array, directions: Array, axes: tuple[str, str], names: NDArray[np.str_]
) -> None:
    """Warn if at most poses that are reached the frame cannot move along both axes of the grid.

    A maps rates of the motors to the prescribed components of these names, free of units, shape
    (k, c, motors); directions have shape (k, c, 2).
    """
    is_stuck = _is_stuck(A, directions)
    if is_stuck.sum() > len(is_stuck) / 2:
        warn_caller(
            f"at {is_stuck.sum()} of {len(is_stuck)} poses that are reached the frame cannot move "
            f"along both {axes[0]} and {axes[1]} with {', '.join(names)} prescribed, so the map "
            "holds only some lines of the grid; take the joints as the grid: assemble(...) for a "
            "batch of coordinates, then frame_placement",
            RuntimeWarning,
        )


def _poses(
    start: pin.SE3, zero: Array, prescribed: Mapping[str, Array], axes: tuple[str, str]
) -> tuple[Array, Array]:
    """Poses of the grid, shape (N, M, 4, 4), and the place of the start on it, in grid steps.

    `zero` is the orientation where the angles are 0.
    """
    # Components that are not prescribed: the position of the start, and angles of zero.
    values: dict[str, ArrayLike] = {"x": start.translation[0], "y": start.translation[1]}
    values |= {"z": start.translation[2], "roll": 0.0, "pitch": 0.0, "yaw": 0.0}
    values |= prescribed
    values |= _meshes(prescribed, axes)
    shape = (len(prescribed[axes[0]]), len(prescribed[axes[1]]))
    numbers = np.stack([np.broadcast_to(values[axis], shape) for axis in _AXES], axis=-1)
    poses = np.empty((*shape, 4, 4))
    for point in np.ndindex(shape):
        position, angles = np.split(numbers[point], 2)
        poses[point] = pin.SE3(pin.rpy.rpyToMatrix(angles) @ zero, position).homogeneous

    angles_of_start = pin.rpy.matrixToRpy(start.rotation @ zero.T)
    components = dict(zip(_AXES, [*start.translation, *angles_of_start], strict=True))
    place = []
    for axis in axes:
        grid = prescribed[axis]
        place.append(np.interp(components[axis], grid, np.arange(len(grid))))
    return poses, np.array(place)


def _flood(
    chain: ClosedChain, guide: FrameGuide, home: Array, poses: Array, start_place: Array
) -> tuple[NDArray[np.int8], Array]:
    """Reasons and configurations of all poses, from neighbour to neighbour.

    The poses next to the start are tried from it. Each pose that is reached adds its neighbours to
    the queue, with its configuration as their start.
    """
    shape = poses.shape[:2]

    def joints_beyond_limits(q: Array) -> list[str]:
        joints: list[str] = []
        for finding in chain.check_limits(q):
            if not finding.singular:
                joints.extend(finding.joints)
        return joints

    joints = joints_beyond_limits(home)
    if joints:
        raise InputError("start", f"outside the limits of {listed(joints)}")
    why = np.full(shape, _CUT_OFF, dtype=np.int8)
    q = np.full((*shape, len(home)), np.nan)
    distances = np.linalg.norm(np.indices(shape) - start_place[:, None, None], axis=0)
    queue = deque[tuple[Array, tuple[int, int]]]()
    for k in np.argsort(distances, axis=None, kind="stable")[:_FIRST]:
        queue.append((home, divmod(int(k), shape[1])))

    def tries() -> Iterator[tuple[Array, tuple[int, int]]]:
        while queue:
            yield queue.popleft()

    for before, (i, j) in counted(tries(), "reach_map, poses tried"):
        if why[i, j] == _REACHED:
            continue
        end = guide.follow(before, pin.SE3(poses[i, j]), _SHORTEST)
        if not end.missed and not joints_beyond_limits(end.q):
            reason = _REACHED
        elif end.singular:
            reason = _SINGULAR
        elif end.missed:
            reason = _OUT
        else:
            reason = _LIMITS
        if reason == _REACHED:
            q[i, j] = end.q
            for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
                if 0 <= a < shape[0] and 0 <= b < shape[1]:
                    queue.append((end.q, (a, b)))
        # A pose may be tried from several neighbours: the smallest code is the result.
        why[i, j] = min(why[i, j], reason)
    return why, q


def _conditions(A: Array) -> Array:
    """Condition numbers of matrices, shape (N, k, motors); very large where one loses rank.

    Components in which the frame can move in no pose do not count: the last singular value is that
    of the largest rank of all poses. A pose with a smaller rank has a very large number.
    """
    s = np.linalg.svd(A, compute_uv=False)
    largest_rank = (s > RANK_TOLERANCE * s[:, :1]).sum(axis=1).max(initial=1)
    with np.errstate(divide="ignore"):
        return np.asarray(s[:, 0] / s[:, largest_rank - 1])

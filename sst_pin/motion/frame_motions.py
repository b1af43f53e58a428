# SPDX-License-Identifier: BSD-2-Clause
"""Motions of any closed chain given by the motion of a frame: all joints follow."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import as_array, finite_array, name_samples
from ..chain.backend import States
from ..chain.closed_chain import ClosedChain
from ..chain.thresholds import CLOSURE_TOLERANCE
from ..chain.tree import frame_id
from ..errors import InputError, SSTError, WorkspaceError
from .coordinate_motions import coordinate_positions, followed, start_of
from .samples import sample_times, spline
from .trajectories import Trajectory

Array = NDArray[np.float64]
#: Newton's method: the longest step and the last one, [rad] or of the robot's length; steps that
#: may bring it no nearer.
_LONGEST, _LAST, _PATIENCE = 0.2, 1e-13, 5
#: Where more than this is wanted at once, the frame is at the end of its reach.
_FARTHEST = 10.0
#: Motions of a frame that a rate of this size hardly makes count as impossible.
_SINGULAR = 1e-8


def frame_motion(
    chain: ClosedChain,
    t: ArrayLike,
    frame: str,
    poses: ArrayLike,
    start: ArrayLike | None = None,
) -> Trajectory:
    """The motion and the torques for given poses of a frame over time.

    The joints are computed from sample to sample by Newton's method, in steps short enough to stay
    in the same assembly and working mode. With more freedoms than the task needs, the coordinates
    move least. Rates are derivatives of splines of degree five through the coordinates.

    Args:
        chain: Any closed chain with revolute or prismatic coordinates.
        t: Times, increasing, shape (N,), N >= 3, [s].
        frame: Name of a frame of the tree.
        poses: In the base: positions of its origin, shape (N, 3), [m], orientations, (N, 3, 3), or
            homogeneous matrices, (N, 4, 4).
        start: A guess of all joints at t[0], shape (nq,), which selects the modes; by default
            `home` or, without it, all joints at zero.

    Raises:
        InputError: For a wrong shape, or matrices that are not rotations.
        WorkspaceError: If the frame does not reach a pose; it names the sample.
        UnknownNameError: For an unknown frame, or a coordinate that neither turns nor slides.

    Example:
        >>> delta = sst_pin.robots.delta()
        >>> t = np.linspace(0, 1, 21)
        >>> points = np.column_stack([0.05 * np.cos(t), 0.05 * np.sin(t), 0 * t - 0.25])
        >>> motion = sst_pin.frame_motion(delta, t, "platform", points)
        >>> delta.platform_pose(motion.q[-1])[:3, 3].round(4)
        array([ 0.027 ,  0.0421, -0.25  ])
    """
    times = sample_times(t, 3)
    targets = targets_of(poses, len(times))
    states, size = chain._states(0.0), (chain.mechanism.model.nq,)
    guess = start_of(chain) if start is None else finite_array("start", start, size)
    now, q = chain.assemble(guess), np.empty((len(times), *size))
    for i, target in enumerate(targets):
        try:
            now = q[i] = _reached(chain, states, frame, now, target)
        except WorkspaceError as error:
            name_samples(error, [i], (len(times),))
            raise
    curve = spline(times, coordinate_positions(chain, q))
    return chain.trajectory(times, q, curve.derivative(1)(times), curve.derivative(2)(times))


def targets_of(poses: ArrayLike, count: int) -> list[tuple[Array | None, Array | None]]:
    """Position and orientation of each sample, None where it does not matter."""
    given = as_array("poses", poses, ())
    if given.shape[1:] not in ((3,), (3, 3), (4, 4)) or len(given) != count:
        shapes = f"({count}, 3), ({count}, 3, 3) or ({count}, 4, 4)"
        raise InputError("poses", f"shape {given.shape}, expected {shapes}")
    given = finite_array("poses", given, given.shape[1:])
    if given.ndim == 2:
        return [(p, None) for p in given]
    R = given[:, :3, :3]
    if np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max() > 1e-6 or (np.linalg.det(R) < 0).any():
        raise InputError("poses", "not all are rotation matrices")
    if given.shape[1:] == (3, 3):
        return [(None, each) for each in R]
    if np.abs(given[:, 3] - (0, 0, 0, 1)).max() > 0:
        raise InputError("poses", "the last row of a homogeneous matrix is 0, 0, 0, 1")
    return list(zip(given[:, :3, 3], R, strict=True))


def pose_error(at: pin.SE3, position: Array | None, R: Array | None) -> Array:
    """From a pose to a target, in base axes, [m] and [rad], shape (3,) or (6,)."""
    away = [] if position is None else [position - at.translation]
    turn = [] if R is None else [at.rotation @ pin.log3(at.rotation.T @ R)]
    return np.concatenate([*away, *turn])


def _reached(
    chain: ClosedChain,
    states: States,
    frame: str,
    q: Array,
    target: tuple[Array | None, Array | None],
) -> Array:
    """The configuration next to q where a frame is at its target."""
    mechanism = chain.mechanism
    model, number = mechanism.model, frame_id(mechanism.model, frame)
    data = model.createData()
    position, R = target
    kept = np.repeat([position is not None, R is not None], 3)
    unit = np.repeat([mechanism.length, 1.0], 3)
    scale = mechanism.rate_scale[mechanism.coordinates]
    missed, stalled = np.inf, 0
    while stalled < _PATIENCE:
        pin.forwardKinematics(model, data, q)
        at = pin.updateFramePlacement(model, data, number)
        error = pose_error(at, position, R) / unit[kept]
        before, missed = missed, float(np.abs(error).max())
        stalled += missed > 0.99 * before
        try:
            J = chain.frame_jacobian(q, frame) / unit[:, None] * scale
            cut = _SINGULAR * np.linalg.norm(J) / max(np.linalg.norm(J[kept]), 1e-300)
            step = np.linalg.pinv(J[kept], rcond=min(1.0, cut)) @ error
            size = float(np.abs(step).max())
            if size <= _LAST or size > _FARTHEST:
                break
            q = followed(chain, states, q, step * scale * min(1.0, _LONGEST / size))
        except SSTError:
            break
    if missed > CLOSURE_TOLERANCE:
        raise WorkspaceError(
            f"frame {frame} does not reach the pose: it misses it by {missed:.3g} (rad, or parts "
            "of the robot's length), at the end of its reach, or because it has fewer freedoms"
        )
    return q

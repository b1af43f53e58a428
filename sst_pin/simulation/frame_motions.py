# SPDX-License-Identifier: BSD-2-Clause
"""Motions of any closed chain given by the motion of a frame: all joints follow."""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, as_array, finite_array, name_samples
from ..closed_chain import ClosedChain
from ..errors import InputError, SSTError
from ..loops.frame_guide import FrameGuide, pose_of, rotations
from ..loops.starts import start_of
from ..model.named_positions import taken
from .coordinate_motions import without_full_turns
from .samples import sample_times, spline
from .trajectories import Trajectory


def frame_motion(
    chain: ClosedChain,
    t: ArrayLike,
    frame: str,
    poses: ArrayLike,
    start: ArrayLike | None = None,
) -> Trajectory:
    """The motion and the torques for given poses of a frame over time.

    The joints are computed from sample to sample by Newton's method, in steps short enough to stay
    in the same assembly and working mode. With more freedoms than the task needs, the joints move
    least. Rates are derivatives of splines of degree five through the coordinates.

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
        WorkspaceError, SingularConfigurationError: As `ClosedChain.frame_configuration`; the error
            names the sample.
        UnknownNameError: For an unknown frame.

    Example:
        >>> delta = sst_pin.robots.delta()
        >>> t = np.linspace(0, 1, 21)
        >>> points = np.column_stack([0.05 * np.cos(t), 0.05 * np.sin(t), 0 * t - 0.25])
        >>> motion = sst_pin.frame_motion(delta, t, "platform", points)
        >>> delta.platform_pose(motion.q[-1])[:3, 3].round(4)
        array([ 0.027 ,  0.0421, -0.25  ])
    """
    chain, times = copy(chain), sample_times(t, 3)
    targets = targets_of(poses, len(times))
    kept = (targets[0][0] is not None, targets[0][1] is not None)
    guide = FrameGuide(chain.mechanism, chain.generic_configuration(), frame, *kept)
    size = (chain.mechanism.model.nq,)
    guess = start_of(chain) if start is None else finite_array("start", start, size)
    now, q = chain.assemble(guess), np.empty((len(times), *size))
    for i, (p, R) in enumerate(targets):
        try:
            now = q[i] = guide.lead(now, pose_of(p, R))
        except SSTError as error:
            name_samples(error, [i], (len(times),))
            raise
    x = taken(chain.mechanism.space, q, chain.coordinates)  # Newton's method makes no full turns
    curve = spline(times, without_full_turns(chain, x))
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
    R = rotations("poses", given[:, :3, :3])
    if given.shape[1:] == (3, 3):
        return [(None, each) for each in R]
    if np.abs(given[:, 3] - (0, 0, 0, 1)).max() > 0:
        raise InputError("poses", "the last row of a homogeneous matrix is 0, 0, 0, 1")
    return list(zip(given[:, :3, 3], R, strict=True))

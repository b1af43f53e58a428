# SPDX-License-Identifier: BSD-2-Clause
"""Motions of any closed chain from poses of a frame over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, as_array, finite_array, name_samples
from ..engine import Robot
from ..errors import InputError, SSTError
from ..loops.frame_guide import FrameGuide, pose_of, rotations
from ..loops.start import assemble, start_of
from ..model.named_positions import taken
from ..progress import counted
from .coordinate_motions import motion_along, without_full_turns
from .samples import sample_times
from .trajectories import Trajectory


def frame_motion(
    chain: Robot,
    t: ArrayLike,
    frame: str,
    poses: ArrayLike,
    start: ArrayLike | None = None,
) -> Trajectory:
    """The motion and the torques for given poses of a frame over time.

    The joints are computed from sample to sample by Newton's method, in steps short enough to stay
    in the same assembly and working mode. If the robot has more degrees of freedom than the task
    needs, the joints move as little as possible. For rates, see `coordinate_motion`.

    Args:
        chain: Any closed chain with revolute or prismatic coordinates.
        t: Times, increasing, shape (N,), N >= 3, [s].
        frame: Name of a frame of the tree.
        poses: In the base: positions of its origin, shape (N, 3), [m], orientations, (N, 3, 3), or
            homogeneous matrices, (N, 4, 4).
        start: A guess of all joints at t[0], shape (nq,), which selects the modes; by default
            `home`, else a configuration near zero.

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
    engine, times = chain.engine, sample_times(t, 3)
    mechanism, size = engine.mechanism, (engine.mechanism.model.nq,)
    targets = targets_of(poses, len(times))
    kinds = (targets[0][0] is not None, targets[0][1] is not None)
    guide = FrameGuide(mechanism, engine.loops.example(), frame, *kinds)
    guess = start_of(engine) if start is None else finite_array("start", start, size)
    last, q = assemble(engine, guess), np.empty((len(times), *size))
    for i, (p, R) in counted(enumerate(targets), "frame_motion", len(targets)):
        try:
            last = q[i] = guide.lead(last, pose_of(p, R))
        except SSTError as error:
            name_samples(error, [i], (len(times),))
            raise
    x = taken(mechanism.space, q, mechanism.coordinate_names)  # Newton's method makes no full turns
    return motion_along(engine, times, q, without_full_turns(mechanism, x))


def targets_of(poses: ArrayLike, count: int) -> list[tuple[Array | None, Array | None]]:
    """Position and orientation of each sample; None for what is free."""
    array = as_array("poses", poses, ())
    if array.shape[1:] not in ((3,), (3, 3), (4, 4)) or len(array) != count:
        shapes = f"({count}, 3), ({count}, 3, 3) or ({count}, 4, 4)"
        raise InputError("poses", f"shape {array.shape}, expected {shapes}")
    array = finite_array("poses", array, array.shape[1:])
    if array.ndim == 2:
        return [(p, None) for p in array]
    R = rotations("poses", array[:, :3, :3])
    if array.shape[1:] == (3, 3):
        return [(None, each) for each in R]
    if np.abs(array[:, 3] - (0, 0, 0, 1)).max() > 0:
        raise InputError("poses", "the last row of a homogeneous matrix is 0, 0, 0, 1")
    return list(zip(array[:, :3, 3], R, strict=True))

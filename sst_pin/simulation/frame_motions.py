# SPDX-License-Identifier: BSD-2-Clause
"""Motions of any closed chain from poses of a frame over time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, as_array, finite_array, name_samples
from ..engine import Robot, require_robot
from ..errors import InputError, SSTError
from ..loops.frame_guide import FrameGuide, pose_of, rotations
from ..loops.start import assemble, start_of
from ..model.named_positions import positions_of
from ..progress import counted
from .coordinate_motions import motion_along, require_start_with_brakes, without_full_turns
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
            `home`, else a configuration near zero. A robot with brakes needs it: it has the
            positions at which they hold.

    Raises:
        InputError: For a wrong shape, matrices that are not rotations, or a robot with brakes and
            no `start`.
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
    require_robot("chain", chain)
    engine = chain.engine
    mechanism = engine.mechanism
    require_start_with_brakes(mechanism, start)
    times = sample_times(t, 3)
    targets = _targets(poses, len(times))
    guide = FrameGuide(
        mechanism, engine.loops.example(), frame, targets.p is not None, targets.R is not None
    )
    if start is None:
        guess = start_of(engine)
    else:
        guess = finite_array("start", start, (mechanism.model.nq,))
    present = assemble(engine, guess)
    q = np.empty((len(times), mechanism.model.nq))
    for i in counted(range(len(times)), "frame_motion", len(times)):
        try:
            present = guide.lead(present, targets.pose(i))
        except SSTError as error:
            name_samples(error, [i], (len(times),))
            raise
        q[i] = present
    # Newton's method makes no full turns, so that only unbounded joints have to be unwrapped.
    x = positions_of(mechanism.space, q, mechanism.coordinate_names)
    return motion_along(engine, times, q, without_full_turns(mechanism, x))


class _Targets(NamedTuple):
    """Poses of a frame in N samples. A position or an orientation that is free is None.

    Attributes:
        p: Positions, shape (N, 3), or None.
        R: Orientations, shape (N, 3, 3), or None.
    """

    p: Array | None
    R: Array | None

    def pose(self, i: int) -> pin.SE3:
        """The pose of sample i; a free position is zero, a free orientation the identity."""
        p = None if self.p is None else self.p[i]
        R = None if self.R is None else self.R[i]
        return pose_of(p, R)


def _targets(poses: ArrayLike, count: int) -> _Targets:
    """The poses in the three forms that a user can give."""
    array = as_array("poses", poses, ())
    if array.shape[1:] not in ((3,), (3, 3), (4, 4)) or len(array) != count:
        shapes = f"({count}, 3), ({count}, 3, 3) or ({count}, 4, 4)"
        raise InputError("poses", f"shape {array.shape}, expected {shapes}")
    array = finite_array("poses", array, array.shape[1:])
    if array.ndim == 2:
        return _Targets(array, None)
    R = rotations("poses", array[:, :3, :3])
    if array.shape[1:] == (3, 3):
        return _Targets(None, R)
    if (array[:, 3] != (0, 0, 0, 1)).any():
        raise InputError("poses", "the last row of a homogeneous matrix is 0, 0, 0, 1")
    return _Targets(array[:, :3, 3], R)

# SPDX-License-Identifier: BSD-2-Clause
"""Which samples of a motion a page shows, and the data at these samples.

A page shows at most 600 samples of a long motion. Forces are means between these samples.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Indices
from ..errors import InputError
from ..model.mechanism import Mechanism
from ..simulation.nonsmooth_rollout import NOT_REACHED, NonsmoothRollout
from ..simulation.trajectories import Trajectory, trajectory_of

#: The most samples of a motion in a page.
_MOST_SAMPLES = 600


def samples_of_page(count: int) -> Indices:
    """Indices of the samples that a page shows, of a motion of `count` samples."""
    return np.linspace(0, count - 1, min(count, _MOST_SAMPLES)).round().astype(np.intp)


def thinned(motion: Trajectory) -> Trajectory:
    """The samples of a motion that a page shows."""
    return motion[samples_of_page(len(motion))]


def mean_forces(forces: Array, samples: Indices) -> Array:
    """Mean forces between samples of a page, shape (n, contacts, 3).

    `forces` has the mean force of each step, and step k ends at sample k + 1. The result has for
    each sample of the page the mean of the steps since the sample before; the first sample has the
    forces of the first step.
    """
    # sums[k] is the sum of the forces of the first k steps, which end at sample k.
    sums = np.concatenate([np.zeros_like(forces[:1]), np.cumsum(forces, axis=0)])
    steps = np.diff(samples).reshape(-1, 1, 1)  # number of steps between two samples of the page
    means = np.diff(sums[samples], axis=0) / steps
    return np.concatenate([forces[:1], means])


def same_time(motion: Trajectory, ghost: Trajectory) -> Trajectory:
    """The samples of a ghost that cover the time it has in common with a motion, thinned.

    Raises:
        InputError: If they have no time in common.
    """
    low = max(motion.t[0], ghost.t[0])
    high = min(motion.t[-1], ghost.t[-1])
    if low >= high:
        time_of_ghost = f"from {ghost.t[0]:g} to {ghost.t[-1]:g} s"
        time_of_motion = f"from {motion.t[0]:g} to {motion.t[-1]:g} s"
        problem = f"{time_of_ghost}, the motion {time_of_motion}: no time in common"
        raise InputError("ghost", problem)
    # From the last sample at or before `low` to the first one at or after `high`.
    first = np.searchsorted(ghost.t, low, "right") - 1
    last = np.searchsorted(ghost.t, high)
    return thinned(ghost[first : last + 1])


def states_of(mechanism: Mechanism, rollout: NonsmoothRollout) -> Trajectory:
    """The states of one nonsmooth motion up to its last sample, as a `Trajectory`.

    Accelerations and torques are zero.

    Raises:
        InputError: For several motions, or the motion of another robot.
    """
    if rollout.q.ndim != 2:
        problem = f"{rollout.q.shape[:-2]} motions; give one, motion.single(0)"
        raise InputError("motion", problem)
    _require_size("positions", rollout.q.shape[-1], mechanism.model.nq)
    _require_size("rates", rollout.va.shape[-1], len(mechanism.coordinates))
    contacts = rollout.contact_forces.shape[-2]
    _require_size("contacts", contacts, len(mechanism.contacts.points))
    steps = int(np.count_nonzero(rollout.status != NOT_REACHED))
    count = steps + 1
    q = rollout.q[:count]
    va = rollout.va[:count]
    no_torques = np.zeros((count, len(mechanism.motor_names)))
    return trajectory_of(mechanism, rollout.t[:count], q, va, np.zeros_like(va), no_torques)


def _require_size(name: str, size: int, needed: int) -> None:
    """Refuse the rollout of another robot."""
    if size != needed:
        problem = f"belongs to another robot, with {size} {name} instead of {needed}"
        raise InputError("motion", problem)

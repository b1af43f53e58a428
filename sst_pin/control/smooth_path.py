# SPDX-License-Identifier: BSD-2-Clause
"""A smooth curve through configurations of a robot, with closed loops between them."""

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, finite_array
from ..closed_chain import ClosedChain
from ..errors import InputError
from ..model.named_positions import positions_of, with_positions
from ..simulation.coordinate_motions import coordinate_positions
from ..simulation.samples import spline

#: A sample counts as moving if its step is longer than this fraction of the path.
_SHORTEST_STEP = 1e-9
#: Largest change of q when the loops are closed between samples, [rad] or robot lengths. A larger
#: one means that the spline through the samples leaves the assembly mode or that samples jump.
_OPEN = 0.02


class SmoothPath:
    """A curve q(s), 0 <= s <= 1, with s about proportional to the length of the path."""

    def __init__(self, chain: ClosedChain, path: ArrayLike) -> None:
        self._chain = chain
        self._space = chain.mechanism.space
        q = finite_array("path", path, (chain.mechanism.model.nq,))
        if q.ndim != 2 or len(q) < 3:
            raise InputError("path", f"shape {q.shape}, expected (N, {q.shape[-1]}) with N >= 3")
        x = coordinate_positions(chain.mechanism, q)
        self._require_small_turns(q, x)

        # Repeated samples are left out: the path has no direction there.
        scale = chain.mechanism.rate_scale[chain.mechanism.coordinates]
        steps = np.linalg.norm(np.diff(x, axis=0) / scale, axis=1)
        moving = np.append(True, steps > _SHORTEST_STEP * steps.sum())
        if moving.sum() < 3:
            raise InputError("path", "the coordinates do not move along it")
        _require_no_return(x[moving] / scale, np.flatnonzero(moving))

        s = np.cumsum(np.append(0, steps)[moving])
        s /= s[-1]
        self._joints = spline(s, self._space.without_jumps(q[moving]))
        self._curve = spline(s, x[moving])
        self._first = self._curve.derivative(1)
        self._second = self._curve.derivative(2)

    def _require_small_turns(self, q: Array, x: Array) -> None:
        """Refuse samples between which the direction of a turn is not known.

        x has the angles of q, unwrapped: each step goes the shorter way round. An angle of q that
        jumps by a full turn between two samples has one of two causes:

        - The angles of q are kept within one turn. Then the shorter way is right, the steps in x
          are small, and jumps are rare.
        - A joint turns by more than half a turn from sample to sample. Then the shorter way is
          wrong, and the steps in x are large too, or one jump follows the other.
        """
        full_turns = x - positions_of(self._space, q, self._chain.coordinates)
        jumps = np.abs(np.diff(full_turns, axis=0)) > 1  # the difference is 2 pi or 0
        is_large = np.abs(np.diff(x, axis=0)) > np.pi / 2
        jumps_twice = jumps[1:] & jumps[:-1]
        if (jumps & is_large).any() or jumps_twice.any():
            raise InputError("path", "a joint turns by half a turn between samples: use more")

    def at(self, s: Array) -> tuple[Array, Array, Array]:
        """Configurations, shape (N, nq), and both derivatives of the coordinates by s, (N, n)."""
        chain = self._chain
        x = self._curve(s)
        guess = with_positions(
            self._space, self._joints(s), dict(zip(chain.coordinates, x.T, strict=True))
        )
        q = guess
        if chain.closures:
            no_rates = np.zeros_like(x)
            states = np.hstack([guess, no_rates])  # as the state space has them: (q, va)
            q = chain.engine.state_space(0.0).closed(states)
        lengths = np.array(self._space.position_units) == "m"
        gaps = np.abs(q - guess) / np.where(lengths, chain.mechanism.length, 1.0)
        if gaps.max() > _OPEN:
            place = s[gaps.max(axis=1).argmax()]
            raise InputError("path", f"it jumps, or has too few samples, at {place:.1%} of it")
        return q, self._first(s), self._second(s)


def _require_no_return(x: Array, samples: Indices) -> None:
    """Refuse a path that turns back.

    x has positions of the coordinates, free of units, shape (N, n). `samples` has the numbers of
    these samples in the path of the caller, shape (N,).
    """
    steps = np.diff(x, axis=0)
    # The path turns back where two steps have an angle of more than 90 degrees.
    returns = np.flatnonzero((steps[1:] * steps[:-1]).sum(axis=1) < 0)
    if len(returns):
        sample = samples[returns[0] + 1]
        raise InputError("path", f"it turns back at sample {sample}: divide it there")

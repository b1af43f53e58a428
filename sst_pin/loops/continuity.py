# SPDX-License-Identifier: BSD-2-Clause
"""Tests whether a motion stays in its assembly mode, for each block of Phi.

An assembly mode is one of the solutions of the loops for the same coordinates. A block has rows of
Phi and the dependent rates that these rows determine together; see `blocks`. Phi_a and Phi_b are a
block at configurations a and b, and Phi_a^+ is the pseudoinverse of Phi_a. The test is on their
change D = Phi_a^+ (Phi_b - Phi_a), which is free of units. |D| is its largest singular value.

- If |D| < 1, all matrices between them, Phi_s = Phi_a + s (Phi_b - Phi_a) with 0 <= s <= 1, have
  full column rank, because Phi_a^+ Phi_s = I + s D is regular.
- If a and b are in different modes at the same coordinates, then |D| is about 2 or more. Let x be
  the difference of their dependent joints. The mean of Phi over the line from a to b maps x to
  f(b) - f(a), which is 0 as both are closed. If this mean is (Phi_a + Phi_b) / 2, then
  Phi_b x = -Phi_a x, so that D x = Phi_a^+ (Phi_b x - Phi_a x) = -2 x.

So a step with |D| <= 1/2 is continuous. The value 1/2 leaves a margin to both bounds, as
(Phi_a + Phi_b) / 2 is only about the mean. A longer step is divided.

The sign of the determinant of all loops is no such test: it stays the same if two blocks become
singular at once.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import ClosureError, SSTError
from ..model.mechanism import Mechanism
from .blocks import diagonal_blocks
from .loops import Loops
from .ranks import largest_condition, scaled_Phi

#: A function path(q, earlier, later): the configuration at a later fraction of a step, from the
#: configuration q at an earlier fraction. It raises an SSTError if there is none.
Path = Callable[[Array, float, float], Array]

#: Largest |D| of two configurations that count as neighbours.
CHANGE = 0.5
#: Largest motion of a joint between neighbours, [rad] or lengths of the loop. Without this limit, a
#: whole turn of a joint would be a step, as D is zero after it. Over half a radian Phi changes
#: about linearly.
TRAVEL = 0.5
#: Largest number of configurations between two samples of a motion. With steps of `TRAVEL` they
#: make 160 turns of a joint, with shorter ones tens of turns.
MOST_STEPS = 2000
#: A part of a step below this fraction of the step is not divided further: its ends differ by less
#: than the errors of assembled loops.
_SHORTEST = 1e-12


@dataclass(frozen=True)
class _Sample:
    """A configuration and its blocks of Phi.

    Attributes:
        q: The configuration, shape (nq,).
        blocks: Arrays of blocks with equal shapes, each of shape (blocks, rows, rates).
    """

    q: Array
    blocks: list[Array]


@dataclass(frozen=True)
class _Anchor:
    """A sample a with which later samples b are compared.

    Attributes:
        sample: The sample.
        inverses: Pseudoinverses of its blocks, arrays of shape (blocks, rates, rows).
        smallest: Smallest singular values of its blocks, arrays of shape (blocks,); 0 for blocks
            with fewer rows than rates.
    """

    sample: _Sample
    inverses: list[Array]
    smallest: list[Array]

    @classmethod
    def at(cls, sample: _Sample) -> "_Anchor":
        """The anchor at a sample."""
        inverses = list[Array]()
        smallest = list[Array]()
        for blocks in sample.blocks:
            U, s, Vt = np.linalg.svd(blocks, full_matrices=False)
            reciprocals = np.zeros_like(s)
            np.divide(1.0, s, out=reciprocals, where=s > 0)
            # The pseudoinverse is V diag(1 / s) U^T, with 0 in place of 1 / 0.
            inverses.append(Vt.mT @ (U * reciprocals[:, None]).mT)
            has_full_rank = s.shape[1] == blocks.shape[2]
            smallest.append(s[:, -1] if has_full_rank else np.zeros(len(blocks)))
        return cls(sample, inverses, smallest)

    @property
    def regular(self) -> bool:
        """Whether all blocks have full column rank."""
        return all((s > 0).all() for s in self.smallest)


class Continuity:
    """Follows motions of one mechanism from a configuration to the next; one object per thread.

    The last sample and its anchor are kept, because the next motion mostly starts there, and SVDs
    are slow. A motion that starts elsewhere gets an anchor of its own.
    """

    def __init__(self, mechanism: Mechanism, loops: Loops) -> None:
        self._mechanism = mechanism
        self._loops = loops
        # `TRAVEL` limits these joints only, on which Phi depends. For instance a motor that is only
        # in linear couplings, such as a gear, may turn by any amount.
        self._curved = np.flatnonzero(loops.curved)
        #: The diagonal blocks, those of one shape together.
        self._blocks = diagonal_blocks(mechanism, loops)
        #: The last sample of the motion.
        self._last: _Sample | None = None
        #: The anchor of the last sample: its own, or that of a neighbour.
        self._anchor: _Anchor | None = None

    def condition_number(self, q: Array) -> float:
        """Condition number of the dependent part of Phi at q, infinite if it is singular.

        It is the largest one of its blocks.
        """
        return self._condition(self._sample(q))

    def follow(
        self,
        start: Array,
        path: Path,
        limit: float,
        first: float = 1.0,
        most_steps: int = MOST_STEPS,
    ) -> tuple[float, Array]:
        """How far a step is continuous and regular: a fraction, and the configuration there.

        Args:
            start: The configuration where the step begins.
            path: Gives configurations at fractions of the step.
            limit: Largest condition number of a regular configuration.
            first: The fraction that is tried first. If a motion goes far and comes back within the
                step, its ends are close, and the whole step would be accepted unseen. The caller
                then gives the fraction where the motion reverses.
            most_steps: A step that needs more configurations raises a ClosureError.
        """
        q = start
        done = 0.0  # up to this fraction the motion is continuous
        # The fraction that is tried next. With 0, all steps would have the length zero.
        end = max(first, _SHORTEST)
        count = 0
        while done < 1:
            if count == most_steps:
                raise ClosureError(
                    f"the motion is too long: {100 * done:.2g} % of it took {most_steps} steps; "
                    "give poses in between",
                    residual=0.0,  # the loops are closed at q
                )
            count += 1
            q_end: Array | None = None
            with suppress(SSTError):
                q_end = path(q, done, end)
            if q_end is not None and self._goes_on(q, q_end, limit):
                q = q_end
                length = end - done
                done = end
                end = min(1.0, done + 2 * length)
            else:
                end = (done + end) / 2
                if end - done < _SHORTEST:
                    break
        return done, q

    def _goes_on(self, before: Array, after: Array, limit: float) -> bool:
        """Whether the motion goes on from the configuration `before` to `after`.

        It does if both are neighbours of one anchor, and the anchor and `after` are regular. Let D
        be the change of Phi from the anchor. |D| is at most `CHANGE` at `before` and at `after`. So
        it is at most `CHANGE` for all matrices between Phi of `before` and Phi of `after`, and they
        are regular too.

        First the anchor of `before` is tried, which may be an earlier configuration. If `after` is
        no neighbour of it, `before` itself becomes the anchor.

        Only the condition number of `after` is compared with `limit`. The first configuration of a
        motion may be above `limit`, so that motions can lead away from it.

        If the motion goes on, `after` becomes the last sample. If not, `before` does: the next try,
        with a shorter step, begins there too, and needs no other SVD.
        """
        sample = self._sample(after)
        start, anchor = self._sample_and_anchor(before)
        continues = self._continues(anchor, sample, limit)
        if not continues and anchor.sample is not start:
            anchor = _Anchor.at(start)
            continues = self._continues(anchor, sample, limit)
        self._anchor = anchor
        self._last = sample if continues else start
        return continues

    def _sample_and_anchor(self, q: Array) -> tuple[_Sample, _Anchor]:
        """The sample at q and its anchor.

        If the last motion ended at q, they are known. Otherwise a motion begins at q, and the
        sample is its own anchor.
        """
        last, anchor = self._last, self._anchor
        if last is not None and anchor is not None and np.array_equal(last.q, q):
            return last, anchor
        sample = self._sample(q)
        return sample, _Anchor.at(sample)

    def _continues(self, anchor: _Anchor, sample: _Sample, limit: float) -> bool:
        """Whether a sample is a regular neighbour of an anchor."""
        if not anchor.regular:
            return False
        step = pin.difference(self._mechanism.model, anchor.sample.q, sample.q)
        step /= self._mechanism.rate_scale
        if not np.abs(step[self._curved]).max(initial=0.0) <= TRAVEL:  # NaN is refused too
            return False
        for inverse, a, b in zip(anchor.inverses, anchor.sample.blocks, sample.blocks, strict=True):
            D = inverse @ (b - a)
            # The Frobenius norm, the root of the sum of squares in a block, is not less than |D|.
            squares = np.einsum("bij,bij->b", D, D)  # sums of D_ij^2 for each block b
            if not squares.max() <= CHANGE**2:
                return False
        return self._is_surely_regular(anchor, sample, limit) or self._condition(sample) < limit

    def _is_surely_regular(self, anchor: _Anchor, sample: _Sample, limit: float) -> bool:
        """Whether a bound shows, without an SVD, that the condition numbers are below the limit.

        The smallest singular value of Phi_b is at least (1 - |D|) times that of Phi_a, where |D| is
        at most `CHANGE`. The largest one of Phi_b is at most its Frobenius norm.

        A block with one dependent rate has only one singular value, so that their ratio would
        always be 1. As in `largest_condition`, this value is compared with the usual size of the
        block, if that is larger. Blocks with several rates have the usual size 0.
        """
        by_shape = zip(self._blocks, sample.blocks, anchor.smallest, strict=True)
        for blocks, matrices, smallest in by_shape:
            norms = np.linalg.norm(matrices, axis=(1, 2))
            largest = np.maximum(norms, blocks.usual_sizes)
            if not (largest < limit * (1 - CHANGE) * smallest).all():
                return False
        return True

    def _condition(self, sample: _Sample) -> float:
        """The largest condition number of the blocks of a sample."""
        usual_sizes = [blocks.usual_sizes for blocks in self._blocks]
        return largest_condition(zip(sample.blocks, usual_sizes, strict=True))

    def _sample(self, q: Array) -> _Sample:
        """The sample at a configuration."""
        Phi = scaled_Phi(self._mechanism, self._loops, q)
        return _Sample(q.copy(), [blocks.of(Phi) for blocks in self._blocks])

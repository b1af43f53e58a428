# SPDX-License-Identifier: BSD-2-Clause
"""Samples shared among threads."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.intp]

#: Samples that are worth a thread.
_SHARE = 256
#: Shares of each thread: who is done takes the next, so that none waits long for another.
_EACH = 4


def in_shares(run: Callable[[slice], Indices], samples: int, threads: int) -> list[Indices]:
    """What `run` returns of the parts of a batch, in their order.

    Args:
        run: Computes some of the samples.
        samples: How many there are.
        threads: How many share them, this one among them.
    """
    threads = max(1, min(threads, samples // _SHARE))
    if threads == 1:
        return [run(slice(0, samples))]
    from concurrent.futures import ThreadPoolExecutor  # takes long

    count = min(threads * _EACH, samples // _SHARE)
    ends = [samples * k // count for k in range(count + 1)]
    parts = iter([(k, slice(*pair)) for k, pair in enumerate(pairwise(ends))])

    def take() -> list[tuple[int, Indices]]:
        return [(k, run(part)) for k, part in parts]

    with ThreadPoolExecutor(threads - 1) as pool:
        others = [pool.submit(take) for _ in range(threads - 1)]
        done = take()
        for other in others:
            done += other.result()
    return [result for _, result in sorted(done, key=lambda pair: pair[0])]

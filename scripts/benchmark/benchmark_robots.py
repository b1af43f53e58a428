# SPDX-License-Identifier: BSD-2-Clause
"""What benchmark.py measures on robots other than the SST: compiled kernels against the rest."""

import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import benchmark_cases as cases
import cassie
from sst_pin import ClosedChain, robots
from sst_pin.dynamics import reactions
from tests.gallery import ladder
from tests.gallery.humanoids import humanoid


def cassie_of_mujoco(locked: Sequence[str] = ()) -> ClosedChain:
    """Floating, or with joints held."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "cassie.xml")
        path.write_text(cassie.mjcf(), encoding="utf-8")
        return ClosedChain.from_mjcf(path, locked=locked)


ROBOTS: dict[str, Callable[[], ClosedChain]] = {
    "four-bar": robots.four_bar,
    "planar 3-RRR": robots.planar_3rrr,
    "delta": robots.delta,
    "hexapod": robots.stewart,
    "Cassie, floating": cassie_of_mujoco,
    "humanoid": humanoid,
    "ladder of 4": partial(ladder, 4),
    "ladder of 96": partial(ladder, 96),
}
#: Coordinates above which only torques are measured.
MOST = 40


@contextmanager
def empty_cache() -> Iterator[None]:
    """Nothing is compiled yet."""
    with tempfile.TemporaryDirectory() as folder, patch.dict(os.environ, XDG_CACHE_HOME=folder):
        yield


def compiled(name: str) -> tuple[ClosedChain, dict[str, float]]:
    """The robot with its kernels, and the seconds that they cost."""
    seconds = []
    with empty_cache():
        for _ in range(2):
            chain = ROBOTS[name]()
            start = time.perf_counter()
            chain.compile()
            seconds.append(time.perf_counter() - start)
    return chain, {"compile": seconds[0], "from the cache": seconds[1]}


def measure(
    names: Sequence[str], in_turn: Callable[..., Any], repeats: tuple[int, int], turn: float
) -> dict[str, Any]:
    """All of it, by robot, with `in_turn` of benchmark.py.

    Long calls and short ones have their own numbers of repeats; a turn of short ones lasts `turn`.
    """
    (few, many), found = repeats, {}
    for name in names:
        chain, cost = compiled(name)
        q = chain.generic_configuration()
        n = chain.degrees_of_freedom
        motion = (q, *np.random.default_rng(0).normal(size=(2, n)))
        closed = cases.in_mujoco(chain, q, step=1e-4) if n <= MOST else None
        calls = cases.single_calls(chain, ROBOTS[name](), motion, closed)
        samples = 1000 if n > MOST else 20_000
        rates = np.random.default_rng(0).normal(size=(2, samples, n))
        many_motions = (np.tile(q, (samples, 1)), *rates)
        found[name] = {
            "joints": chain.model.nv,
            "freedoms": n,
            "path": chain.backend,
            "cost": cost,
            "single call": in_turn(calls, many, turn),
            "motors": len(chain.motor_names),
            "reaction numbers": reactions.size_of(chain.mechanism),
            "sample of a batch": in_turn(cases.batches(chain, many_motions, n > MOST), few),
        }
        if closed:
            found[name]["derivatives"] = in_turn(cases.derivatives(chain, motion), many, turn)
            rolled = cases.rollouts(chain, q, cases.in_mujoco(chain, q, step=1e-4), 64, 200)
            found[name]["rollout step"] = in_turn(rolled, few)
    return found

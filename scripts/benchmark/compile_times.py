# SPDX-License-Identifier: BSD-2-Clause
"""Measure how long robots take to compile: processor seconds of the generator and of the compiler.

    python scripts/benchmark/compile_times.py                      # all robots
    python scripts/benchmark/compile_times.py --robots humanoid
    python scripts/benchmark/compile_times.py --robots "scissor lift" --repeats 3

Chains of 5, 10, 20 and 40 cells are compiled in turn; `ratio` is that of the total to the one of
half of the cells. The cache of kernels and that of ccache are not used.
"""  # fmt: skip

import argparse
import os
import resource
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "examples")]

from benchmark_robots import cassie_of_mujoco, empty_cache  # noqa: E402
from sst_pin import ClosedChain, robots  # noqa: E402
from tests.gallery import ladder, n_four_bar  # noqa: E402
from tests.gallery.humanoids import humanoid  # noqa: E402

CELLS = (5, 10, 20, 40)
CHAINS: dict[str, Callable[[int], ClosedChain]] = {
    "scissor lift": robots.scissor_lift,
    "ladder": ladder,
    "chain of four-bars": n_four_bar,
}
#: Robots whose derivatives are compiled too.
WITH_DERIVATIVES: dict[str, Callable[[], ClosedChain]] = {
    "delta": robots.delta,
    "Cassie, floating": cassie_of_mujoco,
    "humanoid": humanoid,
}


class Seconds(NamedTuple):
    """Processor seconds."""

    generator: float
    compiler: float

    @property
    def total(self) -> float:
        return self.generator + self.compiler


def now() -> Seconds:
    """Processor seconds of this process, and of the compilers that it has run."""
    own = resource.getrusage(resource.RUSAGE_SELF)
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Seconds(own.ru_utime + own.ru_stime, children.ru_utime + children.ru_stime)


def seconds_of(make: Callable[[], ClosedChain], *, derivatives: bool) -> Seconds:
    """Processor seconds of `ClosedChain.compile` with an empty cache."""
    with empty_cache(), patch.dict(os.environ, CCACHE_DISABLE="1"):
        chain = make()
        start = now()
        chain.compile(derivatives=derivatives)
        end = now()
    return Seconds(end.generator - start.generator, end.compiler - start.compiler)


def main() -> int:
    names = [*CHAINS, *WITH_DERIVATIVES]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", choices=names, default=names)
    parser.add_argument("--repeats", type=int, default=1, help="the shortest one counts")
    options = parser.parse_args()

    calls: dict[tuple[str, int], Callable[[], Seconds]] = {}
    for name in options.robots:
        if name in CHAINS:
            for cells in CELLS:
                make = partial(CHAINS[name], cells)
                calls[name, cells] = partial(seconds_of, make, derivatives=False)
        else:
            calls[name, 0] = partial(seconds_of, WITH_DERIVATIVES[name], derivatives=True)
    with empty_cache():
        robots.four_bar().compile()  # imports
    shortest: dict[tuple[str, int], Seconds] = {}
    for _ in range(options.repeats):
        for key, call in calls.items():
            measured = call()
            if key not in shortest or measured.total < shortest[key].total:
                shortest[key] = measured

    print(f"{'robot':20} {'cells':>5} {'generator':>9} {'compiler':>8} {'total':>6} {'ratio':>5}")
    for (name, cells), seconds in shortest.items():
        half = shortest.get((name, cells // 2))
        ratio = f"{seconds.total / half.total:5.2f}" if cells and half else ""
        of_cells = str(cells or "")
        numbers = f"{seconds.generator:9.2f} {seconds.compiler:8.2f} {seconds.total:6.2f}"
        print(f"{name:20} {of_cells:>5} {numbers} {ratio}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

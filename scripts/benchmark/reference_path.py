# SPDX-License-Identifier: BSD-2-Clause
"""Measure the reference path of the gallery's robots, as a multiple of `pin.rnea` of their trees.

    python scripts/benchmark/reference_path.py
    python scripts/benchmark/reference_path.py --robots planar_4rrr delta --repeats 40

Robots that have fewer motors than degrees of freedom compute `generalized_forces`. The calls of one
robot take turns, so that a slow moment of the machine is slow for all of them, and the shortest
turn of each counts. `torques` must be at most 150.
"""  # fmt: skip

import argparse
import sys
from collections.abc import Callable
from timeit import timeit

import numpy as np
import pinocchio as pin

from sst_pin import SST, ClosedChain, robots

ROBOTS: dict[str, Callable[[], ClosedChain]] = {"SST": SST}
for _name in robots.__all__:
    if _name != "GalleryRobot":
        ROBOTS[_name] = getattr(robots, _name)

#: Seconds of one turn: it is longer than a tick of the clock, and shorter than most interruptions.
TURN = 2e-3


def calls_of(chain: ClosedChain) -> dict[str, Callable[[], object]]:
    """`pin.rnea`, and what is measured, for one random motion."""
    q = chain.generic_configuration()
    va, aa = np.random.default_rng(0).normal(size=(2, chain.degrees_of_freedom))
    tau = np.ones(len(chain.motor_names))
    model = chain.model
    data = model.createData()
    v = chain.joint_rates(q, va)
    torques: Callable[..., object] = chain.compute_torques
    if len(tau) < len(va):
        torques = chain.generalized_forces
    return {
        "pin.rnea": lambda: pin.rnea(model, data, q, v, v),
        "torques": lambda: torques(q, va, aa),
        "accelerations": lambda: chain.compute_accelerations(q, va, tau),
        "reactions": lambda: chain.reactions(q, va, tau=tau),
    }


def shortest_times(calls: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Seconds of each call: its shortest turn."""
    numbers = {}
    for name, call in calls.items():
        call()  # what is computed once for a robot does not count
        numbers[name] = max(1, round(TURN / timeit(call, number=1)))
    shortest = dict.fromkeys(calls, np.inf)
    for _ in range(repeats):
        for name, call in calls.items():
            seconds = timeit(call, number=numbers[name]) / numbers[name]
            shortest[name] = min(shortest[name], seconds)
    return shortest


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS), metavar="NAME")
    parser.add_argument("--repeats", type=int, default=60, help="turns of each call")
    options = parser.parse_args()
    measured = ("torques", "accelerations", "reactions")
    print(f"{'robot':14} {'rnea [us]':>9}", *(f"{name:>13}" for name in measured))
    for name in options.robots:
        times = shortest_times(calls_of(ROBOTS[name]()), options.repeats)
        rnea = times["pin.rnea"]
        ratios = (f"{times[call] / rnea:13.0f}" for call in measured)
        print(f"{name:14} {1e6 * rnea:9.2f}", *ratios, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: BSD-2-Clause
"""Measure the kernels against Pinocchio and MuJoCo on the same robot, in one run.

Each group of calls takes turns, so that a slow moment of the machine hits all alike; of the repeats
come the median and the minimum. Only the ratios mean something on another machine. Writes
benchmark.json to docs/ and the tables into docs/evidence.md and README.md; --quick takes fewer
repeats, --out FOLDER leaves docs/ and README.md alone.

    PYTHONPATH=examples python scripts/benchmark/benchmark.py
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from timeit import timeit
from typing import Any

import numpy as np

import benchmark_cases as cases
import benchmark_report as report
import benchmark_robots
from sst_pin import SST

ROOT = Path(__file__).resolve().parents[2]
BATCH = 100_000


def in_turn(calls: cases.Calls, repeats: int, seconds: float = 0) -> report.Times:
    """Median and minimum of the seconds that one unit of work takes, by name.

    All take their turn as often as there are repeats; a turn lasts some seconds at least.
    """
    loops = {}
    for name, (call, _) in calls.items():
        call()
        loops[name] = max(1, round(seconds / timeit(call, number=1)))
    turns = [
        [timeit(call, number=loops[name]) / loops[name] / n for name, (call, n) in calls.items()]
        for _ in range(repeats)
    ]
    return spread(calls, turns)


def spread(names: Iterable[str], runs: list[list[float]]) -> report.Times:
    """Median and minimum of each column."""
    columns = zip(*runs, strict=True)
    return {name: [float(np.median(x)), min(x)] for name, x in zip(names, columns, strict=True)}


def in_a_process(code: str, *arguments: str, **environment: str) -> list[float]:
    """The numbers that Python code prints in a new process."""
    done = subprocess.run(
        [sys.executable, "-c", f"from time import perf_counter as now\n{code}", *arguments],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return [float(x) for x in done.stdout.split()]


def first_use(prepare: str, repeats: int) -> report.Times:
    """Seconds of import, and from there to the first torques; kernels are in the cache."""
    code = (
        f"a = now(); import sst_pin; b = now(); robot = sst_pin.SST(); {prepare};"
        "robot.compute_torques(robot.home, [0] * 3, [0] * 3); print(b - a, now() - b)"
    )
    runs = [in_a_process(code) for _ in range(repeats)]
    return spread(("import", "from import to first torques"), runs)


def first_of_a_file(repeats: int) -> report.Times:
    """Seconds from the delta's URDF to its first compiled torques, twice with one cache."""
    code = (
        "import sst_pin, sys; a = now();"
        "robot = sst_pin.ClosedChain.from_urdf(sys.argv[1]); robot.compile();"
        "robot.compute_torques(robot.generic_configuration(), [0] * 3, [0] * 3); print(now() - a)"
    )
    urdf = str(ROOT / "examples" / "delta.urdf")
    runs = []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as cache:
            runs.append([*(in_a_process(code, urdf, XDG_CACHE_HOME=cache)[0] for _ in range(2))])
    return spread(("compiled now", "from the cache"), runs)


def measure(quick: bool, names: list[str]) -> dict[str, Any]:
    few, many, turn = (3, 21, 2e-3) if quick else (9, 41, 5e-3)
    robot = SST()
    reference = SST()
    cores = os.cpu_count() or 1
    robot.compile()
    motion = cases.on_the_circle(robot, 0.1)
    batches = cases.batches(robot, cases.batch(robot, BATCH))
    moving = cases.in_mujoco(robot, *motion[:2], step=1e-4)
    calls = cases.single_calls(robot, reference, motion, moving)
    resting = cases.in_mujoco(robot, robot.home, step=1e-4)
    rollouts = cases.rollouts(robot, robot.home, resting, starts=256, steps=100)
    return {
        "machine": f"{platform.machine()}, {cores} cores",
        "path": robot.backend,
        "single call": in_turn(cases.of_the_sst(calls), many, turn),
        "sample of a batch": in_turn(cases.of_the_sst(batches), few),
        "rollout step": in_turn(rollouts, few),
        "first use": {
            "kernels": first_use("robot.compile()", few),
            "reference path": first_use("pass", few),
        },
        "robots": benchmark_robots.measure(names, in_turn, (few, many), turn),
        "from a URDF to torques": first_of_a_file(1 if quick else 3),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    parser.add_argument(
        "--robots", nargs="+", choices=benchmark_robots.ROBOTS, metavar="NAME",
        default=list(benchmark_robots.ROBOTS),
        help=f"fewer robots besides the SST: {'; '.join(benchmark_robots.ROBOTS)}",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, help="another folder than docs/; README.md is left")
    arguments = parser.parse_args()
    results = measure(arguments.quick, arguments.robots)
    folder = arguments.out or ROOT / "docs"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "benchmark.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    print(report.table(results), report.robots_table(results), sep="\n", end="")
    if arguments.out is None:
        for page in (ROOT / "README.md", ROOT / "docs" / "evidence.md"):
            text = report.with_table(page.read_text(encoding="utf-8"), results)
            page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

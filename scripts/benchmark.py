# SPDX-License-Identifier: BSD-2-Clause
"""Measure the kernels against Pinocchio and MuJoCo on the same robot, in one run.

Medians of interleaved repeats; only the ratios mean something on another machine. Writes
benchmark.json, benchmark.md and benchmark.png to docs/ and the table into README.md; --quick
takes fewer repeats, --out FOLDER leaves docs/ and README.md alone.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import benchmark_cases as cases
from sst_pin import SST, plots

ROOT = Path(__file__).resolve().parents[1]
MARKS = "<!-- benchmark -->", "<!-- end of benchmark -->"

Calls = dict[str, tuple[Callable[[], object], float]]


def medians(calls: Calls, repeats: int, seconds: float) -> dict[str, float]:
    """Seconds per unit of work: each call with the units that it does, in turn."""
    loops = {}
    for name, (call, _) in calls.items():
        call()
        start = time.perf_counter()
        call()
        loops[name] = max(1, round(seconds / (time.perf_counter() - start)))
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeats):  # in turn: a slow moment of the machine hits all alike
        for name, (call, units) in calls.items():
            start = time.perf_counter()
            for _ in range(loops[name]):
                call()
            taken[name].append((time.perf_counter() - start) / loops[name] / units)
    return {name: float(np.median(values)) for name, values in taken.items()}


def first_use(kernels: str) -> dict[str, float]:
    """Seconds of import and from there to the first torques, in new processes."""
    code = (
        "import time; a = time.perf_counter(); import sst_pin; b = time.perf_counter();"
        "robot = sst_pin.SST(); robot.compute_torques(robot.home, [0] * 3, [0] * 3);"
        "print(b - a, time.perf_counter() - b)"
    )
    runs = [
        subprocess.run(
            [sys.executable, "-c", code],
            env=os.environ | {"SST_PIN_KERNELS": kernels},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.split()
        for _ in range(5)
    ]
    loading, first = np.median(np.array(runs, dtype=float), axis=0)
    return {"import": float(loading), "from import to first torques": float(first)}


def measure(quick: bool) -> dict[str, Any]:
    repeats, seconds = (5, 2e-3) if quick else (31, 5e-3)
    robot = SST()
    results: dict[str, Any] = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "path": robot.path,
        "single call": medians(cases.single_calls(robot), repeats, seconds),
        "sample of a batch": medians(cases.batches(robot, 100_000), max(5, repeats // 2), 0),
        "rollout step": medians(cases.rollouts(robot), 5, 0),
        "examples": medians(cases.examples(robot), 3, 0),
        "first use": {"kernels": first_use("on"), "reference": first_use("off")},
    }
    sizes = [1, 4, 16, 64, 256, 1024, 4096, 16384, 65536]
    results["batch sizes"] = {
        str(n): medians(cases.batches(robot, n, ("kernels", "pin.rneaInParallel")), 5, 2e-3)
        for n in sizes
    }
    results["work and precision"] = cases.work_and_precision(robot)
    return results


def rows(results: dict[str, Any]) -> list[tuple[str, str, float, float | None, str]]:
    """What is compared: ours, theirs, their time over ours, the ratio asked for."""
    single, batch = results["single call"], results["sample of a batch"]
    step, examples = results["rollout step"], results["examples"]

    def row(ours: dict[str, float], a: str, theirs: dict[str, float], b: str) -> tuple[Any, ...]:
        return a, b, ours[a], theirs[b]

    return [
        row(single, "compute_torques", single, "pin.rnea, open tree"),
        row(single, "compute_torques", single, "hand-assembled KKT"),
        row(single, "compute_torques", single, "reference path, torques"),
        row(single, "compute_accelerations", single, "pin.constraintDynamics"),
        row(single, "compute_accelerations", single, "mj_step"),
        row(batch, "kernels", batch, "pin.rneaInParallel"),
        row(batch, "kernels, 2 threads", batch, "kernels"),
        row(step, "rollout", step, "mujoco.rollout"),
        row(examples, "example 1", examples, "example 1, reference path"),
        row(examples, "example 2", examples, "example 2, reference path"),
        row(examples, "example 2, tolerance 1e-10", examples, "example 2, reference path"),
        row(examples, "example 2 by rollout, to 1e-9", examples, "example 2, reference path"),
    ]


def seconds(value: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value * 1e9:.3g} ns"


def table(results: dict[str, Any]) -> str:
    lines = ["| this package | time | against | its time | ratio |", "|---|---|---|---|---|"]
    for ours, theirs, a, b in rows(results):
        lines.append(f"| {ours} | {seconds(a)} | {theirs} | {seconds(b)} | {b / a:.3g} |")
    first = results["first use"]
    used = ", ".join(f"{name} {seconds(value)}" for name, value in first["kernels"].items())
    lines += ["", f"First use: {used}. Kernels: {results['path'].split(': ')[1]}."]
    return "\n".join(lines)


def figure(results: dict[str, Any]) -> Figure:
    with plots.style():
        drawing = Figure(figsize=(8, 3.6), layout="constrained")
        left, right = drawing.subplots(1, 2)
        sizes = [int(n) for n in results["batch sizes"]]
        for name in next(iter(results["batch sizes"].values())):
            speeds = [1 / value[name] for value in results["batch sizes"].values()]
            left.loglog(sizes, speeds, marker="o", label=name)
        left.set_xlabel("samples in a batch")
        left.set_ylabel("samples per second, one thread")
        left.legend()
        for name, points in results["work and precision"].items():
            times, errors = np.array(points).T
            right.loglog(errors, times, marker="o", label=name)
        right.set_xlabel("error of the joints after example 2 (rad)")
        right.set_ylabel("time (s)")
        right.invert_xaxis()
        right.legend()
    return drawing


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    parser.add_argument("--out", type=Path, help="another folder than docs/; README.md is left")
    arguments = parser.parse_args()
    results = measure(arguments.quick)
    folder = arguments.out or ROOT / "docs"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "benchmark.json").write_text(json.dumps(results, indent=1) + "\n")
    (folder / "benchmark.md").write_text(table(results) + "\n")
    figure(results).savefig(folder / "benchmark.png", dpi=120)
    print(table(results))
    if arguments.out is None:
        readme = ROOT / "README.md"
        text = readme.read_text(encoding="utf-8")
        begin, end = MARKS
        inside = re.compile(f"{begin}.*{end}", re.DOTALL)
        replaced = f"{begin}\n{table(results)}\n{end}"
        readme.write_text(inside.sub(lambda _: replaced, text), encoding="utf-8")


if __name__ == "__main__":
    main()

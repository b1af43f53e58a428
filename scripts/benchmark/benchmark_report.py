# SPDX-License-Identifier: BSD-2-Clause
"""What benchmark.py has measured, as tables."""

import re
from collections.abc import Iterable, Sequence
from typing import Any

#: [median, minimum] in seconds, by name.
Times = dict[str, list[float]]

#: What is compared: group, ours and theirs in it.
ROWS = (
    ("single call", "compute_torques", "pin.rnea, open tree"),
    ("single call", "compute_torques", "KKT, hand-assembled on Pinocchio"),
    ("single call", "compute_torques", "reference path, torques"),
    ("single call", "compute_accelerations", "pin.constraintDynamics"),
    ("single call", "compute_accelerations", "mj_step"),
    ("single call", "compute_accelerations", "reference path, accelerations"),
    ("sample of a batch", "compute_torques, batch", "pin.rneaInParallel, 1 thread"),
    ("rollout step", "rollout", "mujoco.rollout"),
)

#: The README tells the ratios of these.
SHORT = (0, 1, 3, 6, 7)

_TABLE = re.compile(r"(<!-- table: benchmark(, short|, robots)? -->\n).*?(<!-- end -->)", re.DOTALL)


def spoken(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(row)} |" for row in (header, *rows)]
    return "\n".join([lines[0], "|---" * len(header) + "|", *lines[1:]]) + "\n"


def table(results: dict[str, Any]) -> str:
    header = ("this package", "times as fast", "as", "fastest repeats", "time", "its time")
    rows = []
    for group, ours, theirs in ROWS:
        a, b = results[group][ours], results[group][theirs]
        median, fastest = (f"{y / x:.3g}" for x, y in zip(a, b, strict=True))
        rows.append((ours, median, theirs, fastest, spoken(a[0]), spoken(b[0])))
    first = "; ".join(f"{path}: {_times(times)}" for path, times in results["first use"].items())
    path = results["path"].split(": ")[1]
    return f"{markdown(header, rows)}\nFirst use, {first}. Kernels: {path}.\n"


def _times(times: Times) -> str:
    return ", ".join(f"{name} {spoken(x[0])}" for name, x in times.items())


def short_table(results: dict[str, Any]) -> str:
    rows = []
    for group, ours, theirs in (ROWS[i] for i in SHORT):
        a = results[group][ours][0]
        b = results[group][theirs][0]
        rows.append((ours, f"{b / a:.3g}", theirs, spoken(a)))
    return markdown(("this package", "times as fast", "as", "time"), rows)


#: Columns of the robots: heading, group, ours and theirs.
COLUMNS = (
    ("pin.rnea", "single call", "torques", "pin.rnea, open tree"),
    ("KKT by hand", "single call", "torques", "KKT, by hand"),
    ("constraintDynamics", "single call", "accelerations", "pin.constraintDynamics"),
    ("mj_step", "single call", "accelerations", "mj_step"),
    ("rneaInParallel", "sample of a batch", "torques, batch", "pin.rneaInParallel, 1 thread"),
    ("mujoco.rollout", "rollout step", "rollout", "mujoco.rollout"),
    (
        "computeRNEADerivatives",
        "derivatives",
        "torque derivatives",
        "pin.computeRNEADerivatives, open tree",
    ),
    (
        "computeABADerivatives",
        "derivatives",
        "acceleration derivatives",
        "pin.computeABADerivatives, open tree",
    ),
)


def _shares(robot: dict[str, Any]) -> list[str]:
    """Ratios of batches: a rollout's step to `accelerations`, `reactions` to `torques`.

    These are ratios of the shortest times; the second compares times for each number of the result.
    """
    batch = {name: times[1] for name, times in robot["sample of a batch"].items()}
    if "reactions, batch" not in batch:
        return ["", ""]
    outputs = max(robot["motors"], robot["freedoms"])  # torques, or forces of all coordinates
    reactions = batch["reactions, batch"] / robot["reaction numbers"]
    return [
        f"{robot['rollout step']['rollout'][1] / batch['accelerations, batch']:.2g}",
        f"{reactions / (batch['torques, batch'] / outputs):.2g}",
    ]


def robots_table(results: dict[str, Any]) -> str:
    """How many times as fast as each; the reference path against `pin.rnea`; costs.

    Ratios are those of the shortest times: a moment in which the machine does something else makes
    a median of few repeats many times as long.
    """
    columns = [
        (heading, group, ours, theirs)
        for heading, group, ours, theirs in COLUMNS
        if any(group in robot for robot in results["robots"].values())
    ]
    header = ["robot", *(heading for heading, *_ in columns), "torques"]
    header += ["joints, degrees of freedom", "reference path, times pin.rnea"]
    header += ["step in accelerations", "reaction in torques", "compiled in"]
    rows = []
    for name, robot in results["robots"].items():
        single, cost = robot["single call"], robot["cost"]
        row = [name]
        for _, group, ours, theirs in columns:
            times = robot.get(group, {})
            known = ours in times and theirs in times
            row.append(f"{times[theirs][1] / times[ours][1]:.3g}" if known else "")
        reference = single["reference path, torques"][1] / single["pin.rnea, open tree"][1]
        row += [spoken(single["torques"][1]), f"{robot['joints']}, {robot['freedoms']}"]
        row += [f"{reference:.3g}", *_shares(robot), spoken(cost["compile"])]
        rows.append(row)
    first = _times(results["from a URDF to torques"])
    ratios = "Times and ratios in this table are those of the shortest times."
    return (
        f"{markdown(header, rows)}\n{ratios} From the delta's URDF to its first torques: {first}.\n"
    )


_TABLES = {None: table, ", short": short_table, ", robots": robots_table}


def with_table(page: str, results: dict[str, Any]) -> str:
    """A page with the tables between their marks."""

    def filled(marks: re.Match[str]) -> str:
        return f"{marks[1]}{_TABLES[marks[2]](results)}{marks[3]}"

    return _TABLE.sub(filled, page)

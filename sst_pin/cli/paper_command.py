# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin paper`: both examples and their figures."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from ..files import Writer, write_files
from ..sst.paper import PERIOD, compare, example_1, example_2
from .common import (
    Commands,
    add_force,
    add_robot,
    add_strict,
    number,
    progress_bar,
    refuses,
    remark,
    sst_of,
)


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "paper", _run, "Compute both examples of the paper and draw their figures."
    )
    add_robot(parser)
    parser.add_argument(
        "-o",
        "--output",
        "--out",
        type=Path,
        default=Path("paper"),
        metavar="FOLDER",
        help="created if it does not exist (default: paper)",
    )
    parser.add_argument(
        "--samples",
        type=number("a whole number from 10 to 10 million", lambda n: 10 <= n <= 10**7, int),
        default=1001,
        metavar="N",
        help="samples per period (default: 1001)",
    )
    add_force(parser)
    add_strict(parser)


def _run(arguments: argparse.Namespace) -> int:
    from .. import plots  # needs the extra `plot`

    robot, out = sst_of(arguments), arguments.output
    t = np.linspace(0, PERIOD, arguments.samples)
    clock = time.perf_counter
    began = clock()
    example = example_1(robot, t)
    seconds = [clock() - began]
    if refuses(robot, example, arguments):
        return 1
    starts = {"exact": False, "printed": True}
    motions = {}
    for name, rounded in starts.items():
        began = clock()
        with progress_bar(f"example 2, {name} start", t[0], t[-1]) as progress:
            motions[name] = example_2(robot, example, rounded, progress)
        seconds.append(clock() - began)

    files: dict[Path, Writer] = {}
    named = {"example_1": example} | {f"example_2_{name}_start": m for name, m in motions.items()}
    for stem, motion in named.items():
        for ending in (".csv", ".npz"):
            files[out / f"{stem}{ending}"] = motion.writer(f"{stem}{ending}")
    figures = plots.paper_figures(robot, example, motions["exact"], motions["printed"])
    files |= {out / name: writer for name, writer in figures.items()}
    write_files(files, arguments.force, folder=out)

    print(f"Example 1: inverse dynamics along the circle, {len(t)} samples, {seconds[0]:.3f} s")
    print("                    tau_1      tau_2      tau_3")
    for label, values in (
        ("peak |tau| (N m)", np.abs(example.tau).max(axis=0)),
        ("RMS tau    (N m)", np.sqrt((example.tau**2).mean(axis=0))),
    ):
        print(f"{label}", *(f"{value:10.4f}" for value in values))
    print("Example 2: direct dynamics with these torques, one period")
    print("start     path error   closures   energy error   time")
    for (name, motion), elapsed in zip(motions.items(), seconds[1:], strict=True):
        returned = compare(robot, example, motion)
        print(
            f"{name:8}  {returned.path_error:.1e} rad  {returned.closure:.1e}    "
            f"{returned.energy:.1e} J     {elapsed:.2f} s{remark(motion)}"
        )
    print(f"{len(files)} files in {out}")
    return 0

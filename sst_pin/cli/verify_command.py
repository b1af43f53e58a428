# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin verify`: comparison of the torques with every referee."""

from __future__ import annotations

import argparse
import json

from tqdm import tqdm

from .common import Commands, add_robot, robot_of


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add("verify", _run, "Compare the torques with every installed referee.")
    add_robot(parser)
    parser.add_argument("--quick", action="store_true", help="fewer cases, no simulation")
    parser.add_argument("--json", action="store_true", help="print the table as JSON")


def _run(arguments: argparse.Namespace) -> int:
    from ..verification import comparisons, verify

    if arguments.robot is None:
        found, missing = verify.verify_sst(arguments.quick), verify.skipped()
    else:  # the engines are built from parameters; multipliers take any closed chain
        robot, count = robot_of(arguments), 5 if arguments.quick else 40
        found, missing = verify.verify_chain(robot, count), []
    rows = []
    with tqdm(found, delay=2, leave=False, bar_format="{n} comparisons, last: {desc}") as bar:
        for row in bar:
            rows.append(row)
            bar.set_description_str(f"{row.referee}, {row.compared}", refresh=False)
    passed = all(row.passed for row in rows)
    if arguments.json:
        skipped = [{"package": e.package, "problem": str(e)} for e in missing]
        content = {"passed": passed, "comparisons": [r.as_dict() for r in rows], "skipped": skipped}
        print(json.dumps(content, indent=1))
    else:
        print(comparisons.table(rows))
        for error in missing:
            print(f"skipped: {error}")
        disagree = sum(not row.passed for row in rows)
        print(f"{disagree} of {len(rows)} disagree" if disagree else "all agree")
    return 0 if passed else 1

# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin validate`, `verify`, `compile` and `robots`: about the robots themselves."""

import argparse
import json
import time
from collections import Counter

from ..compiled import libraries
from ..errors import InputError
from . import common
from .parser import gallery

#: Number of random states at which `verify` compares, and with --quick.
_STATES = 40
_QUICK_STATES = 5


def validate(arguments: argparse.Namespace) -> int:
    """Print all problems in the files of a robot; the exit code is 1 if there is an error."""
    from ..reading.validate import examine, summary_of

    if arguments.file is not None and arguments.robot is not None:
        raise InputError("validate", "give one robot")
    arguments.robot = arguments.robot or arguments.file
    if arguments.robot is not None and arguments.robot not in gallery():
        problems, summary = examine(arguments.robot, arguments.cuts, arguments.model)
    else:
        chain = common.robot_of(arguments)
        problems = []
        summary = summary_of(chain.mechanism.model, chain.mobility())
    for problem in problems:
        print(problem)
    counts = Counter(problem.severity for problem in problems)
    texts = []
    for severity, count in counts.items():
        word = severity if count == 1 else f"{severity}s"
        texts.append(f"{count} {word}")
    print(", ".join(texts) or "no problems found")
    if counts["error"]:
        return 1
    print(summary)
    return 0


def verify(arguments: argparse.Namespace) -> int:
    """Print a comparison of the dynamics with every referee; the exit code is 1 if it fails.

    Each quantity must agree with all referees that can judge it, and at least one must.
    """
    from ..verification.verify import referees_of, table, verify_chain

    robot = common.robot_of(arguments)
    referees, problems = referees_of(robot)
    states = _QUICK_STATES if arguments.quick else _STATES
    rows = list(verify_chain(robot, states, referees))
    failures = sum(not row.passed for row in rows)
    judged = {row.compared for row in rows if row.cases}
    unjudged = sorted({row.compared for row in rows} - judged)
    passed = not failures and not unjudged
    if arguments.json:
        content = {
            "passed": passed,
            "comparisons": [row._asdict() for row in rows],
            "skipped": [str(problem) for problem in problems],
        }
        print(json.dumps(content, indent=1))
    else:
        print(table(rows))
        for problem in problems:
            print(f"skipped: {problem}")
        if failures:
            print(f"{failures} of {len(rows)} disagree")
        elif unjudged:
            print(f"no referee can judge: {', '.join(unjudged)}")
        else:
            print("all agree")
    return 0 if passed else 1


def compile(arguments: argparse.Namespace) -> None:  # noqa: A001
    """Compile kernels, list or clear their cache, or export the dynamics as C code."""
    if arguments.export_c is None and arguments.precision is not None:
        raise InputError("--precision", "only of exported C; add --export-c FOLDER")
    if arguments.clear:
        print(f"{libraries.delete()} kernels deleted from {libraries.cache_folder()}")
    elif arguments.list:
        _list()
    elif arguments.export_c is not None:
        from ..compiled.export import write_c

        robot = common.robot_of(arguments)
        write_c(
            robot,
            arguments.export_c,
            arguments.precision or "double",
            force=arguments.force,
        )
        print(f"robot.h, robot.c, main.c in {arguments.export_c}")
    else:
        chain = common.robot_of(arguments)
        start = time.perf_counter()
        chain.compile(all=arguments.all)
        print(f"{chain.backend}\nin {time.perf_counter() - start:.2g} s")


def _list() -> None:
    """Print the kernels in the cache, in columns."""
    entries = libraries.cached()
    robot_width = max((len(entry.robot) for entry in entries), default=0)
    kernel_width = max((len(entry.kernel) for entry in entries), default=0)
    for entry in entries:
        date = time.strftime("%Y-%m-%d", time.localtime(entry.used))
        names = f"{entry.robot:{robot_width}}  {entry.kernel:{kernel_width}}"
        print(f"{names} {entry.size / 1e3:6.0f} kB  used {date}")
    megabytes = sum(entry.size for entry in entries) / 1e6
    print(f"{len(entries)} kernels, {megabytes:.1f} MB in {libraries.cache_folder()}")


def robots(arguments: argparse.Namespace) -> None:
    """Print the gallery, a line for each robot."""
    from .. import SST
    from .. import robots as room

    for name in gallery():
        make = SST if name == "sst" else getattr(room, name)
        print(f"{name:13} {(make.__doc__ or '').splitlines()[0]}")

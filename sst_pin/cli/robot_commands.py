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


def validate(arguments: argparse.Namespace) -> int:
    """All problems in the files of a robot."""
    from ..reading.validate import examine, summary_of

    if arguments.file is not None and arguments.robot is not None:
        raise InputError("validate", "give one robot")
    arguments.robot = arguments.robot or arguments.file
    if arguments.robot is not None and arguments.robot not in gallery():
        problems, summary = examine(arguments.robot, arguments.cuts)
    else:
        chain = common.robot_of(arguments)
        problems, summary = [], summary_of(chain.mechanism.model, chain.mobility())
    for problem in problems:
        print(problem)
    counts = Counter(problem.severity for problem in problems)
    texts = [f"{n} {severity}{'s' * (n > 1)}" for severity, n in counts.items()]
    print(", ".join(texts) or "no problems found")
    if counts["error"]:
        return 1
    print(summary)
    return 0


def verify(arguments: argparse.Namespace) -> int:
    """Comparison of the dynamics with every referee.

    Each quantity must agree with all referees that can judge it, and there must be one.
    """
    from ..verification.verify import referees_of, table, verify_chain

    robot = common.robot_of(arguments)
    referees, problems = referees_of(robot)
    rows = list(verify_chain(robot, 5 if arguments.quick else 40, referees))
    disagree = sum(not row.passed for row in rows)
    judged = {row.compared for row in rows if row.cases}
    unjudged = sorted({row.compared for row in rows} - judged)
    passed = not disagree and not unjudged
    if arguments.json:
        shown = {"passed": passed, "comparisons": [row._asdict() for row in rows]}
        print(json.dumps(shown | {"skipped": list(map(str, problems))}, indent=1))
    else:
        print(table(rows))
        for problem in problems:
            print(f"skipped: {problem}")
        if disagree:
            print(f"{disagree} of {len(rows)} disagree")
        elif unjudged:
            print(f"no referee can say about: {', '.join(unjudged)}")
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
    elif (folder := arguments.export_c) is not None:
        from ..compiled.export import write_c

        write_c(
            common.robot_of(arguments),
            folder,
            arguments.precision or "double",
            force=arguments.force,
        )
        print(f"robot.h, robot.c, main.c in {folder}")
    else:
        chain = common.robot_of(arguments)
        start = time.perf_counter()
        chain.compile(all=arguments.all)
        print(f"{chain.backend}\nin {time.perf_counter() - start:.2g} s")


def _list() -> None:
    entries, folder = libraries.cached(), libraries.cache_folder()
    robot = max((len(entry.robot) for entry in entries), default=0)
    kernel = max((len(entry.kernel) for entry in entries), default=0)
    for entry in entries:
        when = time.strftime("%Y-%m-%d", time.localtime(entry.used))
        names = f"{entry.robot:{robot}}  {entry.kernel:{kernel}}"
        print(f"{names} {entry.size / 1e3:6.0f} kB  used {when}")
    print(f"{len(entries)} kernels, {sum(e.size for e in entries) / 1e6:.1f} MB in {folder}")


def robots(arguments: argparse.Namespace) -> None:
    """The gallery: a line for each robot."""
    from .. import SST
    from .. import robots as room

    for name in gallery():
        make = SST if name == "sst" else getattr(room, name)
        print(f"{name:13} {(make.__doc__ or '').splitlines()[0]}")

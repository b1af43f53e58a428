# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin validate`, `verify` and `compile`: about the robot itself."""

import argparse
import json
import time
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ..compiled import build
from ..errors import InputError, MissingExtraError
from ..files import write_files
from . import common


def add_validate(commands: common.Commands) -> None:
    """Every problem of a robot description."""
    text = "List all problems of a URDF, SDF or MJCF and of its closures; print its mobility."
    parser = commands.add("validate", _validate, text, robot=False)
    text = "a file, or a name of the gallery; --robot names it too (default: the SST of the paper)"
    parser.option("file FILE", text, nargs="?")
    parser.option("--robot FILE", argparse.SUPPRESS)
    text = "of a URDF: closures and motors (default: the YAML with the name of FILE)"
    parser.option("--cuts YAML", text, Path)


def _validate(arguments: argparse.Namespace) -> int:
    from ..reading.validate import examine, summary_of

    if arguments.file is not None and arguments.robot is not None:
        raise InputError("validate", "give one robot")
    arguments.robot = arguments.robot or arguments.file
    if arguments.robot is not None and not common.in_gallery(arguments.robot):
        problems, summary = examine(arguments.robot, arguments.cuts)
    else:
        chain = common.robot_of(arguments)
        problems, summary = [], summary_of(chain.mechanism.model, chain.mobility())
    for problem in problems:
        print(problem)
    errors = sum(problem.severity == "error" for problem in problems)
    if errors:
        print(f"{errors} error(s), {len(problems) - errors} warning(s)")
        return 1
    found = f"{len(problems)} warning(s), no errors" if problems else "no problems found"
    print(f"{found}\n{summary}")
    return 0


def add_verify(commands: common.Commands) -> None:
    """Comparison of the torques with every referee."""
    parser = commands.add("verify", _verify, "Compare the torques with every installed referee.")
    parser.option("--quick", "fewer cases, no simulation")
    parser.option("--json", "print the table as JSON")


def _verify(arguments: argparse.Namespace) -> int:
    from ..verification import verify

    if arguments.robot is None:
        found, missing = verify.verify_sst(arguments.quick), verify.skipped()
    else:  # the engines are built from parameters; multipliers take any closed chain
        robot, count = common.robot_of(arguments), 5 if arguments.quick else 40
        found, missing = verify.verify_chain(robot, count), []
    rows = []
    with tqdm(found, delay=2, leave=False, bar_format="{n} comparisons, last: {desc}") as bar:
        for row in bar:
            rows.append(row)
            bar.set_description_str(f"{row.referee}, {row.compared}", refresh=False)
    disagree = sum(not row.passed for row in rows)
    if arguments.json:
        content = {
            "passed": not disagree,
            "comparisons": [row._asdict() for row in rows],
            "skipped": [{"package": e.package, "problem": str(e)} for e in missing],
        }
        print(json.dumps(content, indent=1))
    else:
        print(verify.table(rows))
        for error in missing:
            print(f"skipped: {error}")
        print(f"{disagree} of {len(rows)} disagree" if disagree else "all agree")
    return 1 if disagree else 0


def add_compile(commands: common.Commands) -> None:
    """Compiled kernels, the cache that keeps them, and the same equations as C code."""
    parser = commands.add(
        "compile",
        _compile,
        "Compile the kernels of a robot, which chain.compile() loads later; or write the dynamics "
        "as C code for a controller; or look after the cache of kernels.",
    )
    parser.option("--all", "all kernels, not only torques and accelerations")
    text = "write C code: a header, a source with the parameters of the robot, an example"
    parser.option("--export-c FOLDER", text, Path)
    kinds: dict[str, Any] = {"choices": ["double", "single"], "default": "double"}
    parser.add_argument("--precision", help="of the C code (default: double)", **kinds)
    parser.add_force()
    parser.option("--list", "list the kernels in the cache")
    parser.option("--clear", "delete all kernels in the cache")


def _compile(arguments: argparse.Namespace) -> None:
    if arguments.clear:
        print(f"{build.empty_cache()} kernels deleted from {build.cache_folder()}")
    elif arguments.list:
        _list()
    elif arguments.export_c is not None:
        _export(arguments)
    else:
        chain = common.robot_of(arguments)
        start = time.perf_counter()
        chain.compile(all=arguments.all)
        print(f"{chain.path}\nin {time.perf_counter() - start:.2g} s")


def _list() -> None:
    entries, folder = build.cached(), build.cache_folder()
    robot = max((len(entry.robot) for entry in entries), default=0)
    kernel = max((len(entry.kernel) for entry in entries), default=0)
    for entry in entries:
        when = time.strftime("%Y-%m-%d", time.localtime(entry.used))
        names = f"{entry.robot:{robot}}  {entry.kernel:{kernel}}"
        print(f"{names} {entry.size / 1e3:6.0f} kB  used {when}")
    print(f"{len(entries)} kernels, {sum(e.size for e in entries) / 1e6:.1f} MB in {folder}")


def _export(arguments: argparse.Namespace) -> None:
    try:
        from ..compiled import export
    except ImportError:
        raise MissingExtraError("casadi", "compile") from None
    folder = arguments.export_c
    files = export.c_files(common.robot_of(arguments), folder, arguments.precision)
    write_files(files, arguments.force, folder=folder)
    print(f"{', '.join(path.name for path in files)} in {folder}")

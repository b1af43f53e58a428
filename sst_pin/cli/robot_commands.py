# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin info`, `validate`, `verify`, `compile`, `cache`, `export-c`: about the robot itself."""

import argparse
import json
import platform
import time
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ..compiled import build
from ..errors import ClosureError, DescriptionError, InputError, MissingExtraError
from ..files import write_files
from ..version import __version__
from . import common


def add_info(commands: common.Commands) -> None:
    """Versions, model and mobility."""
    parser = commands.add("info", _info, "Print versions, the model and its mobility.")
    parser.option("--json", "print JSON")


def _info(arguments: argparse.Namespace) -> None:
    robot, home = common.robot_of(arguments), None
    with suppress(DescriptionError, ClosureError):
        home = robot.home
    mobility = robot.mobility(home)
    versions = {"sst-pin": __version__}
    for package in ("pin", "numpy", "scipy", "matplotlib"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "(not installed)"
    python, system = platform.python_version(), f"{platform.system()} {platform.machine()}"
    source = arguments.robot or "the URDF of the package"
    model = robot.mechanism.model
    mass = sum(inertia.mass for inertia in model.inertias)
    if arguments.json:
        content = {
            "versions": {"python": python} | versions,
            "system": system,
            "model": model.name,
            "source": str(source),
            "joints": list(robot.joint_names),
            "motors": list(robot.motor_names),
            "coordinates": list(mobility.coordinates),
            "degrees_of_freedom": mobility.degrees_of_freedom,
            "closure_equations": len(mobility.rows),
            "redundant_closure_equations": mobility.redundant_rows,
            "moving_mass_kg": mass,
            "gravity_m_s2": model.gravity.linear.tolist(),
            "friction": not robot.friction.none,
            "path": robot.path,
        }
        print(json.dumps(content, indent=1))
        return
    print(f"Python {python} on {system}")
    print(", ".join(f"{name} {version}" for name, version in versions.items()))
    print(f"model {model.name}: {source}")
    print(f"  order of the joints in q: {', '.join(robot.joint_names)}")
    print(f"  moving mass {mass:.6g} kg, gravity {model.gravity.linear.tolist()} m/s^2")
    friction = "none" if robot.friction.none else "viscous and Coulomb, from the description"
    print(f"  friction: {friction}")
    print(f"  dynamics computed by: {robot.path}")
    print(mobility)


def add_validate(commands: common.Commands) -> None:
    """Every problem of a robot description."""
    text = "List all problems of a URDF or MJCF and of its closures."
    parser = commands.add("validate", _validate, text, robot=False)
    parser.option("file FILE", "a URDF, SDF or MJCF; --robot FILE names it too", Path, nargs="?")
    parser.option("--robot FILE", argparse.SUPPRESS, Path)
    text = "of a URDF: closures and motors (default: the YAML with the name of FILE)"
    parser.option("--cuts YAML", text, Path)


def _validate(arguments: argparse.Namespace) -> int:
    from ..reading.validate import examine

    given = [path for path in (arguments.file, arguments.robot) if path is not None]
    if len(given) != 1:
        raise InputError("validate", "give one file of a robot")
    if common.names_robot(str(given[0])) and not given[0].suffix:
        raise InputError(str(given[0]), "is a robot of the gallery, which has no file to validate")
    problems, summary = examine(given[0], arguments.cuts)
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
    """Compiled kernels, and the cache that keeps them."""
    text = "Compile the kernels of a robot; chain.compile() loads them later."
    parser = commands.add("compile", _compile, text)
    parser.option("--all", "all kernels, not only torques and accelerations")
    text = "List the kernels in the cache, or delete them."
    parser = commands.add("cache", _cache, text, robot=False)
    parser.option("--empty", "delete all kernels")


def _compile(arguments: argparse.Namespace) -> None:
    chain = common.robot_of(arguments)
    start = time.perf_counter()
    chain.compile(all=arguments.all)
    print(f"{chain.path}\nin {time.perf_counter() - start:.2g} s")


def _cache(arguments: argparse.Namespace) -> None:
    folder = build.cache_folder()
    if arguments.empty:
        print(f"{build.empty_cache()} kernels deleted from {folder}")
        return
    entries = build.cached()
    robot = max((len(entry.robot) for entry in entries), default=0)
    kernel = max((len(entry.kernel) for entry in entries), default=0)
    for entry in entries:
        when = time.strftime("%Y-%m-%d", time.localtime(entry.used))
        names = f"{entry.robot:{robot}}  {entry.kernel:{kernel}}"
        print(f"{names} {entry.size / 1e3:6.0f} kB  used {when}")
    print(f"{len(entries)} kernels, {sum(e.size for e in entries) / 1e6:.1f} MB in {folder}")


def add_export(commands: common.Commands) -> None:
    """The dynamics as C code."""
    parser = commands.add(
        "export-c",
        _export,
        "Write the dynamics of a robot as C code for its controller: header, source with the "
        "parameters of the robot, and an example.",
    )
    parser.option("folder FOLDER", "the folder, or -o", Path, nargs="?")
    parser.add_folder()
    kinds: dict[str, Any] = {"choices": ["double", "single"], "default": "double"}
    parser.add_argument("--precision", help="double or float (default: double)", **kinds)
    parser.add_force()


def _export(arguments: argparse.Namespace) -> None:
    given = [path for path in (arguments.folder, arguments.output) if path is not None]
    if len(given) != 1:
        raise InputError("export-c", f"give one folder{common.misplaced([*map(str, given)])}")
    if arguments.robot is None and (hint := common.misplaced([str(given[0])])):
        raise InputError(str(given[0]), f"is a robot, not a folder{hint}")
    try:
        from ..compiled import export
    except ImportError:
        raise MissingExtraError("casadi", "compile") from None
    robot, folder = common.robot_of(arguments), given[0]
    written = export.c_files(robot, folder, arguments.precision)
    write_files(written, arguments.force, folder=folder)
    print(f"{', '.join(path.name for path in written)} in {folder}")

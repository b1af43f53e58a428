# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin compile` and `sst-pin cache`: compile kernels, and list or delete them."""

from __future__ import annotations

import argparse
import time

from ..compiled import build
from .common import Commands, add_robot, robot_of


def add_to(commands: Commands) -> None:
    """Add both commands."""
    parser = commands.add(
        "compile", _compile, "Compile the kernels of a robot; chain.compile() loads them later."
    )
    add_robot(parser)
    parser.add_argument(
        "--all", action="store_true", help="all kernels, not only torques and accelerations"
    )
    parser = commands.add("cache", _cache, "List the kernels in the cache, or delete them.")
    parser.add_argument("--empty", action="store_true", help="delete all kernels")


def _compile(arguments: argparse.Namespace) -> None:
    chain = robot_of(arguments)
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

# SPDX-License-Identifier: BSD-2-Clause
"""Load the description in other people's tools and write the tables of docs/tools.md.

Every tool must be installed: `pip install -e '.[dev,tools]'`, Debian's liburdfdom-tools,
libkdl-parser-dev, g++ and chromium, and `npm install` in scripts/pages/tools/web. With
--installed this alone is asked: tests/project/test_tools.py holds the tables to what each tool that
is there says now.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from markdown_tables import Table, differences, read_table, rewrite
from tools import Tool
from tools.measure import TOOLS, Facts, measure

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tools.md"

#: Columns of what is measured; a last one of the first table has the versions.
HEADERS = {
    "loading": ("tool", "reads", "warnings", "joints", "mass, kg", "visuals"),
    "numbers": (
        *("tool", "frames", "poses off by", "torques off by", "loops closed by"),
        *("arcs apart, rad", "star off ours, rad"),
    ),
}


def rows(kind: type[Tool], facts: Facts) -> dict[str, tuple[str, ...]]:
    """What each table says of one tool."""
    said = "; ".join(f"`{line}`" for line in facts.warnings)
    mass = None if facts.mass is None else f"{facts.mass:.2f}"
    seen = tuple(map(_cell, (facts.joints, mass, facts.visuals)))
    errors = (facts.pose_error, facts.torque_error, facts.gap, facts.fall_error)
    poses, torques, gap, fall = ("-" if x is None else f"{x:.0e}" for x in errors)
    closing = kind.closing or "-"
    return {
        "loading": (kind.name, f"`{kind.file}`", said or "none", *seen),
        "numbers": (kind.name, _cell(facts.frames), poses, torques, closing, gap, fall),
    }


def _cell(fact: object) -> str:
    return "-" if fact is None else str(fact)


def write() -> None:
    made = [rows(kind, measure(kind)) for kind in TOOLS]
    versions = ["version", *(kind.version() for kind in TOOLS)]

    def table(name: str) -> Table:
        found = [HEADERS[name], *(row[name] for row in made)]
        if name == "numbers":
            return found
        return [(*row, version) for row, version in zip(found, versions, strict=True)]

    rewrite(PAGE, {name: lambda _, name=name: table(name) for name in HEADERS})


def problems(page: str, measured: Sequence[tuple[type[Tool], Facts]]) -> Iterator[str]:
    """Rows of the page that do not say what was measured, one sentence each."""
    made = {kind.name: rows(kind, facts) for kind, facts in measured}
    for name, header in HEADERS.items():
        stands = [row[: len(header)] for row in read_table(page, name) if row[0] in made]
        yield from differences(name, stands, [row[name] for row in made.values()])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--installed", action="store_true", help="exit 1 when a tool is missing")
    asked = parser.parse_args().installed
    if missing := [reason for kind in TOOLS if (reason := kind.missing())]:
        print("; ".join(missing), file=sys.stderr)
        return 1
    if not asked:
        write()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

# SPDX-License-Identifier: BSD-2-Clause
"""Tables of a page that scripts write, between `<!-- table: name -->` and `<!-- end -->`."""

import argparse
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

Table = list[tuple[str, ...]]
#: What makes the tables of a page, by name, each from the table that stands there.
Tables = Mapping[str, Callable[[Table], Table]]

_BLOCK = re.compile(r"<!-- table: (\w+) -->\n(.*?)<!-- end -->", re.DOTALL)


def main(page: Path, tables: Tables, slow: Tables, arguments: list[str] | None = None) -> int:
    """Write the tables of a page; with --check compare them, the slow ones excepted."""
    parser = argparse.ArgumentParser(description=f"Write the tables of {page.name}.")
    parser.add_argument("--check", action="store_true", help="exit 1 when they are not current")
    if not parser.parse_args(arguments).check:
        rewrite(page, {**tables, **slow})
        return 0
    found = list(stale(page.read_text(encoding="utf-8"), tables, slow))
    print(*found, f"{page.name}: {'stale' if found else 'current'}", sep="\n")
    return bool(found)


def rewrite(page: Path, tables: Tables) -> None:
    """Write tables of a page anew; others stay."""
    text = page.read_text(encoding="utf-8")

    def made(block: re.Match[str]) -> str:
        if block[1] not in tables:
            return block[0]
        header, *rows = tables[block[1]](read_table(text, block[1]))
        lines = [header, ("---",) * len(header), *rows]
        written = "\n".join("| " + " | ".join(line) + " |" for line in lines)
        return f"<!-- table: {block[1]} -->\n{written}\n<!-- end -->"

    page.write_text(_BLOCK.sub(made, text), encoding="utf-8")


def stale(page: str, tables: Tables, slow: Tables) -> Iterator[str]:
    """Where tables are not what would be written now; of slow ones, whether they are there.

    Other scripts may write other tables of the page.
    """
    there = table_names(page)
    for name in sorted({*tables, *slow} - there):
        yield f"table {name}: only in the script"
    for name in sorted(there & {*tables, *slow}):
        stands = read_table(page, name)
        if not stands:
            yield f"table {name}: empty"
        elif name in tables:
            yield from differences(name, stands, tables[name](stands))


def table_names(page: str) -> set[str]:
    return {name for name, _ in _BLOCK.findall(page)}


def read_table(page: str, name: str) -> Table:
    """A table of the page, its header first."""
    lines = dict(_BLOCK.findall(page))[name].splitlines()
    rows = [tuple(line[2:-2].split(" | ")) for line in lines]
    return rows[:1] + rows[2:]


def differences(name: str, stands: Table, made: Table) -> Iterator[str]:
    """Where a table of the page is not what would be written now, one sentence each."""
    if len(stands) != len(made):
        yield f"table {name}: {len(stands)} rows, {len(made)} now"
    for old, new in zip(stands, made, strict=False):
        if len(old) != len(new) or not all(map(_same, old, new)):
            yield f"table {name}: {' | '.join(old)}\n    is now {' | '.join(new)}"


def _same(old: str, new: str) -> bool:
    """Equal words; numbers like 3e-13 within two orders of magnitude, since they are rounding."""
    number = re.compile(r"\d+e[+-]\d+")
    if number.sub("#", old) != number.sub("#", new):
        return False
    a, b = (np.array(number.findall(text), dtype=float) + 1e-17 for text in (old, new))
    return bool((np.abs(np.log10(a / b)) <= 2).all())

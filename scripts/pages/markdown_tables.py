# SPDX-License-Identifier: BSD-2-Clause
"""Tables of a page that scripts write, between `<!-- table: name -->` and `<!-- end -->`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

import numpy as np

Table = list[tuple[str, ...]]

_BLOCK = re.compile(r"<!-- table: (\w+) -->\n(.*?)<!-- end -->", re.DOTALL)


def with_tables(page: str, make: Callable[[str], Table]) -> str:
    """The page with every table made anew from its name."""

    def made(block: re.Match[str]) -> str:
        header, *rows = make(block[1])
        lines = [header, ("---",) * len(header), *rows]
        text = "\n".join("| " + " | ".join(line) + " |" for line in lines)
        return f"<!-- table: {block[1]} -->\n{text}\n<!-- end -->"

    return _BLOCK.sub(made, page)


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

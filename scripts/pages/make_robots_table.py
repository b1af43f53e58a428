# SPDX-License-Identifier: BSD-2-Clause
"""Write the table of docs/robots.md: what each robot of the gallery is, and how exact it is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from markdown_tables import Table, differences, read_table, with_tables
from sst_pin import robots

PAGE = Path(__file__).resolve().parents[2] / "docs" / "robots.md"
HEADER = (
    "robot",
    "what it is",
    "joints",
    "q, v",
    "closure rows",
    "redundant",
    "freedoms",
    "motors",
    "torques off by",
)


def table() -> Table:
    """One row a robot; the last cell is relative to the reference data."""
    reference = json.loads(robots.REFERENCE_PATH.read_text(encoding="utf-8"))
    return [HEADER, *(_row(name, reference[name]) for name in robots.__all__ if name.islower())]


def _row(name: str, record: dict) -> tuple[str, ...]:
    build = getattr(robots, name)
    chain = build()
    what = build.__doc__.split("\n")[0].rstrip(".")
    report = chain.mobility(chain.home)
    states = record["states"]
    q, v, dv, torques = (
        np.array([state[key] for state in states], float) for key in ("q", "v", "dv", "torques")
    )
    own = [chain.model.joints[chain.model.getJointId(j)].idx_v for j in chain.coordinates]
    error = np.abs(chain.compute_torques(q, v[:, own], dv[:, own]) - torques)
    error = (error / np.abs(torques).max(axis=1, keepdims=True)).max()
    counts = (
        len(chain.joint_names),
        f"{chain.model.nq}, {chain.model.nv}",
        len(report.rows),
        report.redundant_rows,
        report.degrees_of_freedom,
        len(chain.motor_names),
    )
    return (f"`{name}()`", what, *map(str, counts), f"{error:.0e}")


def problems(page: str) -> Iterator[str]:
    """Where the page is not what would be written now, numbers to two orders of magnitude."""
    yield from differences("robots", read_table(page, "robots"), table())


if __name__ == "__main__":
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(with_tables(page, lambda _: table()), encoding="utf-8")

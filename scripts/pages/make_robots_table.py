# SPDX-License-Identifier: BSD-2-Clause
"""Write the table of docs/robots.md: what each robot of the gallery is, and how exact it is."""

import sys
from pathlib import Path
from typing import Any

import numpy as np

import markdown_tables
from markdown_tables import Table
from sst_pin import ClosedChain, robots
from sst_pin.arrays import Array
from tests.data import REFERENCE

PAGE = Path(__file__).resolve().parents[2] / "docs" / "robots.md"
COUNTS = ("joints", "closure rows", "degrees of freedom", "motors")


def counts(chain: ClosedChain, report: Any) -> tuple[str, ...]:
    """The cells of COUNTS, from a report of the mobility."""
    rows = (
        f"{len(report.rows)} ({report.redundant_rows})"
        if report.redundant_rows
        else len(report.rows)
    )
    numbers = len(chain.joint_names), rows, report.degrees_of_freedom, len(chain.motor_names)
    return tuple(map(str, numbers))


def reference_torques(chain: ClosedChain, states: list[dict[str, Any]]) -> tuple[Array, Array]:
    """Torques of states of the reference data: computed, and exact."""
    q, v, dv, exact = (
        np.array([state[key] for state in states], float) for key in ("q", "v", "dv", "torques")
    )
    own = [chain.model.joints[chain.model.getJointId(j)].idx_v for j in chain.coordinates]
    return chain.compute_torques(q, v[:, own], dv[:, own]), exact


def table(_: Table) -> Table:
    """One row a robot; the last cell is relative to the reference data."""
    rows: Table = [("robot", "what it is", *COUNTS, "torque error")]
    for name in filter(str.islower, robots.__all__):
        build = getattr(robots, name)
        chain = build()
        what = build.__doc__.split("\n")[0].rstrip(".")
        tau, exact = reference_torques(chain, REFERENCE[name]["states"])
        error = (np.abs(tau - exact) / np.abs(exact).max(axis=1, keepdims=True)).max()
        numbers = counts(chain, chain.mobility(chain.home))
        rows.append((f"`{name}()`", what, *numbers, f"{error:.0e}"))
    return rows


def main(arguments: list[str] | None = None) -> int:
    return markdown_tables.main(PAGE, {"robots": table}, {}, arguments)


if __name__ == "__main__":
    sys.exit(main())

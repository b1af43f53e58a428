# SPDX-License-Identifier: BSD-2-Clause
"""A page of the loads of joints and closures."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..description.colours import HUES
from ..errors import InputError
from ..simulation.bearing_loads import Load, Loads
from .curves import label, legend_above
from .style import Axes, StyledFigure, style

#: Units of loads.
_LOADS = {"force": "N", "moment": "N m"}
#: Loads that are smaller than this part of the largest are rounding.
_NO_LOAD = 1e-9


def loads_page(loads: Loads) -> Figure:
    """Bars of the peak forces and moments of joints and closures along a motion.

    The inner bar is the root mean square. The numbers beside a bar are the direction of the load at
    the peak, x, y, z in the axes of the wrench. If not all components are unique, letters in front
    name the unique ones. A bar is hatched if its load is unique only because of stiffnesses.

    Args:
        loads: Table of `ClosedChain.loads`.

    Raises:
        InputError: If `loads` is not such a table.
    """
    if not isinstance(loads, Loads):
        raise InputError("loads", f"a table of loads is needed, not {type(loads).__name__}")
    largest = np.nanmax([row.peak for row in loads.rows] + [0.0])
    figure = StyledFigure(figsize=(7, 1 + 0.12 * len(loads.rows)), layout="constrained")
    with style():
        for kind, ax in zip(_LOADS, figure.subplots(1, 2, sharey=True), strict=True):
            rows = [row for row in loads.rows if row.kind == kind]
            unit, prefix = _unit(rows)
            _bars(ax, rows, _NO_LOAD * largest, unit)
            ax.xaxis.set_major_locator(MaxNLocator(4))
            ax.set_xlabel(f"{kind} ({prefix}{_LOADS[kind]})")
    return figure


def _unit(rows: list[Load]) -> tuple[float, str]:
    """The unit of some loads, as a multiple of N or N m, and its prefix: "", "k" or "M"."""
    largest = np.nanmax([row.peak for row in rows] + [0.0])
    if largest >= 1e7:
        return 1e6, "M"
    if largest >= 1e4:
        return 1e3, "k"
    return 1.0, ""


def _direction(row: Load) -> str:
    """The direction of the peak as text, with letters of the components if not all are unique."""
    numbers = [f"{round(x, 2) + 0.0:.2f}" for x in (row.x, row.y, row.z) if np.isfinite(x)]
    letters = "" if len(row.components) == 3 else f"{row.components}: "
    return letters + ", ".join(numbers)


def _bars(ax: Axes, rows: list[Load], zero: float, unit: float) -> None:
    """Draw bars of loads of one kind.

    Args:
        ax: 2-D axes.
        rows: The loads, one bar for each.
        zero: Loads up to this size count as zero, [N] or [N m].
        unit: Unit of the x axis, [N] or [N m].
    """
    names_in_legend = set[str]()

    def bar(y: int, length: float, width: float, name: str, **look: Any) -> None:
        """Draw a bar; `name` is written into the legend only once."""
        ax.barh(y, length, width, label=None if name in names_in_legend else name, **look)
        names_in_legend.add(name)

    outline = {"facecolor": "white", "edgecolor": HUES[0], "linewidth": 0.8}
    for y, row in enumerate(rows):
        length = 0.0
        if np.isnan(row.peak):
            text = "not unique"
        elif row.peak <= zero:
            text = "0"
        else:
            length = row.peak / unit
            text = _direction(row)
            # If a load is not determined, but all its components are known, they come from
            # stiffnesses.
            if not row.determined and len(row.components) == 3:
                bar(y, length, 0.7, "peak, from stiffnesses", hatch="/////", **outline)
            else:
                bar(y, length, 0.7, "peak", hatch="", **outline)
            bar(y, row.rms / unit, 0.35, "root mean square", color=HUES[1])
        ax.annotate(text, (length, y), (3, 0), textcoords="offset points", va="center", fontsize=6)
    ax.set_yticks(range(len(rows)), [label(row.name) for row in rows])
    # Room for the numbers beside the longest bar.
    right = 1.5 * ax.dataLim.x1 if names_in_legend else 1
    ax.set(xlim=(0, right), ylim=(len(rows) - 0.5, -0.5))
    if names_in_legend:
        legend_above(ax)

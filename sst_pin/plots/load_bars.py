# SPDX-License-Identifier: BSD-2-Clause
"""Peaks, means and directions of loads as bars."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..description.colours import HUES
from ..errors import InputError
from ..motion.bearing_loads import Load, Loads
from .curves import label, legend_above
from .style import Axes, StyledFigure, style

#: Sizes that are smaller than this part of the largest are rounding.
_ROUNDING = 1e-9
_AXES = {"force": "force (N)", "moment": "moment (N m)"}


def loads_page(loads: Loads) -> Figure:
    """Forces and moments of joints and closures along a motion, a bar for each peak.

    The inner bar is the root mean square; the numbers are the direction at the peak, x, y, z in the
    axes of the wrench. Hatched bars come from stiffnesses.

    Args:
        loads: Table of `ClosedChain.loads`.

    Raises:
        InputError: For anything else.

    Example:
        >>> page = plots.loads_page(chain.loads(motion))
        >>> page.axes[1].get_xlabel()
        'moment (N m)'
    """
    if not isinstance(loads, Loads):
        raise InputError("loads", f"a table of loads is needed, not {type(loads).__name__}")
    largest = np.nanmax([row.peak for row in loads.rows] + [0.0])
    figure = StyledFigure(figsize=(7, 1 + 0.12 * len(loads.rows)), layout="constrained")
    with style():
        for kind, ax in zip(_AXES, figure.subplots(1, 2, sharey=True), strict=True):
            _bars(ax, [row for row in loads.rows if row.kind == kind], _ROUNDING * largest)
            ax.set_xlabel(_AXES[kind])
    return figure


def _bars(ax: Axes, rows: list[Load], zero: float) -> None:
    told = set()
    for y, row in enumerate(rows):
        text = "0" if row.peak <= zero else "not unique"
        if row.peak > zero:
            what = "peak" if row.determined else "peak, from stiffnesses"
            hatch = "" if row.determined else "/////"
            outline = {"facecolor": "white", "edgecolor": HUES[0], "linewidth": 0.8}
            for size, name, width, look in (
                (row.peak, what, 0.7, outline | {"hatch": hatch}),
                (row.rms, "root mean square", 0.35, {"color": HUES[1]}),
            ):
                ax.barh(y, size, width, label=None if name in told else name, **look)
                told.add(name)
            text = ", ".join(f"{round(x, 2) + 0.0:.2f}" for x in row[4:7])
        at = (row.peak if row.peak > zero else 0.0, y)
        ax.annotate(text, at, (3, 0), textcoords="offset points", va="center", fontsize=6)
    ax.set_yticks(range(len(rows)), [label(row.name) for row in rows])
    ax.set(xlim=(0, 1.5 * ax.dataLim.x1 if told else 1), ylim=(len(rows) - 0.5, -0.5))
    if told:
        legend_above(ax)

# SPDX-License-Identifier: BSD-2-Clause
"""Maps of what a frame of any closed chain reaches."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch

from ..control.reach import REASONS, ReachMap
from ..errors import InputError
from .style import Axes
from .workspace_maps import LEVELS, condition_colours

#: Colours of the reasons that end a workspace from inside.
_ENDS = {"joint limits": "0.55", "singular": "#CC79A7"}
_LABELS = {
    "condition": "condition number (1)",
    "used": "largest part of a motor's limit (1)",
}


def reach_map(ax: Axes, found: ReachMap, show: str = "condition") -> Axes:
    """What a frame reaches, coloured by the condition number or the load of the motors.

    What ends the map is marked where it is a joint's limit or a singular configuration; beyond the
    end of its reach it is white. Angles are in degrees.

    Args:
        ax: 2-D axes.
        found: What `sst_pin.reach_map` gives.
        show: "condition", or "used" for the largest part of a motor's limits.

    Raises:
        InputError: If `show` is neither.

    Example:
        >>> lift, side = sst_pin.robots.five_bar(), np.linspace(-0.15, 0.15, 7)
        >>> found = sst_pin.reach_map(lift, "platform", 2.0, x=side, y=side + 0.1)
        >>> plots.reach_map(ax, found).get_xlabel()
        '$x_0$ (m)'
    """
    if show not in _LABELS:
        raise InputError("show", f"{show!r} unknown; known: {', '.join(_LABELS)}")
    x, y = (
        values if axis in "xyz" else np.degrees(values)
        for axis, values in zip(found.axes, found.values, strict=True)
    )
    cmap, norm = condition_colours()
    if show == "used":
        cmap = mpl.colormaps["viridis_r"].with_extremes(over="#D55E00")
        norm = BoundaryNorm(np.linspace(0, 1, 11), cmap.N, extend="max")
    grid: dict[str, Any] = {"shading": "nearest", "rasterized": True}
    field = ax.pcolormesh(x, y, getattr(found, show).T, cmap=cmap, norm=norm, **grid)
    names = [name for name in _ENDS if (found.why == REASONS.index(name)).any()]
    for name in names:
        here = np.where(found.why == REASONS.index(name), 0.0, np.nan)
        ax.pcolormesh(x, y, here.T, cmap=ListedColormap([_ENDS[name]]), **grid)
    bar = ax.figure.colorbar(field, ax=ax, label=_LABELS[show], spacing="uniform", shrink=0.8)
    if show == "condition":
        bar.set_ticks(LEVELS, labels=[f"{level:g}" for level in LEVELS])
    labels = [f"${axis}_0$ (m)" if axis in "xyz" else f"{axis} (deg)" for axis in found.axes]
    ax.set(xlabel=labels[0], ylabel=labels[1])
    if len({axis in "xyz" for axis in found.axes}) == 1:
        ax.set_aspect("equal")
    if names:
        handles = [Patch(facecolor=_ENDS[name], label=name) for name in names]
        ax.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    return ax

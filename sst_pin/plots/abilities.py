# SPDX-License-Identifier: BSD-2-Clause
"""Sets of forces and accelerations that a pose allows; maps of poses that a frame reaches."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch, Polygon
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array
from ..control.pose_abilities import Ellipsoid
from ..control.reach import REASONS, ReachMap
from ..errors import InputError
from .style import Axes
from .workspace_maps import CONDITION, LEVELS

#: Colours of the reasons that end a workspace from inside.
_ENDS = {"joint limits": "0.55", "singular": "#CC79A7"}
_LABELS = {"condition": "condition number (1)", "used": "largest part of a motor's limit (1)"}


def convex_set(
    ax: Axes,
    shape: ArrayLike | Ellipsoid,
    at: ArrayLike = (0.0, 0.0, 0.0),
    *,
    scale: float = 1.0,
    plane: tuple[int, int] = (0, 1),
    **look: Any,
) -> Axes:
    """A set of forces or accelerations in a plane of the base, as a polygon, or as a body.

    Args:
        ax: Plane axes, which show what the shape covers in the plane, or axes with projection "3d".
        shape: Corners, shape (N, 3), as `force_polytope` gives them, or an `Ellipsoid` that is
            finite in these axes.
        at: Where its zero is drawn, shape (3,), [m].
        scale: Length of one unit of the shape, such as [m/N].
        plane: The two axes of the base that plane axes show.
        **look: Of the polygon or of the faces, as Matplotlib takes it: facecolor, edgecolor, alpha.

    Raises:
        InputError: For a shape that is not finite, or flat in these axes.

    Example:
        >>> lift = sst_pin.robots.five_bar()
        >>> corners = sst_pin.force_polytope(lift, lift.home, "platform", 1.0)
        >>> plots.convex_set(ax, corners, scale=0.01).get_aspect()
        1.0
    """
    from scipy.spatial import ConvexHull, QhullError

    points = _points_of(shape) if isinstance(shape, Ellipsoid) else shape
    shown = list(plane) if ax.name != "3d" else [0, 1, 2]
    drawn = finite_array("at", at, (3,)) + scale * finite_array("shape", points, (3,))
    try:
        hull = ConvexHull(drawn[:, shown])
    except (QhullError, ValueError):
        raise InputError("shape", "flat in these axes") from None
    look = {"alpha": 0.4} | look
    if ax.name != "3d":
        ax.add_patch(Polygon(drawn[hull.vertices][:, shown], closed=True, **look))
        ax.set_aspect("equal", adjustable="datalim")
        ax.autoscale_view()
        return ax
    ax.add_collection3d(Poly3DCollection(drawn[hull.simplices], **look))
    ax.auto_scale_xyz(*drawn.T)
    return ax


def _points_of(shape: Ellipsoid) -> Array:
    """Points of the surface, shape (N, 3)."""
    axes = shape.axes[np.isfinite(shape.sizes)]
    turn, tilt = np.meshgrid(np.linspace(0, 2 * np.pi, 61), np.linspace(0, np.pi, 31))
    sphere = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], -1)
    sizes = shape.sizes[np.isfinite(shape.sizes)]
    ball = sphere.reshape(-1, 3)[:, : len(sizes)]
    return np.asarray(shape.center + ball * sizes @ axes)


def reach_map(ax: Axes, found: ReachMap, show: str = "condition") -> Axes:
    """Map of the poses that a frame reaches, coloured by condition number or load of motors.

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
    colours = CONDITION
    if show == "used":
        cmap = mpl.colormaps["viridis_r"].with_extremes(over="#D55E00")
        norm = BoundaryNorm(np.linspace(0, 1, 11), cmap.N, extend="max")
        colours = {"cmap": cmap, "norm": norm}
    grid: dict[str, Any] = {"shading": "nearest", "rasterized": True}
    field = ax.pcolormesh(x, y, getattr(found, show).T, **colours, **grid)
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

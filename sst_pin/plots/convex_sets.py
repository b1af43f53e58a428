# SPDX-License-Identifier: BSD-2-Clause
"""Sets of forces and accelerations of a frame: polytopes and ellipsoids."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array
from ..control.pose_abilities import Ellipsoid
from ..errors import InputError
from .style import Axes


def convex_set(
    ax: Axes,
    shape: ArrayLike | Ellipsoid,
    at: ArrayLike = (0.0, 0.0, 0.0),
    *,
    scale: float = 1.0,
    plane: tuple[int, int] = (0, 1),
    **look: Any,
) -> Axes:
    """What a pose can do, as a polygon or an ellipse in a plane of the base, or as a body.

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
        from matplotlib.patches import Polygon

        ax.add_patch(Polygon(drawn[hull.vertices][:, shown], closed=True, **look))
        ax.set_aspect("equal", adjustable="datalim")
        ax.autoscale_view()
        return ax
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

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

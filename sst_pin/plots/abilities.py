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

from ..arrays import Array, finite_array, require_instance, require_word, single_array
from ..control.pose_abilities import Ellipsoid
from ..control.reach import ReachMap
from ..control.reach_search import REASONS
from ..errors import InputError
from .style import Axes

#: Limits of the colours of the condition number: light is good, dark is singular.
LEVELS = (1, 1.1, 1.25, 1.5, 2, 3, 5, 10)
_COLOUR_MAP: Any = mpl.colormaps["viridis_r"].with_extremes(over="#1c0021")
#: Colours and their limits, as arguments of Matplotlib.
CONDITION: dict[str, Any] = {
    "cmap": _COLOUR_MAP,
    "norm": BoundaryNorm(LEVELS, _COLOUR_MAP.N, extend="max"),
}
#: Colours of poses that are not reached, by the reason.
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
    """A set of forces or accelerations, as a polygon in a plane of the base or as a solid in 3-D.

    Args:
        ax: 2-D axes, which show the projection of the shape, or axes with projection "3d".
        shape: Corners, shape (N, 3), as `force_polytope` gives them, or an `Ellipsoid` that is
            finite in these axes.
        at: Position where the zero of the shape is drawn, shape (3,), [m].
        scale: Length of one unit of the shape, such as [m/N].
        plane: The two axes of the base that 2-D axes show.
        **look: Matplotlib options of the polygon or faces, such as facecolor, edgecolor, alpha.

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
    axes_of_base = list(plane) if ax.name != "3d" else [0, 1, 2]
    points_in_space = finite_array("at", at, (3,)) + scale * finite_array("shape", points, (3,))
    if points_in_space.ndim != 2:
        raise InputError("shape", f"shape {np.shape(points)}, expected (N, 3)")
    try:
        hull = ConvexHull(points_in_space[:, axes_of_base])
    except (QhullError, ValueError):
        raise InputError("shape", "flat in these axes") from None
    look = {"alpha": 0.4} | look
    if ax.name != "3d":
        ax.add_patch(Polygon(points_in_space[hull.vertices][:, axes_of_base], closed=True, **look))
        ax.set_aspect("equal", adjustable="datalim")
        ax.autoscale_view()
        return ax
    ax.add_collection3d(Poly3DCollection(points_in_space[hull.simplices], **look))
    ax.auto_scale_xyz(*points_in_space.T)
    return ax


def _points_of(shape: Ellipsoid) -> Array:
    """Points of the surface of an ellipsoid, shape (N, 3), along its axes of finite length.

    With fewer than three such axes, the points fill a flat ellipse or a line.
    """
    is_finite = np.isfinite(shape.sizes)
    axes = shape.axes[is_finite]  # unit vectors as rows
    sizes = shape.sizes[is_finite]
    azimuth, polar = np.meshgrid(np.linspace(0, 2 * np.pi, 61), np.linspace(0, np.pi, 31))
    x = np.sin(polar) * np.cos(azimuth)
    y = np.sin(polar) * np.sin(azimuth)
    unit_sphere = np.stack([x, y, np.cos(polar)], axis=-1).reshape(-1, 3)
    coordinates = unit_sphere[:, : len(sizes)] * sizes
    return np.asarray(shape.center + coordinates @ axes)


def equal_area(directions: ArrayLike, middle: ArrayLike) -> Array:
    """Directions on Lambert's equal-area map of the sphere, shape (..., 2).

    The middle is at the origin, and z points up. The half of the sphere around the middle fills the
    disc of radius sqrt(2).

    Args:
        directions: Shape (..., 3), of any length.
        middle: The direction in the middle of the map, shape (3,).

    Example:
        >>> plots.equal_area([[0, 0, 1], [0, 1, 0]], middle=[1, 0, 0]).round(3)
        array([[0.   , 1.414],
               [1.414, 0.   ]])
    """
    s = finite_array("directions", directions, (3,))
    ahead = single_array("middle", middle, (3,))
    ahead = ahead / np.linalg.norm(ahead)
    up = np.array([0.0, 0.0, 1.0])
    if abs(ahead[2]) >= 1 - 1e-9:  # the middle is z itself: then y points up
        up = np.array([0.0, 1.0, 0.0])
    s = s / np.linalg.norm(s, axis=-1, keepdims=True)
    # The axes of the map, to the right and upwards, as columns.
    right = np.cross(up, ahead) / np.linalg.norm(np.cross(up, ahead))
    axes = np.stack([right, np.cross(ahead, right)], axis=-1)
    # Lambert's projection: with the cosine c of the angle from the middle, components in the plane
    # of the map are multiplied by sqrt(2 / (1 + c)).
    cosine = (s @ ahead)[..., None]  # shape (..., 1)
    return np.asarray(s @ axes * np.sqrt(2 / (1 + cosine)))


def reach_map(
    ax: Axes,
    poses: ReachMap,
    show: str = "condition",
    *,
    axis: str = "",
    middle: ArrayLike | None = None,
) -> Axes:
    """Map of the poses that a frame reaches, coloured by condition number or load of motors.

    Poses that joint limits or singular configurations prevent have colours of their own; all others
    that are not reached are white. Angles are in degrees.

    Args:
        ax: 2-D axes.
        poses: What `sst_pin.reach_map` returns.
        show: "condition", or "used" for the largest part of a motor's limits.
        axis: "x", "y" or "z" for an `equal_area` map of the directions of this axis of the frame,
            without ticks; by default the map has the axes of the grid.
        middle: The direction in the middle of the equal-area map, shape (3,); by default the mean
            direction.

    Raises:
        InputError: If `show` or `axis` is unknown.

    Example:
        >>> lift, side = sst_pin.robots.five_bar(), np.linspace(-0.15, 0.15, 7)
        >>> poses = sst_pin.reach_map(lift, "platform", 2.0, x=side, y=side + 0.1)
        >>> plots.reach_map(ax, poses).get_xlabel()
        '$x_0$ (m)'
    """
    require_instance("poses", poses, ReachMap)
    require_word("show", show, _LABELS)
    require_word("axis", axis, ("", "x", "y", "z"))
    if axis:
        s = poses.poses[..., :3, "xyz".index(axis)]
        points = equal_area(s, s.mean(axis=(0, 1)) if middle is None else middle)
        x, y = np.moveaxis(points, -1, 0)
        ax.set_axis_off()
    else:
        first, xlabel = _grid_values(poses, 0)
        second, ylabel = _grid_values(poses, 1)
        x, y = np.meshgrid(first, second, indexing="ij")
        ax.set(xlabel=xlabel, ylabel=ylabel)
    are_lengths = [name in "xyz" for name in poses.axes]
    if axis or are_lengths[0] == are_lengths[1]:
        ax.set_aspect("equal")
    _fill(ax, poses, show, x, y)
    return ax


def _grid_values(poses: ReachMap, k: int) -> tuple[Array, str]:
    """Values along an axis of the grid, in metres or degrees, and their label."""
    name = poses.axes[k]
    if name in "xyz":
        return poses.values[k], f"${name}_0$ (m)"
    return np.degrees(poses.values[k]), f"{name} (deg)"


def _fill(ax: Axes, poses: ReachMap, show: str, x: Array, y: Array) -> None:
    """Draw the cells around points x, y of a grid, both of shape (N, M), with a colour bar."""
    colours = CONDITION
    if show == "used":
        cmap = mpl.colormaps["viridis_r"].with_extremes(over="#D55E00")
        norm = BoundaryNorm(np.linspace(0, 1, 11), cmap.N, extend="max")
        colours = {"cmap": cmap, "norm": norm}
    x_corners = _corners(x)
    y_corners = _corners(y)
    field = ax.pcolormesh(x_corners, y_corners, getattr(poses, show), rasterized=True, **colours)
    # Cells that are not reached, in one colour for each reason. `poses.why` has indices of REASONS.
    names = [name for name in _ENDS if (poses.why == REASONS.index(name)).any()]
    for name in names:
        cells = np.where(poses.why == REASONS.index(name), 0.0, np.nan)  # NaN is transparent
        colour = ListedColormap([_ENDS[name]])
        ax.pcolormesh(x_corners, y_corners, cells, cmap=colour, rasterized=True)
    bar = ax.figure.colorbar(field, ax=ax, label=_LABELS[show], spacing="uniform", shrink=0.8)
    if show == "condition":
        bar.set_ticks(LEVELS, labels=[f"{level:g}" for level in LEVELS])
    if names:
        handles = [Patch(facecolor=_ENDS[name], label=name) for name in names]
        ax.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)


def _corners(x: Array) -> Array:
    """Corners of the cells around points of a grid: x of shape (N, M) gives (N + 1, M + 1).

    A corner is the mean of its four neighbours. The grid is first continued by one point beyond
    each edge, with the same step as before the edge: this is NumPy's odd reflection.
    """
    wide = np.pad(x, 1, mode="reflect", reflect_type="odd")
    return np.asarray((wide[:-1, :-1] + wide[1:, :-1] + wide[:-1, 1:] + wide[1:, 1:]) / 4)

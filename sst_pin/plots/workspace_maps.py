# SPDX-License-Identifier: BSD-2-Clause
"""The workspace of the star's axis s, as an equal-area map and as a sphere."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from contourpy import contour_generator
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from matplotlib.patheffects import withStroke
from scipy.spatial.transform import Rotation

from ..arrays import Array
from ..sst.platform_motion import orientation
from ..sst.robot import SST
from ..sst.workspace import Chart, WorkspaceMap
from .space import great_arc
from .style import Axes

#: Steps of the condition number, each with its colour: light is good, dark is singular.
LEVELS = (1, 1.1, 1.25, 1.5, 2, 3, 5, 10)
COLOUR_MAP: Any = mpl.colormaps["viridis_r"].with_extremes(over="#1c0021")
#: Colours and steps as arguments of Matplotlib.
CONDITION: dict[str, Any] = {
    "cmap": COLOUR_MAP,
    "norm": mpl.colors.BoundaryNorm(LEVELS, COLOUR_MAP.N, extend="max"),
}
#: sin(mu_k) below which a leg is drawn as flat on its arc: three degrees.
NEARLY_FLAT = np.sin(np.radians(3))

_EDGE = np.sqrt(2)  # radius of the map
_FLAT_COLOUR = "#CC79A7"
_BOUNDARY: dict[str, Any] = {"color": "black", "linewidth": 1.6}
_SECOND: dict[str, Any] = {"color": "#D55E00", "linewidth": 1.4}
_HALO: dict[str, Any] = {"path_effects": [withStroke(linewidth=2.8, foreground="white")]}
_TEXT: dict[str, Any] = {
    "ha": "center",
    "va": "center",
    "path_effects": [withStroke(linewidth=2, foreground="white", alpha=0.8)],
}
_TRIANGLE: dict[str, Any] = {"color": "black", "linewidth": 1.0, "linestyle": (0, (1, 1.5))} | _HALO
_PATH: dict[str, Any] = {"color": "black", "linewidth": 1.3, "linestyle": (0, (4, 1.5))} | _HALO
_ROLL: dict[str, Any] = {"color": "0.15", "linewidth": 0.6}
_BEST: dict[str, Any] = {
    "color": "white",
    "markeredgecolor": "black",
    "markersize": 5,
    "markeredgewidth": 0.7,
    "linestyle": "none",
}


def condition_colourbar(ax: Axes, *, within: bool = True) -> Axes:
    """Colour bar of the condition number, in wide and low axes of its own or else below a map."""
    mappable = mpl.cm.ScalarMappable(**CONDITION)
    beside = {"ax": ax, "pad": 0.02, "shrink": 0.8, "aspect": 25}
    place: dict[str, Any] = {"cax": ax} if within else beside
    bar = ax.figure.colorbar(mappable, orientation="horizontal", spacing="uniform", **place)
    bar.set_ticks(LEVELS, labels=[f"{level:g}" for level in LEVELS])
    bar.set_label("condition number of $A$ (1); hatched: a slider off its arc")
    bar.ax.tick_params(labelsize=7, length=2)
    return bar.ax


def second_kind(robot: SST, workspace: WorkspaceMap) -> list[Array]:
    """Singular curves of the second kind, det A = 0, as directions of s, shapes (N, 3).

    Close to singularities of the first kind A is not well defined, and the curves have a gap.
    """
    determinant = np.where(workspace.first_kind < NEARLY_FLAT, np.nan, workspace.determinant)
    return _zeros(robot, determinant)


def workspace_map(
    ax: Axes,
    robot: SST,
    workspace: WorkspaceMap,
    path: Array | None = None,
    *,
    colourbar: bool = True,
) -> Axes:
    """Equal-area map of the directions of s, for the half sphere about the base triangle.

    Colours show the condition number of A. Directions where a slider would leave its arc are
    hatched. A map at one psi also shows the singular curves of the second kind and the poses close
    to the first kind. A map over all psi shows lines of equal range of the roll angle.

    Args:
        ax: 2-D axes.
        robot: The SST.
        workspace: A workspace of this robot.
        path: Directions of s along a motion, shape (N, 3).
        colourbar: Whether it is drawn below.

    Example:
        >>> at_psi = sst_pin.sst.workspace.workspace_at(robot, rings=9, spokes=24)
        >>> plots.workspace_map(ax, robot, at_psi).figure.savefig("map.png")
    """
    chart = Chart.of_robot(robot)
    _draw(ax, robot, workspace, path, chart.project, chart.axes[2])
    _graticule_labels(ax, chart)
    return _framed(ax, _EDGE, 1.24, colourbar)


def workspace_on_sphere(
    ax: Axes,
    robot: SST,
    workspace: WorkspaceMap,
    path: Array | None = None,
    *,
    colourbar: bool = True,
) -> Axes:
    """Map of `workspace_map`, drawn on the sphere.

    Args:
        ax: 2-D axes; the view is an orthographic projection.
        robot: The SST.
        workspace: A workspace of this robot.
        path: Directions of s along a motion, shape (N, 3).
        colourbar: Whether it is drawn below.

    Example:
        >>> at_psi = sst_pin.sst.workspace.workspace_at(robot, rings=9, spokes=24)
        >>> plots.workspace_on_sphere(ax, robot, at_psi).figure.savefig("sphere.png")
    """
    aside = Rotation.from_euler("yx", (-22, 6), degrees=True).as_matrix()
    view = aside @ Chart.of_robot(robot).axes
    _draw(ax, robot, workspace, path, lambda s: np.asarray(s @ view[:2].T), view[2])
    return _framed(ax, 1.0, 1.1, colourbar)


def _draw(
    ax: Axes,
    robot: SST,
    workspace: WorkspaceMap,
    path: Array | None,
    project: Callable[[Array], Array],
    eye: Array,
) -> None:
    """A workspace in a projection of the half sphere before the eye."""
    chart = Chart.of_robot(robot)
    v = robot.geometry.R_0[:, :, 0]
    # A little beyond the horizon, so that what is drawn ends there and not at the grid's steps.
    hidden = workspace.s @ eye < -0.05
    x, y = np.moveaxis(project(workspace.s), -1, 0)
    horizon = Circle((0, 0), np.hypot(x, y).max(), color="0.94", zorder=0)
    ax.add_patch(horizon)

    def fill(field: Array, levels: Sequence[float], **look: Any) -> None:
        found = ax.contourf(x, y, np.where(hidden, np.nan, field), levels, **look)
        found.set_clip_path(horizon)

    def draw(curve: Array, **look: Any) -> None:
        seen = (curve @ eye >= 0) & (curve @ chart.axes[2] >= -1e-9)
        ax.plot(*project(np.where(seen[:, None], curve, np.nan)).T, **look)

    margin = np.where(np.isnan(workspace.margin), -np.pi, workspace.margin)  # flat is off the arc
    fill(workspace.condition_number, LEVELS, **CONDITION, extend="max")
    with mpl.rc_context({"hatch.color": "white", "hatch.linewidth": 0.5}):
        fill(margin, (-2 * np.pi, 0), colors="none", hatches=["////"])
    for _, _, line in _parallels_and_meridians():
        draw(line, color="black", linewidth=0.35, alpha=0.35)
    if _one_psi(workspace):
        fill(workspace.first_kind, (0, NEARLY_FLAT), colors=_FLAT_COLOUR)
        for curve in second_kind(robot, workspace):
            draw(curve, **_SECOND)
    else:
        _roll_lines(ax, workspace, x, y)
    for k in range(3):
        draw(great_arc(v[k], v[(k + 1) % 3]), **_TRIANGLE)
    for curve in _zeros(robot, margin):
        draw(curve, **_BOUNDARY)
    if path is not None:
        draw(path, **_PATH)
    if workspace.best is not None:
        draw(workspace.s[workspace.best][None], **_best_look(workspace))
    middle = project(chart.axes[2])
    for k in range(3):
        if v[k] @ eye >= 0:
            point = project(v[k])
            ax.plot(*point, "o", color="black", markersize=3)
            beside = (point - middle) / np.linalg.norm(point - middle)
            if np.linalg.norm(point) > 0.85 * np.hypot(x, y).max():  # not among the angles outside
                beside = -beside
            ax.text(*(point + 0.12 * beside), rf"$\mathbf{{v}}_{k + 1}$", **_TEXT)


def workspace_legend(workspace: WorkspaceMap, path: str | None = None) -> list[Any]:
    """Handles for the legend of a map.

    Args:
        workspace: The workspace in the map.
        path: Name of the path, if there is one.

    Example:
        >>> at_psi = sst_pin.sst.workspace.workspace_at(robot, rings=9, spokes=24)
        >>> [handle.get_label() for handle in plots.workspace_legend(at_psi)][0]
        'base triangle'
    """
    styles = {"base triangle": _TRIANGLE}
    if workspace.best is not None:
        styles["sliders at the ends of their arcs"] = _BOUNDARY
        best = f"best pose, condition number {workspace.condition_number[workspace.best]:.3g}"
        styles["isotropic pose" if _isotropic(workspace) else best] = _best_look(workspace)
    if path is not None:
        styles[path] = _PATH
    if _one_psi(workspace):
        styles[r"singularity of the second kind: $\det A = 0$"] = _SECOND
    else:
        styles["range of the roll angle about the star's axis"] = _ROLL
    handles: list[Any] = [Line2D([], [], label=name, **look) for name, look in styles.items()]
    if _one_psi(workspace):
        flat = r"near the first kind: $|\sin\mu_k| < \sin 3°$"
        handles.append(Patch(facecolor=_FLAT_COLOUR, label=flat))
    return handles


def _isotropic(workspace: WorkspaceMap) -> bool:
    return bool(workspace.condition_number[workspace.best] < 1 + 1e-6)


def _best_look(workspace: WorkspaceMap) -> dict[str, Any]:
    shape = {"marker": "*", "markersize": 9} if _isotropic(workspace) else {"marker": "D"}
    return _BEST | shape


def _one_psi(workspace: WorkspaceMap) -> bool:
    return bool(np.ptp(workspace.psi) == 0)


def _zeros(robot: SST, field: Array) -> list[Array]:
    """Curves on which a field on the grid of a workspace is zero, as directions."""
    rings, spokes = field.shape
    x, y = np.moveaxis(Chart.grid(rings, spokes - 1), -1, 0)
    found: Any = contour_generator(x=x, y=y, z=np.ma.masked_invalid(field)).lines(0.0)
    return [Chart.of_robot(robot).directions(curve) for curve in found]


def _roll_lines(ax: Axes, workspace: WorkspaceMap, x: Array, y: Array) -> None:
    """Lines of equal roll, labelled below the best pose where there is room."""
    if workspace.best is None:
        return
    roll = np.where(workspace.on_arcs, np.degrees(workspace.roll), np.nan)
    best = np.array((x[workspace.best], y[workspace.best]))
    places = [best]
    found: Any = contour_generator(x=x, y=y, z=np.ma.masked_invalid(roll))
    ticks = mpl.ticker.MaxNLocator(5, steps=[1, 1.5, 3, 10])
    for level in ticks.tick_values(np.nanmin(roll), np.nanmax(roll)):
        lines = [_smooth(line, 1 / len(x)) for line in found.lines(level)]
        for line in lines:
            ax.plot(*line.T, **_ROLL)
        line = np.concatenate([np.empty((0, 2)), *lines])
        below = line[line[:, 1] < best[1]]
        if len(below):
            place = below[np.abs(below[:, 0] - best[0]).argmin()]
            if min(np.linalg.norm(place - other) for other in places) > 0.13:
                places.append(place)
                ax.text(*place, f"{level:.0f}°", fontsize=7, **_TEXT)


def _smooth(line: Array, step: float) -> Array:
    """A smooth line through samples that are exact to half a step of the map."""
    from scipy.interpolate import make_smoothing_spline

    length = np.append(0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    kept = np.append(True, np.diff(length) > 1e-9)
    if kept.sum() < 6:
        return line
    curve = make_smoothing_spline(length[kept], line[kept], lam=step**3)
    return np.asarray(curve(np.linspace(0, length[-1], 400)))


def _framed(ax: Axes, radius: float, room: float, colourbar: bool) -> Axes:
    """Axes with the outline of a map instead of a frame, and a colour bar below where asked for."""
    ax.add_patch(Circle((0, 0), radius, fill=False, linewidth=0.6, zorder=2))
    limits = (-room * radius, room * radius)
    ax.set(xlim=limits, ylim=limits, aspect="equal")
    ax.set_axis_off()
    if colourbar:
        condition_colourbar(ax, within=False)
    return ax


def _parallels_and_meridians() -> Iterator[tuple[str, int, Array]]:
    """Colatitudes phi and longitudes theta of s every 30 degrees: name, angle, directions."""
    round_about = np.radians(np.linspace(-180, 180, 721))
    pole_to_pole = np.radians(np.linspace(5, 175, 341))  # at the poles they would crowd
    for at in range(30, 180, 30):
        yield "phi", at, orientation(round_about, np.radians(at))[..., 0]
    for at in range(-150, 181, 30):
        yield "theta", at, orientation(np.radians(at), pole_to_pole)[..., 0]


def _graticule_labels(ax: Axes, chart: Chart) -> None:
    """Angles of parallels and meridians where they leave the map."""
    taken: list[float] = []
    for name, at, line in _parallels_and_meridians():
        for leaving in np.flatnonzero(np.diff(np.sign(line @ chart.axes[2]))):
            right, up, _ = chart.axes @ line[leaving]
            turn = float(np.arctan2(up, right))
            needed = 0.17 + 0.08 * abs(up)  # side by side they need more than one below the other
            crowded = any(abs(np.angle(np.exp(1j * (turn - t)))) < needed for t in taken)
            if crowded or (name == "phi" and right > 0):  # colatitudes at the left
                continue
            taken.append(turn)
            ax.text(
                1.04 * _EDGE * right,
                1.06 * _EDGE * up,
                rf"$\{name}$ {at}°".replace("-", "\N{MINUS SIGN}"),
                ha="center" if abs(right) < 0.3 else "left" if right > 0 else "right",
                va="center",
                fontsize=7,
                color="0.3",
            )

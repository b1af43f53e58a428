# SPDX-License-Identifier: BSD-2-Clause
"""Figures of docs/paper.md with several methods, or several readings of the paper, side by side.

Like those of `sst_pin.plots`, the functions draw into axes that they are given and hand them back.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from sst_pin import SST, Trajectory
from sst_pin.arrays import Array, Indices
from sst_pin.description.colours import LEG_COLOURS
from sst_pin.plots import motor_torques, paths_on_sphere
from sst_pin.plots.style import DASHES, Axes

#: Colour and marker of each method; the colours of legs and these are eight of Okabe and Ito's.
MARKERS = (
    (LEG_COLOURS[0], ""),
    ("#000000", "o"),
    ("#E69F00", "s"),
    ("#56B4E9", "^"),
    ("#CC79A7", "x"),
)


class Method(NamedTuple):
    """What one method found."""

    label: str  # in the legend
    t: Array  # (N,), [s]
    values: Array  # torques (N, 3), orientations (N, 3, 3), or differences (N,)
    marker: int  # index of colour and marker in MARKERS; runs of one engine share them
    rough: bool = False  # a coarser run of the method before it, drawn dashed


def torques_of_methods(ax: Axes, ours: Trajectory, others: Sequence[Method]) -> Axes:
    """Torques of ours as lines, those of other methods as marks on them (Fig. 10)."""
    motor_torques(ax, ours)
    for number, method in enumerate(others):
        picked = _spread(method.t, number, len(others), 9)
        ax.plot(method.t[picked], method.values[picked], **_mark(method))
    return ax


def differences(ax: Axes, methods: Sequence[Method], what: str) -> Axes:
    """Sizes of differences against time, logarithmic; exact zeros have no place on the axis."""
    for number, method in enumerate(methods):
        colour, _ = MARKERS[method.marker]
        seen = method.values > 0
        t = method.t[seen]
        values = method.values[seen]
        dashes = (0, (4, 2)) if method.rough else "-"
        ax.semilogy(t, values, color=colour, linestyle=dashes, linewidth=0.8, alpha=0.8)
        if seen.any() and not method.rough:
            picked = _spread(t, number, len(methods), 9)
            ax.plot(t[picked], values[picked], **_mark(method))
        # One entry of the legend for line and marks.
        mark = {} if method.rough else _mark(method)
        ax.plot([], [], **(mark | {"linestyle": dashes, "color": colour}), label=method.label)
    ax.set(xlabel="time (s)", ylabel=what)
    return ax


def legend_below(figure: Figure, ax: Axes) -> None:
    """One legend for all axes of a figure, where it covers none of their curves."""
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, ncols=2, loc="outside lower center", handlelength=2.2)


def paths_of_methods(
    ax: Axes, robot: SST, wanted: Trajectory, ours: Trajectory, others: Sequence[Method]
) -> Axes:
    """Path of E by ours as a line over the wanted one, those of others as marks (Fig. 11)."""
    paths_on_sphere(ax, robot, [("wanted path", wanted), ("NOC", ours)])
    ax.get_legend().remove()
    for number, method in enumerate(others):
        picked = _spread(method.t, number, len(others), 9)
        E = robot.star_radius * method.values[picked, :, 0]
        ax.plot(*E.T, **_mark(method), zorder=12)
    return ax


def torques_of_reading(ax: Axes, default: Trajectory, reading: Trajectory, title: str) -> Axes:
    """Torques of one reading of the paper over those of the default, with their peaks."""
    ax.axhline(0, color="0.8", linewidth=0.5)
    ax.plot(default.t, default.tau, color="0.72", linewidth=1.8, label=["default", "", ""])
    for k, tau in enumerate(reading.tau.T):
        look = {"color": LEG_COLOURS[k], "linestyle": DASHES[k], "linewidth": 1.0}
        ax.plot(reading.t, tau, **look, label=rf"$\tau_{k + 1}$")
    peaks = ", ".join(f"{peak:.1f}" for peak in np.abs(reading.tau).max(axis=0))
    ax.set_title(title, fontsize=8)
    ax.text(0.5, 0.03, f"peaks {peaks} N m", transform=ax.transAxes, ha="center", fontsize=7)
    ax.set(xlim=(default.t[0], default.t[-1]))
    return ax


def _spread(t: Array, number: int, of: int, count: int) -> Indices:
    """Indices of some samples, evenly apart and beside those of the other methods."""
    share = (np.arange(count) + (number + 0.5) / max(of, 1)) / count
    wanted = t[0] + share * (t[-1] - t[0])
    return np.minimum(np.searchsorted(t, wanted), len(t) - 1)


def _mark(method: Method) -> dict[str, Any]:
    """An open mark that leaves what is under it to be seen."""
    colour, marker = MARKERS[method.marker]
    open_mark = {"markerfacecolor": "none", "markersize": 3.5, "markeredgewidth": 0.8}
    return {"linestyle": "none", "marker": marker, "color": colour} | open_mark

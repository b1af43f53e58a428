# SPDX-License-Identifier: BSD-2-Clause
"""Curves over time: their labels, axes and legends; their colours, dashes and marks."""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from cycler import cycler

from ..arrays import Array
from ..description.colours import HUES
from ..errors import InputError, UnknownNameError
from .style import DASHES, Axes

#: The most curves in one pair of axes.
MOST = 6
#: Colours, dashes and marks of successive curves: any nine of them differ, also in grey print.
_LOOKS = (
    cycler(color=(*HUES, "#000000", "#7F7F7F", "#8C510A"))
    + cycler(linestyle=3 * DASHES)
    + cycler(marker=["", "", "", "o", "o", "o", "s", "s", "s"])
)
_MARKS: dict[str, Any] = {
    "markevery": 0.17,
    "markersize": 3.5,
    "markerfacecolor": "white",
    "markeredgewidth": 0.8,
}

_GREEK = "alpha|beta|gamma|delta|theta|phi|psi|mu|nu|xi|rho|sigma|omega"
_LETTER = re.compile(rf"({_GREEK})_(\d+)")

#: Labels of the axes, by what is drawn and its unit.
POSITION = {"rad": "joint angle (deg)", "m": "joint displacement (m)", "": "quaternion (1)"}
RATE = {"rad": "joint rate (rad/s)", "m": "joint rate (m/s)"}
FORCE = {"Nm": "motor torque (N m)", "N": "motor force (N)"}


class Curves(NamedTuple):
    """Numbers over time with a name and a unit for each column; `values` of shape (N, columns)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array

    def pick(self, names: Sequence[str] | None) -> "Curves":
        """The curves of some names; all of them by default."""
        if names is None:
            return self
        for name in names:
            if name not in self.names:
                raise UnknownNameError("curve", name, self.names)
        chosen = [self.names.index(name) for name in names]
        return Curves(tuple(names), tuple(self.units[i] for i in chosen), self.values[:, chosen])

    def unit(self) -> str:
        """The one unit of the curves; InputError for several units or nothing to draw."""
        kinds = list(dict.fromkeys(self.units))
        if len(kinds) != 1:
            units = f"of several units ({', '.join(map(repr, kinds))})"
            several = f"{units}; name curves of one unit, or draw a motion_page"
            raise InputError("names", several if kinds else "none, so there is nothing to draw")
        return kinds[0]

    def panels(self) -> Iterator[tuple[str, ...]]:
        """Names of the curves in each pair of axes: one unit, at most `MOST` curves.

        More than that are divided: gamma_1, mu_1, gamma_2 by their letters, others evenly.
        """
        names_by_unit: dict[str, list[str]] = {}
        for name, unit in zip(self.names, self.units, strict=True):
            names_by_unit.setdefault(unit, []).append(name)
        for names in names_by_unit.values():
            groups: dict[str, list[str]] = {}
            for name in names:
                letter = _LETTER.fullmatch(name)
                group = letter[1] if letter and len(names) > MOST else ""
                groups.setdefault(group, []).append(name)
            for members in groups.values():
                panels = int(np.ceil(len(members) / MOST))
                for part in np.array_split(members, panels):
                    yield tuple(part)


class StyledCurve(NamedTuple):
    """A curve with a look of its own, such as a sum of others."""

    values: Array  #: Shape (N,).
    label: str
    look: Mapping[str, Any]  #: Matplotlib options.


def draw(
    ax: Axes,
    t: Array,
    curves: Curves,
    labels: Sequence[str],
    y_label: str,
    *,
    others: Sequence[StyledCurve] = (),
    zero: bool = False,
    columns: int | None = None,
) -> Axes:
    """Draw curves over time, with a legend above the axes.

    Args:
        ax: 2-D axes.
        t: Times, shape (N,), [s].
        curves: Curves in colours, dashes and marks that differ.
        labels: Their names in the legend.
        y_label: Label of the y axis.
        others: Curves that are drawn after these.
        zero: Whether there is a thin line at 0.
        columns: Columns of the legend; by default three for curves whose labels are a letter and a
            number, two for others.
    """
    for look, values, label in zip(cycle(_LOOKS), curves.values.T, labels, strict=False):
        ax.plot(t, values, label=label, **look, **_MARKS)
    for other in others:
        ax.plot(t, other.values, label=other.label, **other.look)
    if zero:
        zero_line(ax)
    ax.set(xlabel="time (s)", ylabel=y_label, xlim=(t[0], t[-1]))
    if ax.get_yscale() == "linear":
        _plain_numbers(ax)
    if columns is None:
        columns = 3 if all(digits_of(name) for name in curves.names) else 2
    legend_above(ax, columns)
    return ax


def zero_line(ax: Axes) -> None:
    """A thin line at 0."""
    ax.axhline(0, color="0.7", linewidth=0.5, zorder=0)


def _plain_numbers(ax: Axes) -> None:
    """Numbers along y without a separate power of ten above the axes."""
    low, high = ax.get_ylim()
    size = max(abs(low), abs(high))
    if high - low < 1e-4 * size:  # else the numbers are long and differ at their ends
        ax.set_ylim(low - 5e-5 * size, high + 5e-5 * size)
    if 1e-4 < size < 1e6:
        plain = mpl.ticker.ScalarFormatter(useOffset=False)
        plain.set_scientific(False)
        ax.yaxis.set_major_formatter(plain)
    else:
        ax.yaxis.set_major_formatter(lambda y, _: f"{y:.6g}".replace("-", "\N{MINUS SIGN}"))


def label(name: str, accent: str = "") -> str:
    """A name for the legend: gamma_1 as a letter with its number, others as they are."""
    if match := _LETTER.fullmatch(name):
        return rf"${accent}\{match[1]}_{subscript(match[2])}$"
    plain = name.replace("$", r"\$")
    return f" {plain}" if plain.startswith("_") else plain  # legends omit names that begin with _


def formula(text: str) -> str:
    """A text with bars and Greek letters in TeX."""
    return re.sub(rf"({_GREEK})_(\w)", r"$\\\1_\2$", text).replace("|", "$|$")


def subscript(digits: str) -> str:
    """Digits as a subscript in TeX."""
    return digits if len(digits) == 1 else "{" + digits + "}"


def digits_of(name: str) -> str:
    """The digits of a name like gamma_1; of another name an empty text."""
    match = _LETTER.fullmatch(name)
    return match[2] if match else ""


def legend_above(ax: Axes, columns: int = 2) -> None:
    """A legend above the axes, where it covers no curve; constrained layout makes room for it."""
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, fontsize="small")

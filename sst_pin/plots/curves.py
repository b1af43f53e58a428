# SPDX-License-Identifier: BSD-2-Clause
"""Curves over time: their labels, axes and legends; their colours, dashes and marks.

`Curves` holds the numbers of several curves, and `draw` draws them into one pair of axes.
"""

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
#: Colours, dashes and marks of successive curves. Nine curves differ by dashes or marks alone, and
#: so in grey print too.
_LOOKS = (
    cycler(color=(*HUES, "#000000", "#7F7F7F", "#8C510A"))
    + cycler(linestyle=3 * DASHES)
    + cycler(marker=["", "", "", "o", "o", "o", "s", "s", "s"])
)
_MARKS: dict[str, Any] = {
    "markevery": 0.17,  # the distance of marks, as a share of the diagonal of the axes
    "markersize": 3.5,
    "markerfacecolor": "white",
    "markeredgewidth": 0.8,
}

#: Names of joints such as gamma_1: a Greek letter and a number.
_GREEK = "alpha|beta|gamma|delta|theta|phi|psi|mu|nu|xi|rho|sigma|omega"
_LETTER = re.compile(rf"({_GREEK})_(\d+)")

#: Labels of the y axis for positions, rates and forces, by their unit.
POSITION = {"rad": "joint angle (deg)", "m": "joint displacement (m)", "": "quaternion (1)"}
RATE = {"rad": "joint rate (rad/s)", "m": "joint rate (m/s)"}
FORCE = {"Nm": "motor torque (N m)", "N": "motor force (N)"}


class Curves(NamedTuple):
    """Several curves over time."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array  #: A column for each curve, shape (N, curves).

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
        """The one unit of the curves; InputError for several units or no curves."""
        units = list(dict.fromkeys(self.units))
        if not units:
            raise InputError("names", "none, so there is nothing to draw")
        if len(units) > 1:
            several = f"of several units ({', '.join(map(repr, units))})"
            cure = "name curves of one unit, or draw a motion_page"
            raise InputError("names", f"{several}; {cure}")
        return units[0]

    def panels(self) -> Iterator[tuple[str, ...]]:
        """Names of the curves in each pair of axes, which have one unit and are at most `MOST`.

        More curves of a unit are divided: names such as gamma_1, mu_1, gamma_2 by their Greek
        letters, and others evenly.
        """
        names_by_unit: dict[str, list[str]] = {}
        for name, unit in zip(self.names, self.units, strict=True):
            names_by_unit.setdefault(unit, []).append(name)
        for names in names_by_unit.values():
            names_by_letter: dict[str, list[str]] = {}
            for name in names:
                match = _LETTER.fullmatch(name)
                letter = match[1] if match and len(names) > MOST else ""
                names_by_letter.setdefault(letter, []).append(name)
            for group in names_by_letter.values():
                panels = int(np.ceil(len(group) / MOST))
                for part in np.array_split(group, panels):
                    yield tuple(part)


class StyledCurve(NamedTuple):
    """A curve that is drawn in its own style, for instance the sum of others."""

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
        curves: Curves, which get different colours, dashes and marks.
        labels: Names of `curves` in the legend.
        y_label: Label of the y axis.
        others: Further curves, which are drawn after `curves`.
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
    """Write the numbers along y without an offset or a power of ten above the axes."""
    low, high = ax.get_ylim()
    size = max(abs(low), abs(high))
    # A curve that is almost constant gets a larger range. Otherwise the numbers along y would be
    # long, and would differ in their last digits only.
    if high - low < 1e-4 * size:
        ax.set_ylim(low - 5e-5 * size, high + 5e-5 * size)
    if 1e-4 < size < 1e6:
        plain = mpl.ticker.ScalarFormatter(useOffset=False)
        plain.set_scientific(False)
        ax.yaxis.set_major_formatter(plain)
    else:
        ax.yaxis.set_major_formatter(lambda y, _: f"{y:.6g}".replace("-", "\N{MINUS SIGN}"))


def label(name: str, accent: str = "") -> str:
    """A name for the legend: gamma_1 as a Greek letter with an index, others as they are.

    `accent` is TeX for a mark above the letter, for instance a dot.
    """
    if match := _LETTER.fullmatch(name):
        return rf"${accent}\{match[1]}_{subscript(match[2])}$"
    plain = name.replace("$", r"\$")
    return f" {plain}" if plain.startswith("_") else plain  # legends omit names that begin with _


def formula(text: str) -> str:
    """A text for the legend, whose bars and names such as mu_k become TeX."""
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

# SPDX-License-Identifier: BSD-2-Clause
"""Curves over time: their labels, axes and legends; their colours, dashes and marks."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np

from ..arrays import Array
from ..description.colours import HUES
from ..errors import InputError, UnknownNameError
from .style import DASHES, Axes

#: The most curves in one pair of axes.
MOST = 6
_HUES = (*HUES, "#000000", "#7F7F7F", "#8C510A")
_MARKS = ("", "o", "s")

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
        for unit in dict.fromkeys(self.units):
            names = [name for name, u in zip(self.names, self.units, strict=True) if u == unit]
            groups: dict[str, list[str]] = {}
            for name in names:
                letter = _LETTER.fullmatch(name)
                group = letter[1] if letter and len(names) > MOST else ""
                groups.setdefault(group, []).append(name)
            for members in groups.values():
                yield from map(tuple, np.array_split(members, -(-len(members) // MOST)))


def draw(
    ax: Axes,
    t: Array,
    curves: Curves,
    labels: Sequence[str],
    what: str,
    *others: tuple[Array, str, Mapping[str, Any]],
    zero: bool = False,
) -> Axes:
    """Draw curves, and `others` with their own labels and styles; `zero` adds a line at 0."""
    for look, values, label in zip(looks(curves.names), curves.values.T, labels, strict=True):
        ax.plot(t, values, label=label, **look)
    for values, label, style in others:
        ax.plot(t, values, label=label, **style)
    if zero:
        zero_line(ax)
    ax.set(xlabel="time (s)", ylabel=what, xlim=(t[0], t[-1]))
    if ax.get_yscale() == "linear":
        _plain_numbers(ax)
    legend_above(ax)
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


def looks(names: Sequence[str]) -> list[dict[str, Any]]:
    """Colours, dashes and marks of curves, distinct on a screen and in grey print.

    Up to three curves differ in colour and dashes, more also in marks. If there are more than three
    names like gamma_1, the number selects colour and mark, the letter the dashes.
    """
    if len(names) <= len(DASHES):
        return [_look(i, i, 0) for i in range(len(names))]
    matches = [_LETTER.fullmatch(name) for name in names]
    if all(matches):
        letters, numbers = (list(dict.fromkeys(m[i] for m in matches if m)) for i in (1, 2))
        if len(letters) <= len(DASHES) and len(numbers) <= len(_MARKS):
            places = [(numbers.index(m[2]), letters.index(m[1])) for m in matches if m]
            return [_look(k, kind, k, place) for place, (k, kind) in enumerate(places)]
    return [_look(i % len(_HUES), i % 3, i // 3 % 3, i) for i in range(len(names))]


def _look(colour: int, dashes: int, mark: int, place: int = 0) -> dict[str, Any]:
    return {
        "color": _HUES[colour],
        "linestyle": DASHES[dashes],
        "marker": _MARKS[mark],
        "markevery": (0.02 + 0.018 * place, 0.17),  # not below one another
        "markersize": 3.5,
        "markerfacecolor": "white",
        "markeredgewidth": 0.8,
    }


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
    return digits if len(digits) == 1 else f"{{{digits}}}"


def digits_of(name: str) -> str:
    """The digits of a name like gamma_1; of another name an empty text."""
    match = _LETTER.fullmatch(name)
    return match[2] if match else ""


def legend_above(ax: Axes) -> None:
    """A legend above the axes, where it covers no curve, in as many columns as fit."""
    handles, labels = ax.get_legend_handles_labels()
    longest = max(map(_letters, labels), default=1)
    size = mpl.rcParams["font.size"] * (1 if longest < 8 else 0.83)
    entry = size * (5.2 + 0.45 * longest)  # [pt]: handle, gaps, letters
    spec = ax.get_subplotspec()
    share = 1 / spec.get_gridspec().ncols if spec else ax.get_position().width
    width = 72 * ax.figure.get_figwidth() * share - 55  # [pt], roughly
    columns = int(np.clip(width // entry, 1, 3))
    place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.3}
    look = {"handlelength": 2.8, "columnspacing": 1.2, "fontsize": size}
    ax.legend(handles, labels, ncols=columns, **place, **look)


def _letters(text: str) -> int:
    """About how many letters a label has; a command of mathematics counts as one."""
    plain = re.sub(r"\\[a-z]+\s?|\^\{.*?\}", "x", text)
    return len(re.sub(r"[${}_\\,]", "", plain) if "$" in text else text)

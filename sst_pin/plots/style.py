# SPDX-License-Identifier: BSD-2-Clause
"""The look of the figures, and their files."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from cycler import cycler
from matplotlib.figure import Figure

from ..description.colours import HUES
from ..files import Writer, require_ending

Axes = Any

#: Dashes of legs 1, 2, 3, so that their curves differ without colours too.
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.5, 1)))

_STYLE: dict[Any, Any] = {
    "font.family": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
    "font.size": 9,
    "axes.linewidth": 0.6,
    "axes.prop_cycle": cycler(color=HUES),
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "svg.hashsalt": "sst_pin",  # the same figure is the same file
    "savefig.dpi": 300,
}

#: Metadata of each kind of file: nothing that changes from run to run.
_METADATA: dict[str, Mapping[str, None]] = {
    "png": {},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}


def style() -> AbstractContextManager[None]:
    """The look of the figures, for a `with` statement.

    Example:
        >>> with plots.style():
        ...     ax = plots.motor_torques(Figure().add_subplot(), motion)
        ...     ax.figure.savefig("torques.png")
    """
    return mpl.rc_context(_STYLE)


class StyledFigure(Figure):
    """A figure that has the look of `style` wherever it is drawn or saved."""

    draw = mpl.rc_context(_STYLE)(Figure.draw)
    savefig = mpl.rc_context(_STYLE)(Figure.savefig)

    def _repr_png_(self) -> bytes:
        file = BytesIO()
        self.savefig(file, format="png", dpi=110)
        return file.getvalue()


def picture_kind(path: str | Path) -> str:
    """Kind of picture by the ending of a path; OutputError unless it is .png, .svg or .pdf."""
    return require_ending(path, *(f".{kind}" for kind in _METADATA))[1:]


def figure_writer(figure: Figure, path: str | Path) -> Writer:
    """A function that writes a figure in the format of the path's ending."""
    kind = picture_kind(path)

    def write(file: Any) -> None:
        with style():
            figure.savefig(file, format=kind, metadata=_METADATA[kind])

    return write

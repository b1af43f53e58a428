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

from ..description.colours import HUES, LEG_COLOURS
from ..errors import OutputError
from ..files import Writer, as_path

Axes = Any

#: Colours and dashes of legs 1, 2, 3, told apart without colour too (Okabe and Ito).
COLOURS = LEG_COLOURS
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
    context: AbstractContextManager[None] = mpl.rc_context(_STYLE)
    return context


class StyledFigure(Figure):
    """A figure that has the look of `style` wherever it is drawn or saved.

    Example:
        >>> figure = plots.StyledFigure(figsize=(3.5, 2.5), layout="constrained")
        >>> ax = plots.motor_torques(figure.add_subplot(), motion)
        >>> figure.savefig("torques.pdf")
    """

    def draw(self, renderer: Any) -> None:
        """Draw with the fonts of the pages; see `Figure.draw`."""
        with style():
            super().draw(renderer)

    def savefig(self, fname: Any, **options: Any) -> None:
        """Save with the fonts of the pages; see `Figure.savefig`."""
        with style():
            super().savefig(fname, **options)

    def _repr_png_(self) -> bytes:
        file = BytesIO()
        self.savefig(file, format="png", dpi=110)
        return file.getvalue()


def require_ending(path: str | Path) -> str:
    """The kind of picture that a path's ending asks for.

    Raises:
        OutputError: For another ending than .png, .svg or .pdf.

    Example:
        >>> plots.require_ending("torques.pdf")
        'pdf'
    """
    ending = as_path(path).suffix.lower()
    if ending[1:] not in _METADATA:
        raise OutputError(path, f"ending {ending!r} unknown; known: .png, .svg, .pdf")
    return ending[1:]


def figure_writer(figure: Figure, path: str | Path) -> Writer:
    """A function that writes a figure in the format of the path's ending.

    Raises:
        OutputError: For another ending than .png, .svg or .pdf.

    Example:
        >>> page = plots.motion_page(chain, motion, ["torques"])
        >>> with open("torques.svg", "wb") as file:
        ...     plots.figure_writer(page, "torques.svg")(file)
    """
    kind = require_ending(path)

    def write(file: Any) -> None:
        with style():
            figure.savefig(file, format=kind, metadata=_METADATA[kind])

    return write


def figure_writers(figure: Figure, stem: str) -> dict[str, Writer]:
    """Writers of a figure as PNG and SVG, by file name.

    Example:
        >>> page = plots.motion_page(chain, motion, ["torques"])
        >>> list(plots.figure_writers(page, "torques"))
        ['torques.png', 'torques.svg']
    """
    return {name: figure_writer(figure, name) for name in (f"{stem}.png", f"{stem}.svg")}

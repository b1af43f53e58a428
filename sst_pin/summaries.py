# SPDX-License-Identifier: BSD-2-Clause
"""A few lines about an object, for `repr` and for notebooks."""

from collections.abc import Sequence
from html import escape

#: Pairs of a label and its text.
Rows = Sequence[tuple[str, str]]


def as_text(title: str, rows: Rows) -> str:
    """A title and a line for each row, the labels in a column."""
    width = max((len(label) for label, _ in rows), default=0)
    return "\n".join([title, *(f"  {label:{width}}  {value}" for label, value in rows)])


def as_html(title: str, rows: Rows) -> str:
    """A title and rows as a table that takes the colours of the page around it."""
    cell = 'style="text-align:left;vertical-align:top;padding:0 1em 0 0"'
    lines = [
        f"<tr><th {cell}>{escape(word)}</th><td {cell}>{escape(value)}</td></tr>"
        for word, value in rows
    ]
    return f"<div><b>{escape(title)}</b><table>{''.join(lines)}</table></div>"


class Summary:
    """Shows itself by the rows of `_summary`."""

    def __repr__(self) -> str:
        return as_text(*self._summary())

    def _repr_html_(self) -> str:
        return as_html(*self._summary())

    def _summary(self) -> tuple[str, Rows]:
        """A title, and a row for each part."""
        raise NotImplementedError


def listed(words: Sequence[str], most: int = 9) -> str:
    """Words with commas: the first `most` and the number of the rest; "none" without words."""
    shown = ", ".join(words[:most])
    return f"{shown} and {len(words) - most} more" if len(words) > most else shown or "none"


def three_digits(value: float) -> str:
    """A number to three digits, without a power of ten up to ten digits: 23900, not 2.39e+04."""
    return f"{float(f'{value:.3g}'):.10g}"

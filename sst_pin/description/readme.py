# SPDX-License-Identifier: BSD-2-Clause
"""The README of a description: its files, and the source of each number."""

import re
from pathlib import Path

import numpy as np

from ..arrays import Array
from .parameters import ENTRIES, Parameters

#: Text with a row for each parameter; its value is $name, its grade and source are the paper's.
_TEMPLATE = Path(__file__).with_name("readme.md")
_ONLY_PAPER = "<!-- only the paper's robot -->\n"


def readme_of(p: Parameters) -> str:
    """Markdown of a description's README."""
    values, papers = _values(p), _values(Parameters())

    def row(match: re.Match[str]) -> str:
        name, rest = match.groups()
        value = _text(values[name])
        if np.allclose(values[name], papers[name], rtol=1e-12, atol=1e-15):
            return f"{value} | {rest}"
        return f"{value} | U | the paper's robot has {_text(papers[name])} |"

    text, _, more = _TEMPLATE.read_text(encoding="utf-8").partition(_ONLY_PAPER)
    text = re.sub(r"\$(\w+) \| (.*)", row, text)
    return text + more if p == Parameters() else text


def _values(p: Parameters) -> dict[str, Array]:
    names = "base_directions base_radius star_radius viscous_friction coulomb_friction gravity"
    values = {name: np.atleast_1d(getattr(p, name)) for name in names.split()}
    values["arc_angles"] = np.degrees(p.arc_angles)
    for name, bodies in (("link", p.links), ("passive_link", p.passive_links), ("star", [p.star])):
        values[f"{name}_mass"] = np.array([body.mass for body in bodies])
        values[f"{name}_center_of_mass"] = np.array([body.center_of_mass for body in bodies])
        values[f"{name}_inertia"] = np.array([body.inertia[ENTRIES] for body in bodies])
    return values


def _text(value: Array) -> str:
    """Numbers with six digits; one row where all rows are the same."""
    rows = np.atleast_2d(value[0] if (value == value[0]).all() else value)
    return "; ".join(", ".join(f"{x:.6g}" for x in row) for row in rows)

# SPDX-License-Identifier: BSD-2-Clause
"""The columns of motion files: `t_s`, then names with units."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..errors import FileFormatError
from ..files import Table

#: Units of the endings of positions, rates, accelerations and torques.
_ENDINGS = {
    "q": {"_rad": "rad", "_m": "m", "_1": ""},
    "va": {"_rad_s": "rad", "_m_s": "m"},
    "aa": {"_rad_s2": "rad", "_m_s2": "m"},
    "tau": {"_Nm": "Nm", "_N": "N"},
}


class Column(NamedTuple):
    """A column, with the name and the unit of its values."""

    column: str
    name: str
    unit: str


def columns_of(kind: str, names: Sequence[str], units: Sequence[str]) -> list[str]:
    """Columns of "q", "va", "aa" or "tau": `crank_rad`, `crank_rad_s`, ..., `tau_crank_Nm`."""
    endings = {unit: ending for ending, unit in _ENDINGS[kind].items()}
    begin = "tau_" if kind == "tau" else ""
    return [f"{begin}{name}{endings[unit]}" for name, unit in zip(names, units, strict=True)]


def columns_in(table: Table, kind: str) -> list[Column]:
    """The columns of one kind in a table."""
    begin = "tau_" if kind == "tau" else ""
    return [
        Column(column, column.removeprefix(begin).removesuffix(ending), unit)
        for column in table.columns
        for ending, unit in _ENDINGS[kind].items()
        if column.startswith(begin) and column.endswith(ending)
    ]


def parts_of(table: Table) -> dict[str, Any]:
    """Arguments of `Trajectory` from a CSV that `Trajectory.save` has written."""
    q, va, aa, tau = (columns_in(table, kind) for kind in _ENDINGS)
    if not q or not va:
        text = "not a motion: no columns like gamma_1_rad, gamma_1_rad_s"
        raise FileFormatError(table.path, text)
    if {column.name for column in aa} - {column.name for column in va}:
        raise FileFormatError(table.path, "not a motion: accelerations of joints without rates", 1)
    accelerations = [f"{column.column}2" for column in va]
    parts = [[column.column for column in columns] for columns in (q, va, tau)]
    values = table.select(["t_s", *parts[0], *parts[1], *accelerations, *parts[2]])
    sizes = np.cumsum([1, len(q), len(va), len(va)])
    arrays = np.split(values, sizes, axis=1)
    return {
        **dict(zip(("t", "q", "va", "aa", "tau"), [arrays[0][:, 0], *arrays[1:]], strict=True)),
        **{"joint_names": [c.name for c in q], "units": [c.unit for c in q]},
        **{"coordinates": [c.name for c in va], "rate_units": [c.unit for c in va]},
        **{"motor_names": [c.name for c in tau], "torque_units": [c.unit for c in tau]},
    }

# SPDX-License-Identifier: BSD-2-Clause
"""The columns of motion files: `t_s`, then names with units."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from ..errors import FileFormatError
from ..files import Table

#: Units by the endings of columns, for positions, rates, accelerations and torques; the unit of a
#: quaternion's entry, or of a cosine, is "".
_ENDINGS = {
    "q": {"_rad": "rad", "_m": "m", "_1": ""},
    "va": {"_rad_s": "rad", "_m_s": "m"},
    "aa": {"_rad_s2": "rad", "_m_s2": "m"},
    "tau": {"_Nm": "Nm", "_N": "N"},
}


def printed_units(units: Sequence[str]) -> list[str]:
    """Units of torques and forces as texts have them: "N m" for the "Nm" of columns."""
    return [unit.replace("Nm", "N m") for unit in units]


class Column(NamedTuple):
    """A column, with the name and the unit of its values."""

    column: str
    name: str
    unit: str


def columns_of(kind: str, names: Sequence[str], units: Sequence[str]) -> list[str]:
    """Columns of "q", "va", "aa" or "tau": `crank_rad`, `crank_rad_s`, ..., `tau_crank_Nm`."""
    ending_of = {unit: ending for ending, unit in _ENDINGS[kind].items()}
    pairs = zip(names, units, strict=True)
    return [f"{_beginning(kind)}{name}{ending_of[unit]}" for name, unit in pairs]


def columns_in(table: Table, kind: str) -> list[Column]:
    """The columns of one kind in a table."""
    beginning = _beginning(kind)
    columns = list[Column]()
    for column in table.columns:
        for ending, unit in _ENDINGS[kind].items():
            if column.startswith(beginning) and column.endswith(ending):
                name = column.removeprefix(beginning).removesuffix(ending)
                columns.append(Column(column, name, unit))
    return columns


def _beginning(kind: str) -> str:
    """How the columns of a kind begin."""
    return "tau_" if kind == "tau" else ""


def parts_of(table: Table) -> dict[str, Any]:
    """Arguments of `Trajectory` from a CSV that `Trajectory.save` has written."""
    q = columns_in(table, "q")
    va = columns_in(table, "va")
    aa = columns_in(table, "aa")
    tau = columns_in(table, "tau")
    if not q or not va:
        text = "not a motion: no columns like gamma_1_rad, gamma_1_rad_s"
        raise FileFormatError(table.path, text)
    if {column.name for column in aa} - {column.name for column in va}:
        raise FileFormatError(table.path, "not a motion: accelerations of joints without rates", 1)
    # Accelerations in the order of the rates, so that both have the same coordinates: the column of
    # an acceleration, such as crank_rad_s2, is that of the rate and a 2.
    accelerations = [f"{column.column}2" for column in va]
    return {
        "t": table.column("t_s"),
        "q": table.select([column.column for column in q]),
        "va": table.select([column.column for column in va]),
        "aa": table.select(accelerations),
        "tau": table.select([column.column for column in tau]),
        "joint_names": [column.name for column in q],
        "units": [column.unit for column in q],
        "coordinates": [column.name for column in va],
        "rate_units": [column.unit for column in va],
        "motor_names": [column.name for column in tau],
        "torque_units": [column.unit for column in tau],
    }

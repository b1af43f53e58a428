# SPDX-License-Identifier: BSD-2-Clause
"""What a check finds, and the numbers it reads."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Problem:
    """Something in a description that is wrong, or that some tool will stumble over.

    Attributes:
        severity: "error" when the robot cannot be, or cannot be computed; else "warning".
        where: What it concerns: "link foot", "joint knee", "closure A - B".
        text: One sentence.
    """

    severity: str
    where: str
    text: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.where}: {self.text}"


def error(where: str, text: str) -> Problem:
    """A problem that must be solved."""
    return Problem("error", where, text)


def warning(where: str, text: str) -> Problem:
    """A problem that some tools have."""
    return Problem("warning", where, text)


def numbers(text: str, count: int) -> NDArray[np.float64] | None:
    """So many finite numbers, or None when it is anything else."""
    try:
        values = np.array(text.split(), dtype=float)
    except ValueError:
        return None
    return values if values.shape == (count,) and np.isfinite(values).all() else None


def origins(element: ET.Element, where: str) -> list[Problem]:
    """Origins of an element that do not consist of numbers."""
    return [
        error(where, f"origin {key}={text!r} is not three numbers")
        for origin in element.findall("origin")
        for key, text in origin.attrib.items()
        if key in ("xyz", "rpy") and numbers(text, 3) is None
    ]

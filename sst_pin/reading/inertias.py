# SPDX-License-Identifier: BSD-2-Clause
"""Inertias that no body has."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from ..errors import DescriptionWarning
from .problems import number
from .urdf_checks import ENTRIES

#: What rounding of an exact rod or disc leaves, as a share of the largest moment.
_ROUNDING = 1e-9
#: Links that a warning names.
_NAMED = 5


def inertia_of(inertial: ET.Element) -> NDArray[np.float64] | None:
    """Moments of inertia of a link, shape (3, 3), [kg m^2]; None where a number is missing."""
    entries = [number(inertial.find("inertia"), key) for key in ENTRIES]
    if None in entries:
        return None
    xx, xy, xz, yy, yz, zz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)


def principal_moments(inertia: NDArray[np.float64]) -> NDArray[np.float64]:
    """Principal moments of inertia, ascending, shape (3,), [kg m^2]."""
    size = np.abs(inertia).max() or 1.0  # of 1e300 the eigenvalues overflow
    return np.linalg.eigvalsh(inertia / size) * size


def impossible(mass: float, inertia: NDArray[np.float64]) -> str:
    """Why no body has this mass and these moments; empty for those that one has.

    A point or a rod without thickness counts as a body.
    """
    A, B, C = principal_moments(inertia)
    if not inertia.any():
        return ""
    if mass == 0:
        return "inertia without mass"
    shown = f"principal moments {A:.4g}, {B:.4g}, {C:.4g} kg m^2"
    if A < -_ROUNDING * C:
        return f"inertia not positive definite: {shown}"
    if A + B < C * (1 - _ROUNDING):
        return f"impossible inertia, the two smaller moments must reach the third: {shown}"
    return ""


def warn(root: ET.Element, source: str, stacklevel: int) -> None:
    """Warn of the links of a URDF with impossible inertias, which are computed as they stand.

    `stacklevel` is that of the line that the warning points to, see `warnings.warn`.
    """
    found = []
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        mass, inertia = number(inertial.find("mass"), "value"), inertia_of(inertial)
        if mass is not None and inertia is not None and (text := impossible(mass, inertia)):
            found.append(f"link {link.get('name')}: {text}")
    if found:
        more = f" and {len(found) - _NAMED} more" * (len(found) > _NAMED)
        listed = "; ".join(found[:_NAMED])
        message = f"{source}: {listed}{more}. The dynamics are computed with these numbers"
        warnings.warn(message, DescriptionWarning, stacklevel=stacklevel + 1)

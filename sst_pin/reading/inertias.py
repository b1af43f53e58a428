# SPDX-License-Identifier: BSD-2-Clause
"""Inertias that no body has."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np

from ..arrays import Array
from .problems import number
from .urdf_checks import ENTRIES

#: What rounding of an exact rod or disc leaves, as a share of the largest moment.
_ROUNDING = 1e-9
#: Links that a warning names.
_NAMED = 5


def mass_of(inertial: ET.Element) -> tuple[float, Array] | None:
    """Mass, and moments of inertia of shape (3, 3), [kg m^2]; None if a number is missing."""
    mass = number(inertial.find("mass"), "value")
    entries = [number(inertial.find("inertia"), key) for key in ENTRIES]
    if mass is None or None in entries:
        return None
    xx, xy, xz, yy, yz, zz = entries
    return mass, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)


def principal_moments(inertia: Array) -> Array:
    """Principal moments of inertia, ascending, shape (3,), [kg m^2]."""
    size = np.abs(inertia).max() or 1.0  # of 1e300 the eigenvalues overflow
    return np.linalg.eigvalsh(inertia / size) * size


def impossible(mass: float, inertia: Array) -> str:
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


def notes(root: ET.Element) -> Iterator[str]:
    """The links of a URDF with impossible inertias, which are computed as they stand."""
    found = []
    for link in root.findall("link[inertial]"):
        for body in filter(None, map(mass_of, link.findall("inertial"))):
            if text := impossible(*body):
                found.append(f"link {link.get('name')}: {text}")
    if found:
        more = f" and {len(found) - _NAMED} more" * (len(found) > _NAMED)
        listed = "; ".join(found[:_NAMED])
        yield f"{listed}{more}. The dynamics are computed with these numbers"

# SPDX-License-Identifier: BSD-2-Clause
"""Masses and inertias that a body can have, in a form that every tool takes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..reading.checks import ENTRIES, ends
from ..reading.problems import Problem, error, number, warning

#: Of the largest moment: what rounding of an exact rod or disc leaves.
_ROUNDING = 1e-9
#: Heaviest over lightest moving link, beyond which half the digits are gone.
_SPREAD = 1e8


def check(root: ET.Element) -> Iterator[Problem]:
    """Problems of a URDF's inertials."""
    joints = root.findall("joint")
    borne = {ends(joint)[1] for joint in joints}
    moving = {ends(joint)[1] for joint in joints if joint.get("type") != "fixed"}
    masses = {}
    for link in root.findall("link"):
        name, inertial = link.get("name", ""), link.find("inertial")
        where = f"link {name}"
        if inertial is not None:
            yield from _inertial(inertial, where, name in moving)
            mass = number(inertial.find("mass"), "value")
            if name in moving and mass is not None and mass > 0:
                masses[name] = mass
        elif name in moving:
            yield error(
                where,
                "moves without <inertial>: no mass in Pinocchio, 1 kg in PyBullet, "
                "an error in MuJoCo",
            )
        elif name in borne:
            yield warning(
                where, "fixed link without <inertial>: 1 kg in PyBullet; add an <inertial> of zeros"
            )
    if masses:
        heavy, light = max(masses, key=lambda n: masses[n]), min(masses, key=lambda n: masses[n])
        if masses[heavy] > _SPREAD * masses[light]:
            yield warning(
                f"links {heavy} and {light}",
                f"very different masses, {masses[heavy]:.3g} kg and {masses[light]:.3g} kg",
            )


def _inertial(inertial: ET.Element, where: str, moves: bool) -> Iterator[Problem]:
    mass = number(inertial.find("mass"), "value")
    entries = [number(inertial.find("inertia"), key) for key in ENTRIES]
    if mass == 0 and moves:
        yield error(where, "moves without mass: MuJoCo refuses it")
    if mass is None or mass < 0 or None in entries:
        return  # told by the reader's checks
    xx, xy, xz, yy, yz, zz = entries
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)
    if mass > 0 or not moves:
        yield from _moments(inertia, mass, where, moves)


def _moments(
    inertia: NDArray[np.float64], mass: float, where: str, moves: bool
) -> Iterator[Problem]:
    size = np.abs(inertia).max() or 1.0  # of 1e300 the eigenvalues overflow
    A, B, C = np.linalg.eigvalsh(inertia / size) * size
    shown = f"principal moments {A:.4g}, {B:.4g}, {C:.4g} kg m^2"
    if not inertia.any():
        if mass and moves:
            yield error(where, f"moves, has {mass:g} kg but no inertia: MuJoCo refuses it")
        elif mass:
            yield warning(where, f"has {mass:g} kg but no inertia")
    elif mass == 0:
        yield error(where, "inertia without mass")
    elif A <= 0:
        yield error(where, f"inertia not positive definite: {shown}")
    elif A + B < C * (1 - _ROUNDING):
        yield error(
            where, f"impossible inertia, the two smaller moments must reach the third: {shown}"
        )

# SPDX-License-Identifier: BSD-2-Clause
"""Masses and inertias that a body can have, in a form that every tool takes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .problems import Problem, error, numbers, origins, warning
from .tree import ends

_ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
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
            yield from origins(inertial, where)
            yield from _inertial(inertial, where, name in moving)
            mass = _number(inertial, "mass", "value")
            if name in moving and mass is not None and mass > 0:
                masses[name] = mass
        elif name in moving:
            yield error(
                where,
                "moves and has no <inertial>: no mass in Pinocchio, 1 kg in PyBullet, "
                "an error in MuJoCo",
            )
        elif name in borne:
            yield warning(
                where, "fixed, no <inertial>: 1 kg in PyBullet; write one that is zero throughout"
            )
    if masses:
        heavy, light = max(masses, key=lambda n: masses[n]), min(masses, key=lambda n: masses[n])
        if masses[heavy] > _SPREAD * masses[light]:
            yield warning(
                f"links {heavy} and {light}",
                f"masses of {masses[heavy]:.3g} kg and {masses[light]:.3g} kg in one robot",
            )


def _inertial(inertial: ET.Element, where: str, moves: bool) -> Iterator[Problem]:
    mass = _number(inertial, "mass", "value")
    entries = [_number(inertial, "inertia", key) for key in _ENTRIES]
    if mass is None:
        yield error(where, "its mass is not a number")
    elif mass < 0:
        yield error(where, f"a mass of {mass:g} kg")
    elif mass == 0 and moves:
        yield error(where, "moves and has no mass: MuJoCo refuses it")
    missing = [key for key, entry in zip(_ENTRIES, entries, strict=True) if entry is None]
    if missing:
        yield error(where, f"its inertia has no number {', '.join(missing)}")
        return
    xx, xy, xz, yy, yz, zz = entries
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)
    if mass is not None and (mass > 0 or (mass == 0 and not moves)):
        yield from _moments(inertia, mass, where, moves)


def _moments(
    inertia: NDArray[np.float64], mass: float, where: str, moves: bool
) -> Iterator[Problem]:
    A, B, C = np.linalg.eigvalsh(inertia)
    shown = f"principal moments {A:.4g}, {B:.4g}, {C:.4g} kg m^2"
    if not inertia.any():
        if mass and moves:
            yield error(where, f"moves, {mass:g} kg and no inertia: MuJoCo refuses it")
        elif mass:
            yield warning(where, f"a point of {mass:g} kg: no inertia")
    elif mass == 0:
        yield error(where, "inertia without mass")
    elif A <= 0:
        yield error(where, f"inertia not positive definite: {shown}")
    elif A + B < C * (1 - _ROUNDING):
        yield error(
            where, f"no body has this inertia, the two smaller must reach the third: {shown}"
        )


def _number(inertial: ET.Element, tag: str, key: str) -> float | None:
    element = inertial.find(tag)
    value = None if element is None else numbers(element.get(key, ""), 1)
    return None if value is None else float(value[0])

# SPDX-License-Identifier: BSD-2-Clause
"""Masses and inertias that a body can have, in a form that every tool takes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator

from ..reading.inertias import impossible, inertia_of, principal_moments
from ..reading.problems import Problem, error, number, warning
from ..reading.urdf_checks import ends

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
    inertia = inertia_of(inertial)
    if mass == 0 and moves:
        yield error(where, "moves without mass: MuJoCo refuses it")
    elif mass is None or mass < 0 or inertia is None:
        return  # told by the reader's checks
    elif not inertia.any():
        if mass and moves:
            yield error(where, f"moves, has {mass:g} kg but no inertia: MuJoCo refuses it")
        elif mass:
            yield warning(where, f"has {mass:g} kg but no inertia")
    elif text := impossible(mass, inertia):
        yield error(where, text)
    elif (smallest := principal_moments(inertia)[0]) <= 0:
        yield error(where, f"inertia not positive definite: smallest moment {smallest:.4g} kg m^2")

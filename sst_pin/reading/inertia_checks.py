# SPDX-License-Identifier: BSD-2-Clause
"""Checks of the inertias of a URDF's links: can a body have them, are their units right?

`inertia_notes` has the warnings for everyone who reads the file, `check_inertias` all problems, for
`validate`.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from .problems import Problem, attribute, note, number, numbers, warning

#: Attributes of an `<inertia>`.
ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


class _Body(NamedTuple):
    """Numbers of a link."""

    mass: float  #: [kg]
    inertia: Array  #: Moments about the mass centre, shape (3, 3), [kg m^2].


def _bodies_of(root: ET.Element) -> dict[str, _Body]:
    """The links that have a mass and moments of inertia, by name."""
    bodies = dict[str, _Body]()
    for link in root.findall("link[inertial]"):
        mass = number(link.find("inertial/mass"), "value")
        entries = [number(link.find("inertial/inertia"), key) for key in ENTRIES]
        if mass is not None and None not in entries:
            xx, xy, xz, yy, yz, zz = entries
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)
            bodies[link.get("name", "")] = _Body(mass, inertia)
    return bodies


def _principal_moments(inertia: Array) -> Array:
    """Principal moments of inertia, ascending, shape (3,), [kg m^2]."""
    scale = np.abs(inertia).max() or 1.0  # without it, the eigenvalues of 1e300 overflow
    return np.linalg.eigvalsh(inertia / scale) * scale


#: Rounding of the moments of a rod or disc, as a share of the largest moment.
_ROUNDING = 1e-9


def impossible(mass: float, inertia: Array) -> str:
    """The reason why no body has this mass and these moments; empty if one can have them.

    The moments are integrals over the mass. So the principal moments A <= B <= C satisfy A >= 0 and
    A + B >= C. A point or a rod without thickness counts as a body.
    """
    A, B, C = _principal_moments(inertia)
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


#: Largest number of links that a warning names.
_MAX_NAMES = 5


def inertia_notes(root: ET.Element) -> Iterator[str]:
    """Notes on links of a URDF with impossible inertias, which are used unchanged."""
    problems = list[str]()
    for name, body in _bodies_of(root).items():
        reason = impossible(body.mass, body.inertia)
        if reason:
            problems.append(f"link {name}: {reason}")
    if not problems:
        return
    text = "; ".join(problems[:_MAX_NAMES])
    if len(problems) > _MAX_NAMES:
        text += f" and {len(problems) - _MAX_NAMES} more"
    yield f"{text}. The dynamics are computed with these numbers"


def check_inertias(root: ET.Element, helpers: Collection[str] = ()) -> Iterator[Problem]:
    """Problems of a URDF's inertials.

    Args:
        root: The URDF.
        helpers: Names of links without mass that the reader of a file has added, for instance
            between the two axes of a universal joint. They need no inertial.
    """
    bodies = _bodies_of(root)
    # Whether a link moves relative to its parent; the base is not among them.
    moves = {
        attribute(joint, "child/link"): joint.get("type") != "fixed"
        for joint in root.findall("joint")
    }
    for link in root.findall("link"):
        name = link.get("name", "")
        where = f"link {name}"
        if name in bodies:
            yield from _body_problem(bodies[name], where, moves.get(name, False))
        elif link.find("inertial") is not None or name in helpers:
            continue  # `urdf_checks` reports missing numbers
        elif moves.get(name):
            yield note(where, "moves without <inertial>: 1 kg in PyBullet, refused by MuJoCo")
        elif name in moves:
            text = "1 kg in PyBullet; add an <inertial> of zeros"
            yield note(where, f"fixed link without <inertial>: {text}")
    moving_masses = dict[str, float]()
    for name, body in bodies.items():
        if moves.get(name) and body.mass > 0:
            moving_masses[name] = body.mass
    yield from _mass_ratio(moving_masses)
    yield from _sizes(root, bodies)


def _body_problem(body: _Body, where: str, moves: bool) -> Iterator[Problem]:
    """A problem of the mass and the inertia of a link, here or in other tools; at most one."""
    if body.mass < 0:
        return  # `urdf_checks` reports it
    reason = impossible(body.mass, body.inertia)
    if reason:
        yield warning(where, reason)
    elif moves and body.mass == 0:
        yield note(where, "moves without mass: refused by MuJoCo")
    elif moves and not body.inertia.any():
        yield note(where, "moves, has mass but no inertia: refused by MuJoCo")
    elif body.mass and not body.inertia.any():
        yield note(where, "has mass but no inertia")
    elif moves and _principal_moments(body.inertia)[0] <= 0:
        yield note(where, "moves, a principal moment of its inertia is 0: refused by MuJoCo")


#: Largest ratio of the masses of moving links; beyond it, half of the digits are lost.
_MAX_MASS_RATIO = 1e8


def _mass_ratio(masses: Mapping[str, float]) -> Iterator[Problem]:
    """A warning of very different masses of moving links."""
    if not masses:
        return
    heavy = max(masses, key=lambda name: masses[name])
    light = min(masses, key=lambda name: masses[name])
    if masses[heavy] > _MAX_MASS_RATIO * masses[light]:
        text = f"very different masses, {masses[heavy]:.3g} kg and {masses[light]:.3g} kg"
        yield warning(f"links {heavy} and {light}", text)


#: The largest value of two ratios. One is the size of a link over its radius of gyration, which is
#: 3.5 for a rod. The other is this radius over the largest size of all links. If lengths are in
#: millimetres and moments in kg m^2, the first ratio is a thousand times too large. If lengths are
#: in metres and moments in kg mm^2, the second one is.
_MAX_SIZE_RATIO = 100


def _sizes(root: ET.Element, bodies: Mapping[str, _Body]) -> Iterator[Problem]:
    """Warnings of links whose lengths and inertias are in different units.

    The size of a link is compared with its radius of gyration, sqrt(largest moment / mass).
    """
    sizes = dict[str, float]()  # largest distance of a child's joint from the link's frame
    for joint in root.findall("joint"):
        parent = attribute(joint, "parent/link")
        place = numbers(attribute(joint, "origin/xyz"), 3)
        if parent and place is not None:
            sizes[parent] = max(sizes.get(parent, 0.0), float(np.linalg.norm(place)))
    largest_size = max(sizes.values(), default=0.0)
    for name, body in bodies.items():
        size = sizes.get(name, 0.0)
        moment = _principal_moments(body.inertia)[2]
        if body.mass <= 0 or moment <= 0:
            continue
        radius = math.sqrt(moment / body.mass)
        if not radius:
            continue  # it underflows
        if size > _MAX_SIZE_RATIO * radius:
            distance = f"joints {size:.3g} m apart"
        elif radius > _MAX_SIZE_RATIO * largest_size > 0:
            distance = f"no link has joints more than {largest_size:.3g} m apart"
        else:
            continue
        text = f"{distance}, but a radius of gyration of {radius:.3g} m"
        yield warning(f"link {name}", f"{text}; URDF needs m, kg and kg m^2")

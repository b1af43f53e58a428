# SPDX-License-Identifier: BSD-2-Clause
"""Parts that an SST could be built of, as solids and as triangle meshes (trimesh).

The paper gives the axes and two radii. All other sizes are chosen so that the bodies do not touch
one another when they turn about O: the base frame and the links are inside, the star is outside,
and the passive links, as carriages on the links, hold the star's arcs. The signs of `_gap` and
`_outside` adapt the parts to robots whose star is inside the base or whose triangle is left-handed.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from ..errors import MissingExtraError
from ..files import Writer
from .parameters import Parameters
from .solids import Arc, Ball, Box, Cylinder, Solid, bar, lofted, rod

# Sizes in metres for the paper's radii, 0.35 and 0.40 m. `parts_of` scales them.
_TUBE = 0.006  # radius of the tubes of the base frame
_BALL = 0.044  # radius of the ball at O
_MOTOR = 0.032  # radius of a motor
_HUB = 0.125  # distance from O to the hub of an actuator link, along the axis of its motor
_WIDTH = 0.024  # width of the link's arm
# Radial and axial size of the star's arcs. With these, arcs and hub of aluminium have the paper's
# 2.6 kg.
_RAIL = (0.020, 0.024)
_ROLLER = 0.007  # radius of a roller of a carriage
_PAPER_BASE_RADIUS = 0.35
_PAPER_GAP = 0.05
#: Smallest distance between the two spheres, relative to the radius of the base.
_LEAST_GAP = 0.01
#: Options of trimesh's export, by format.
_EXPORT: dict[str, dict[str, Any]] = {
    "stl": {},
    "obj": {"include_normals": False, "digits": 6, "header": None},
}


def parts_of(p: Parameters) -> dict[str, tuple[Solid, ...]]:
    """Solids of each mesh, by its name. All legs have the same meshes.

    `base` and `motors` are in base axes, `link` in {1k}, `passive` in {2k}, the others in {3k}.
    """
    # Sizes are proportional to the base radius, or smaller, so that a carriage fits between the
    # sphere of the base and the sphere of the star.
    scale = min(p.base_radius / _PAPER_BASE_RADIUS, abs(_gap(p)) / _PAPER_GAP)
    return {
        "base": tuple(_base(p, scale)),
        "motors": tuple(_motors(p, scale)),
        "link": tuple(_link(p, scale)),
        "passive": tuple(_passive(p, scale)),
        "arc": tuple(_star_arc(p, scale)),
        "tool": tuple(_tool(p, scale)),
    }


def meshes_of(p: Parameters) -> dict[str, Any]:
    """Meshes of an SST, each a `trimesh.Trimesh` in [m], by the names of `parts_of`."""
    try:
        import trimesh
    except ImportError:
        raise MissingExtraError("trimesh", "mesh") from None

    meshes = {}
    for name, solids in parts_of(p).items():
        parts = [trimesh.Trimesh(*lofted(solid.loops()), process=False) for solid in solids]
        meshes[name] = trimesh.util.concatenate(parts)
    return meshes


def mesh_writers(p: Parameters) -> dict[str, Writer]:
    """Writers of the meshes as STL and OBJ, by file name relative to the URDF."""

    def write(mesh: Any, kind: str, file: BinaryIO) -> None:
        content = mesh.export(file_type=kind, **_EXPORT[kind])
        file.write(content if isinstance(content, bytes) else content.encode())

    writers = dict[str, Writer]()
    for name, mesh in meshes_of(p).items():
        for kind in _EXPORT:
            writers[f"meshes/{name}.{kind}"] = partial(write, mesh, kind)
    return writers


def _gap(p: Parameters) -> float:
    """Distance from the sphere of the base to the sphere of the star, [m].

    It is negative if the star is inside. It is never zero, because sizes are proportional to it.
    """
    gap = p.star_radius - p.base_radius
    return float(np.copysign(max(abs(gap), _LEAST_GAP * p.base_radius), gap))


def _outside(p: Parameters) -> float:
    """Sign of the direction along e_k that leads out of the triangle, where the motors are."""
    return -float(np.sign(np.linalg.det(p.base_directions)))


def _base(p: Parameters, scale: float) -> Iterator[Solid]:
    """The triangle P1P2P3 on spokes from a ball at O, and a stand."""
    tube = _TUBE * scale
    center = np.zeros(3)
    yield Ball(center, _BALL * scale)
    for k in range(3):
        v = p.base_directions[k]
        v_next = p.base_directions[(k + 1) % 3]
        e = p.actuated_axes[k]
        yield rod(center, p.base_radius * v, tube)
        yield Ball(p.base_radius * v, 1.5 * tube)
        # The side from P_k to P_k+1, about e_k.
        axes = np.stack([v, np.cross(e, v), e], axis=-1)
        side = float(np.arctan2(np.linalg.norm(np.cross(v, v_next)), v @ v_next))
        yield Arc(axes, p.base_radius, side, (2 * tube, 2 * tube), round=True)
    # The stand. A post goes from O away from the triangle, where the arcs of the star do not come,
    # to an elbow outside the sphere of the star. From there it goes to the foot, along the axis of
    # motor 1, which is vertical in the paper.
    away = -p.base_directions.sum(axis=0)
    elbow = 1.17 * max(p.base_radius, p.star_radius) * away / np.linalg.norm(away)
    down = _outside(p) * p.actuated_axes[0]
    # The foot is 1.3 radii below O.
    foot = elbow + (1.3 * max(p.base_radius, p.star_radius) - elbow @ down) * down
    post = 0.018 * scale
    plate = 0.012 * scale
    yield rod(center, elbow, post)
    yield Ball(elbow, 1.15 * post)
    yield rod(elbow, foot, post)
    yield Cylinder(foot - 2 * post * down, foot, post, 1.8 * post)
    yield rod(foot, foot + plate * down, 0.1 * scale)


def _motors(p: Parameters, scale: float) -> Iterator[Solid]:
    """Motors on the ball at O, their shafts along e_k."""
    for axis in _outside(p) * p.actuated_axes:
        # Housing, two flanges and shaft: distances from O to both ends, and radius.
        for start, end, radius in (
            (0.034, 0.085, _MOTOR),
            (0.085, 0.089, 0.8 * _MOTOR),
            (0.089, 0.097, 0.6 * _MOTOR),
            (0.097, _HUB, 0.009),
        ):
            yield rod(start * scale * axis, end * scale * axis, radius * scale)


def _link(p: Parameters, scale: float) -> Iterator[Solid]:
    """An actuator link, from the motor's shaft around the base frame to the axis of mu_k.

    The hub on the shaft has a cap. An arm goes from the hub to an elbow beside the head, and a
    short arm from there to the head.
    """
    x, y, z = np.eye(3)
    z = _outside(p) * z
    hub = _HUB * scale
    width = _WIDTH * scale
    thick = width / 2
    yield rod((hub - thick) * z, (hub + thick) * z, width)
    yield rod((hub + thick) * z, (hub + 1.4 * thick) * z, 0.6 * width)
    inner, outer = _head(p, scale)
    head = (inner + outer) / 2 * x
    elbow = head + 0.034 * scale * z
    yield bar(hub * z, elbow, y, width, thick)
    yield rod(elbow - width / 2 * y, elbow + width / 2 * y, 0.6 * thick)
    yield bar(elbow, head, y, width, thick)
    yield rod(inner * x, outer * x, 0.6 * width)


def _head(p: Parameters, scale: float) -> tuple[float, float]:
    """The head of a link, which is the bearing of mu_k: its inner and outer end on x of {1k}, [m].

    It lies between the base frame and the star.
    """
    towards_star = np.sign(_gap(p)) * scale
    return p.base_radius + 0.015 * towards_star, p.base_radius + 0.028 * towards_star


def _passive(p: Parameters, scale: float) -> Iterator[Solid]:
    """A carriage that turns on the link and holds an arc of the star between four rollers.

    A pin in the link's head carries a plate, between the link and the arc. On each side of the arc
    two rollers stand on the plate, and a strip joins their other ends. The arc goes along y of
    {2k}.
    """
    x, _, _ = np.eye(3)
    gap = _gap(p)
    towards_star = np.sign(gap) * x
    star = (p.base_radius + gap) * x  # the middle of the arc
    depth = _RAIL[0] * scale
    width = _RAIL[1] * scale
    length = 0.05 * scale  # of the carriage along the arc
    plate = 0.005 * scale  # thickness
    strip = 0.004 * scale  # thickness
    slack = 0.002 * scale  # between the arc and the plate or a strip
    radius = _ROLLER * scale
    roller_z = width / 2 + radius + 0.1 * slack
    near = star - (depth / 2 + slack) * towards_star  # the ends of the rollers on the plate
    far = star + (depth / 2 + slack) * towards_star  # their ends at the strips
    _, head_end = _head(p, scale)
    yield rod(head_end * x, near - plate * towards_star, 0.3 * _WIDTH * scale)
    size = np.array((plate, length, 2 * (roller_z + radius)))
    yield Box(near - plate / 2 * towards_star, np.eye(3), size)
    for side in (-1, 1):
        for along in (-0.32, 0.32):
            offset = np.array((0, along * length, side * roller_z))
            yield rod(near + offset, far + offset, radius)
        middle = np.array((0, 0, side * (roller_z - slack / 2))) + far + strip / 2 * towards_star
        yield Box(middle, np.eye(3), np.array((strip, length, 2 * radius)))


def _star_arc(p: Parameters, scale: float) -> Iterator[Solid]:
    """A quarter circle from E over R_k, and a stop at its end."""
    x = np.eye(3)[0]
    y, z = _outside(p) * np.eye(3)[1:]  # R_k is at negative y if v_1, v_2, v_3 are right-handed
    depth = _RAIL[0] * scale
    width = _RAIL[1] * scale
    yield Arc(np.stack([x, y, z], axis=-1), p.star_radius, np.pi / 2, (depth, width))
    size = np.array((0.3 * depth, 1.5 * depth, 1.5 * width))
    yield Box(p.star_radius * y, np.stack([x, y, z], axis=-1), size)


def _tool(p: Parameters, scale: float) -> Iterator[Solid]:
    """The hub in which the arcs meet, and a tip along s, which is x of {3k}."""
    x = np.eye(3)[0]
    # Ends relative to the point E, and radii there: hub, collar, shaft and tip.
    for low, high, radius, end_radius in (
        (-0.013, 0.013, 0.028, 0.028),
        (0.013, 0.022, 0.016, 0.016),
        (0.022, 0.045, 0.009, 0.009),
        (0.045, 0.075, 0.009, 0.001),
    ):
        start = (p.star_radius + low * scale) * x
        end = (p.star_radius + high * scale) * x
        yield Cylinder(start, end, radius * scale, end_radius * scale)

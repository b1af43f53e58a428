# SPDX-License-Identifier: BSD-2-Clause
"""Parts that an SST could be built of, as solids and as triangle meshes (trimesh).

The paper fixes axes and two radii; the rest is chosen so that the bodies turn in shells about O and
keep clear of each other: base frame and links inside, carriages on them, the star outside.
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
_TUBE = 0.006  # radius of the base frame
_BALL = 0.044
_MOTOR = 0.032  # radius
_HUB = 0.125  # of an actuator link, from O along the axis of its motor
_WIDTH = 0.024  # of the link's arm
_RAIL = (0.020, 0.024)  # section of the star's arcs: with the hub the paper's 2.6 kg in aluminium
_ROLLER = 0.007  # radius
_PAPER_BASE_RADIUS = 0.35
_PAPER_GAP = 0.05
#: Smallest distance of the two spheres, relative to the radius of the base.
_LEAST_GAP = 0.01
#: Options of trimesh's export, by format.
_EXPORT: dict[str, dict[str, Any]] = {
    "stl": {},
    "obj": {"include_normals": False, "digits": 6, "header": None},
}


def parts_of(p: Parameters) -> dict[str, tuple[Solid, ...]]:
    """Solids of each mesh, by its name; the legs share theirs.

    `base` and `motors` are in base axes, `link` in {1k}, `passive` in {2k}, the others in {3k}.
    """
    # Sizes are proportional to the base, but a carriage must fit between the spheres.
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
    """Meshes of an SST, `trimesh.Trimesh` by its file's stem, in metres and axes of `parts_of`."""
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
    """Writers of the meshes as STL and OBJ, by the file's name from the URDF on."""

    def write(mesh: Any, kind: str, file: BinaryIO) -> None:
        content = mesh.export(file_type=kind, **_EXPORT[kind])
        file.write(content if isinstance(content, bytes) else content.encode())

    writers = dict[str, Writer]()
    for name, mesh in meshes_of(p).items():
        for kind in _EXPORT:
            writers[f"meshes/{name}.{kind}"] = partial(write, mesh, kind)
    return writers


def _gap(p: Parameters) -> float:
    """Distance from the sphere of the base to the sphere of the star.

    It is negative if the star is inside, and never zero, as sizes are scaled by it.
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
        axes = np.stack([v, np.cross(e, v), e], axis=-1)
        side = float(np.arctan2(np.linalg.norm(np.cross(v, v_next)), v @ v_next))
        yield Arc(axes, p.base_radius, side, (2 * tube, 2 * tube), round=True)
    # A stand: away from the triangle, where the arcs of the star do not come, until it is outside
    # their sphere; then along the axis of motor 1, which is the paper's vertical.
    away = -p.base_directions.sum(axis=0)
    elbow = 1.17 * max(p.base_radius, p.star_radius) * away / np.linalg.norm(away)
    down = _outside(p) * p.actuated_axes[0]
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
        for start, end, radius in (
            (0.034, 0.085, _MOTOR),
            (0.085, 0.089, 0.8 * _MOTOR),
            (0.089, 0.097, 0.6 * _MOTOR),
            (0.097, _HUB, 0.009),
        ):
            yield rod(start * scale * axis, end * scale * axis, radius * scale)


def _link(p: Parameters, scale: float) -> Iterator[Solid]:
    """An actuator link, from the motor's shaft around the base frame to the axis of mu_k."""
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
    """Ends of the bearing of mu_k on x of {1k}: clear of the base frame, towards the star."""
    out = np.sign(_gap(p)) * scale
    return p.base_radius + 0.015 * out, p.base_radius + 0.028 * out


def _passive(p: Parameters, scale: float) -> Iterator[Solid]:
    """A carriage that turns on the link and holds an arc of the star between four rollers."""
    x, _, _ = np.eye(3)
    gap = _gap(p)
    towards = np.sign(gap) * x
    star = (p.base_radius + gap) * x
    depth = _RAIL[0] * scale
    width = _RAIL[1] * scale
    plate = 0.005 * scale
    slack = 0.002 * scale
    strip = 0.004 * scale
    radius = _ROLLER * scale
    length = 0.05 * scale
    across = width / 2 + radius + 0.1 * slack
    near = star - (depth / 2 + slack) * towards
    far = star + (depth / 2 + slack) * towards
    yield rod(_head(p, scale)[1] * x, near - plate * towards, 0.3 * _WIDTH * scale)
    size = np.array((plate, length, 2 * (across + radius)))
    yield Box(near - plate / 2 * towards, np.eye(3), size)
    for side in (-1, 1):
        for along in (-0.32, 0.32):
            foot = np.array((0, along * length, side * across))
            yield rod(near + foot, far + foot, radius)
        middle = np.array((0, 0, side * (across - slack / 2))) + far + strip / 2 * towards
        yield Box(middle, np.eye(3), np.array((strip, length, 2 * radius)))


def _star_arc(p: Parameters, scale: float) -> Iterator[Solid]:
    """A quarter circle from E over R_k, and a stop at its end."""
    x = np.eye(3)[0]
    y, z = _outside(p) * np.eye(3)[1:]  # where R_k lies: at negative y when v is right-handed
    depth = _RAIL[0] * scale
    width = _RAIL[1] * scale
    yield Arc(np.stack([x, y, z], axis=-1), p.star_radius, np.pi / 2, (depth, width))
    size = np.array((0.3 * depth, 1.5 * depth, 1.5 * width))
    yield Box(p.star_radius * y, np.stack([x, y, z], axis=-1), size)


def _tool(p: Parameters, scale: float) -> Iterator[Solid]:
    """The hub in which the arcs meet, and a tip along s."""
    x = np.eye(3)[0]
    for low, high, radius, end_radius in (
        (-0.013, 0.013, 0.028, 0.028),
        (0.013, 0.022, 0.016, 0.016),
        (0.022, 0.045, 0.009, 0.009),
        (0.045, 0.075, 0.009, 0.001),
    ):
        start = (p.star_radius + low * scale) * x
        end = (p.star_radius + high * scale) * x
        yield Cylinder(start, end, radius * scale, end_radius * scale)

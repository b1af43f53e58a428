# SPDX-License-Identifier: BSD-2-Clause
"""Contacts of an MJCF: spheres and corners of boxes against planes, and ropes."""

from collections import Counter
from collections.abc import Iterator
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..model.contacts import Contact, Rope
from ..summaries import listed
from .mjcf_compiled import Compiled, pose_of
from .mjcf_tree import MjcfTree

#: Spheres up to this radius are points, [m]: MuJoCo has no points.
_POINT = 1e-8
#: Places that differ by less are the same, [m].
_SAME = 1e-9


def contacts_of(compiled: Compiled, tree: MjcfTree) -> Iterator[Contact]:
    """Contacts of spheres and of the corners of boxes with planes.

    Their frames are added to the tree. A note names the pairs of shapes that are left out.
    """
    mj = compiled.mj
    geoms = compiled.mujoco.mjtGeom
    plane = int(geoms.mjGEOM_PLANE)
    sphere = int(geoms.mjGEOM_SPHERE)
    box = int(geoms.mjGEOM_BOX)
    left_out = Counter[str]()
    for pair in _pairs(compiled, tree):
        ground = pair.first
        shape = pair.second
        if mj.geom_type[ground] != plane:
            ground = pair.second
            shape = pair.first
        kind = mj.geom_type[shape]
        if mj.geom_type[ground] != plane or kind not in (sphere, box):
            kinds = [_geom_kind(compiled, geom) for geom in (pair.first, pair.second)]
            left_out[" on ".join(sorted(kinds))] += 1
            continue
        ground_frame = _frame(compiled, tree, ground, np.zeros(3), "")
        name = compiled.name("geom", shape)
        if kind == sphere:
            radius = float(mj.geom_size[shape, 0])
            if radius <= _POINT:
                radius = 0.0
            frame = _frame(compiled, tree, shape, np.zeros(3), name)
            yield Contact(frame, radius=radius, ground=ground_frame, friction=pair.friction)
            continue
        for k, signs in enumerate(product((-1, 1), repeat=3)):
            corner = mj.geom_size[shape] * signs
            frame = _frame(compiled, tree, shape, corner, f"{name}_corner_{k}")
            yield Contact(frame, ground=ground_frame, friction=pair.friction)
    if left_out:
        pairs = listed([f"{count} of {kinds}" for kinds, count in left_out.items()])
        compiled.notes.append(f"contacts are left out: {pairs}; spheres and boxes on planes act")


def _geom_kind(compiled: Compiled, geom: int) -> str:
    """The kind of a shape in words, such as "capsule"."""
    kind = compiled.mujoco.mjtGeom(int(compiled.mj.geom_type[geom]))
    return str(kind.name.removeprefix("mjGEOM_").lower())


def ropes_of(compiled: Compiled) -> Iterator[Rope]:
    """Ropes: spatial tendons between two sites with a largest length, without other forces."""
    mj = compiled.mj
    for tendon in range(mj.ntendon):
        sites = [mj.wrap_objid[k] for k in compiled.wraps(tendon)]
        is_rope = (
            mj.tendon_limited[tendon]
            and mj.tendon_range[tendon, 0] <= 0  # no least length
            and not mj.tendon_stiffness[tendon]
            and not mj.tendon_damping[tendon]
            and not mj.tendon_frictionloss[tendon]
            and len(sites) == 2
            and compiled.is_spatial(tendon)
        )
        if is_rope:
            frame_a = compiled.name("site", sites[0])
            frame_b = compiled.name("site", sites[1])
            length = float(mj.tendon_range[tendon, 1])
            yield Rope(frame_a, frame_b, length, name=compiled.name("tendon", tendon))


def contact_note(compiled: Compiled, tree: MjcfTree) -> str:
    """Where contacts are not read: a note if shapes of the robot can touch something, else ""."""
    mj = compiled.mj
    if compiled.disabled("contact"):
        return ""
    moving = np.array([tree.bodies[body][0] > 0 for body in mj.geom_bodyid], dtype=bool)
    can_touch = (mj.geom_contype | mj.geom_conaffinity)[moving].any()
    special = list[str]()
    # Not every MuJoCo has these fields.
    if np.any(getattr(mj, "geom_adhesion", 0)) or np.any(getattr(mj, "pair_adhesion", 0)):
        special.append("adhesion")
    if np.any(getattr(mj, "geom_surfacevel", 0)):
        special.append("surfacevel")
    if special:
        return f"contacts are not computed, nor {listed(special)}"
    if can_touch or mj.npair:
        return "contacts are not computed"
    return ""


class _Pair(NamedTuple):
    """Two shapes that can touch, by index, and their coefficient of friction."""

    first: int
    second: int
    friction: float


def _pairs(compiled: Compiled, tree: MjcfTree) -> Iterator[_Pair]:
    """Pairs of shapes on different bodies that can touch: listed ones, then by their masks."""
    mj = compiled.mj
    joints = [tree.bodies[body][0] for body in mj.geom_bodyid]
    for k in range(mj.npair):
        a = int(mj.pair_geom1[k])
        b = int(mj.pair_geom2[k])
        if joints[a] != joints[b]:
            yield _Pair(a, b, _friction(mj.pair_dim[k], mj.pair_friction[k, 0]))
    for a, b in combinations(range(mj.ngeom), 2):
        a_touches_b = mj.geom_contype[a] & mj.geom_conaffinity[b]
        b_touches_a = mj.geom_contype[b] & mj.geom_conaffinity[a]
        if (a_touches_b or b_touches_a) and joints[a] != joints[b]:
            dimension = max(mj.geom_condim[a], mj.geom_condim[b])
            larger = max(mj.geom_friction[a, 0], mj.geom_friction[b, 0])
            yield _Pair(a, b, _friction(dimension, larger))


def _friction(dimension: int, coefficient: float) -> float:
    """The coefficient of friction; contacts of dimension 1 have none."""
    return float(coefficient) if dimension > 1 else 0.0


def _frame(compiled: Compiled, tree: MjcfTree, geom: int, offset: np.ndarray, name: str) -> str:
    """Name of a frame at a point of a shape: one that exists, or a new one of this name.

    An empty name is for a plane: the z axis of its frame is the normal of the plane.
    """
    mj = compiled.mj
    model = tree.model
    joint, on_body = tree.bodies[mj.geom_bodyid[geom]]
    place = on_body * pose_of(mj.geom_pos[geom], mj.geom_quat[geom])
    place = place * pin.SE3(np.eye(3), offset)
    for frame in model.frames:
        if frame.parentJoint != joint:
            continue
        relative = frame.placement.actInv(place)
        same_point = np.abs(relative.translation).max() < _SAME
        same_normal = np.abs(relative.rotation[:, 2] - [0, 0, 1]).max() < _SAME
        if same_point and (name or same_normal):
            return str(frame.name)
    name = name or compiled.name("geom", geom)
    if model.existFrame(name):
        name = f"{name}_contact"
    model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    return name

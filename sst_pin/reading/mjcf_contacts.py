# SPDX-License-Identifier: BSD-2-Clause
"""Contacts of an MJCF: spheres and corners of boxes against planes, and ropes."""

from collections import Counter
from collections.abc import Iterator
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.contacts import Contact, Rope
from ..summaries import listed
from .mjcf_compiled import Compiled, pose_of
from .mjcf_tree import MjcfTree

#: Spheres up to this radius are points, [m]: MuJoCo has no points.
_POINT = 1e-8
#: Points that are closer are the same, [m]. Axes whose entries differ by less are the same.
_SAME = 1e-9


def add_contacts(compiled: Compiled, tree: MjcfTree) -> list[Contact]:
    """Contacts of spheres and of the corners of boxes with planes; adds their frames to the tree.

    A note names the pairs of shapes that are left out.
    """
    mj = compiled.mj
    sphere = int(compiled.mujoco.mjtGeom.mjGEOM_SPHERE)
    box = int(compiled.mujoco.mjtGeom.mjGEOM_BOX)
    contacts = list[Contact]()
    left_out = Counter[str]()  # how often each pair of kinds is left out
    for pair in _pairs(compiled, tree):
        ground, shape = _ground_first(compiled, pair)
        kind = mj.geom_type[shape]
        if not _is_plane(compiled, ground) or kind not in (sphere, box):
            kinds = [_geom_kind(compiled, geom) for geom in (pair.first, pair.second)]
            left_out[" on ".join(sorted(kinds))] += 1
            continue
        ground_frame = _ground_frame(compiled, tree, ground)
        name = compiled.name("geom", shape)
        if kind == sphere:
            radius = float(mj.geom_size[shape, 0])
            if radius <= _POINT:
                radius = 0.0
            frame = _frame_at_point(compiled, tree, shape, np.zeros(3), name)
            contact = Contact(frame, radius=radius, ground=ground_frame, friction=pair.friction)
            contacts.append(contact)
        else:
            for k, signs in enumerate(product((-1, 1), repeat=3)):
                corner = mj.geom_size[shape] * signs
                frame = _frame_at_point(compiled, tree, shape, corner, f"{name}_corner_{k}")
                contacts.append(Contact(frame, ground=ground_frame, friction=pair.friction))
    if left_out:
        pairs = listed([f"{count} of {kinds}" for kinds, count in left_out.items()])
        compiled.notes.append(f"contacts are left out: {pairs}; spheres and boxes on planes act")
    return contacts


class _Pair(NamedTuple):
    """Two shapes that can touch, by index, and their coefficient of friction."""

    first: int
    second: int
    friction: float


def _pairs(compiled: Compiled, tree: MjcfTree) -> Iterator[_Pair]:
    """Pairs of shapes on different joints that can touch, each once, as MuJoCo chooses them.

    First come the pairs that the file lists, then the pairs of shapes whose masks `contype` and
    `conaffinity` match. MuJoCo leaves out matching shapes if `_never_touch` holds for their bodies.
    """
    mj = compiled.mj
    joints = [tree.bodies[body].joint for body in mj.geom_bodyid]
    listed_pairs = set[frozenset[int]]()
    for k in range(mj.npair):
        a = int(mj.pair_geom1[k])
        b = int(mj.pair_geom2[k])
        listed_pairs.add(frozenset((a, b)))
        if joints[a] != joints[b]:
            yield _Pair(a, b, _friction(mj.pair_dim[k], mj.pair_friction[k, 0]))
    for a, b in combinations(range(mj.ngeom), 2):
        a_touches_b = mj.geom_contype[a] & mj.geom_conaffinity[b]
        b_touches_a = mj.geom_contype[b] & mj.geom_conaffinity[a]
        if not (a_touches_b or b_touches_a) or frozenset((a, b)) in listed_pairs:
            continue
        if _never_touch(compiled, int(mj.geom_bodyid[a]), int(mj.geom_bodyid[b])):
            continue
        if joints[a] != joints[b]:
            # The shape of higher priority decides; of two with the same priority, the larger value.
            priority = max(mj.geom_priority[a], mj.geom_priority[b])
            deciding = [geom for geom in (a, b) if mj.geom_priority[geom] == priority]
            dimension = max(mj.geom_condim[geom] for geom in deciding)
            coefficient = max(mj.geom_friction[geom, 0] for geom in deciding)
            yield _Pair(a, b, _friction(dimension, coefficient))


def _never_touch(compiled: Compiled, a: int, b: int) -> bool:
    """Whether MuJoCo computes no contacts of two bodies.

    The file may exclude the two bodies. A body does not touch its parent either, unless the file
    switches this filter off; bodies that are fixed to each other count as one body here. The world
    touches the bodies whose parent it is.
    """
    mj = compiled.mj
    # A pair that the file excludes is one number: the lower index in the upper 16 bits, the other
    # index in the lower ones.
    if (min(a, b) << 16) + max(a, b) in mj.exclude_signature:
        return True
    if mj.opt.disableflags & int(compiled.mujoco.mjtDisableBit.mjDSBL_FILTERPARENT):
        return False
    # `body_weldid` is the first of the bodies that are fixed to each other; 0 is the world.
    a_fixed_to = int(mj.body_weldid[a])
    b_fixed_to = int(mj.body_weldid[b])
    if a_fixed_to == 0 or b_fixed_to == 0:
        return False
    parent_of_a = mj.body_weldid[mj.body_parentid[a_fixed_to]]
    parent_of_b = mj.body_weldid[mj.body_parentid[b_fixed_to]]
    return bool(parent_of_a == b_fixed_to or parent_of_b == a_fixed_to)


def _friction(dimension: int, coefficient: float) -> float:
    """The coefficient of friction; contacts of dimension 1 (`condim`) have none."""
    return float(coefficient) if dimension > 1 else 0.0


def _is_plane(compiled: Compiled, geom: int) -> bool:
    """Whether a shape is a plane."""
    return bool(compiled.mj.geom_type[geom] == int(compiled.mujoco.mjtGeom.mjGEOM_PLANE))


def _ground_first(compiled: Compiled, pair: _Pair) -> tuple[int, int]:
    """The two shapes of a pair; the plane is the first if one of them is a plane.

    Without a plane the order does not matter: `add_contacts` leaves out the pair.
    """
    if _is_plane(compiled, pair.first):
        return pair.first, pair.second
    return pair.second, pair.first


def _geom_kind(compiled: Compiled, geom: int) -> str:
    """The kind of a shape in words, such as "capsule"."""
    kind = compiled.mujoco.mjtGeom(int(compiled.mj.geom_type[geom]))
    return str(kind.name.removeprefix("mjGEOM_").lower())


def _ground_frame(compiled: Compiled, tree: MjcfTree, plane: int) -> str:
    """Name of a frame on a plane, whose z axis is the normal; adds one to the tree if need be."""
    joint, place = _placement(compiled, tree, plane)
    for frame in tree.model.frames:
        if frame.parentJoint == joint:
            relative = frame.placement.actInv(place)  # of the plane, in the frame
            has_same_z = np.abs(relative.rotation[:, 2] - [0, 0, 1]).max() < _SAME
            if _is_at_origin(relative) and has_same_z:
                return str(frame.name)
    return _add_frame(tree.model, compiled.name("geom", plane), joint, place)


def _frame_at_point(compiled: Compiled, tree: MjcfTree, geom: int, point: Array, name: str) -> str:
    """Name of a frame at a point of a shape, in the shape's frame, shape (3,), [m].

    If there is none, a frame with the name `name` is added to the tree.
    """
    joint, place = _placement(compiled, tree, geom)
    place = place * pin.SE3(np.eye(3), point)
    for frame in tree.model.frames:
        if frame.parentJoint == joint and _is_at_origin(frame.placement.actInv(place)):
            return str(frame.name)
    return _add_frame(tree.model, name, joint, place)


def _placement(compiled: Compiled, tree: MjcfTree, geom: int) -> tuple[int, pin.SE3]:
    """The joint that moves a shape, and the shape's placement on this joint."""
    mj = compiled.mj
    joint, body_on_joint = tree.bodies[mj.geom_bodyid[geom]]
    return joint, body_on_joint * pose_of(mj.geom_pos[geom], mj.geom_quat[geom])


def _is_at_origin(relative: pin.SE3) -> bool:
    """Whether two frames with this relative placement have the same origin."""
    return bool(np.abs(relative.translation).max() < _SAME)


def _add_frame(model: pin.Model, name: str, joint: int, place: pin.SE3) -> str:
    """Add a frame to a joint; returns its name, which is another one if this name is used."""
    while model.existFrame(name):
        name = f"{name}_contact"
    model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    return name


def ropes_of(compiled: Compiled) -> Iterator[Rope]:
    """Ropes: spatial tendons between two sites with a largest length, without other forces."""
    mj = compiled.mj
    for tendon in range(mj.ntendon):
        # For a fixed tendon these would be joints, but it is no rope, as `is_spatial` says below.
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
    """The note on a robot that is read without its contacts; "" if it has none."""
    mj = compiled.mj
    if compiled.disabled("contact"):
        return ""
    moving = np.array([tree.bodies[body].joint > 0 for body in mj.geom_bodyid], dtype=bool)
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

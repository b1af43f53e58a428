# SPDX-License-Identifier: BSD-2-Clause
"""Contacts of an MJCF: spheres and corners of boxes against planes, and ropes."""

from collections import Counter
from collections.abc import Iterator
from itertools import combinations, product

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


def contacts_of(compiled: Compiled, tree: MjcfTree) -> Iterator[Contact | Rope]:
    """Contacts and ropes; a note names the pairs of shapes that are left out."""
    mj = compiled.mj
    geoms = compiled.mujoco.mjtGeom
    left_out = Counter[str]()
    plane, sphere, box = (int(getattr(geoms, f"mjGEOM_{x}")) for x in ("PLANE", "SPHERE", "BOX"))
    for a, b, friction in _pairs(compiled, tree):
        ground, shape = (a, b) if mj.geom_type[a] == plane else (b, a)
        kind = mj.geom_type[shape]
        if mj.geom_type[ground] != plane or kind not in (sphere, box):
            kinds = [geoms(int(mj.geom_type[x])).name[7:].lower() for x in (a, b)]
            left_out[" on ".join(sorted(kinds))] += 1
            continue
        on = _frame(compiled, tree, ground, np.zeros(3), "")
        name = compiled.name("geom", shape)
        if kind == sphere:
            radius = float(mj.geom_size[shape, 0])
            size = radius if radius > _POINT else 0.0
            at = _frame(compiled, tree, shape, np.zeros(3), name)
            yield Contact(at, radius=size, ground=on, friction=friction)
            continue
        for k, signs in enumerate(product((-1, 1), repeat=3)):
            corner = mj.geom_size[shape] * signs
            at = _frame(compiled, tree, shape, corner, f"{name}_corner_{k}")
            yield Contact(at, ground=on, friction=friction)
    if left_out:
        pairs = listed([f"{count} of {kinds}" for kinds, count in left_out.items()])
        compiled.notes.append(f"contacts are left out: {pairs}; spheres and boxes on planes act")
    for tendon in range(mj.ntendon):
        wraps = [mj.wrap_objid[k] for k in compiled.wraps(tendon)]
        numbers_of = (mj.tendon_stiffness[tendon], mj.tendon_damping[tendon])
        is_rope = mj.tendon_limited[tendon] and not any(numbers_of) and len(wraps) == 2
        if is_rope and compiled.is_spatial(tendon) and mj.tendon_range[tendon, 0] <= 0:
            first, second = (compiled.name("site", site) for site in wraps)
            name = compiled.name("tendon", tendon)
            compiled.notes = [x for x in compiled.notes if not x.startswith(f"tendon {name}: its")]
            yield Rope(first, second, float(mj.tendon_range[tendon, 1]), name=name)


def _pairs(compiled: Compiled, tree: MjcfTree) -> Iterator[tuple[int, int, float]]:
    """Pairs of shapes on different bodies that can touch, and their friction."""
    mj = compiled.mj
    joints = [tree.bodies[body][0] for body in mj.geom_bodyid]
    for k in range(mj.npair):
        a, b = int(mj.pair_geom1[k]), int(mj.pair_geom2[k])
        if joints[a] != joints[b]:
            yield a, b, float(mj.pair_friction[k, 0]) * bool(mj.pair_dim[k] > 1)
    for a, b in combinations(range(mj.ngeom), 2):
        touch = mj.geom_contype[a] & mj.geom_conaffinity[b]
        touch = touch or mj.geom_contype[b] & mj.geom_conaffinity[a]
        if touch and joints[a] != joints[b]:
            dimension = max(mj.geom_condim[a], mj.geom_condim[b])
            friction = max(mj.geom_friction[a, 0], mj.geom_friction[b, 0])
            yield a, b, float(friction) * bool(dimension > 1)


def _frame(compiled: Compiled, tree: MjcfTree, geom: int, offset: np.ndarray, name: str) -> str:
    """A frame at a point of a shape: one that is there already, or a new one of this name.

    Without a name it is that of a plane, whose axes count.
    """
    mj = compiled.mj
    model = tree.model
    joint, on_body = tree.bodies[mj.geom_bodyid[geom]]
    place = on_body * pose_of(mj.geom_pos[geom], mj.geom_quat[geom])
    place = place * pin.SE3(np.eye(3), offset)
    for frame in model.frames:
        apart = frame.placement.actInv(place)
        same = frame.parentJoint == joint and np.abs(apart.translation).max() < _SAME
        if same and (name or np.abs(apart.rotation[:, 2] - [0, 0, 1]).max() < _SAME):
            return str(frame.name)
    name = name or compiled.name("geom", geom)
    if model.existFrame(name):
        name = f"{name}_contact"
    model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    return name

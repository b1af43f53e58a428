# SPDX-License-Identifier: BSD-2-Clause
"""A Pinocchio tree as single joints whose unit twists are constant in the frame of their child."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import DescriptionError

Array = NDArray[np.float64]

#: Kinds by how the joint's placement follows from its coordinates.
_KINDS = {
    "Planar": "planar",
    "Spherical": "ball",
    "FreeFlyer": "free",
    "Translation": "slides",
    **dict.fromkeys(("RX", "RY", "RZ", "RevoluteUnaligned"), "turn"),
    **dict.fromkeys(("RUBX", "RUBY", "RUBZ", "RevoluteUnboundedUnaligned"), "unbounded"),
    **dict.fromkeys(("PX", "PY", "PZ", "PrismaticUnaligned"), "slide"),
    **dict.fromkeys(("HX", "HY", "HZ", "HelicalUnaligned"), "screw"),
}


@dataclass
class Link:
    """A joint and the body behind it.

    Attributes:
        parent: Index of the parent in `Tree.links`; the base is 0.
        R: Orientation of the joint's frame at rest in the parent's frame, shape (3, 3).
        p: Its origin, shape (3,), [m].
        kind: How its placement follows from q: one of the values of `_KINDS`.
        q: Indices of its coordinates.
        v: Indices of its rates.
        S: Unit twists [linear; angular] of its rates in the child's frame, shape (6, nv).
        body: Index of Pinocchio's joint whose inertia it carries, 0 for none.
    """

    parent: int
    R: Array
    p: Array
    kind: str
    q: range
    v: range
    S: Array
    body: int = 0


@dataclass
class Tree:
    """All links, parents first; link 0 is the base.

    Attributes:
        links: Of the tree.
        link_of: Index in `links` for each of Pinocchio's joints.
    """

    links: list[Link] = field(default_factory=list)
    link_of: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, model: pin.Model) -> Tree:
        """The tree of a Pinocchio model.

        Raises:
            DescriptionError: For a joint without compiled equations.
        """
        base = Link(0, np.eye(3), np.zeros(3), "fixed", range(0), range(0), np.zeros((6, 0)))
        tree = cls([base], [0])
        for i in range(1, model.njoints):
            parent, body = tree.link_of[model.parents[i]], 0
            placement = model.jointPlacements[i]
            for inner, joint in _simple_joints(model.joints[i].extract(), model.names[i]):
                placement = placement * inner
                link = _link(parent, placement, joint, model.names[i])
                placement = pin.SE3.Identity()
                tree.links.append(link)
                parent = len(tree.links) - 1
                body = i
            tree.links[-1].body = body
            tree.link_of.append(parent)
        return tree

    def ancestors(self, link: int) -> list[int]:
        """From the base to a link, both included."""
        path = [link]
        while path[-1]:
            path.append(self.links[path[-1]].parent)
        return path[::-1]


def _simple_joints(joint: pin.JointModel, name: str) -> Iterator[tuple[pin.SE3, pin.JointModel]]:
    """Parts of a joint, each with its placement in the part before."""
    kind, identity = joint.shortname(), pin.SE3.Identity()
    if kind == "JointModelComposite":
        for placement, part in zip(joint.jointPlacements, joint.joints, strict=True):
            parts = list(_simple_joints(part.extract(), name))
            yield placement * parts[0][0], parts[0][1]
            yield from parts[1:]
    elif kind in ("JointModelUniversal", "JointModelSphericalZYX"):
        if kind == "JointModelUniversal":
            axes = [np.ravel(joint.axis1), np.ravel(joint.axis2)]
        else:
            axes = [*np.eye(3)[::-1]]
        for k, axis in enumerate(axes):
            simple = pin.JointModelRevoluteUnaligned(axis)
            simple.setIndexes(joint.id, joint.idx_q + k, joint.idx_v + k)
            yield identity, simple
    else:
        yield identity, joint


def _link(parent: int, placement: pin.SE3, joint: pin.JointModel, name: str) -> Link:
    kind = _KINDS.get(joint.shortname().removeprefix("JointModel"))
    if kind is None:
        problem = f"joint {name}: {joint.shortname()} has no compiled equations"
        raise DescriptionError("compiled kernels", [problem])
    data = joint.createData()
    joint.calc(data, np.concatenate([np.zeros(joint.idx_q), _neutral(kind)]))
    S = np.asarray(data.S if isinstance(data.S, np.ndarray) else data.S.matrix())
    return Link(
        parent,
        clean(placement.rotation),
        clean(placement.translation),
        kind,
        range(joint.idx_q, joint.idx_q + joint.nq),
        range(joint.idx_v, joint.idx_v + joint.nv),
        clean(S.reshape(6, joint.nv)),
    )


def _neutral(kind: str) -> list[float]:
    return {
        "planar": [0.0, 0.0, 1.0, 0.0],
        "ball": [0.0, 0.0, 0.0, 1.0],
        "free": [0.0] * 6 + [1.0],
        "slides": [0.0] * 3,
        "unbounded": [1.0, 0.0],
    }.get(kind, [0.0])


def clean(a: Array) -> Array:
    """Numbers that are 0, 1 or -1 but for rounding made so: what they multiply falls away."""
    a = np.array(a, dtype=float)
    for whole in (-1.0, 0.0, 1.0):
        a[np.abs(a - whole) < 4e-16] = whole
    return a

# SPDX-License-Identifier: BSD-2-Clause
"""A Pinocchio tree as single joints whose twists are constant in the frame of their child."""

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError
from ..model.normal_tree import series_of

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
#: Coordinates at rest, unless they are a single zero.
_NEUTRAL = {
    "planar": [0.0, 0.0, 1.0, 0.0],
    "ball": [0.0, 0.0, 0.0, 1.0],
    "free": [0.0] * 6 + [1.0],
    "slides": [0.0] * 3,
    "unbounded": [1.0, 0.0],
}


@dataclass
class Link:
    """A joint and the body behind it."""

    #: Index of the parent in `LinkTree.links`; the base is 0.
    parent: int
    #: Orientation of the joint's frame at rest in the parent's frame, and its origin, [m].
    R: Array
    p: Array
    #: How its placement follows from q: one of the values of `_KINDS`.
    kind: str
    #: Indices of its coordinates and of its rates; of a mimic joint those of the one it follows.
    q: range
    v: range
    #: Twists [linear; angular] of its rates in the child's frame, shape (6, nv); unit ones, but for
    #: a mimic joint.
    S: Array
    #: Index of Pinocchio's joint whose inertia it carries, 0 for none.
    body: int = 0


@dataclass
class LinkTree:
    """All links, parents first, link 0 the base; `link_of` gives that of each Pinocchio joint."""

    links: list[Link] = field(default_factory=list)
    link_of: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, model: pin.Model) -> "LinkTree":
        """The tree of a Pinocchio model; a joint without compiled equations is refused."""
        base = Link(0, np.eye(3), np.zeros(3), "fixed", range(0), range(0), np.zeros((6, 0)))
        tree = cls([base], [0])
        for i in range(1, model.njoints):
            parent = tree.link_of[model.parents[i]]
            body = 0
            placement = model.jointPlacements[i]
            q = model.joints[i].idx_q
            v = model.joints[i].idx_v
            for joint, inner in series_of(model.joints[i]):
                link = _link(parent, placement * inner, joint, q, v)
                if link is None:
                    problem = f"joint {model.names[i]}: {joint.shortname()} has no equations here"
                    raise DescriptionError("compiled kernels", [problem])
                placement = pin.SE3.Identity()
                tree.links.append(link)
                parent = len(tree.links) - 1
                body = i
                q = q + joint.nq
                v = v + joint.nv
            tree.links[-1].body = body
            tree.link_of.append(parent)
        return tree

    def ancestors(self, link: int) -> list[int]:
        """From the base to a link, both included."""
        path = [link]
        while path[-1]:
            path.append(self.links[path[-1]].parent)
        return path[::-1]


def _link(parent: int, placement: pin.SE3, joint: pin.JointModel, q: int, v: int) -> Link | None:
    """A joint of one axis or of fixed axes; None for one without compiled equations."""
    short = joint.shortname().removeprefix("JointModel")
    kind = _KINDS.get(short, "")
    data = joint.createData()
    at_rest = _NEUTRAL.get(kind, [0.0])
    joint.calc(data, np.concatenate([np.zeros(max(joint.idx_q, 0)), at_rest]))
    S = np.asarray(data.S if isinstance(data.S, np.ndarray) else data.S.matrix()).reshape(6, -1)
    if short == "Mimic":  # its twist is scaled; it rests where the other joint is zero
        kind = "turn" if S[3:].any() else "slide"
        placement = placement * data.M
    if not kind:
        return None
    return Link(
        parent,
        clean(placement.rotation),
        clean(placement.translation),
        kind,
        range(q, q + (joint.nq or 1)),
        range(v, v + S.shape[1]),
        clean(S),
    )


def clean(a: Array) -> Array:
    """Round numbers near 0, 1 and -1 to them, so that products need no operation."""
    a = np.array(a, dtype=float)
    for whole in (-1.0, 0.0, 1.0):
        a[np.abs(a - whole) < 4e-16] = whole
    return a

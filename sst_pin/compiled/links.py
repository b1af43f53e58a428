# SPDX-License-Identifier: BSD-2-Clause
"""A Pinocchio tree as links, for which equations are written.

A link is a body together with the joint before it, the joint that connects it to its parent. The
twists of this joint are constant in the frame of the link. A joint with moving axes, such as a
universal joint or a composite, becomes several links in series. The last of them carries the body,
the others have no mass.
"""

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError
from ..model.normal_tree import series_of

#: The kind of a link, by the name of Pinocchio's joint. The kind determines how the placement of
#: the link follows from its coordinates. "turn" is a revolute joint, "slide" a prismatic one,
#: "slides" are three prismatic ones. "unbounded" is a revolute joint whose coordinates are the
#: cosine and the sine of the angle.
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
#: Neutral coordinates of a kind, as in `pin.neutral`; a single zero for other kinds.
_NEUTRAL = {
    "planar": [0.0, 0.0, 1.0, 0.0],
    "ball": [0.0, 0.0, 0.0, 1.0],
    "free": [0.0] * 6 + [1.0],
    "slides": [0.0] * 3,
    "unbounded": [1.0, 0.0],
}


@dataclass
class Link:
    """A body and the joint before it."""

    #: Index of the parent in `LinkTree.links`; the base is 0.
    parent: int
    #: Orientation of the joint's frame at neutral coordinates, in the parent's frame.
    R: Array
    #: Origin of the joint's frame at neutral coordinates, in the parent's frame, [m].
    p: Array
    #: One of the values of `_KINDS`; "fixed" for the base.
    kind: str
    #: Indices of the joint's coordinates. A mimic joint has those of the joint that it follows.
    q: range
    #: Indices of the joint's rates, likewise.
    v: range
    #: Twists [linear; angular] of the link in its parent at a unit of each rate, in the frame of
    #: the link, shape (6, rates). They are unit twists, except those of a mimic joint.
    S: Array
    #: Index of Pinocchio's joint whose inertia the link carries, 0 for none.
    body: int = 0


@dataclass
class LinkTree:
    """The links of a model."""

    #: All links, parents first; link 0 is the base.
    links: list[Link] = field(default_factory=list)
    #: For each joint of Pinocchio the index of the link that carries its body; 0 for the universe.
    link_of: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, model: pin.Model) -> "LinkTree":
        """The tree of a Pinocchio model; a joint without compiled equations is refused."""
        base = Link(
            parent=0,
            R=np.eye(3),
            p=np.zeros(3),
            kind="fixed",
            q=range(0),
            v=range(0),
            S=np.zeros((6, 0)),
        )
        tree = cls([base], [0])
        for i in range(1, model.njoints):
            parent = tree.link_of[model.parents[i]]
            placement = model.jointPlacements[i]
            q = model.joints[i].idx_q
            v = model.joints[i].idx_v
            for joint, inner in series_of(model.joints[i]):
                link = _link(parent, placement * inner, joint, q, v)
                if link is None:
                    problem = f"joint {model.names[i]}: {joint.shortname()} has no equations here"
                    raise DescriptionError("compiled kernels", [problem])
                parent = len(tree.links)
                tree.links.append(link)
                placement = pin.SE3.Identity()
                q = q + joint.nq
                v = v + joint.nv
            tree.links[parent].body = i  # it is fixed to the last link of the series
            tree.link_of.append(parent)
        return tree

    def ancestors(self, link: int) -> list[int]:
        """Indices of the links from the base to a link, both included."""
        path = [link]
        while path[-1]:
            path.append(self.links[path[-1]].parent)
        return path[::-1]


def _link(parent: int, placement: pin.SE3, joint: pin.JointModel, q: int, v: int) -> Link | None:
    """The link of a joint with fixed axes; None if the joint has no compiled equations.

    Args:
        parent: Index of the parent.
        placement: Placement of the joint's frame in the parent's frame.
        joint: The joint.
        q: Index of its first coordinate in the model's q.
        v: Index of its first rate.
    """
    short = joint.shortname().removeprefix("JointModel")
    kind = _KINDS.get(short, "")

    # The twists S are constant, so Pinocchio evaluates the joint at neutral coordinates. In the
    # vector that it gets, the coordinates of the joint begin at `idx_q`; a joint of a series that
    # is in no model has idx_q = -1.
    data = joint.createData()
    neutral = _NEUTRAL.get(kind, [0.0])
    joint.calc(data, np.concatenate([np.zeros(max(joint.idx_q, 0)), neutral]))
    S = np.asarray(data.S if isinstance(data.S, np.ndarray) else data.S.matrix()).reshape(6, -1)

    if short == "Mimic":
        # q = factor times q of the other joint + offset. S has the factor; the placement gets the
        # offset, so that the link has the other joint's coordinate and rate.
        kind = "turn" if S[3:].any() else "slide"
        placement = placement * data.M
    if not kind:
        return None
    return Link(
        parent=parent,
        R=clean(placement.rotation),
        p=clean(placement.translation),
        kind=kind,
        # A mimic joint has nq = 0. It reads one coordinate, that of the joint that it follows.
        q=range(q, q + (joint.nq or 1)),
        v=range(v, v + S.shape[1]),
        S=clean(S),
    )


def clean(a: Array) -> Array:
    """Round numbers near 0, 1 and -1 to these, so that products with them need no operation.

    The threshold is two roundings of 1. Numbers of placements that should be 0, 1 or -1 differ from
    these by no more.
    """
    a = np.array(a, dtype=float)
    for whole in (-1.0, 0.0, 1.0):
        a[np.abs(a - whole) < 4e-16] = whole
    return a

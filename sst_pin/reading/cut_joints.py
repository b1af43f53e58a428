# SPDX-License-Identifier: BSD-2-Clause
"""A joint that closes a loop, by its two sides, and the closure that it becomes."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError
from ..model.closures import Closure

#: Kind of the closure for each type of joint.
_KINDS = {
    "fixed": "6d",
    "spherical": "3d",
    "spherical_joint": "3d",
    "ball": "3d",
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "prismatic",
    "universal": "universal",
    "cylindrical": "cylindrical",
    "planar": "planar",
}


class Side(NamedTuple):
    """One of the two sides of a joint, as a file describes it.

    Placement and axis are those in the neutral configuration, q = 0.
    """

    #: The link that the joint connects; "universe" is the base.
    link: str
    #: The link relative to which the file has the placement; often it is `link` itself.
    relative_to: str
    #: The pose of the joint's frame relative to the link `relative_to`.
    placement: pin.SE3
    #: The axis of the joint in the joint's frame, shape (3,); welds and balls do not use it.
    axis: Array


class CutJoint(NamedTuple):
    """A joint that closes a loop.

    The frames of its sides have the axes that a `Closure` of this kind needs; see `cut_joint`.
    """

    name: str
    #: A kind of `Closure`.
    kind: str
    side_a: Side
    side_b: Side

    def add_closure(self, model: pin.Model) -> Closure:
        """Add the frames NAME_A and NAME_B of the joint NAME to a tree; returns its closure."""
        data = model.createData()
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        self._add_frame(model, data, f"{self.name}_A", self.side_a)
        self._add_frame(model, data, f"{self.name}_B", self.side_b)
        return Closure(f"{self.name}_A", f"{self.name}_B", self.kind)

    def _add_frame(self, model: pin.Model, data: pin.Data, name: str, side: Side) -> None:
        """Add the frame of a side; `data` has the placements in the neutral configuration."""
        if model.existFrame(name):
            raise DescriptionError(self.name, [f"a frame {name} exists; rename this joint"])
        link_id = self._link_id(model, side.link)
        reference_id = self._link_id(model, side.relative_to)
        on_link = side.placement
        if reference_id != link_id:
            reference_on_link = data.oMf[link_id].actInv(data.oMf[reference_id])
            on_link = reference_on_link * on_link
        link = model.frames[link_id]
        on_joint = link.placement * on_link
        kind = pin.FrameType.OP_FRAME
        model.addFrame(pin.Frame(name, link.parentJoint, link_id, on_joint, kind))

    def _link_id(self, model: pin.Model, link: str) -> int:
        """Index of the frame of a link; the base has index 0."""
        if link == "universe":
            return 0
        link_id = model.getFrameId(link, pin.FrameType.BODY)
        if link_id == model.nframes:  # Pinocchio's answer for an unknown frame
            raise DescriptionError(self.name, [f"{self.name}: no link {link}"])
        return int(link_id)


def cut_joint(name: str, kind: str, side_a: Side, side_b: Side) -> CutJoint:
    """The joint that closes a loop, with frames as a `Closure` needs them.

    A closure has fixed axes in its frames: z, or x of the first and y of the second frame for a
    universal joint. So each frame is rotated until this axis is the axis of the joint.

    Args:
        name: The name of the joint.
        kind: Its type in a URDF, such as "revolute"; a key of `_KINDS`.
        side_a: The first side.
        side_b: The second side.

    Raises:
        ValueError: If the type is unknown, both links are the same, or the axes of a slide differ.
    """
    if kind not in _KINDS:
        raise ValueError(f"type {kind!r} unknown; known: {', '.join(_KINDS)}")
    if side_a.link == side_b.link:
        raise ValueError(f"connects {side_a.link} with itself")
    if kind == "prismatic" and not np.allclose(side_a.axis, side_b.axis):
        raise ValueError("the axes of a prismatic joint must be the same on both sides")
    x, y, z = np.eye(3)
    if kind == "universal":
        side_a = _with_axis(side_a, x)
        side_b = _with_axis(side_b, y)
    elif _KINDS[kind] not in ("6d", "3d"):  # welds and balls have no axis
        side_a = _with_axis(side_a, z)
        side_b = _with_axis(side_b, z)
    return CutJoint(name, _KINDS[kind], side_a, side_b)


def _with_axis(side: Side, axis: Array) -> Side:
    """The side with its frame rotated until the joint's axis has the direction `axis` in it."""
    rotation = pin.Quaternion.FromTwoVectors(axis, side.axis).matrix()
    placement = side.placement * pin.SE3(rotation, np.zeros(3))
    return side._replace(placement=placement, axis=axis)

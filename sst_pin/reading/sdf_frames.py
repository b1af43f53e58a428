# SPDX-License-Identifier: BSD-2-Clause
"""Poses of the frames of an SDF's model, and the links that the frames are fixed to.

Links, joints and `<frame>`s have frames. Each pose is relative to a reference frame, which the pose
can name. Otherwise a joint has the frame of its child as reference, a `<frame>` has the frame that
it is attached to, and a link has the frame of the model.
"""

import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin

from .joint_graph import WORLD
from .problems import is_true, numbers, placement

#: Name of the model's own frame.
MODEL = "__model__"


class SdfFrames:
    """The frames of a model.

    Args:
        model: The `<model>`.
        is_in_world: Whether the model is in a `<world>`.
        problems: The list to which problems are added.

    Attributes:
        elements: The elements with frames, by name.
    """

    def __init__(self, model: ET.Element, is_in_world: bool, problems: list[str]) -> None:
        self._model = model
        self._is_in_world = is_in_world
        self._problems = problems
        self._links = [link.get("name", "") for link in model.findall("link")]
        self.elements = dict[str, ET.Element]()
        for tag in ("link", "frame", "joint"):
            for element in model.findall(tag):
                self.elements[element.get("name", "")] = element
        # Poses in the frame of the model, by name. None marks a pose that is being computed.
        self._poses: dict[str, pin.SE3 | None] = {MODEL: pin.SE3.Identity()}
        # The pose of the model says where its placement frame is in the world.
        placement_in_model = self.pose_in_model(model.get("placement_frame") or MODEL)
        placement_in_world = self._pose_of_part(model, model)
        world_in_placement = placement_in_world.inverse()
        self._poses[WORLD] = placement_in_model * world_in_placement

    def pose_in_model(self, name: str) -> pin.SE3:
        """The pose of a frame in the frame of the model; a problem if there is none."""
        if name not in self._poses:
            element = self.elements.get(name)
            if element is None:
                self._problems.append(f"frame {name} is not in this model")
                self._poses[name] = pin.SE3.Identity()  # one problem is enough
                return pin.SE3.Identity()
            self._poses[name] = None  # the frames to which this pose is relative come first
            reference = _named_reference(element)
            if not reference and element.tag == "joint":
                reference = element.findtext("child", "").strip()
            elif not reference:
                reference = element.get("attached_to") or MODEL
            self._poses[name] = self.pose_in_model(reference) * self._pose(element)
        pose = self._poses[name]
        if pose is None:
            self._problems.append(f"frame {name}: its pose is relative to itself")
            return pin.SE3.Identity()
        return pose

    def relative_pose(self, reference: str, name: str) -> pin.SE3:
        """The pose of a frame relative to the frame `reference`."""
        return self.pose_in_model(reference).actInv(self.pose_in_model(name))

    def inertia_pose(self, inertial: ET.Element, link: ET.Element) -> pin.SE3:
        """The pose of an inertia on its link."""
        return self._pose_of_part(inertial, link)

    def shape_pose(self, link: str, shape: ET.Element) -> pin.SE3:
        """The pose of a shape on its link, by the link's name."""
        reference = _named_reference(shape)
        if not reference:
            return self._pose(shape)
        return self.relative_pose(link, reference) * self._pose(shape)

    def link_of(self, name: str) -> str:
        """The link, or the world, that a link, a joint or a frame is attached to; "" without one.

        A joint is attached to its child. A frame may be attached to another frame.
        """
        # The chain of frames goes through the model's own frame and each element at most once;
        # otherwise it is a circle.
        for _ in range(len(self.elements) + 2):
            if name == MODEL:
                first_link = self._links[0] if self._links else ""
                name = self._model.get("canonical_link") or first_link
            if name == WORLD or name in self._links:
                return name
            element = self.elements.get(name)
            if element is None:
                return ""
            if element.tag == "joint":
                name = element.findtext("child", "").strip()
            else:
                name = element.get("attached_to") or MODEL
        return ""

    def _pose_of_part(self, part: ET.Element, owner: ET.Element) -> pin.SE3:
        """The pose of the model or of an inertia.

        The pose of a model is relative to the world, the pose of an inertia to its link. If the
        pose names another frame, `owner`, the model or the link, has a problem.
        """
        reference = _named_reference(part)
        is_model_in_world = part is self._model and self._is_in_world and reference == WORLD
        if reference and not is_model_in_world:
            text = f"its <pose> of {part.tag} relative to {reference} is not supported"
            self._refuse(owner, text)
        return self._pose(part)

    def _pose(self, element: ET.Element) -> pin.SE3:
        """The pose that is written in an element, relative to its reference frame."""
        pose = element.find("pose")
        text = "" if pose is None else pose.text or ""
        has_quaternion = len(text.split()) == 7
        values = numbers(text or "0 0 0 0 0 0", 7 if has_quaternion else 6)
        if values is None:
            self._refuse(element, f"its pose {text!r} is not six or seven numbers")
            return pin.SE3.Identity()
        if has_quaternion:  # x y z w, as in Pinocchio
            return pin.SE3(pin.Quaternion(values[3:]).normalized().matrix(), values[:3])
        if pose is not None and is_true(pose.get("degrees")):
            values[3:] = np.deg2rad(values[3:])
        return placement(values[:3], values[3:])

    def _refuse(self, element: ET.Element, text: str) -> None:
        self._problems.append(f"{element.tag} {element.get('name')}: {text}")


def _named_reference(element: ET.Element) -> str:
    """Name of the frame to which the pose of an element is relative; empty if it names none."""
    pose = element.find("pose")
    if pose is None:
        return ""
    return pose.get("relative_to", "") or pose.get("frame", "")  # `frame` until version 1.6

# SPDX-License-Identifier: BSD-2-Clause
"""Bodies and joints of a robot in an MJCF.

The file has the bodies of the robot's normal tree (`model.normal_tree`), which has the same motions
as the robot. Universal joints, which MuJoCo does not have, are hinges in series there. In this
module a body is named by the index of its joint in the normal tree; body 0 is the base.
"""

from collections.abc import Collection, Sequence
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ..errors import DescriptionError
from ..model.mechanism import Mechanism
from ..model.normal_tree import NormalTree
from ..summaries import listed
from .mjcf_attributes import SINGLE, pose_attributes
from .mjcf_joint_attributes import has_velocity_limit, joint_attributes, joint_problems
from .mjcf_joints import MjcfJoint, joints_of, principal_axes
from .urdf_writer import numbers

_IDENTITY = pin.SE3.Identity()
#: The smallest mass and moment that MuJoCo compiles, [kg], [kg m^2].
_LEAST_MASS = 1e-12
_LEAST_INERTIA = 1e-14
#: A smaller relative violation of the triangle inequality of moments is rounding.
_ROUNDING = 1e-9
#: Types of frames that are points on a body, and the type of links.
POINTS = (pin.FrameType.OP_FRAME, pin.FrameType.SENSOR)
LINK = pin.FrameType.BODY


class MjcfBodies:
    """Writes the bodies of a robot into the `<worldbody>` of an MJCF.

    Attributes:
        joints: MuJoCo's joints, in its order.
        elements: The element of each body, the base first.
        base: The element that contains the bodies on the base: the body of the base, or the world.
        names: Names of the bodies, by index.
        problems: What MJCF cannot express.
        notes: What is left out or written with other numbers.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        tree: NormalTree,
        world: Element,
        end_frames: Collection[str],
        with_numbers: bool,
    ) -> None:
        """Write the bodies.

        Args:
            mechanism: The robot, with its own tree.
            tree: The normal tree of the robot.
            world: The `<worldbody>`.
            end_frames: Names of frames at the ends of closures, lines and ropes.
            with_numbers: Whether joints have friction, rotors, springs and limits.
        """
        self._mechanism = mechanism
        self._tree = tree
        self._model = tree.model
        self._end_frames = end_frames
        self._with_numbers = with_numbers
        self.problems = list[str]()
        self.notes = list[str]()
        self.joints = list[MjcfJoint]()
        self.names = _body_names(self._model)

        # The base is the world, or a body in it if the base has another name. MuJoCo allows free
        # bodies only directly in the world. If one of the bodies on the base is free, they are all
        # written there, and not in the body of the base, so that they keep their order.
        base = world
        if self.names[0] != "universe":
            base = SubElement(world, "body", name=self.names[0])
        on_base = self._model.children[0]
        has_free_body = any(_is_free_flyer(self._model.joints[joint]) for joint in on_base)
        self.base = world if has_free_body else base
        self.elements = [base] * self._model.njoints  # `_add_body` replaces all but the first
        for joint in on_base:
            self._add_body(joint, self.base)

        if with_numbers:
            self._note_velocity_limits()

    def _add_body(
        self,
        index: int,
        parent_body: Element,
        start: pin.SE3 = _IDENTITY,
        joints_before: Sequence[MjcfJoint] = (),
    ) -> Element:
        """Add a body, and all bodies after it; returns its element.

        In MuJoCo a body can have several joints. So an empty body between two joints is not
        written: the next body gets the joints of both.

        Args:
            index: Index of the body.
            parent_body: The element of the nearest body before it that is written.
            start: Placement, in `parent_body`, of the body directly before it. It is the identity
                unless empty bodies are between `parent_body` and this body.
            joints_before: Joints of these empty bodies, in the frame of the last of them.
        """
        on_parent = self._model.jointPlacements[index]
        joints = [joint.seen_from(on_parent) for joint in joints_before]
        try:
            joints += joints_of(self._mechanism.model, self._tree, index)
        except DescriptionError as error:  # all problems are collected, and reported at the end
            self.problems += error.problems
        placement = start * on_parent

        # Only hinges and slides can share a body.
        if self._is_empty(index) and all(joint.kind in SINGLE for joint in joints):
            (child,) = self._model.children[index]
            body = self._add_body(child, parent_body, placement, joints)
        else:
            attributes = {"name": self.names[index]} | pose_attributes(placement)
            body = SubElement(parent_body, "body", attributes)
            for joint in joints:
                self._add_joint(body, joint)
            self._add_inertia(body, index)
            self._add_weight_share(body, index)
            for child in self._model.children[index]:
                self._add_body(child, body)
        self.elements[index] = body
        return body

    def _is_empty(self, index: int) -> bool:
        """Whether a body does nothing but carry one other joint.

        Example: the body between the two axes of a universal joint.
        """
        model = self._model
        frames = [frame for frame in model.frames if frame.parentJoint == index]
        has_only_joint_frames = all(
            frame.type == pin.FrameType.JOINT and frame.name not in self._end_frames
            for frame in frames
        )
        is_massless = bool(model.inertias[index] == pin.Inertia.Zero())
        has_one_child = len(model.children[index]) == 1
        return has_only_joint_frames and is_massless and has_one_child

    def _add_joint(self, body: Element, joint: MjcfJoint) -> None:
        """Add a joint to its body."""
        self.joints.append(joint)
        attributes = {"name": joint.name, "type": joint.kind}
        if joint.kind in SINGLE:
            attributes["axis"] = numbers(joint.axis)
            if joint.point.any():
                attributes["pos"] = numbers(joint.point)
        # A mimic joint has the numbers of the joint that it follows.
        if self._with_numbers and not joint.mimics:
            attributes |= joint_attributes(self._mechanism, joint)
            self.problems += joint_problems(self._mechanism, joint)
        SubElement(body, "joint", attributes)

    def _note_velocity_limits(self) -> None:
        """Note the joints whose largest velocities are left out."""
        names = list[str]()
        for joint in self.joints:
            if not joint.mimics and has_velocity_limit(self._mechanism, joint):
                names.append(joint.name)
        if names:
            text = f"largest velocities of the joints {listed(names)} are left out"
            self.notes.append(f"{text}: MuJoCo has none")

    def _add_inertia(self, body: Element, index: int) -> None:
        """Add mass and inertia of a body, with MuJoCo's smallest values where they are smaller."""
        inertia = self._model.inertias[index]
        name = self.names[index]
        moments, R = principal_axes(inertia.inertia)
        if inertia.mass < _LEAST_MASS or moments.min() < _LEAST_INERTIA:
            text = f"at least {_LEAST_MASS:g} kg and {_LEAST_INERTIA:g} kg m^2"
            needs = "MuJoCo needs mass, and inertia about all axes"
            self.notes.append(f"body {name}: {needs}; each is written as {text}")
        largest = moments.argmax()
        moments = np.maximum(moments, _LEAST_INERTIA)
        sum_of_others = np.delete(moments, largest).sum()
        if moments[largest] > sum_of_others * (1 + _ROUNDING):
            text = f"one of the principal moments {moments.round(6)} exceeds the sum of the others"
            self.problems.append(f"body {name}: {text}, which no body has")
        # MuJoCo refuses even rounding beyond the triangle inequality.
        moments[largest] = min(moments[largest], sum_of_others)
        attributes = {"pos": numbers(inertia.lever), "diaginertia": numbers(moments)}
        attributes["mass"] = numbers([max(inertia.mass, _LEAST_MASS)])
        pose = pose_attributes(pin.SE3(R, inertia.lever))
        SubElement(body, "inertial", pose | attributes)

    def _add_weight_share(self, body: Element, index: int) -> None:
        """Write the share s of the weight that acts on a body, with its offset d, as `gravcomp`.

        `weight_shares` explains s and d: the weight is s m g, and its first moment about the mass
        centre c is m d. `gravcomp` is the share of the weight m g that MuJoCo compensates by an
        upward force at c: it is 1 - s if d = 0.

        A share above 1 would need a negative `gravcomp`, which MuJoCo ignores unless another body
        has a positive one, and an offset has no attribute. In both cases a second body is fixed to
        the first one. It has almost no mass, but a negative `gravcomp` that gives it the weight
        x m g, with x = max(1, s), at c + d / x. The `gravcomp` of the first body is then x + 1 - s.
        The sum of both weights is (1 - (x + 1 - s)) m g + x m g = s m g, and the first moment about
        c is x m d / x = m d.
        """
        weight_shares = self._mechanism.weight_shares
        if weight_shares is None or index not in self._tree.bodies:
            return
        number = self._tree.bodies.index(index) - 1  # the shares begin after the base
        inertia = self._model.inertias[index]
        share = float(weight_shares.shares[number])
        offset = weight_shares.offsets[number]
        gravcomp = 1 - share
        if inertia.mass and (share > 1 or offset.any()):
            added_share = max(1.0, share)
            gravcomp += added_share
            at = inertia.lever + offset / added_share
            gravcomp_of_second = -added_share * inertia.mass / _LEAST_MASS
            second_body = SubElement(body, "body", gravcomp=numbers([gravcomp_of_second]))
            attributes = {"pos": numbers(at), "mass": numbers([_LEAST_MASS])}
            SubElement(
                second_body, "inertial", attributes, diaginertia=numbers([_LEAST_INERTIA] * 3)
            )
        if gravcomp:
            body.set("gravcomp", numbers([gravcomp]))


def _body_names(model: pin.Model) -> dict[int, str]:
    """Name of each body, by its index.

    It is the name of a link at the origin of the body; without such a link, it is the name of the
    joint. But another frame may have this name: a link or a point that is not at the origin of this
    body. `add_sites` writes that frame as a site of its name, so that the name means the same frame
    when the file is read again. The body is then called `NAME_joint`.
    """
    names = dict(enumerate(model.names))
    # Backwards, so that the first one of several links gives the name.
    for frame in list(model.frames)[::-1]:
        if frame.type != LINK or frame.name in ("universe", "world"):
            continue
        if frame.placement.isIdentity():
            names[frame.parentJoint] = frame.name

    # Names of all links and points. Then names of links and points at the origin of a body, each
    # with the index of this body.
    names_of_frames = {f.name for f in model.frames if f.type in (*POINTS, LINK)}
    at_origin = {(f.name, f.parentJoint) for f in model.frames if _is_at_origin(f)}
    for joint, name in names.items():
        if name in names_of_frames and (name, joint) not in at_origin:
            names[joint] = f"{name}_joint"
    return names


def _is_free_flyer(joint: Any) -> bool:
    """Whether a joint is a free-flyer."""
    return bool(joint.shortname() == "JointModelFreeFlyer")


def _is_at_origin(frame: pin.Frame) -> bool:
    """Whether a frame, other than the frame of a joint, is at the origin of its body."""
    return frame.type != pin.FrameType.JOINT and bool(frame.placement.isIdentity())

# SPDX-License-Identifier: BSD-2-Clause
"""Bodies and joints of a robot in an MJCF.

The bodies are those of the normal tree of the robot (`model.normal_tree`), which has the robot's
motions and only joints that MuJoCo has, or almost: universal joints are hinges in series there.
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
#: Types of frames that are points on a body, and of those that are links.
POINTS = (pin.FrameType.OP_FRAME, pin.FrameType.SENSOR)
LINK = pin.FrameType.BODY


class MjcfBodies:
    """Writes the bodies of a robot into the `<worldbody>` of an MJCF.

    Attributes:
        joints: MuJoCo's joints, in its order.
        of_joint: The element of the body of each joint of the normal tree, the base first.
        base: The element in which the first bodies are: the base, or the world.
        names: Names of the bodies, by the joint of the normal tree.
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
            mechanism: The robot.
            tree: Its normal tree.
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

        # The base is the world, or a body of another name in it. Free bodies must be in the world.
        # If there is one, the others are written there too, so that the order of the joints stays.
        base = world
        if self.names[0] != "universe":
            base = SubElement(world, "body", name=self.names[0])
        on_base = self._model.children[0]
        has_free_body = any(_is_free(self._model.joints[joint]) for joint in on_base)
        self.base = world if has_free_body else base
        self.of_joint = [base] * self._model.njoints  # the others are filled below
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
        """Add the body of a joint of the normal tree, and all bodies after it; returns its element.

        In MuJoCo a body can have several joints. So an empty body between two joints is not
        written; the next body has its joints too.

        Args:
            index: The joint.
            parent_body: The element of the last body before it that is written.
            start: The placement of the last joint before it on this body.
            joints_before: Joints of bodies between both that are not written, in the axes of the
                last joint before.
        """
        on_parent = self._model.jointPlacements[index]
        joints = [joint.seen_from(on_parent) for joint in joints_before]
        try:
            joints += joints_of(self._mechanism.model, self._tree, index)
        except DescriptionError as error:
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
            self._put_weight_share(body, index)
            for child in self._model.children[index]:
                self._add_body(child, body)
        self.of_joint[index] = body
        return body

    def _is_empty(self, index: int) -> bool:
        """Whether the body of a joint only carries one other joint.

        Example: the body between the axes of a universal joint.
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
        fast = list[str]()
        for joint in self.joints:
            if not joint.mimics and has_velocity_limit(self._mechanism, joint):
                fast.append(joint.name)
        if fast:
            text = f"largest velocities of the joints {listed(fast)} are left out"
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

    def _put_weight_share(self, body: Element, index: int) -> None:
        """Write the share of the weight that does not act on a body, as `gravcomp`.

        MuJoCo compensates weight at the mass centre c, and ignores negative numbers unless another
        body has a positive one. So a share s above 1, or with an offset d, is written thus: with
        x = max(1, s), a body of almost no mass has the weight x m g at c + d / x, and the share
        x + 1 - s of m g is compensated. Together these are the weight s m g and the moment m d.
        """
        weight_shares = self._mechanism.weight_shares
        if weight_shares is None or index not in self._tree.bodies:
            return
        number = self._tree.bodies.index(index) - 1
        inertia = self._model.inertias[index]
        share = float(weight_shares.shares[number])
        offset = weight_shares.offsets[number]
        compensated = 1 - share
        if inertia.mass and (share > 1 or offset.any()):
            added_share = max(1.0, share)
            compensated += added_share
            at = inertia.lever + offset / added_share
            gravcomp = -added_share * inertia.mass / _LEAST_MASS
            added = SubElement(body, "body", gravcomp=numbers([gravcomp]))
            attributes = {"pos": numbers(at), "mass": numbers([_LEAST_MASS])}
            SubElement(added, "inertial", attributes, diaginertia=numbers([_LEAST_INERTIA] * 3))
        if compensated:
            body.set("gravcomp", numbers([compensated]))


def _body_names(model: pin.Model) -> dict[int, str]:
    """Name of the body of each joint: the name of a link at the joint's origin, else of the joint.

    When the file is read again, the name of a body or a site is the name of a frame there. So a
    link or a point that is not at the origin of the body of its name needs a site, which gets the
    name (`add_sites`). The name of the body is then `NAME_joint`.
    """
    names = dict(enumerate(model.names))
    for frame in list(model.frames)[::-1]:  # so that the first link counts
        if frame.type != LINK or frame.name in ("universe", "world"):
            continue
        if frame.placement.isIdentity():
            names[frame.parentJoint] = frame.name

    # Frames at the origin of a body, by name and joint, and names that frames other than those of
    # joints have.
    at_origin = {(f.name, f.parentJoint) for f in model.frames if _is_at_joint(f)}
    names_of_frames = {f.name for f in model.frames if f.type in (*POINTS, LINK)}
    for joint, name in names.items():
        if name in names_of_frames and (name, joint) not in at_origin:
            names[joint] = f"{name}_joint"
    return names


def _is_free(joint: Any) -> bool:
    """Whether a joint is a free-flyer."""
    return bool(joint.shortname() == "JointModelFreeFlyer")


def _is_at_joint(frame: pin.Frame) -> bool:
    """Whether a frame other than that of a joint is at its joint."""
    return frame.type != pin.FrameType.JOINT and bool(frame.placement.isIdentity())

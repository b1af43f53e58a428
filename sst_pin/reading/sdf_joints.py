# SPDX-License-Identifier: BSD-2-Clause
"""Joints of a model of an SDF, gear boxes included.

What is wrong with a joint becomes a problem of the model.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from .joint_graph import Axis, GraphJoint, axis_names
from .problems import SHORTEST_AXIS, is_true, numbers, unknown_parts, warning
from .sdf_frames import MODEL
from .sdf_model import SdfModel
from .tool_elements import is_weld, is_weld_within

#: Number of axes for each type of joint that has axes.
_AXES = {
    "revolute": 1,
    "continuous": 1,
    "prismatic": 1,
    "screw": 1,
    "universal": 2,
    "revolute2": 2,
}
_KINDS = (*_AXES, "ball", "fixed", "gearbox")
#: Drake's element of a joint that follows another one; it is for joints of one axis.
DRAKE_MIMIC = "drake:mimic"
#: Limits of an axis, with their values if the file has none. An effort or a rate of 0 is no limit.
_LIMITS = {"lower": -np.inf, "upper": np.inf, "effort": 0.0, "velocity": 0.0}
#: Elements of an axis that exert forces.
_ACTING = ("damping", "friction", "spring_stiffness")
#: Rounding of the cosine of the angle between two axes that are written as parallel.
_PARALLEL = 1e-9


def joints_of(model: SdfModel, axes_in_model: bool) -> list[GraphJoint]:
    """The joints of a model. A gear box becomes no joint, but a coupling of two joints.

    `axes_in_model` says whether directions of axes are in the frame of the model by default, or in
    the frame of the joint.
    """
    return _JointReader(model, axes_in_model).joints()


class _Hinge(NamedTuple):
    """A hinge between a link and the reference body of a gear box."""

    #: Its number among the joints.
    number: int
    #: 1 if a positive position turns the link on the body about the gear's axis; -1 if it turns it
    #: the other way.
    sign: float


class _JointReader:
    """Reads the joints of a model."""

    def __init__(self, model: SdfModel, axes_in_model: bool) -> None:
        self._model = model
        self._axes_in_model = axes_in_model

    def joints(self) -> list[GraphJoint]:
        """All joints, some with the coupling of a gear box."""
        gears = list[ET.Element]()
        joints = list[GraphJoint]()
        for element in self._model.element.findall("joint"):
            if element.get("type") == "gearbox":
                gears.append(element)
                continue
            joint = self._joint(element)
            if joint is not None:
                joints.append(joint)
        for gear in gears:
            joints = self._with_gear(joints, gear)
        return joints

    def _joint(self, joint: ET.Element) -> GraphJoint | None:
        """A joint that is no gear box; None, and a problem, if it cannot be read."""
        name = joint.get("name", "")
        kind = joint.get("type", "")
        parent = self._end(joint, "parent")
        child = self._end(joint, "child")
        if kind not in _KINDS:
            self._model.refuse(
                joint, f"type {kind!r} is not supported; supported: {', '.join(_KINDS)}"
            )
            return None
        if not parent or not child:
            return None
        if parent == child:
            self._model.refuse(joint, f"it connects {parent} with itself")
            return None
        return GraphJoint(
            name=name,
            kind="universal" if kind == "revolute2" else kind,
            parent=parent,
            child=child,
            on_parent=self._model.frames.relative_pose(parent, name),
            on_child=self._model.frames.relative_pose(child, name),
            axes=self._axes(joint, name, kind) or (Axis(),),  # a ball and a weld have no axis
            lead=self._lead(joint) if kind == "screw" else 0.0,
        )

    def _end(self, joint: ET.Element, side: str) -> str:
        """The link, or the world, on one side of a joint; "" and a problem if it is missing."""
        name = joint.findtext(side, "").strip()
        link = self._model.frames.link_of(name)
        if not link:
            self._model.refuse(joint, f"its {side} {name!r} is not a link of this model")
        return link

    def _lead(self, joint: ET.Element) -> float:
        """How far a screw slides in one turn, [m]; positive for a right-handed thread."""
        if joint.find("screw_thread_pitch") is None and joint.find("thread_pitch") is not None:
            # This old element is an angle per distance, [rad/m], positive for a left-handed thread.
            radians_per_metre = self._model.number(joint, "thread_pitch", 1.0)
            if not radians_per_metre:
                self._model.refuse(joint, "its thread_pitch is 0")
                return 0.0
            return -2 * np.pi / radians_per_metre
        return self._model.number(joint, "screw_thread_pitch", 1.0)

    def _axes(self, joint: ET.Element, name: str, kind: str) -> tuple[Axis, ...]:
        """The axes of a joint of this kind, none for a ball and a weld.

        The file may have more elements of axes. Forces in them are problems.
        """
        count = _AXES.get(kind, 0)
        tags = ("axis", "axis2")[:count]
        unused_tags = ("axis", "axis2")[count:]
        for tag in unused_tags:
            for key in _ACTING:
                path = f"{tag}/dynamics/{key}"
                if self._model.number(joint, path, 0.0):
                    self._model.refuse(joint, f"{kind}, and does not have the axis of its {path}")
        for tag in tags:
            if joint.find(tag) is None:
                text = f"{kind} without <{tag}>: read as about 0 0 1, which other tools refuse"
                self._model.notes.append(warning(f"joint {name}", text))
        return tuple(self._axis(joint, tag) for tag in tags)

    def _axis(self, joint: ET.Element, tag: str) -> Axis:
        """An axis of a joint."""
        axis = _axis_element(joint, tag)
        limit = dict[str, float]()
        for key, default in _LIMITS.items():
            limit[key] = self._model.number(joint, f"limit/{key}", default, part=axis)
        dynamics = dict[str, float]()
        for key in (*_ACTING, "spring_reference"):
            dynamics[key] = self._model.number(joint, f"dynamics/{key}", 0.0, part=axis)
        if limit["lower"] > limit["upper"]:
            self._model.refuse(joint, "its lower limit is above the upper one")
        mimic = self._mimic(joint, axis)
        drake_mimic = self._drake_mimic(joint)
        if mimic and drake_mimic and mimic != drake_mimic:
            self._model.refuse(joint, f"its <mimic> and its <{DRAKE_MIMIC}> differ")
        return Axis(self._direction(joint, tag), limit, dynamics, mimic or drake_mimic)

    def _mimic(self, joint: ET.Element, axis: ET.Element) -> dict[str, str]:
        """How an axis follows another one, as attributes of a URDF's `<mimic>`; else empty.

        In an SDF: position = multiplier * (leader - reference) + offset.
        """
        element = axis.find("mimic")
        if element is None:
            return {}
        tags = ["multiplier", "reference", "offset"]
        for fault in unknown_parts(element, tags=tags, attributes=["joint", "axis"]):
            self._model.refuse(joint, fault)
        multiplier = self._model.number(joint, "mimic/multiplier", 1.0, part=axis)
        reference = self._model.number(joint, "mimic/reference", 0.0, part=axis)
        offset = self._model.number(joint, "mimic/offset", 0.0, part=axis)
        return {
            "joint": self._axis_name(element.get("joint", ""), element.get("axis", "axis")),
            "multiplier": repr(multiplier),
            "offset": repr(offset - multiplier * reference),
        }

    def _drake_mimic(self, joint: ET.Element) -> dict[str, str]:
        """How a joint follows another one by Drake's element, in the form of `_mimic`; else empty.

        In Drake: position = multiplier * leader + offset.
        """
        if not has_one_axis(joint):
            return {}
        element = joint.find(DRAKE_MIMIC)
        if element is None:
            return {}
        for fault in unknown_parts(element, attributes=["joint", "multiplier", "offset"]):
            self._model.refuse(joint, fault)
        mimic = {"joint": self._axis_name(element.get("joint", ""), "axis")}
        for key, default in (("multiplier", "1"), ("offset", "0")):
            text = element.get(key, default)
            value = numbers(text, 1)
            if value is None:
                self._model.refuse(joint, f"its <{DRAKE_MIMIC} {key}={text!r}> is not a number")
            else:
                mimic[key] = repr(float(value[0]))
        return mimic

    def _direction(self, joint: ET.Element, tag: str) -> Array:
        """The direction of an axis, in the joint's frame; z if the file has no axis."""
        axis = _axis_element(joint, tag)
        xyz = axis.find("xyz")
        direction = numbers("0 0 1" if xyz is None else xyz.text or "", 3)
        if direction is None or not np.linalg.norm(direction) > SHORTEST_AXIS:
            self._model.refuse(joint, f"its <{tag}> is not a direction")
            direction = np.array([0.0, 0.0, 1.0])
        # The frame in which the file has the direction; "" is the joint's own frame.
        frame = "" if xyz is None else xyz.get("expressed_in", "")
        text = axis.findtext("use_parent_model_frame")
        is_in_model = self._axes_in_model if text is None else is_true(text)
        if not frame and is_in_model:
            frame = MODEL
        if frame:
            frame_in_joint = self._model.frames.relative_pose(joint.get("name", ""), frame)
            direction = frame_in_joint.rotation @ direction
        return np.asarray(direction / np.linalg.norm(direction))

    def _axis_name(self, joint: str, axis: str) -> str:
        """Name of the URDF's joint for one axis, "axis" or "axis2", of the joint of this name.

        A URDF has no joints of two axes; `axis_names` names the two joints that replace one.
        """
        element = self._model.frames.elements.get(joint)
        count = 1 if element is None else _AXES.get(element.get("type", ""), 1)
        names = axis_names(joint, count)
        return names[1] if axis == "axis2" and count == 2 else names[0]

    # --- gear boxes ---------------------------------------------------------------------------

    def _with_gear(self, joints: list[GraphJoint], gear: ET.Element) -> list[GraphJoint]:
        """The joints, one of them with the coupling of a gear box.

        A gear box couples the angles of two links relative to its reference body: angle_1 of its
        parent about axis 1, and angle_2 of its child about axis 2,

            angle_2 = -ratio angle_1.

        Each link turns on the body by a hinge. The axis of hinge k may be opposite to axis k, so
        that angle_k = sign_k position_k, with sign_k = 1 or -1. Hinge 2 therefore mimics hinge 1:

            position_2 = -ratio sign_1 sign_2 position_1.
        """
        body = gear.findtext("gearbox_reference_body", "").strip()
        link_of_body = self._model.frames.link_of(body)
        ratio = self._model.number(gear, "gearbox_ratio", 1.0)
        parent = self._end(gear, "parent")
        hinge_1 = self._hinge(joints, gear, "axis", body=link_of_body, link=parent)
        child = self._end(gear, "child")
        hinge_2 = self._hinge(joints, gear, "axis2", body=link_of_body, link=child)
        if hinge_1 is None or hinge_2 is None:
            text = f"its links have no hinges about its axes on the body {body!r}"
            self._model.refuse(gear, f"{text}, between which the gear box acts")
            return joints
        leader = joints[hinge_1.number]
        follower = joints[hinge_2.number]
        axis = follower.axes[0]
        if axis.mimic:
            self._model.refuse(gear, f"joint {follower.name} mimics another joint already")
        factor = -ratio * hinge_1.sign * hinge_2.sign
        mimic = {"joint": leader.name, "multiplier": repr(factor), "offset": "0.0"}
        coupled = list(joints)
        coupled[hinge_2.number] = replace(follower, axes=(replace(axis, mimic=mimic),))
        return coupled

    def _hinge(
        self, joints: Sequence[GraphJoint], gear: ET.Element, tag: str, *, body: str, link: str
    ) -> _Hinge | None:
        """The hinge between a link and a body about an axis of a gear box; None without one."""
        gear_frame = self._model.frames.pose_in_model(gear.get("name", ""))
        gear_axis = gear_frame.rotation @ self._direction(gear, tag)
        for index, joint in enumerate(joints):
            is_hinge = joint.kind in ("revolute", "continuous")
            if not is_hinge or {joint.parent, joint.child} != {body, link}:
                continue
            frame = self._model.frames.pose_in_model(joint.name)
            hinge_axis = frame.rotation @ joint.axes[0].direction  # in the model, as gear_axis
            cosine = float(hinge_axis @ gear_axis)
            if abs(abs(cosine) - 1) < _PARALLEL:  # parallel or antiparallel
                sign = float(np.sign(cosine))
                if joint.parent != body:  # its position is the angle of the body on the link
                    sign = -sign
                return _Hinge(index, sign)
        return None


def welds_of(model: SdfModel) -> list[GraphJoint]:
    """The welds between two links of a model by the plugins `DetachableJoint` of Gazebo."""
    welds = list[GraphJoint]()
    plugins = [plugin for plugin in model.element.findall("plugin") if is_weld(plugin)]
    for number, plugin in enumerate(plugins, 1):
        if not is_weld_within(plugin, model.name):
            continue
        where = f"plugin {plugin.get('name')}"
        parent = plugin.findtext("parent_link", "").strip()
        child = plugin.findtext("child_link", "").strip()
        unknown = [link for link in (parent, child) if link not in model.links]
        for link in unknown:
            model.problems.append(f"{where}: {link!r} is not a link of this model")
        if parent == child:
            model.problems.append(f"{where}: it connects {parent!r} with itself")
        elif not unknown:
            on_parent = model.frames.relative_pose(parent, child)
            name = f"detachable_{number}"
            welds.append(GraphJoint(name, "fixed", parent, child, on_parent, pin.SE3.Identity()))
    return welds


def has_one_axis(joint: ET.Element) -> bool:
    """Whether the type of a joint has one axis."""
    return _AXES.get(joint.get("type", "")) == 1


def _axis_element(joint: ET.Element, tag: str) -> ET.Element:
    """The element of an axis; an empty one, with all defaults, if the file has none."""
    axis = joint.find(tag)
    return ET.Element(tag) if axis is None else axis

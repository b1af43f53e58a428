# SPDX-License-Identifier: BSD-2-Clause
"""Reads an SDF as the elements of a URDF.

An `Sdf` is one model of the file. Its constructor checks what cannot be read and notes what is not;
`graph` writes the model as links, joints and frames of a URDF. `sdf_frames` has the poses.
"""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError
from ..summaries import listed
from .acting_elements import plugin_problem
from .joint_graph import WORLD, Axis, GraphJoint, JointGraph, axis_names, origin_of
from .problems import Problem, is_true, numbers, warning
from .sdf_frames import MODEL, SdfFrames
from .sdf_nesting import without_nested_models

#: Number of axes for each type of joint.
_AXES = {
    "revolute": 1,
    "continuous": 1,
    "prismatic": 1,
    "screw": 1,
    "universal": 2,
    "revolute2": 2,
}
_KINDS = (*_AXES, "ball", "fixed", "gearbox")
#: Elements of an axis that exert forces.
_ACTING = ("damping", "friction", "spring_stiffness")
#: Default entries of an inertia, from the specification [kg m^2].
_UNIT_INERTIA = {"ixx": 1.0, "ixy": 0.0, "ixz": 0.0, "iyy": 1.0, "iyz": 0.0, "izz": 1.0}
#: Before this minor version axes are in the frame of the model by default, from it on of the joint.
_AXES_IN_JOINT = 5
#: A shorter axis counts as zero; below 1e-154 the square of its length underflows.
_SHORTEST_AXIS = 1e-100
#: Rounding of the cosine of the angle between two axes that are written as parallel.
_PARALLEL = 1e-9


class Sdf:
    """The model of an SDF; its base is the world of the SDF.

    Attributes:
        gravity: Of the world, shape (3,), [m/s^2].
        notes: Warnings of content that is not read, or that is missing and has a default.
    """

    def __init__(self, root: ET.Element, source: str, model: str | None = None) -> None:
        self._source = source
        self._minor = self._minor_version(root)
        worlds = root.findall("world")
        if len(worlds) > 1:
            raise DescriptionError(source, [f"{len(worlds)} worlds; one is needed"])
        chosen_model = self._chosen_model(root, model)
        is_in_world = chosen_model not in root.findall("model")
        # The checks and readers below add to the problems and the notes.
        self._model, self._problems = without_nested_models(chosen_model)
        self.notes = list[Problem]()
        self._links = {link.get("name", ""): link for link in self._model.findall("link")}
        self._frames = SdfFrames(self._model, is_in_world, self._problems)
        self._require_distinct_names()
        self._require_no_other_parts()
        for world in worlds:
            self._note_rest_of_world(world)
        self._note_unread([*worlds, self._model])
        self.gravity = self._gravity(root)

    def _minor_version(self, root: ET.Element) -> int:
        """The minor number of the SDF's version 1.x."""
        version = root.get("version", "1.7").strip()
        match = re.fullmatch(r"1\.(\d+)(\.\d+)?", version)
        if match is None:
            text = f"version {version!r} is none of SDF, such as 1.12"
            raise DescriptionError(self._source, [text])
        return int(match[1])

    def _gravity(self, root: ET.Element) -> Array:
        """The gravity of the world, shape (3,), [m/s^2]."""
        text = root.findtext("world/gravity")
        if text is None:
            text = root.findtext("world/physics/gravity")  # until version 1.4
        if text is None:
            text = "0 0 -9.81"
        gravity = numbers(text, 3)
        if gravity is None:
            self._problems.append(f"gravity {text!r} is not three numbers")
            return np.zeros(3)
        return gravity

    def graph(self) -> JointGraph:
        """The robot as joints between links; all problems in one DescriptionError."""
        # Joints; gear boxes couple two of them.
        gears = list[ET.Element]()
        joints = list[GraphJoint]()
        for element in self._model.findall("joint"):
            if element.get("type") == "gearbox":
                gears.append(element)
                continue
            joint = self._joint(element)
            if joint is not None:
                joints.append(joint)
        for gear in gears:
            joints = self._couple(gear, joints)

        # The tree of these joints, then links and frames.
        world = self._frames.pose_in_model(WORLD)
        poses = {name: world.actInv(self._frames.pose_in_model(name)) for name in self._links}
        graph = JointGraph(self._model.get("name", ""), joints, poses)
        self._add_links(graph)
        for element in self._model.findall("frame"):
            name = element.get("name", "")
            link = self._frames.link_of(name)
            if link:
                graph.add_frame(name, link, self._frames.relative_pose(link, name))
            else:
                self._refuse(element, "it is not attached to a link of this model")
        problems = dict.fromkeys([*self._problems, *graph.problems])  # each once
        if problems:
            raise DescriptionError(self._source, problems)
        return graph

    # --- what is read -----------------------------------------------------------------------

    def _chosen_model(self, root: ET.Element, name: str | None) -> ET.Element:
        """The model of this name; without a name, the only model that is not static."""
        models = [*root.findall("model"), *root.findall("world/model")]
        moving = [model for model in models if not is_true(model.findtext("static"))]
        names = ", ".join(model.get("name", "") for model in moving)
        if name is None:
            candidates = moving
        else:
            candidates = [model for model in models if model.get("name") == name]
        if len(candidates) == 1:
            return candidates[0]
        if name is not None:
            text = f"{len(candidates)} models are named {name}; the models are {names}"
        elif candidates:
            text = f"{len(candidates)} models that move: {names}; model= chooses one, --model in "
            text += "the shell"
        else:
            text = "no model that moves; one is needed"
        raise DescriptionError(self._source, [text])

    def _require_distinct_names(self) -> None:
        """Links, joints and frames of one kind need different names."""
        for tag in ("link", "joint", "frame"):
            names = Counter(e.get("name", "") for e in self._model.findall(tag))
            for name, count in names.items():
                if not name:
                    self._problems.append(f"{tag}: {count} without a name")
                elif count > 1:
                    self._problems.append(f"{tag} {name}: {count} have this name")
        canonical = self._model.get("canonical_link")
        if canonical and canonical not in self._links:
            self._problems.append(f"model: its canonical_link {canonical} is not one of its links")

    def _require_no_other_parts(self) -> None:
        """Refuse parts of the robot that are not in its links and joints."""
        for part in self._model.findall("include"):
            name = part.get("name") or part.findtext("uri") or ""
            text = "parts of a model in other files are not supported; write them into this file"
            self._problems.append(f"<include> {name}: {text}")
        for link in self._links.values():
            if is_true(link.findtext("kinematic")):
                self._refuse(link, "a kinematic link, moved without forces, is not supported")
            inertial = link.find("inertial")
            if inertial is not None and is_true(inertial.get("auto")):
                text = "the inertia of shapes (auto) is not computed; write mass and inertia"
                self._refuse(link, text)

    def _note_rest_of_world(self, world: ET.Element) -> None:
        """Warn of elements of the world that may touch or hold the model."""
        for include in world.findall("include"):
            text = f"{include.findtext('uri', '').strip()} is not read"
            self.notes.append(warning("<include> in <world>", text))
        for joint in world.findall("joint"):
            text = "a joint of the world is not read; put it into the model"
            self.notes.append(warning(f"joint {joint.get('name')}", text))

    def _note_unread(self, parents: Sequence[ET.Element]) -> None:
        """Warn of forces that are not read; `parents` can have plugins."""
        for parent in parents:
            for plugin in parent.findall("plugin"):
                self.notes += plugin_problem(plugin, parent.tag)
        windy = is_true(self._model.findtext("enable_wind"))
        for link in self._links.values():
            where = f"link {link.get('name')}"
            for path in ("velocity_decay/linear", "velocity_decay/angular"):
                if self._number(link, link, path, 0.0):
                    self.notes.append(warning(where, f"<{path}> is not read"))
            if link.find("inertial/fluid_added_mass") is not None:
                self.notes.append(warning(where, "<fluid_added_mass> is not read"))
            windy = windy or is_true(link.findtext("enable_wind"))
        if windy:
            self.notes.append(warning("model", "wind is not read"))
        for element in self._model.iter():
            pose = element.find("pose")
            if pose is None or element is self._model:
                continue
            if pose.get("relative_to") == WORLD:
                where = f"{element.tag} {element.get('name', '')}".strip()
                text = "its pose is relative to the world, which other tools refuse"
                self.notes.append(warning(where, text))

    # --- joints -----------------------------------------------------------------------------

    def _end(self, joint: ET.Element, side: str) -> str:
        """The link, or the world, that a joint connects; "" if it is missing."""
        name = joint.findtext(side, "").strip()
        link = self._frames.link_of(name)
        if not link:
            self._refuse(joint, f"its {side} {name!r} is not a link of this model")
        return link

    def _joint(self, joint: ET.Element) -> GraphJoint | None:
        """A joint but a gear box; None and a problem if it cannot be read."""
        name = joint.get("name", "")
        kind = joint.get("type", "")
        parent = self._end(joint, "parent")
        child = self._end(joint, "child")
        if kind not in _KINDS:
            self._refuse(joint, f"type {kind!r} is not supported; supported: {', '.join(_KINDS)}")
            return None
        if not parent or not child:
            return None
        if parent == child:
            self._refuse(joint, f"it connects {parent} with itself")
            return None
        return GraphJoint(
            name=name,
            kind="universal" if kind == "revolute2" else kind,
            parent=parent,
            child=child,
            on_parent=self._frames.relative_pose(parent, name),
            on_child=self._frames.relative_pose(child, name),
            axes=self._axes(joint, name, kind) or (Axis(),),  # a ball and a weld have no axis
            lead=self._lead(joint) if kind == "screw" else 0.0,
        )

    def _axes(self, joint: ET.Element, name: str, kind: str) -> tuple[Axis, ...]:
        """The axes of a joint; forces about axes that the joint does not have are problems."""
        count = _AXES.get(kind, 0)
        tags = ("axis", "axis2")[:count]
        unused_tags = ("axis", "axis2")[count:]
        for tag in unused_tags:
            for key in _ACTING:
                path = f"{tag}/dynamics/{key}"
                if self._number(joint, joint, path, 0.0):
                    self._refuse(joint, f"{kind}, and does not have the axis of its {path}")
        for tag in tags:
            if joint.find(tag) is None:
                text = f"{kind} without <{tag}>: read as about 0 0 1, which other tools refuse"
                self.notes.append(warning(f"joint {name}", text))
        return tuple(self._axis(joint, tag) for tag in tags)

    def _lead(self, joint: ET.Element) -> float:
        """Metres of a screw in one turn; positive for a right-handed thread."""
        if joint.find("screw_thread_pitch") is None and joint.find("thread_pitch") is not None:
            # The old element has rad/m, positive for a left-handed thread.
            radians_per_metre = self._number(joint, joint, "thread_pitch", 1.0)
            if not radians_per_metre:
                self._refuse(joint, "its thread_pitch is 0")
                return 0.0
            return -2 * np.pi / radians_per_metre
        return self._number(joint, joint, "screw_thread_pitch", 1.0)

    def _direction(self, joint: ET.Element, tag: str) -> Array:
        """The direction of an axis, in the joint's frame; z if the file has no axis."""
        axis = joint.find(tag)
        axis = ET.Element(tag) if axis is None else axis
        xyz = axis.find("xyz")
        direction = numbers("0 0 1" if xyz is None else xyz.text or "", 3)
        if direction is None or not np.linalg.norm(direction) > _SHORTEST_AXIS:
            self._refuse(joint, f"its <{tag}> is not a direction")
            direction = np.array([0.0, 0.0, 1.0])
        # The frame in which the file has it: the joint's own, unless it names another one.
        frame = "" if xyz is None else xyz.get("expressed_in", "")
        in_model = str(self._minor < _AXES_IN_JOINT)
        if not frame and is_true(axis.findtext("use_parent_model_frame", in_model)):
            frame = MODEL
        if frame:
            direction = (
                self._frames.relative_pose(joint.get("name", ""), frame).rotation @ direction
            )
        return np.asarray(direction / np.linalg.norm(direction))

    def _axis(self, joint: ET.Element, tag: str) -> Axis:
        """An axis of a joint."""
        axis = joint.find(tag)
        axis = ET.Element(tag) if axis is None else axis

        def value(path: str, default: float = 0.0) -> float:
            return self._number(joint, axis, path, default)

        limit = {
            "lower": value("limit/lower", -np.inf),
            "upper": value("limit/upper", np.inf),
            "effort": value("limit/effort"),
            "velocity": value("limit/velocity"),
        }
        if limit["lower"] > limit["upper"]:
            self._refuse(joint, "its lower limit is above the upper one")
        dynamics = {key: value(f"dynamics/{key}") for key in (*_ACTING, "spring_reference")}
        mimic = dict[str, str]()
        mimic_element = axis.find("mimic")
        if mimic_element is not None:
            leader = mimic_element.get("joint", "")
            leader_axis = mimic_element.get("axis", "axis")
            # SDF: position = multiplier * (leader - reference) + offset
            multiplier = value("mimic/multiplier", 1.0)
            offset = value("mimic/offset") - multiplier * value("mimic/reference")
            mimic["joint"] = self._axis_name(leader, leader_axis)
            mimic["multiplier"] = repr(multiplier)
            mimic["offset"] = repr(offset)
        return Axis(self._direction(joint, tag), limit, dynamics, mimic)

    def _axis_name(self, joint: str, axis: str) -> str:
        """Name of the joint of one axis that stands for an axis of a joint."""
        element = self._frames.elements.get(joint)
        count = 1 if element is None else _AXES.get(element.get("type", ""), 1)
        names = axis_names(joint, count)
        return names[1] if axis == "axis2" and count == 2 else names[0]

    def _couple(self, gear: ET.Element, joints: list[GraphJoint]) -> list[GraphJoint]:
        """The joints, one of them with the coupling of a gear box.

        The gear box couples two angles of links on its reference body: angle 2, of its child about
        axis 2, is -ratio times angle 1, of its parent about axis 1. Both must be angles of hinges:
        angle k = sign_k times the position of hinge k. So hinge 2 mimics hinge 1 with the factor
        -ratio sign_1 sign_2.
        """
        body = gear.findtext("gearbox_reference_body", "").strip()
        ratio = self._number(gear, gear, "gearbox_ratio", 1.0)
        first = self._hinge(
            gear, joints, self._frames.link_of(body), self._end(gear, "parent"), "axis"
        )
        second = self._hinge(
            gear, joints, self._frames.link_of(body), self._end(gear, "child"), "axis2"
        )
        if first is None or second is None:
            text = f"its links have no hinges about its axes on the body {body!r}"
            self._refuse(gear, f"{text}, between which the gear box acts")
            return joints
        leader, leader_sign = first
        follower, follower_sign = second
        factor = -ratio * leader_sign * follower_sign
        axis = joints[follower].axes[0]
        if axis.mimic:
            self._refuse(gear, f"joint {joints[follower].name} mimics another joint already")
        mimic = {"joint": joints[leader].name, "multiplier": repr(factor), "offset": "0.0"}
        coupled = replace(joints[follower], axes=(replace(axis, mimic=mimic),))
        return [*joints[:follower], coupled, *joints[follower + 1 :]]

    def _hinge(
        self, gear: ET.Element, joints: list[GraphJoint], body: str, link: str, tag: str
    ) -> tuple[int, float] | None:
        """Index of the hinge between a link and a body, and its sign; None if there is none.

        The sign is 1 if a positive position turns the link on the body about the gear's axis, -1
        if it turns it the other way.
        """
        gear_frame = self._frames.pose_in_model(gear.get("name", ""))
        gear_axis = gear_frame.rotation @ self._direction(gear, tag)
        for index, joint in enumerate(joints):
            if joint.kind not in ("revolute", "continuous") or {joint.parent, joint.child} != {
                body,
                link,
            }:
                continue
            axis = self._frames.pose_in_model(joint.name).rotation @ joint.axes[0].direction
            cosine = float(axis @ gear_axis)
            if abs(abs(cosine) - 1) < _PARALLEL:  # parallel or antiparallel
                sign = float(np.sign(cosine))
                if joint.parent != body:  # the hinge moves the body on the link
                    sign = -sign
                return index, sign
        return None

    # --- links ------------------------------------------------------------------------------

    def _add_links(self, graph: JointGraph) -> None:
        """Add the links with inertias, gravity and shapes."""
        missing_entries = dict[str, list[str]]()
        for name, link in self._links.items():
            inertial = link.find("inertial")
            if inertial is None:
                inertial = ET.Element("inertial")
            needed = ("mass", "inertia/ixx", "inertia/iyy", "inertia/izz")
            missing = ", ".join(path for path in needed if inertial.find(path) is None)
            if missing:
                missing_entries.setdefault(missing, []).append(name)
            inertia = {
                key: self._number(link, inertial, f"inertia/{key}", default)
                for key, default in _UNIT_INERTIA.items()
            }
            mass = self._number(link, inertial, "mass", 1.0)
            element = graph.add_link(name, self._frames.inertia_pose(inertial, link), mass, inertia)
            if not is_true(link.findtext("gravity", "true")):
                gazebo = ET.SubElement(graph.urdf, "gazebo", reference=name)
                ET.SubElement(gazebo, "gravity").text = "false"
            for tag in ("visual", "collision"):
                for shape in link.findall(tag):
                    place = self._frames.shape_pose(name, shape)
                    element.extend(_shape(tag, shape, place, f"{name}_{len(element)}"))
        for missing, names in missing_entries.items():
            text = f"no {missing}: 1 kg and the unit inertia by the specification"
            self.notes.append(warning(f"links {listed(names)}", text))

    def _number(self, owner: ET.Element, inside: ET.Element, path: str, default: float) -> float:
        """The number at a path in the element `inside`; a problem of `owner` if it is none."""
        text = inside.findtext(path, "").strip() or repr(default)
        if text.lstrip("+-").lower() in ("inf", "infinity"):
            return float(text)
        value = numbers(text, 1)
        if value is None:
            self._refuse(owner, f"{path} {text!r} is not a number")
            return default
        return float(value[0])

    def _refuse(self, element: ET.Element, text: str) -> None:
        self._problems.append(f"{element.tag} {element.get('name')}: {text}")


#: Shapes that are drawn: the names of their sizes in an SDF and in a URDF.
_SHAPES: dict[str, dict[str, str]] = {
    "box": {"size": "size"},
    "cylinder": {"radius": "radius", "length": "length"},
    "sphere": {"radius": "radius"},
    "mesh": {"uri": "filename", "scale": "scale"},
}


def _shape(tag: str, shape: ET.Element, place: pin.SE3, name: str) -> Iterator[ET.Element]:
    """A shape as an element of a URDF; planes and height maps are left out."""
    geometry = shape.find("geometry")
    if geometry is None or not len(geometry):
        return
    solid = geometry[0]
    if solid.tag not in _SHAPES:
        return
    part = ET.Element(tag)
    ET.SubElement(part, "origin", origin_of(place))
    sizes = {
        urdf_key: (solid.findtext(key) or "").strip()
        for key, urdf_key in _SHAPES[solid.tag].items()
    }
    if solid.tag == "mesh" and not sizes["scale"]:
        sizes["scale"] = "1 1 1"
    ET.SubElement(ET.SubElement(part, "geometry"), solid.tag, sizes)
    colour = shape.findtext("material/diffuse", "").strip()
    if colour:
        material = ET.SubElement(part, "material", name=name)
        ET.SubElement(material, "color", rgba=colour)
    yield part

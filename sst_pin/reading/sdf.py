# SPDX-License-Identifier: BSD-2-Clause
"""Reads an SDF as the elements of a URDF."""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError
from ..summaries import listed
from .acting_elements import acting_plugins
from .joint_graph import WORLD, Axis, GraphJoint, JointGraph, axis_names, origin_of
from .problems import Problem, is_true, numbers, placement, warning

#: Types of joints, by the number of their axes.
_AXES = {
    "revolute": 1,
    "continuous": 1,
    "prismatic": 1,
    "screw": 1,
    "universal": 2,
    "revolute2": 2,
}
_KINDS = (*_AXES, "ball", "fixed", "gearbox")
#: Forces of a joint's axis.
_ACTING = ("damping", "friction", "spring_stiffness")
#: Entries of an inertia and their values by default, by the specification.
_UNIT_INERTIA = {"ixx": 1.0, "ixy": 0.0, "ixz": 0.0, "iyy": 1.0, "iyz": 0.0, "izz": 1.0}
_MODEL = "__model__"


class Sdf:
    """The model of an SDF; its base is the world of the SDF.

    `gravity` is that of the world; `notes` are warnings of content that is not read, or that is
    missing and has a default.
    """

    def __init__(self, root: ET.Element, source: str, model: str | None = None) -> None:
        self._source, version = source, root.get("version", "1.7").strip()
        minor = re.fullmatch(r"1\.(\d+)(\.\d+)?", version)
        if minor is None:
            raise DescriptionError(source, [f"version {version!r} is none of SDF, such as 1.12"])
        self._minor = int(minor[1])
        worlds = root.findall("world")
        if len(worlds) > 1:
            raise DescriptionError(source, [f"{len(worlds)} worlds; one is needed"])
        self._model = self._chosen(root, model)
        self._in_world = self._model not in root.findall("model")
        self._problems, self.notes = list[str](), list[Problem]()
        self._links = {e.get("name", ""): e for e in self._model.findall("link")}
        self._frames = {e.get("name", ""): e for e in self._named()}
        self._require_distinct_names()
        self._require_no_other_parts()
        for world in worlds:
            self._note_rest_of_world(world)
        self._note_unread([*worlds, self._model])
        old = root.findtext("world/physics/gravity")  # until version 1.4
        text = root.findtext("world/gravity", "0 0 -9.81" if old is None else old)
        gravity = numbers(text, 3)
        if gravity is None:
            self._problems.append(f"gravity {text!r} is not three numbers")
        self.gravity: Array = np.zeros(3) if gravity is None else gravity
        #: Poses in the frame of the model; None while a pose is being computed.
        self._at: dict[str, pin.SE3 | None] = {_MODEL: pin.SE3.Identity()}
        placed = self._place(self._model.get("placement_frame") or _MODEL)
        self._at[WORLD] = placed * self._fixed_pose(self._model, self._model).inverse()

    def graph(self) -> JointGraph:
        """The robot as joints between bodies; all problems in one DescriptionError."""
        elements = self._model.findall("joint")
        gears = [element for element in elements if element.get("type") == "gearbox"]
        parsed = [self._joint(element) for element in elements if element not in gears]
        joints = [joint for joint in parsed if joint is not None]
        for gear in gears:
            joints = self._geared(gear, joints)
        world = self._place(WORLD)
        rest = {name: world.actInv(self._place(name)) for name in self._links}
        graph = JointGraph(self._model.get("name", ""), joints, rest)
        self._add_links(graph)
        for element in self._model.findall("frame"):
            name = element.get("name", "")
            link = self._link_of(name)
            if link:
                graph.add_frame(name, link, self._place(link).actInv(self._place(name)))
            else:
                self._refuse(element, "it is not attached to a link of this model")
        if problems := dict.fromkeys([*self._problems, *graph.problems]):
            raise DescriptionError(self._source, problems)
        return graph

    # --- what is read -----------------------------------------------------------------------

    def _chosen(self, root: ET.Element, name: str | None) -> ET.Element:
        """The model that is read."""
        models = [*root.findall("model"), *root.findall("world/model")]
        moving = [model for model in models if not is_true(model.findtext("static"))]
        names = [model.get("name", "") for model in moving]
        if name is not None:
            moving = [model for model in models if model.get("name") == name]
        if len(moving) == 1:
            return moving[0]
        if name is not None:
            text = f"{len(moving)} models are named {name}; the models are {', '.join(names)}"
        elif moving:
            text = f"{len(moving)} models that move: {', '.join(names)}; model= chooses one"
        else:
            text = "no model that moves; one is needed"
        raise DescriptionError(self._source, [text])

    def _named(self) -> list[ET.Element]:
        return [e for tag in ("link", "frame", "joint") for e in self._model.findall(tag)]

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
        for tag in ("include", "model"):
            for part in self._model.findall(tag):
                name = part.get("name") or part.findtext("uri") or ""
                text = "parts of a model in other models are not supported"
                self._problems.append(f"<{tag}> {name}: {text}")
        for link in self._links.values():
            if is_true(link.findtext("kinematic")):
                self._refuse(link, "a kinematic link, moved without forces, is not supported")
            if is_true(getattr(link.find("inertial"), "attrib", {}).get("auto")):
                text = "the inertia of shapes (auto) is not computed; write mass and inertia"
                self._refuse(link, text)

    def _note_rest_of_world(self, world: ET.Element) -> None:
        """Warnings of what else in the world may touch or hold the model."""
        for include in world.findall("include"):
            text = f"{include.findtext('uri', '').strip()} is not read"
            self.notes.append(warning("<include> in <world>", text))
        for joint in world.findall("joint"):
            text = "a joint of the world is not read; put it into the model"
            self.notes.append(warning(f"joint {joint.get('name')}", text))

    def _note_unread(self, holders: Sequence[ET.Element]) -> None:
        """Warnings of forces that are not read."""
        for holder in holders:
            self.notes += acting_plugins(holder, holder.tag)
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

    # --- poses ------------------------------------------------------------------------------

    def _pose(self, element: ET.Element) -> pin.SE3:
        """The pose of an element, relative to the frame that it names."""
        pose = element.find("pose")
        text = "" if pose is None else pose.text or ""
        values = numbers(text or "0 0 0 0 0 0", 7 if len(text.split()) == 7 else 6)
        if values is None:
            self._refuse(element, f"its pose {text!r} is not six or seven numbers")
            return pin.SE3.Identity()
        if len(values) == 7:
            return pin.SE3(pin.Quaternion(values[3:]).normalized().matrix(), values[:3])
        if pose is not None and is_true(pose.get("degrees")):
            values[3:] = np.deg2rad(values[3:])
        return placement(values[:3], values[3:])

    def _fixed_pose(self, element: ET.Element, owner: ET.Element) -> pin.SE3:
        """The pose of the model or of an inertia, which can be relative to one frame only."""
        pose = element.find("pose")
        frame = "" if pose is None else pose.get("relative_to") or pose.get("frame", "")
        if frame and not (owner is self._model and self._in_world and frame == WORLD):
            self._refuse(owner, f"its <pose> of {element.tag} relative to {frame} is not supported")
        return self._pose(element)

    def _place(self, name: str) -> pin.SE3:
        """A frame in the frame of the model."""
        if name not in self._at:
            self._at[name] = None
            element = self._frames.get(name)
            if element is None:
                self._problems.append(f"frame {name} is not in this model")
                return pin.SE3.Identity()
            pose = element.find("pose")
            base = "" if pose is None else pose.get("relative_to") or pose.get("frame", "")
            if not base and element.tag == "joint":
                base = element.findtext("child", "").strip()
            elif not base:
                base = element.get("attached_to") or _MODEL
            self._at[name] = self._place(base) * self._pose(element)
        place = self._at[name]
        if place is None:
            self._problems.append(f"frame {name}: its pose is relative to itself")
            return pin.SE3.Identity()
        return place

    def _link_of(self, name: str) -> str:
        """The link, or the world, that a link, a joint or a frame is attached to; "" if none is.

        A joint is attached to its child.
        """
        for _ in range(len(self._frames) + 2):  # a frame may be attached to a frame
            if name == _MODEL:
                name = self._model.get("canonical_link") or next(iter(self._links), "")
            element = self._frames.get(name)
            if name == WORLD or name in self._links:
                return name
            if element is None:
                return ""
            if element.tag == "joint":
                name = element.findtext("child", "").strip()
            else:
                name = element.get("attached_to") or _MODEL
        return ""

    # --- joints -----------------------------------------------------------------------------

    def _end(self, joint: ET.Element, side: str) -> str:
        """The link, or the world, that a joint connects; "" if it is missing."""
        name = joint.findtext(side, "").strip()
        link = self._link_of(name)
        if not link:
            self._refuse(joint, f"its {side} {name!r} is not a link of this model")
        return link

    def _joint(self, joint: ET.Element) -> GraphJoint | None:
        name, kind = joint.get("name", ""), joint.get("type", "")
        a, b = self._end(joint, "parent"), self._end(joint, "child")
        if kind not in _KINDS:
            self._refuse(joint, f"type {kind!r} is not supported; supported: {', '.join(_KINDS)}")
            return None
        if not (a and b):
            return None
        if a == b:
            self._refuse(joint, f"it connects {a} with itself")
            return None
        place = self._place(name)
        places = self._place(a).actInv(place), self._place(b).actInv(place)
        tags, count = ("axis", "axis2"), _AXES.get(kind, 0)
        for path in (f"{tag}/dynamics/{key}" for tag in tags[count:] for key in _ACTING):
            if self._number(joint, joint, path, 0.0):
                self._refuse(joint, f"{kind}, and does not have the axis of its {path}")
        for tag in tags[:count]:
            if joint.find(tag) is None:
                text = f"{kind} without <{tag}>: read as about 0 0 1, which other tools refuse"
                self.notes.append(warning(f"joint {name}", text))
        axes = tuple(self._axis(joint, tag) for tag in tags[:count])
        kind = "universal" if kind == "revolute2" else kind
        graph_joint = GraphJoint(name, kind, (a, b), places)
        if axes:
            graph_joint = graph_joint._replace(axes=axes)
        if kind == "screw":
            graph_joint = graph_joint._replace(lead=self._lead(joint))
        return graph_joint

    def _lead(self, joint: ET.Element) -> float:
        """Metres of a screw in one turn; positive for a right-handed thread."""
        if joint.find("screw_thread_pitch") is None and joint.find("thread_pitch") is not None:
            old = self._number(joint, joint, "thread_pitch", 1.0)  # rad/m, of a left-handed thread
            if not old:
                self._refuse(joint, "its thread_pitch is 0")
                return 0.0
            return -2 * np.pi / old
        return self._number(joint, joint, "screw_thread_pitch", 1.0)

    def _direction(self, joint: ET.Element, tag: str) -> Array:
        """The direction of an axis, in the joint's frame."""
        axis = joint.find(tag)
        axis = ET.Element(tag) if axis is None else axis
        xyz = axis.find("xyz")
        direction = numbers("0 0 1" if xyz is None else xyz.text or "", 3)
        if direction is None or not np.linalg.norm(direction) > 1e-100:
            self._refuse(joint, f"its <{tag}> is not a direction")
            direction = np.array([0.0, 0.0, 1.0])
        frame = "" if xyz is None else xyz.get("expressed_in", "")
        old = str(self._minor < 5)
        if not frame and is_true(axis.findtext("use_parent_model_frame", old)):
            frame = _MODEL
        if frame:
            place = self._place(joint.get("name", ""))
            direction = place.rotation.T @ (self._place(frame).rotation @ direction)
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
        mimic, follows = axis.find("mimic"), dict[str, str]()
        if mimic is not None:
            factor = value("mimic/multiplier", 1.0)
            offset = value("mimic/offset") - factor * value("mimic/reference")
            follows["joint"] = self._axis_name(mimic.get("joint", ""), mimic.get("axis", "axis"))
            follows["multiplier"], follows["offset"] = repr(factor), repr(offset)
        return Axis(self._direction(joint, tag), limit, dynamics, follows)

    def _axis_name(self, joint: str, axis: str) -> str:
        """The joint of one axis that an axis of a joint becomes."""
        element = self._frames.get(joint)
        count = 1 if element is None else _AXES.get(element.get("type", ""), 1)
        return axis_names(joint, count)[1 if axis == "axis2" and count == 2 else 0]

    def _geared(self, gear: ET.Element, joints: list[GraphJoint]) -> list[GraphJoint]:
        """The joints with the coupling of a gear box.

        Angle 2, of the child on the reference body about axis 2, is -ratio times angle 1, of the
        parent there about axis 1. Both must be angles of hinges.
        """
        base = gear.findtext("gearbox_reference_body", "").strip()
        ratio = self._number(gear, gear, "gearbox_ratio", 1.0)
        first, second = (
            self._hinge(gear, joints, self._link_of(base), self._end(gear, side), tag)
            for side, tag in (("parent", "axis"), ("child", "axis2"))
        )
        if first is None or second is None:
            text = f"its links have no hinges about its axes on the body {base!r}"
            self._refuse(gear, f"{text}, between which the gear box acts")
            return joints
        (leader, sign_1), (follower, sign_2) = first, second
        factor = -ratio * sign_1 * sign_2
        axis = joints[follower].axes[0]
        if axis.mimic:
            self._refuse(gear, f"joint {joints[follower].name} mimics another joint already")
        mimic = {"joint": joints[leader].name, "multiplier": repr(factor), "offset": "0.0"}
        coupled = joints[follower]._replace(axes=(axis._replace(mimic=mimic),))
        return [*joints[:follower], coupled, *joints[follower + 1 :]]

    def _hinge(
        self, gear: ET.Element, joints: list[GraphJoint], base: str, link: str, tag: str
    ) -> tuple[int, float] | None:
        """The hinge of a link on a base, by its index, and its sense about an axis of the gear."""
        gear_axis = self._place(gear.get("name", "")).rotation @ self._direction(gear, tag)
        for k, joint in enumerate(joints):
            if joint.kind not in ("revolute", "continuous") or {*joint.links} != {base, link}:
                continue
            axis = self._place(joint.name).rotation @ joint.axes[0].direction
            sense = float(axis @ gear_axis)
            if abs(abs(sense) - 1) < 1e-9:
                return k, float(np.sign(sense)) * (1.0 if joint.links[0] == base else -1.0)
        return None

    # --- links ------------------------------------------------------------------------------

    def _add_links(self, graph: JointGraph) -> None:
        unknown = dict[str, list[str]]()
        for name, link in self._links.items():
            inertial = link.find("inertial")
            inertial = ET.Element("inertial") if inertial is None else inertial
            needed = ("mass", *(f"inertia/{key}" for key in ("ixx", "iyy", "izz")))
            if missing := ", ".join(key for key in needed if inertial.find(key) is None):
                unknown.setdefault(missing, []).append(name)
            values = {
                key: self._number(link, inertial, f"inertia/{key}", default)
                for key, default in _UNIT_INERTIA.items()
            }
            mass = self._number(link, inertial, "mass", 1.0)
            element = graph.add_link(name, self._fixed_pose(inertial, link), mass, values)
            if not is_true(link.findtext("gravity", "true")):
                ET.SubElement(
                    ET.SubElement(graph.urdf, "gazebo", reference=name), "gravity"
                ).text = "false"
            for tag in ("visual", "collision"):
                for shape in link.findall(tag):
                    place = self._shape_pose(name, shape)
                    element.extend(_shape(tag, shape, place, f"{name}_{len(element)}"))
        for missing, names in unknown.items():
            text = f"no {missing}: 1 kg and the unit inertia by the specification"
            self.notes.append(warning(f"links {listed(names)}", text))

    def _shape_pose(self, link: str, shape: ET.Element) -> pin.SE3:
        """The pose of a shape on its link."""
        pose = shape.find("pose")
        frame = "" if pose is None else pose.get("relative_to") or pose.get("frame", "")
        if not frame:
            return self._pose(shape)
        return self._place(link).actInv(self._place(frame)) * self._pose(shape)

    def _number(self, of: ET.Element, inside: ET.Element, path: str, default: float) -> float:
        text = inside.findtext(path, "").strip() or repr(default)
        if text.lstrip("+-").lower() in ("inf", "infinity"):
            return float(text)
        value = numbers(text, 1)
        if value is None:
            self._refuse(of, f"{path} {text!r} is not a number")
        return default if value is None else float(value[0])

    def _refuse(self, element: ET.Element, text: str) -> None:
        self._problems.append(f"{element.tag} {element.get('name')}: {text}")


#: Shapes that are drawn, and the names of their sizes in a URDF; others are left out.
_SHAPES: dict[str, dict[str, str]] = {
    "box": {"size": "size"},
    "cylinder": {"radius": "radius", "length": "length"},
    "sphere": {"radius": "radius"},
    "mesh": {"uri": "filename", "scale": "scale"},
}


def _shape(tag: str, shape: ET.Element, place: pin.SE3, name: str) -> Iterator[ET.Element]:
    """A shape as an element of a URDF; planes and height maps are left out."""
    geometry = shape.find("geometry")
    kind = next(iter(geometry), None) if geometry is not None else None
    if kind is None or kind.tag not in _SHAPES:
        return
    part = ET.Element(tag)
    ET.SubElement(part, "origin", origin_of(place))
    sizes = {to: (kind.findtext(key) or "").strip() for key, to in _SHAPES[kind.tag].items()}
    if kind.tag == "mesh":
        sizes["scale"] = sizes["scale"] or "1 1 1"
    ET.SubElement(ET.SubElement(part, "geometry"), kind.tag, sizes)
    if colour := shape.findtext("material/diffuse", "").strip():
        ET.SubElement(ET.SubElement(part, "material", name=name), "color", rgba=colour)
    yield part

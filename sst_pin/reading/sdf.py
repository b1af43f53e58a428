# SPDX-License-Identifier: BSD-2-Clause
"""Reads an SDF as the elements of a URDF."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from ..errors import DescriptionError
from .joint_graph import WORLD, Axis, GraphJoint, JointGraph, origin_of
from .known_words import is_true, unknown
from .problems import numbers, placement

#: Types of joints, by the number of their axes.
_AXES = {"revolute": 1, "continuous": 1, "prismatic": 1, "universal": 2, "revolute2": 2}
_KINDS = (*_AXES, "ball", "fixed")
#: Words that are read, or that do not act on the motion.
_WORDS = {
    "world": "@name gravity physics+ magnetic_field atmosphere wind scene light+ gui audio state+ "
    "include+ model+ frame+ road+ actor+ population+ spherical_coordinates plugin+",
    "wind": "linear_velocity=0",
    "model": "@name @placement_frame @canonical_link pose static self_collide allow_auto_disable "
    "enable_wind link+ joint+ frame+ plugin+ gripper+",
    "frame": "@name @attached_to pose",
    "pose": "@relative_to @frame @degrees @rotation_format",
    **dict.fromkeys(
        ("model/pose", "inertial/pose"), "@relative_to=0 @frame=0 @degrees @rotation_format"
    ),
    "link": "@name pose inertial visual+ collision+ sensor+ light+ projector+ particle_emitter+ "
    "audio_sink+ audio_source+ battery+ contact self_collide enable_wind must_be_base_link "
    "gravity=1 kinematic=0 velocity_decay",
    "velocity_decay": "linear=0 angular=0",
    "inertial": "@auto=0 @density pose mass inertia density auto_inertia_params",
    "inertia": "ixx ixy ixz iyy iyz izz",
    "joint": "@name @type parent child pose axis axis2 sensor+ physics",
    **dict.fromkeys(
        ("axis", "axis2"), "xyz limit dynamics mimic use_parent_model_frame initial_position"
    ),
    "xyz": "@expressed_in",
    "limit": "lower upper effort velocity stiffness dissipation",
    "dynamics": "damping friction spring_stiffness spring_reference",
    "mimic": "@joint @axis multiplier offset reference",
}
_ACTING = ("damping", "friction", "spring_stiffness")
#: Plugins that exert no force but a motor's.
_FORCELESS = re.compile(
    "altimeter|applyjointforce|battery|breadcrumb|camera|comms|contact|control|detector|drive|"
    "forcetorque|(?<![a-z])imu|label|magnetometer|monitor|navsat|physics|publisher|scene|sensor|"
    "steering|usercommands"
)


class Sdf:
    """The model of an SDF; its base is the world of the SDF."""

    def __init__(self, root: ET.Element, source: str) -> None:
        self._source, version = source, root.get("version", "1.7").strip()
        minor = re.fullmatch(r"1\.(\d+)(\.\d+)?", version)
        if minor is None:
            raise DescriptionError(source, [f"version {version!r} is none of SDF, such as 1.12"])
        self._old, worlds = int(minor[1]) < 5, root.findall("world")
        models = [*root.findall("model"), *root.findall("world/model")]
        models = [model for model in models if not is_true(model.findtext("static"))]
        for what, elements in (("models that move", models), ("worlds", worlds)):
            if len(elements) > 1 or not models:
                raise DescriptionError(source, [f"{len(elements)} {what}; one is needed"])
        (self._model,), self._problems = models, list[str]()
        self._links = {e.get("name", ""): e for e in self._model.findall("link")}
        frames = (e for tag in ("link", "frame", "joint") for e in self._model.findall(tag))
        self._frames = {element.get("name", ""): element for element in frames}
        self._require_known(worlds)
        old = root.findtext("world/physics/gravity")  # until version 1.4
        text = root.findtext("world/gravity", "0 0 -9.81" if old is None else old)
        self._gravity = numbers(text, 3)
        if self._gravity is None:
            self._problems.append(f"gravity {text!r} is not three numbers")
        self._at: dict[str, pin.SE3 | None] = {"__model__": pin.SE3.Identity()}
        placed = self._place(self._model.get("placement_frame") or "__model__")
        self._at[WORLD] = placed * self._pose(self._model).inverse()

    def graph(self) -> JointGraph:
        """The robot as joints between bodies; all problems in one DescriptionError."""
        joints = [j for e in self._model.findall("joint") if (j := self._joint(e)) is not None]
        world = self._place(WORLD)
        rest = {name: world.actInv(self._place(name)) for name in self._links}
        graph = JointGraph(self._model.get("name", ""), joints, rest)
        for name, element in self._links.items():
            self._link(graph, name, element)
        if problems := dict.fromkeys([*self._problems, *graph.problems]):
            raise DescriptionError(self._source, problems)
        graph.gravity = np.asarray(self._gravity)
        return graph

    def _require_known(self, worlds: list[ET.Element]) -> None:
        self._problems += [f"model: {text}" for text in unknown(self._model, _WORDS)]
        table = {tag: row for tag, row in _WORDS.items() if tag != "model"}  # others are static
        self._problems += [f"world: {text}" for world in worlds for text in unknown(world, table)]
        for plugin in (e for parent in (*worlds, self._model) for e in parent.findall("plugin")):
            name = f"{plugin.get('name')} {plugin.get('filename')}"
            if not _FORCELESS.search(re.sub("[-_]", "", name.lower())):
                text = f"plugin {name}: forces of plugins are not read; delete it if it has none"
                self._problems.append(text)

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

    def _place(self, name: str) -> pin.SE3:
        """A frame in the frame of the model."""
        if name not in self._at:
            self._at[name] = None  # being found
            element = self._frames.get(name)
            if element is None:
                self._problems.append(f"frame {name} is not in this model")
                return pin.SE3.Identity()
            pose = element.find("pose")
            base = "" if pose is None else pose.get("relative_to") or pose.get("frame", "")
            if not base:
                base = element.get("attached_to") or "__model__"
                base = self._end(element, "child") if element.tag == "joint" else base
            self._at[name] = self._place(base) * self._pose(element)
        place = self._at[name]
        if place is None:
            self._problems.append(f"frame {name}: its pose is relative to itself")
            return pin.SE3.Identity()
        return place

    def _end(self, joint: ET.Element, side: str) -> str:
        """The link, or the world, that a joint connects."""
        name = joint.findtext(side, "").strip()
        for _ in self._frames:  # a frame may be attached to a frame
            element = self._frames.get(name)
            if element is None or element.tag == "link":
                break
            attached = element.get("attached_to") or self._model.get("canonical_link", "")
            name = attached or next(iter(self._links), "")
        if name not in self._links and name != WORLD:
            self._refuse(joint, f"its {side} {name!r} is not a link of this model")
        return name

    def _joint(self, joint: ET.Element) -> GraphJoint | None:
        name, kind = joint.get("name", ""), joint.get("type", "")
        a, b = (self._end(joint, side) for side in ("parent", "child"))
        if kind not in _KINDS:
            self._refuse(joint, f"type {kind!r} is not supported; supported: {', '.join(_KINDS)}")
        if kind not in _KINDS or not {a, b} <= {WORLD, *self._links}:
            return None
        place = self._place(name)
        places = self._place(a).actInv(place), self._place(b).actInv(place)
        kind = "universal" if kind == "revolute2" else kind
        tags, count = ("axis", "axis2"), _AXES.get(kind, 0)
        for path in (f"{tag}/dynamics/{key}" for tag in tags[count:] for key in _ACTING):
            if self._number(joint, joint, path, 0.0):
                self._refuse(joint, f"{kind}, and does not have the axis of its {path}")
        graph_joint = GraphJoint(name, kind, (a, b), places)
        axes = tuple(self._axis(joint, tag) for tag in tags[:count])
        return graph_joint._replace(axes=axes) if count else graph_joint

    def _axis(self, joint: ET.Element, tag: str) -> Axis:
        """An axis, in the joint's frame."""
        axis = joint.find(tag)
        axis = ET.Element(tag) if axis is None else axis
        xyz = axis.find("xyz")
        direction = numbers("0 0 1" if xyz is None else xyz.text or "", 3)
        if direction is None or not np.linalg.norm(direction) > 1e-100:
            self._refuse(joint, f"its <{tag}> is not a direction")
            direction = np.array([0.0, 0.0, 1.0])
        of_model = is_true(axis.findtext("use_parent_model_frame", str(self._old)))
        frame = "" if xyz is None else xyz.get("expressed_in", "")
        if frame := frame or "__model__" * of_model:
            place = self._place(joint.get("name", ""))
            direction = place.rotation.T @ (self._place(frame).rotation @ direction)

        def value(path: str, default: float = 0.0) -> float:
            return self._number(joint, axis, path, default)

        limit = {"lower": value("limit/lower", -np.inf), "upper": value("limit/upper", np.inf)}
        limit |= {key: value(f"limit/{key}") for key in ("effort", "velocity")}
        if limit["lower"] > limit["upper"]:
            self._refuse(joint, "its lower limit is above the upper one")
        dynamics = {key: value(f"dynamics/{key}") for key in (*_ACTING, "spring_reference")}
        mimic, follows = axis.find("mimic"), dict[str, str]()
        if mimic is not None:
            factor = value("mimic/multiplier", 1.0)
            offset = value("mimic/offset") - factor * value("mimic/reference")
            follows = {"joint": mimic.get("joint", ""), "multiplier": repr(factor)}
            follows["offset"] = repr(offset)
            if mimic.get("axis", "axis") != "axis":
                self._refuse(joint, "mimics the second axis of a joint, which is not supported")
        return Axis(direction / np.linalg.norm(direction), limit, dynamics, follows)

    def _link(self, graph: JointGraph, name: str, link: ET.Element) -> None:
        inertial = link.find("inertial")
        inertial = ET.Element("inertial") if inertial is None else inertial
        needed = ("mass", *(f"inertia/{key}" for key in ("ixx", "iyy", "izz")))
        if missing := ", ".join(key for key in needed if inertial.find(key) is None):
            self._refuse(link, f"no {missing}, for which SDF has 1; write it")
        entries = _WORDS["inertia"].split()
        values = {key: self._number(link, inertial, f"inertia/{key}", 0.0) for key in entries}
        mass = self._number(link, inertial, "mass", 1.0)
        element = graph.add_link(name, self._pose(inertial), mass, values)
        for tag in ("visual", "collision"):
            for shape in link.findall(tag):
                place = graph.frames[name].actInv(self._pose(shape))
                element.extend(_shape(tag, shape, place, f"{name}_{len(element)}"))

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

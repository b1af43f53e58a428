# SPDX-License-Identifier: BSD-2-Clause
"""An SDF to the elements of a URDF: what is no tree there becomes joints that close loops."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import DescriptionError
from .problems import numbers

Array = NDArray[np.float64]

_ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_ONE_AXIS = ("revolute", "continuous", "prismatic")
_TWO_AXES = ("universal", "revolute2")
_KINDS = (*_ONE_AXIS, *_TWO_AXES, "ball", "fixed")
#: Limit from which a joint has none, [rad] or [m].
_WIDE = 1e9


class Sdf:
    """The model of an SDF.

    Attributes:
        gravity: Acceleration of gravity of its world, [m/s^2]; None without.
        balls: Names of its ball joints in the tree, which a URDF does not have.

    Raises:
        DescriptionError: With every problem found.
    """

    def __init__(self, root: ET.Element, source: str) -> None:
        gravity, version = root.findtext("world/gravity"), root.get("version", "1.7").strip()
        self.gravity, self.balls = numbers(gravity or "", 3), list[str]()
        self._problems: list[str] = []
        if gravity is not None and self.gravity is None:
            self._problems.append(f"gravity {gravity!r} is not three numbers")
        minor = re.fullmatch(r"1\.(\d+)(\.\d+)?", version)
        if minor is None:
            raise DescriptionError(source, [f"version {version!r} is none of SDF, such as 1.12"])
        self._old = int(minor[1]) < 5
        models = [*root.findall("model"), *root.findall("world/model")]
        models = [model for model in models if model.findtext("static", "").strip() != "true"]
        if len(models) != 1:
            raise DescriptionError(source, [f"{len(models)} models that move; one is needed"])
        self._source, (self._model,) = source, models
        for tag in ("model", "include"):
            if self._model.find(tag) is not None:
                raise DescriptionError(source, [f"<{tag}> inside a model is not supported"])
        self._links = {e.get("name", ""): e for e in self._model.findall("link")}
        self._frames = {
            element.get("name", ""): element
            for tag in ("link", "frame", "joint")
            for element in self._model.findall(tag)
        }
        self._at: dict[str, pin.SE3 | None] = {"__model__": pin.SE3.Identity()}
        self._at["world"] = self._pose(self._model).inverse()

    def urdf(self) -> ET.Element:
        """The elements of a URDF, its base the world of the SDF."""
        urdf = ET.Element("robot", name=self._model.get("name", ""))
        ET.SubElement(urdf, "link", name="world")
        own: dict[str, pin.SE3] = {"world": self._place("world")}
        left = list(self._model.findall("joint"))
        while not self._links.keys() <= own.keys() and not self._problems:
            found = next(self._next(left, own), None)
            if found is None:  # nothing holds this link: it floats
                link = next(name for name in self._links if name not in own)
                own[link] = self._place(link)
                name = "floating_base" if len(own) == 2 else f"{link}_floats"
                self._joint(urdf, name, "floating", "world", link, own)
            else:
                left.remove(found)
                self._branch(urdf, found, own)
        for joint in left:
            self._cut(urdf, joint, own)
        for name, element in self._links.items():
            self._link(urdf, element, own.get(name, pin.SE3.Identity()))
        if self._problems:
            raise DescriptionError(self._source, self._problems)
        return urdf

    # --- frames -----------------------------------------------------------------------------

    def _pose(self, element: ET.Element) -> pin.SE3:
        """The pose that an element has, relative to whatever it is given."""
        pose = element.find("pose")
        text = "" if pose is None else pose.text or ""
        values = numbers(text or "0 0 0 0 0 0", 7 if len(text.split()) == 7 else 6)
        if values is None:
            self._told(element, f"its pose {text!r} is not six or seven numbers")
            return pin.SE3.Identity()
        if len(values) == 7:
            return pin.SE3(pin.Quaternion(values[3:]).normalized().matrix(), values[:3])
        degrees = pose is not None and pose.get("degrees", "") in ("true", "1")
        return pin.SE3(
            pin.rpy.rpyToMatrix(np.deg2rad(values[3:]) if degrees else values[3:]), values[:3]
        )

    def _place(self, name: str) -> pin.SE3:
        """A frame in the frame of the model."""
        if name not in self._at:
            self._at[name] = None  # being found
            element = self._frames.get(name)
            if element is None:
                self._problems.append(f"frame {name} is not in this model")
                return pin.SE3.Identity()
            pose = element.find("pose")
            given = "" if pose is None else pose.get("relative_to") or pose.get("frame", "")
            if not given:
                given = element.get("attached_to") or "__model__"
                given = self._end(element, "child") if element.tag == "joint" else given
            self._at[name] = self._place(given) * self._pose(element)
        found = self._at[name]
        if found is None:
            self._problems.append(f"frame {name}: its pose is relative to itself")
            return pin.SE3.Identity()
        return found

    def _end(self, joint: ET.Element, side: str) -> str:
        """The link, or the world, that a joint connects."""
        name = joint.findtext(side, "").strip()
        for _ in self._frames:  # a frame may be attached to a frame
            element = self._frames.get(name)
            if element is None or element.tag == "link":
                break
            attached = element.get("attached_to") or self._model.get("canonical_link", "")
            name = attached or next(iter(self._links), "")
        if name not in self._links and name != "world":
            self._told(joint, f"its {side} {name!r} is not a link of this model")
        return name

    def _axes(self, joint: ET.Element) -> list[Array]:
        """The axes of a joint, in its frame."""
        found = []
        for tag in ("axis", "axis2")[: 2 if joint.get("type") in _TWO_AXES else 1]:
            xyz = joint.find(f"{tag}/xyz")
            axis = numbers("0 0 1" if xyz is None else xyz.text or "", 3)
            if axis is None or not np.linalg.norm(axis) > 1e-100:
                self._told(joint, f"its <{tag}> is not a direction")
                axis = np.array([0.0, 0.0, 1.0])
            model = joint.findtext(f"{tag}/use_parent_model_frame", str(self._old)).strip().lower()
            frame = "" if xyz is None else xyz.get("expressed_in", "")
            frame = frame or ("__model__" if model in ("true", "1") else "")
            if frame:
                axis = self._place(joint.get("name", "")).rotation.T @ (
                    self._place(frame).rotation @ axis
                )
            found.append(axis / np.linalg.norm(axis))
        return found

    # --- joints -----------------------------------------------------------------------------

    def _next(self, joints: list[ET.Element], own: dict[str, pin.SE3]) -> Iterator[ET.Element]:
        """Joints that add a link to the tree; first those of the links that came first."""
        for link in own:
            for joint in joints:
                ends = [self._end(joint, side) for side in ("parent", "child")]
                if link in ends and (ends[0] in own) != (ends[1] in own):
                    yield joint

    def _branch(self, urdf: ET.Element, joint: ET.Element, own: dict[str, pin.SE3]) -> None:
        """A joint of the tree, and the place of the link that it adds."""
        name, kind = joint.get("name", ""), joint.get("type", "")
        parent, child = (self._end(joint, side) for side in ("parent", "child"))
        reverse = child in own
        if reverse:
            parent, child = child, parent
        own[child] = self._place(name)
        if kind not in _KINDS:
            self._told(joint, f"type {kind!r} is not supported; supported: {', '.join(_KINDS)}")
        elif kind == "ball":
            self.balls.append(name)
            made = self._joint(urdf, name, "revolute", parent, child, own, np.eye(3)[2])
            wide = {"lower": repr(-_WIDE), "upper": repr(_WIDE), "effort": "0", "velocity": "0"}
            ET.SubElement(made, "limit", wide)
        elif kind == "fixed":
            self._joint(urdf, name, kind, parent, child, own)
        else:
            axes, tags = self._axes(joint), ["axis", "axis2"]
            names = [name] if kind in _ONE_AXIS else [f"{name}_1", f"{name}_2"]
            steps = list(zip(names, axes, tags, strict=False))[:: -1 if reverse else 1]
            for step, axis, tag in steps:
                last = step == steps[-1][0]
                link = child if last else f"{name}_cross"
                if not last:
                    ET.SubElement(urdf, "link", name=link)
                    own[link] = own[child]
                shown = kind if kind in _ONE_AXIS else "revolute"
                sign = -1 if reverse else 1
                made = self._joint(urdf, step, shown, parent, link, own, sign * axis)
                self._details(made, joint, tag, sign)
                parent = link

    def _joint(
        self,
        urdf: ET.Element,
        name: str,
        kind: str,
        parent: str,
        child: str,
        own: dict[str, pin.SE3],
        axis: Array | None = None,
    ) -> ET.Element:
        joint = ET.SubElement(urdf, "joint", name=name, type=kind)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "origin", origin_of(own[parent].actInv(own[child])))
        if axis is not None:
            ET.SubElement(joint, "axis", xyz=text_of(axis))
        return joint

    def _details(self, made: ET.Element, joint: ET.Element, tag: str, sign: int) -> None:
        """Limits, friction and mimicry of one axis."""
        axis = joint.find(tag)
        axis = ET.Element(tag) if axis is None else axis
        value = {
            key: self._number(joint, axis, key, default)
            for key, default in {
                "limit/lower": -np.inf,
                "limit/upper": np.inf,
                "limit/effort": -1.0,
                "limit/velocity": -1.0,
                "dynamics/damping": 0.0,
                "dynamics/friction": 0.0,
                "dynamics/spring_stiffness": 0.0,
                "mimic/multiplier": 1.0,
                "mimic/offset": 0.0,
                "mimic/reference": 0.0,
            }.items()
        }
        if value["dynamics/spring_stiffness"]:
            self._told(joint, "springs are not read; give stiffness= to ClosedChain")
        if value["limit/lower"] > value["limit/upper"]:
            self._told(joint, "its lower limit is above the upper one")
        low, high = sorted((sign * value["limit/lower"], sign * value["limit/upper"]))
        free = low <= -_WIDE and high >= _WIDE
        if free and made.get("type") == "revolute":
            made.set("type", "continuous")
        limit = {"lower": low, "upper": high}
        limit |= {key: max(value[f"limit/{key}"], 0.0) for key in ("effort", "velocity")}
        limit = {key: float(np.clip(x, -_WIDE, _WIDE)) for key, x in limit.items()}
        limit |= {key: 0.0 for key in ("effort", "velocity") if limit[key] >= _WIDE}
        ET.SubElement(made, "limit", {key: repr(x) for key, x in limit.items()})
        keys = ("damping", "friction")
        ET.SubElement(made, "dynamics", {key: repr(value[f"dynamics/{key}"]) for key in keys})
        mimic = axis.find("mimic")
        if mimic is not None:
            factor = sign * value["mimic/multiplier"]
            offset = sign * value["mimic/offset"] - factor * value["mimic/reference"]
            leader = mimic.get("joint", "")
            ET.SubElement(made, "mimic", joint=leader, multiplier=repr(factor), offset=repr(offset))
            if sign < 0 or mimic.get("axis", "axis") != "axis":
                self._told(joint, "mimics another joint in a way that is not supported")

    def _cut(self, urdf: ET.Element, joint: ET.Element, own: dict[str, pin.SE3]) -> None:
        """A joint that closes a loop."""
        kind, ends = joint.get("type", ""), [self._end(joint, side) for side in ("parent", "child")]
        if kind == "revolute2":
            kind = "universal"
        if any(end not in own for end in ends):
            return
        cut = ET.SubElement(urdf, "constraint", name=joint.get("name", ""), type=kind)
        axes = self._axes(joint)
        place = self._place(joint.get("name", ""))
        for side, end, axis in zip(("parent", "child"), ends, (axes[0], axes[-1]), strict=True):
            ET.SubElement(cut, side, link=end)
            ET.SubElement(cut, f"{side}_origin", origin_of(own[end].actInv(place)))
            ET.SubElement(cut, f"{side}_axis", xyz=text_of(axis))
        if kind == "universal" and abs(axes[0] @ axes[1]) > 1e-9:
            self._told(joint, "closes a loop with two axes that are not at a right angle")
        for tag in ("damping", "friction", "spring_stiffness"):
            if any(
                self._number(joint, joint, f"{a}/dynamics/{tag}", 0.0) for a in ("axis", "axis2")
            ):
                self._told(joint, f"closes a loop and has {tag}, which is not supported")

    # --- links ------------------------------------------------------------------------------

    def _link(self, urdf: ET.Element, link: ET.Element, own: pin.SE3) -> None:
        made = ET.SubElement(urdf, "link", name=link.get("name", ""))
        at = own.actInv(self._place(link.get("name", "")))
        inertial = link.find("inertial")
        entries = {
            key: None if inertial is None else inertial.findtext(key)
            for key in ("mass", *(f"inertia/{key}" for key in ("ixx", "iyy", "izz")))
        }
        if inertial is None or None in entries.values():
            missing = ", ".join(key for key, text in entries.items() if text is None)
            self._told(link, f"no {missing}, for which SDF has 1; write it")
            return
        part = ET.SubElement(made, "inertial")
        ET.SubElement(part, "origin", origin_of(at * self._pose(inertial)))
        ET.SubElement(part, "mass", value=repr(self._number(link, inertial, "mass", 1.0)))
        values = {key: self._number(link, inertial, f"inertia/{key}", 0.0) for key in _ENTRIES}
        ET.SubElement(part, "inertia", {key: repr(x) for key, x in values.items()})
        for tag in ("visual", "collision"):
            for shape in link.findall(tag):
                self._shape(made, tag, shape, at)

    def _shape(self, made: ET.Element, tag: str, shape: ET.Element, at: pin.SE3) -> None:
        """A shape; planes, height maps and others are left out, because they only look."""
        geometry = shape.find("geometry")
        kind = next(iter(geometry)) if geometry is not None and len(geometry) else None
        keys: dict[str, dict[str, str]] = {
            "box": {"size": "size"},
            "cylinder": {"radius": "radius", "length": "length"},
            "sphere": {"radius": "radius"},
            "mesh": {"uri": "filename", "scale": "scale"},
        }
        if kind is None or kind.tag not in keys:
            return
        part = ET.SubElement(made, tag)
        ET.SubElement(part, "origin", origin_of(at * self._pose(shape)))
        given = {to: (kind.findtext(key) or "").strip() for key, to in keys[kind.tag].items()}
        if kind.tag == "mesh":
            given["scale"] = given["scale"] or "1 1 1"
        ET.SubElement(ET.SubElement(part, "geometry"), kind.tag, given)
        if colour := shape.findtext("material/diffuse", "").strip():
            material = ET.SubElement(part, "material", name=f"{made.get('name')}_{len(made)}")
            ET.SubElement(material, "color", rgba=colour)

    def _number(self, of: ET.Element, inside: ET.Element, path: str, default: float) -> float:
        text = inside.findtext(path)
        if text is None or not text.strip():
            return default
        if text.strip().lstrip("+-").lower() in ("inf", "infinity"):
            return float(text)
        value = numbers(text, 1)
        if value is None:
            self._told(of, f"{path} {text!r} is not a number")
            return default
        return float(value[0])

    def _told(self, element: ET.Element, text: str) -> None:
        problem = f"{element.tag} {element.get('name')}: {text}"
        if problem not in self._problems:
            self._problems.append(problem)


def origin_of(place: pin.SE3) -> dict[str, Any]:
    """Attributes of the `<origin>` of a URDF."""
    return {"xyz": text_of(place.translation), "rpy": text_of(pin.rpy.matrixToRpy(place.rotation))}


def text_of(vector: Array) -> str:
    """Numbers with blanks between, as many digits as they have."""
    return " ".join(map(repr, map(float, vector)))

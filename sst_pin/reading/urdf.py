# SPDX-License-Identifier: BSD-2-Clause
"""Reads a URDF as a Pinocchio model, couplings of its mimic joints and shapes."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError, InputError
from ..model.closures import Coupling
from ..model.weight_shares import Link, shares_of_links
from .acting_elements import unread_elements
from .joint_kinds import with_kinds
from .loop_elements import loop_elements
from .problems import ALIKE, attribute, number, numbers, placement
from .sdf import read_sdf
from .text import parse_almost_xml, read_text, with_elements
from .tool_elements import is_weightless, joint_numbers, links_without_gravity, mimics_of
from .urdf_checks import check
from .urdf_defaults import WIDE, add_defaults

#: Parts that urdfdom reads of a fixed joint, and of a joint that moves.
_PARTS_OF_FIXED_JOINTS = ("origin", "parent", "child")
_PARTS_OF_JOINTS = (*_PARTS_OF_FIXED_JOINTS, "axis", "limit", "dynamics")
#: Largest number of moving joints. Pinocchio's data have arrays with the cube of it: some 4 GB.
MOST_JOINTS = 400


class Urdf:
    """A URDF, or an SDF in the form of a URDF, read and parsed once.

    Attributes:
        source: Its path, or another name for messages.
        root: Its elements; they must not be changed.
        gravity: In base axes, shape (3,), [m/s^2].
        numbers: Springs and rotors of its joints.
        loop_elements: Joints that close loops, and gears.
        helpers: Names of links without mass that are added to an SDF; see `JointGraph`.
        notices: Warnings of content that is read otherwise or not at all, for everyone who reads
            the file.
        problems: All errors, warnings and notes, the notices among them.
    """

    def __init__(self, text: str, source: str, model: str | None = None) -> None:
        self.source = source
        self._format = "an SDF" if "<sdf" in text else "a URDF"  # for messages
        self.root, notices = parse_almost_xml(text, source, self._format)
        self.gravity = np.array([0, 0, -9.81])
        self._balls = list[str]()  # names of joints of an SDF that are no hinges, but balls
        self.helpers: list[str] = []
        is_sdf = self.root.tag == "sdf"
        if is_sdf:
            sdf = read_sdf(self.root, source, model)
            self.root = sdf.graph.urdf
            self.gravity = sdf.gravity
            self._balls = sdf.graph.balls
            self.helpers = sdf.graph.helpers
            notices += sdf.notes
        elif model is not None:
            raise InputError("model", "only an SDF has several models")
        if is_weightless(self.root):
            self.gravity = np.zeros(3)
        notices += add_defaults(self.root)
        notices += unread_elements(self.root)
        self.numbers = joint_numbers(self.root)
        self.loop_elements = loop_elements(self.root)
        self.notices = tuple(notice for notice in notices if notice.severity != "error")
        self.problems = (*notices, *check(self.root), *self.loop_elements.problems)

    @classmethod
    def read(cls, path: str | Path, model: str | None = None) -> "Urdf":
        """The URDF in a file, or a model of an SDF."""
        return cls(read_text(path, "URDF"), str(path), model)

    @property
    def joint_names(self) -> list[str]:
        """Names of all joints, in the order of the file."""
        return [joint.get("name", "") for joint in self.root.findall("joint")]

    @property
    def mimics(self) -> tuple[Coupling, ...]:
        """A coupling for each joint that mimics another: multiplier and offset."""
        couplings = list[Coupling]()
        for mimic in mimics_of(self.root):
            # The coefficients of q^0 and q^1 of the leader.
            polynomials = {mimic.leader: (0.0, float(mimic.multiplier))}
            couplings.append(Coupling(mimic.follower, polynomials, float(mimic.offset)))
        return tuple(couplings)

    def weight_shares(self, model: pin.Model) -> dict[str, Array]:
        """Shares of the weights in a tree of this URDF, by joint; see `model.weight_shares`.

        Links without gravity have no weight. Empty if all links have their weight, or if none has:
        then the gravity of the robot is zero.
        """
        without_gravity = links_without_gravity(self.root)
        if not without_gravity or is_weightless(self.root):
            return {}
        links = list[Link]()
        for element in self.root.findall("link"):
            name = element.get("name", "")
            frame = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
            center = numbers(attribute(element, "inertial/origin/xyz") or "0 0 0", 3)
            assert center is not None  # `urdf_checks` reports other texts
            link = Link(
                joint=frame.parentJoint,
                mass=number(element.find("inertial/mass"), "value") or 0.0,
                center=frame.placement.act(center),
                share=0.0 if name in without_gravity else 1.0,
            )
            links.append(link)
        return shares_of_links(model, links)

    def tree(self, kinds: Mapping[str, str] | None = None) -> pin.Model:
        """The Pinocchio model; an error names every error of `problems`.

        A `continuous` joint is read as a revolute one without limits: one angle, where Pinocchio
        would have its cosine and sine. A joint that mimics another is free here; see `mimics`.
        `kinds` has the true kinds of joints by name, see `joint_kinds`; a universal joint becomes
        a joint for each axis, `name_X` and `name_Y`.
        """
        kinds = {**dict.fromkeys(self._balls, "BALL"), **(kinds or {})}
        problems = [*self._errors(), *self._wrong_kinds(kinds)]
        root = _elements_for_dynamics(self.root, kinds)
        moving = sum(joint.get("type") != "fixed" for joint in root.findall("joint"))
        if moving > MOST_JOINTS:
            problems.append(f"{moving} moving joints; at most {MOST_JOINTS} are supported")
        if problems:
            raise DescriptionError(self.source, problems)

        # The tree: first each joint has one axis, then joints get their true kinds. The last frames
        # are those of Drake.
        try:
            model = pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))
        except (ValueError, RuntimeError) as error:
            raise DescriptionError(self.source, [f"not {self._format}: {error}"]) from None
        model = with_kinds(model, self.root, kinds, self.source)
        for frame in self.root.findall("frame"):
            _add_drake_frame(model, frame)
        return model

    def _errors(self) -> Iterator[str]:
        """The errors among the problems, as texts."""
        for problem in self.problems:
            if problem.severity == "error":
                where = f"not {self._format}" if problem.where == "file" else problem.where
                yield f"{where}: {problem.text}"

    def _wrong_kinds(self, kinds: Mapping[str, str]) -> Iterator[str]:
        """Problems of the joints in `kinds` that the file does not have, or that it fixes."""
        names = self.joint_names
        for name in kinds:
            if name in names:
                continue
            text = f"joint {name} is missing"
            similar = get_close_matches(name, names, 1, ALIKE)
            if similar:
                text += f"; {similar[0]} is meant?"
            yield text
        for element in self.root.iterfind("joint[@type='fixed']"):
            name = element.get("name", "")
            kind = kinds.get(name, "FIXED")
            if kind != "FIXED":
                yield f"joint {name}: {kind}, but fixed in the URDF; make it revolute"


def _elements_for_dynamics(root: ET.Element, kinds: Mapping[str, str]) -> ET.Element:
    """A copy of the elements that affect the dynamics, in the form for urdfdom.

    Joints of the kind "FIXED" are fixed in it, and no joint is continuous.
    """
    root_copy = with_elements(root, {"link": ("inertial",), "joint": _PARTS_OF_JOINTS})
    for joint in root_copy.findall("joint"):
        for dynamics in joint.findall("dynamics"):  # urdfdom needs one of its attributes
            dynamics.attrib.setdefault("damping", "0")
        kind = kinds.get(joint.get("name", ""), "")
        if joint.get("type") == "fixed" or kind == "FIXED":
            joint.set("type", "fixed")
            joint[:] = [child for child in joint if child.tag in _PARTS_OF_FIXED_JOINTS]
        elif joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ET.SubElement(joint, "limit", effort="0", velocity="0")
            limit.attrib.update(lower=f"-{WIDE}", upper=WIDE)
    return root_copy


def _add_drake_frame(model: pin.Model, element: ET.Element) -> None:
    """Add a `<frame>` of Drake, which is fixed to a link."""
    xyz = numbers(element.get("xyz", "0 0 0"), 3)
    rpy = numbers(element.get("rpy", "0 0 0"), 3)
    assert xyz is not None  # `urdf_checks` reports other texts
    assert rpy is not None
    link = model.frames[model.getFrameId(element.get("link", ""), pin.FrameType.BODY)]
    on_joint = link.placement * placement(xyz, rpy)
    name = element.get("name", "")
    model.addFrame(pin.Frame(name, link.parentJoint, on_joint, pin.FrameType.OP_FRAME))

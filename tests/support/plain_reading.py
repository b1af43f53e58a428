# SPDX-License-Identifier: BSD-2-Clause
"""Descriptions read once more, strictly and with other means, and torques by other means.

Whoever reads a description differently than these few lines is wrong, or should have refused it.
"""

import re
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

import sst_pin
from sst_pin.verification.lagrange import LagrangeMultipliers

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)


class UnreadableError(Exception):
    """A description that no reader may take."""


def numbers(text: str, count: int) -> np.ndarray:
    """A given count of finite decimal numbers."""
    words = text.split()
    if len(words) != count or not all(_NUMBER.fullmatch(word) for word in words):
        raise UnreadableError(text)
    values = np.array([float(word) for word in words])
    if not np.isfinite(values).all():
        raise UnreadableError(text)
    return values


def model_of(urdf: str) -> pin.Model:
    """The tree of a URDF, a frame for each of its links."""
    root = ET.fromstring(urdf)
    links = {link.get("name"): link for link in root.findall("link")}
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    if len(links) != len(root.findall("link")) or len(joints) != len(root.findall("joint")):
        raise UnreadableError("a name twice")
    if not links or None in links or None in joints:
        raise UnreadableError("no name")
    children: dict[str, list[ET.Element]] = {}
    borne = set()
    for joint in joints.values():
        parent, child = (joint.find(end).get("link") for end in ("parent", "child"))
        if {parent, child} - set(links) or child in borne:
            raise UnreadableError("not a tree")
        children.setdefault(parent, []).append(joint)
        borne.add(child)
    (base,) = set(links) - borne
    model = pin.Model()

    def add(name: str, joint: int, placement: pin.SE3) -> None:
        model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.BODY))
        inertial = links[name].find("inertial")
        if inertial is not None:
            model.appendBodyToJoint(joint, _inertia(inertial), placement)
        for element in children.get(name, []):
            at = placement * _placement(element)
            child = element.find("child").get("link")
            if element.get("type") == "fixed":
                add(child, joint, at)
            else:
                number = model.addJoint(joint, _joint(element), at, element.get("name"))
                add(child, number, pin.SE3.Identity())

    add(base, 0, pin.SE3.Identity())
    if len(model.frames) - 1 != len(links):
        raise UnreadableError("a ring of links")
    for i, name in enumerate(list(model.names)[1:]):
        dynamics = joints[name].find("dynamics")
        given = {} if dynamics is None else dynamics.attrib
        model.damping[i] = numbers(given.get("damping", "0"), 1)[0]
        model.friction[i] = numbers(given.get("friction", "0"), 1)[0]
    return model


def _joint(element: ET.Element) -> pin.JointModel:
    kinds = {
        "revolute": pin.JointModelRevoluteUnaligned,
        "continuous": pin.JointModelRevoluteUnaligned,
        "prismatic": pin.JointModelPrismaticUnaligned,
    }
    axis = element.find("axis")
    direction = numbers("1 0 0" if axis is None else axis.get("xyz", "1 0 0"), 3)
    if element.get("type") not in kinds or not direction.any():
        raise UnreadableError("joint")
    return kinds[element.get("type")](direction / np.linalg.norm(direction))


def _placement(element: ET.Element) -> pin.SE3:
    origin = element.find("origin")
    given = {} if origin is None else origin.attrib
    rpy = numbers(given.get("rpy", "0 0 0"), 3)
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), numbers(given.get("xyz", "0 0 0"), 3))


def _inertia(inertial: ET.Element) -> pin.Inertia:
    given = inertial.find("inertia").attrib
    axes = ("xx", "xy", "xz", "yy", "yz", "zz")
    xx, xy, xz, yy, yz, zz = (numbers(given[f"i{a}"], 1)[0] for a in axes)
    mass = numbers(inertial.find("mass").get("value"), 1)[0]
    if mass < 0:
        raise UnreadableError("negative mass")
    body = pin.Inertia.FromDynamicParameters(np.array((1, 0, 0, 0, xx, xy, yy, xz, yz, zz)))
    body.mass = mass  # impossible inertias as well, which the constructor refuses
    return _placement(inertial).act(body)


class _StrictLoader(yaml.SafeLoader):
    """Refuses a key that appears twice."""

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        keys = [key.value for key, _ in node.value]
        if len(set(map(str, keys))) != len(keys):
            raise UnreadableError("a key twice")
        return super().construct_mapping(node, deep)


def torques_of(
    urdf: str, cuts: str, chain: sst_pin.ClosedChain, q: np.ndarray, va: np.ndarray, aa: np.ndarray
) -> np.ndarray:
    """Torques by Lagrange multipliers of what the files say; the chain only orders its joints."""
    model = model_of(urdf)
    content = yaml.load(cuts, _StrictLoader)
    others = set(content) - {"closed_loop", "type", "name_mot", "gravity"}
    if not others <= {"joint_name", "joint_type"} or any(content[key] for key in others):
        raise UnreadableError("keys")
    motors, gravity = content["name_mot"], content.get("gravity", [0, 0, -9.81])
    kinds, loops = content.get("type", []), content.get("closed_loop", [])  # none: an open tree
    named = [*motors, *kinds, *(name for pair in loops for name in pair)]
    if not all(isinstance(name, str) for name in named):
        raise UnreadableError("a name that is none")
    if len(gravity) != 3 or not all(type(x) in (int, float, str) for x in gravity):
        raise UnreadableError("gravity")
    # YAML 1.1 takes 1e3 for a text.
    model.gravity.linear = np.array(
        [numbers(x, 1)[0] if type(x) is str else float(x) for x in gravity]
    )
    names = list(model.names)[1:]
    order = [chain.joint_names.index(name) for name in names]
    pairs = zip(loops, kinds, strict=True)
    closures = [sst_pin.Closure(a, b, kind.lower()) for (a, b), kind in pairs]
    own = sst_pin.ClosedChain(model, closures, motors)
    return LagrangeMultipliers(own).torques(q[order], va, aa)

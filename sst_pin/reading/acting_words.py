# SPDX-License-Identifier: BSD-2-Clause
"""Elements of Drake and Gazebo that affect the motion. They are read, or a warning names them."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator

from ..summaries import listed
from .joint_numbers import JointNumbers
from .known_words import is_true, means, unknown
from .problems import Problem, error, number, numbers, warning

#: Elements that are read or exert no force, see `known_words`. A robot may also have others that
#: name no link and no joint.
_WORDS = {
    "robot": "link joint material gazebo transmission loop loop_constraint loop_joint constraint "
    "coupling drake:ball_constraint drake:collision_filter_group sensor ros2_control mujoco frame "
    "group group_state disable_collisions end_effector virtual_joint camera gripper "
    "safety_controller",
    "gazebo": "@reference material+ visual+ collision+ sensor+ light+ plugin+ joint+ mu1 mu2 "
    "mu fdir1 slip1 slip2 kp kd maxVel max_vel minDepth min_depth maxContacts max_contacts "
    "selfCollide self_collide laserRetro laser_retro rollingFriction gravity turnGravityOff "
    "springStiffness springReference dampingFactor=0 static=0 stopCfm stopErp cfmDamping "
    "implicitSpringDamper fudgeFactor provideFeedback disableFixedJointLumping preserveFixedJoint "
    "canonicalBody",
    "transmission": "@name @type type joint+ actuator+ leftActuator rightActuator flexJoint "
    "rollJoint gap_joint+ passive_joint+ use_simulated_gripper_joint mechanicalReduction "
    "robotNamespace hardwareInterface+ motorTorqueConstant param+",
    "transmission/joint": "@name @role ...",
    "actuator": "@name @role drake:rotor_inertia drake:gear_ratio ...",
}
#: Elements of Gazebo for the numbers of a spring.
SPRINGS = {"stiffness": "springStiffness", "reference": "springReference"}
_ROTORS = ("drake:rotor_inertia", "drake:gear_ratio")
_ACTING_PLUGIN = re.compile("mimic|attach|coupl|closed_?loop", re.I)


def unread(root: ET.Element) -> Iterator[Problem]:
    """Problems of elements that act in other tools: not read here, or not a number."""
    known = {element.get("name", "") for element in root if element.tag in ("link", "joint")}
    for element in root:
        texts = {text for part in element.iter() for text in (*part.attrib.values(), part.text)}
        if element.tag in ("gazebo", "transmission"):
            yield from _extension(element)
        elif element.tag not in _WORDS["robot"].split() and (names := sorted(known & texts)):
            yield warning(f"<{element.tag}>", f"of {listed(names)} is not read")
    for name in () if is_weightless(root) else sorted(_without_gravity(root)):
        text = "gravity is off for this link only, which is not supported; it counts as on"
        yield warning(f"link {name}", text)
    odd: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        for key, text in (pair for each in joint.findall("dynamics") for pair in each.items()):
            if key not in ("damping", "friction") and not means(text, "0"):
                odd.setdefault(key, []).append(joint.get("name", ""))
    for key, names in odd.items():
        yield warning(f"joints {', '.join(names)}", f"dynamics {key}=... is not read")


def _extension(element: ET.Element) -> Iterator[Problem]:
    """Problems of a `<gazebo>` or a `<transmission>`."""
    where = f"{element.tag} {element.get('reference') or element.get('name', '')}".strip()
    yield from (warning(where, text) for text in unknown(element, _WORDS))
    for part in element.iter():
        plugin = f"plugin {part.get('name')} {part.get('filename')}"
        if part.tag == "plugin" and _ACTING_PLUGIN.search(plugin):
            yield warning(where, f"{plugin} is not read")
        text = part.get("value", "") if part.tag in _ROTORS else part.text or ""
        if part.tag in (*_ROTORS, *SPRINGS.values()) and numbers(text, 1) is None:
            yield error(where, f"{part.tag} {text!r} is not a number")


def joint_numbers(root: ET.Element) -> JointNumbers:
    """Springs of Gazebo and reflected rotor inertias of Drake, for the joints that move."""
    values: dict[str, dict[str, float]] = {kind: {} for kind in (*SPRINGS, "armature")}
    joints = [j.get("name") for j in root.findall("joint") if j.get("type") != "fixed"]
    for element in root.findall("gazebo"):
        name = element.get("reference", "")
        for kind, tag in SPRINGS.items() if name in joints else ():
            if (value := numbers(element.findtext(tag, ""), 1)) is not None:
                values[kind][name] = float(value[0])
    for element in root.findall("transmission"):
        parts = {part.tag: number(part, "value") for part in element.iter()}
        rotor, gear = parts.get(_ROTORS[0], 0.0), parts.get(_ROTORS[1], 1.0)
        for name in (joint.get("name", "") for joint in element.findall("joint")):
            if rotor and gear and name in joints:
                values["armature"][name] = rotor * gear**2
    return values


def is_weightless(root: ET.Element) -> bool:
    """Whether gravity is off for each moving link that has a mass."""
    moving = {child.get("link") for child in root.iterfind("joint/child")}
    masses = {link.get("name", ""): link.find("inertial/mass") for link in root.findall("link")}
    heavy = {name for name, mass in masses.items() if name in moving and number(mass, "value")}
    return bool(heavy) and heavy <= _without_gravity(root)


def _without_gravity(root: ET.Element) -> set[str]:
    """Links without gravity, from elements of Drake and Gazebo."""
    links = {link.get("name", ""): link for link in root.findall("link")}
    off = {n for n, link in links.items() if any(e.tag == "drake:disable_gravity" for e in link)}
    for element in root.findall("gazebo"):
        on = element.findtext("gravity", "true")
        if is_true(element.findtext("turnGravityOff")) or not is_true(on):
            off.add(element.get("reference", ""))
    return off & links.keys()

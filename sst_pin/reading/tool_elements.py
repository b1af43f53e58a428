# SPDX-License-Identifier: BSD-2-Clause
"""Elements that other tools add to a URDF and that are read here.

These are springs and gravity of Gazebo, rotors and gravity of Drake, motors of `<transmission>`,
`<ros2_control>` and controllers of Gazebo, and joints that follow others.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection
from typing import NamedTuple

from .joint_numbers import JointNumbers
from .problems import is_true, number, numbers

#: Types of joints of a URDF with one axis.
ONE_AXIS = ("revolute", "prismatic", "continuous")
#: Elements of Gazebo for the numbers of a spring.
SPRINGS = {"stiffness": "springStiffness", "reference": "springReference"}
#: Elements of Drake for the inertia of a rotor and its gear ratio.
ROTOR_INERTIA = "drake:rotor_inertia"
GEAR_RATIO = "drake:gear_ratio"
#: Plugins of Gazebo whose `<joint_name>` are driven. A `JointStatePublisher` only reports joints.
_DRIVING_PLUGIN = re.compile("joint(position|trajectory)?controller|applyjointforce")


def joint_numbers(root: ET.Element) -> JointNumbers:
    """Springs of Gazebo and reflected rotor inertias of Drake, for the joints that move."""
    values: dict[str, dict[str, float]] = {kind: {} for kind in (*SPRINGS, "armature")}
    moving = [j.get("name") for j in root.findall("joint") if j.get("type") != "fixed"]
    for element in root.findall("gazebo"):
        joint_name = element.get("reference", "")
        if joint_name not in moving:
            continue
        for kind, tag in SPRINGS.items():
            value = numbers(element.findtext(tag, ""), 1)
            if value is not None:
                values[kind][joint_name] = float(value[0])
    for element in root.findall("transmission"):
        parts = {part.tag: number(part, "value") for part in element.iter()}
        rotor_inertia = parts.get(ROTOR_INERTIA, 0.0)
        gear_ratio = parts.get(GEAR_RATIO, 1.0)
        if not rotor_inertia or not gear_ratio:
            continue  # no rotor, or a text that is no number, which `acting_elements` reports
        for joint in element.findall("joint"):
            joint_name = joint.get("name", "")
            if joint_name in moving:
                values["armature"][joint_name] = rotor_inertia * gear_ratio**2
    return values


# --- joints that follow others, and motors ----------------------------------------------------


class Mimic(NamedTuple):
    """A joint that follows another: its position is multiplier times the leader's, plus offset.

    Both numbers are texts of the file. `urdf_checks` reports those that are no numbers.
    """

    follower: str
    leader: str
    multiplier: str
    offset: str


def one_axis_joints(root: ET.Element) -> set[str]:
    """Names of the joints that move along or about one axis."""
    return {j.get("name", "") for j in root.findall("joint") if j.get("type") in ONE_AXIS}


def mimics_of(root: ET.Element) -> list[Mimic]:
    """Joints that follow others by `<mimic>`, else by parameters of `<ros2_control>`."""
    mimics = list[Mimic]()
    followers = set[str]()
    for joint in root.findall("joint"):
        for element in joint.findall("mimic"):
            mimic = Mimic(
                follower=joint.get("name", ""),
                leader=element.get("joint", ""),
                multiplier=element.get("multiplier", "1"),
                offset=element.get("offset", "0"),
            )
            mimics.append(mimic)
            followers.add(mimic.follower)
    candidates = one_axis_joints(root)
    for joint in root.findall("ros2_control/joint"):
        ros2_mimic = mimic_of_ros2_control(joint, candidates)
        if ros2_mimic is not None and ros2_mimic.follower not in followers:
            mimics.append(ros2_mimic)
            followers.add(ros2_mimic.follower)
    return mimics


def mimic_of_ros2_control(joint: ET.Element, candidates: Collection[str]) -> Mimic | None:
    """How a joint of `<ros2_control>` follows another; None if it does not, or cannot.

    Both joints must be among `candidates`, the joints of one axis.
    """
    parameters = ros2_control_parameters(joint)
    mimic = Mimic(
        follower=joint.get("name", ""),
        leader=parameters.get("mimic", ""),
        multiplier=parameters.get("multiplier", "1"),
        offset=parameters.get("offset", "0"),
    )
    if numbers(mimic.multiplier, 1) is None or numbers(mimic.offset, 1) is None:
        return None
    if mimic.follower not in candidates or mimic.leader not in candidates:
        return None
    if mimic.follower == mimic.leader:
        return None
    return mimic


def ros2_control_parameters(joint: ET.Element) -> dict[str, str]:
    """The parameters of a joint of `<ros2_control>`, by name."""
    return {p.get("name", ""): (p.text or "").strip() for p in joint.findall("param")}


def motors_of(root: ET.Element) -> tuple[str, ...]:
    """Names of the joints with motors, in the order of the file.

    They are joints of transmissions, joints of ros2_control with a command interface, and joints of
    controllers of Gazebo, if they have one axis and follow no other joint.
    """
    driven = [joint.get("name", "") for joint in root.findall("transmission/joint")]
    for joint in root.findall("ros2_control/joint"):
        if joint.find("command_interface") is not None:
            driven.append(joint.get("name", ""))
    for plugin in root.findall("gazebo/plugin"):
        if _DRIVING_PLUGIN.search(joined_plugin_name(plugin)):
            driven += [(joint.text or "").strip() for joint in plugin.findall("joint_name")]
    followers = {mimic.follower for mimic in mimics_of(root)}
    can_have_motor = one_axis_joints(root) - followers
    return tuple(name for name in dict.fromkeys(driven) if name in can_have_motor)


# --- gravity ----------------------------------------------------------------------------------


def links_without_gravity(root: ET.Element) -> set[str]:
    """Links for which elements of Drake or Gazebo switch gravity off."""
    links = set[str]()
    without_gravity = set[str]()
    for link in root.findall("link"):
        name = link.get("name", "")
        links.add(name)
        if any(element.tag == "drake:disable_gravity" for element in link):
            without_gravity.add(name)
    for element in root.findall("gazebo"):
        is_off = is_true(element.findtext("turnGravityOff"))
        if is_off or not is_true(element.findtext("gravity", "true")):
            without_gravity.add(element.get("reference", ""))
    return without_gravity & links


def is_weightless(root: ET.Element) -> bool:
    """Whether gravity is off for all links with a mass that can move: the robot has no gravity.

    All links but the base count, also children of fixed joints: their parents may move.
    """
    children = {child.get("link") for child in root.iterfind("joint/child")}
    with_mass = set[str]()
    for link in root.findall("link"):
        name = link.get("name", "")
        if name in children and number(link.find("inertial/mass"), "value"):
            with_mass.add(name)
    return bool(with_mass) and with_mass <= links_without_gravity(root)


# --- plugins of Gazebo, in a URDF or an SDF -----------------------------------------------------


def plugin_name(plugin: ET.Element) -> str:
    """The name of a plugin and the name of its file, as far as it has them."""
    return f"{plugin.get('name', '')} {plugin.get('filename', '')}".strip()


def joined_plugin_name(plugin: ET.Element) -> str:
    """The plugin's name in lower case, without - and _: versions of Gazebo put them differently."""
    return re.sub("[-_]", "", plugin_name(plugin).lower())


def is_weld(plugin: ET.Element) -> bool:
    """Whether a plugin is a `DetachableJoint`, which welds two links in their pose at q = 0."""
    return "detachable" in plugin_name(plugin).lower()


def is_weld_within(plugin: ET.Element, model: str) -> bool:
    """Whether the child of a `DetachableJoint` is a link of this model, not of another model."""
    return plugin.findtext("child_model", "").strip() in (model, "__model__")

# SPDX-License-Identifier: BSD-2-Clause
"""Elements that exert forces in Gazebo, Drake or MuJoCo: read, or named by a warning."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping
from typing import NamedTuple

from ..summaries import listed
from .joint_numbers import JointNumbers
from .problems import Problem, error, is_true, number, numbers, stands_for, warning

#: Elements of Gazebo for the numbers of a spring.
SPRINGS = {"stiffness": "springStiffness", "reference": "springReference"}
#: Elements of Drake for the inertia of a rotor and its gear ratio.
_ROTOR_INERTIA = "drake:rotor_inertia"
_GEAR_RATIO = "drake:gear_ratio"
#: Elements of a robot that exert no force, or are read. Others are named in a warning if they name
#: a link, a joint or a frame.
_HARMLESS = {
    "link",
    "joint",
    "frame",
    "material",
    "sensor",
    "camera",
    "gripper",
    "safety_controller",
    "drake:collision_filter_group",
    # of an SRDF
    "group",
    "group_state",
    "disable_collisions",
    "end_effector",
    "virtual_joint",
    # joints that close loops, see `cut_joints`
    "loop",
    "loop_constraint",
    "loop_joint",
    "constraint",
    "coupling",
    "drake:ball_constraint",
}
#: Elements of `<gazebo>` that move links or push them, unless they are zero or false.
_OF_GAZEBO = (
    "dampingFactor",
    "static",
    "kinematic",
    "buoyancy",
    "enable_wind",
    "velocity_decay/linear",
    "velocity_decay/angular",
)
#: Attributes of elements of `<mujoco>` in a URDF that change masses or forces.
_OF_MUJOCO = {
    "compiler": (
        "settotalmass",
        "boundmass",
        "boundinertia",
        "balanceinertia",
        "inertiafromgeom",
    ),
    "option": ("gravity", "density", "viscosity", "wind"),
}
#: Attributes of elements of a joint that are read.
_OF_JOINT = {"dynamics": ("damping", "friction"), "axis": ("xyz",)}
#: Parts of names of plugins that exert no force, or only move motors. `imu` and `ray` count only if
#: no letter stands before them, as in `array`.
_FORCELESS = re.compile(
    "altimeter|applyjointforce|battery|breadcrumb|bumper|camera|comms|contact|control|depth|"
    "detector|drive|forcetorque|gps|(?<![a-z])imu|label|laser|lidar|magnetometer|monitor|navsat|"
    "openni|p3d|physics|projector|publisher|(?<![a-z])ray|range|scene|sensor|sonar|steering|"
    "trajectory|usercommands|video"
)


class Mimic(NamedTuple):
    """A joint that follows another: its position is multiplier times the leader's, plus offset."""

    follower: str
    leader: str
    multiplier: str
    offset: str


def unread(root: ET.Element) -> Iterator[Problem]:
    """Problems of elements that act in other tools: not read here, or not a number."""
    named = {e.get("name", "") for e in root if e.tag in ("link", "joint", "frame")}
    joints = {joint.get("name", "") for joint in root.findall("joint")}
    for element in root:
        if element.tag == "gazebo":
            yield from _gazebo(element, joints)
        elif element.tag == "transmission":
            yield from _transmission(element, joints)
        elif element.tag == "mujoco":
            yield from _mujoco(element)
        elif element.tag == "ros2_control":
            yield from _ros2_control(element, _single_joints(root))
        elif element.tag not in _HARMLESS:
            names = sorted(named & _texts(element))
            if names:
                yield warning(f"<{element.tag}>", f"of {listed(names)} is not read")
    yield from _of_joints(root)
    if not is_weightless(root):  # gravity that is off for all links is read as no gravity
        without_gravity = _without_gravity(root)
        for link in root.findall("link"):
            if link.get("name", "") in without_gravity:
                yield warning(f"link {link.get('name')}", _weight_problem(link))


def _weight_problem(link: ET.Element) -> str:
    """What to do about a link without gravity in a robot with gravity."""
    name = link.get("name")
    mass = number(link.find("inertial/mass"), "value") or 0.0
    origin = link.find("inertial/origin")
    center = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
    return (
        "gravity is off for some links only, which is not supported; it counts as on. To carry the "
        "weight (with the gravity of an SDF's world in place of 9.81 m/s^2, if it is another one), "
        f'add a frame at the mass centre, <frame name="{name}_lift" link="{name}" '
        f'xyz="{center}"/> in a URDF or <frame> in an SDF, and pass external_wrenches='
        f'{{"{name}_lift": [0, 0, 9.81 * {mass:.12g}, 0, 0, 0]}}'
    )


def _texts(element: ET.Element) -> set[str]:
    """All attributes and texts of an element and of those in it."""
    texts = set[str]()
    for part in element.iter():
        texts.update(part.attrib.values())
        texts.add(part.text or "")
    return texts


def _gazebo(element: ET.Element, joints: set[str]) -> Iterator[Problem]:
    """Problems of a `<gazebo>`; its springs belong to joints."""
    reference = element.get("reference", "")
    where = f"gazebo {reference}".strip()
    for path in _OF_GAZEBO:
        for part in element.findall(path):
            text = (part.text or "").strip()
            if not stands_for(text, 0):
                yield warning(where, f"{path} {text!r} is not read")
    for tag in SPRINGS.values():
        for part in element.findall(tag):
            text = part.text or ""
            if numbers(text, 1) is None:
                yield error(where, f"{tag} {text!r} is not a number")
            elif reference not in joints:
                yield warning(where, f"{tag} is not read: {reference!r} is no joint of this file")
    yield from acting_plugins(element, where)


def acting_plugins(holder: ET.Element, where: str) -> Iterator[Problem]:
    """Warnings of plugins of Gazebo that may exert forces; those that close loops are read."""
    for plugin in holder.findall("plugin"):
        name = f"{plugin.get('name')} {plugin.get('filename')}"
        if is_detachable(plugin) and holder.tag == "gazebo":
            continue  # a weld of a URDF, which `cut_joints` reads; it does not read those of SDF
        if not _FORCELESS.search(re.sub("[-_]", "", name.lower())):
            yield warning(where, f"plugin {name} is not read, nor any force of it")


def is_detachable(plugin: ET.Element) -> bool:
    """Whether a plugin of Gazebo welds two links."""
    return "detachable" in f"{plugin.get('name')} {plugin.get('filename')}".lower()


def _transmission(element: ET.Element, joints: set[str]) -> Iterator[Problem]:
    """Problems of a `<transmission>`."""
    where = f"transmission {element.get('name', '')}".strip()
    for part in element.iter():
        if part.tag in (_ROTOR_INERTIA, _GEAR_RATIO):
            text = part.get("value", "")
            if numbers(text, 1) is None:
                yield error(where, f"{part.tag} {text!r} is not a number")
    for joint in element.findall("joint"):
        if joint.get("name") not in joints:
            yield warning(where, f"{joint.get('name')!r} is not a joint of this file")


def _ros2_control(element: ET.Element, single_joints: set[str]) -> Iterator[Problem]:
    """Warnings of joints of a `<ros2_control>` that cannot follow another joint as it says."""
    for joint in element.findall("joint"):
        name = joint.get("name", "")
        values = _parameters(joint)
        if "mimic" in values and not _can_follow(name, values, single_joints):
            yield warning("ros2_control", f"joint {name}: mimic {values['mimic']!r} is not read")


def _parameters(joint: ET.Element) -> dict[str, str]:
    """The parameters of a joint of `<ros2_control>`."""
    return {p.get("name", ""): (p.text or "").strip() for p in joint.findall("param")}


def _can_follow(joint: str, values: Mapping[str, str], single_joints: Collection[str]) -> bool:
    """Whether a joint of `<ros2_control>` can follow the joint that its parameters name."""
    leader = values["mimic"]
    factors = (values.get("multiplier", "1"), values.get("offset", "0"))
    if any(numbers(factor, 1) is None for factor in factors):
        return False
    return joint in single_joints and leader in single_joints and joint != leader


def _mujoco(element: ET.Element) -> Iterator[Problem]:
    """Warnings of a `<mujoco>`, which MuJoCo reads in a URDF."""
    for part in element:
        for key in _OF_MUJOCO.get(part.tag, ()):
            value = part.get(key)
            if value is None or value in ("false", "auto"):
                continue
            # Zero changes nothing, unless it is a gravity.
            if key == "gravity" or not stands_for(value, 0):
                yield warning("<mujoco>", f"<{part.tag} {key}={value!r}> is not read")
    for tag in ("equality", "tendon", "actuator", "contact"):
        if element.find(tag) is not None:
            yield warning("<mujoco>", f"<{tag}> is not read; ClosedChain.from_mjcf reads an MJCF")


def _of_joints(root: ET.Element) -> Iterator[Problem]:
    """Warnings of attributes of joints that other tools add."""
    joints_by_attribute: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        for tag, known in _OF_JOINT.items():
            for element in joint.findall(tag):
                for key, text in element.items():
                    if key not in known and not stands_for(text, 0):
                        names = joints_by_attribute.setdefault(f"{tag} {key}", [])
                        names.append(joint.get("name", ""))
    for attribute, names in joints_by_attribute.items():
        yield warning(f"joints {', '.join(names)}", f"{attribute}=... is not read")


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
        rotor_inertia = parts.get(_ROTOR_INERTIA, 0.0)
        gear_ratio = parts.get(_GEAR_RATIO, 1.0)
        if not rotor_inertia or not gear_ratio:
            continue
        for joint in element.findall("joint"):
            joint_name = joint.get("name", "")
            if joint_name in moving:
                values["armature"][joint_name] = rotor_inertia * gear_ratio**2
    return values


def motors_of(root: ET.Element) -> tuple[str, ...]:
    """Joints of `<transmission>`, and those of `<ros2_control>` with a command interface."""
    driven = [joint.get("name", "") for joint in root.findall("transmission/joint")]
    for joint in root.findall("ros2_control/joint"):
        if joint.find("command_interface") is not None:
            driven.append(joint.get("name", ""))
    followers = {mimic.follower for mimic in mimics_of(root)}
    can_have_motor = _single_joints(root) - followers
    return tuple(name for name in dict.fromkeys(driven) if name in can_have_motor)


def _single_joints(root: ET.Element) -> set[str]:
    """Names of the joints that move along or about one axis."""
    kinds = ("revolute", "continuous", "prismatic")
    return {j.get("name", "") for j in root.findall("joint") if j.get("type") in kinds}


def mimics_of(root: ET.Element) -> Iterator[Mimic]:
    """Joints that follow others by `<mimic>`, else by parameters of `<ros2_control>`."""
    followers = set[str]()
    for joint in root.findall("joint"):
        for mimic in joint.findall("mimic"):
            follower = joint.get("name", "")
            followers.add(follower)
            multiplier = mimic.get("multiplier", "1")
            yield Mimic(follower, mimic.get("joint", ""), multiplier, mimic.get("offset", "0"))
    single = _single_joints(root)
    for joint in root.findall("ros2_control/joint"):
        follower = joint.get("name", "")
        values = _parameters(joint)
        if "mimic" not in values or follower in followers:
            continue
        if _can_follow(follower, values, single):
            followers.add(follower)
            multiplier = values.get("multiplier", "1")
            yield Mimic(follower, values["mimic"], multiplier, values.get("offset", "0"))


def is_weightless(root: ET.Element) -> bool:
    """Whether gravity is off for each moving link that has a mass."""
    moving = {child.get("link") for child in root.iterfind("joint/child")}
    with_mass = set[str]()
    for link in root.findall("link"):
        name = link.get("name", "")
        if name in moving and number(link.find("inertial/mass"), "value"):
            with_mass.add(name)
    return bool(with_mass) and with_mass <= _without_gravity(root)


def _without_gravity(root: ET.Element) -> set[str]:
    """Links without gravity, from elements of Drake and Gazebo."""
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

# SPDX-License-Identifier: BSD-2-Clause
"""Elements that exert forces in Gazebo, Drake or MuJoCo: read, or named by a warning."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping

from ..summaries import listed
from .joint_numbers import JointNumbers
from .problems import Problem, error, is_true, means, number, numbers, warning

#: Elements of Gazebo for the numbers of a spring.
SPRINGS = {"stiffness": "springStiffness", "reference": "springReference"}
_ROTORS = ("drake:rotor_inertia", "drake:gear_ratio")
#: Elements of a robot that exert no force, or are read. Others are named if they name a link, a
#: joint or a frame.
_HARMLESS = {
    "link",
    "joint",
    "frame",
    "material",
    "gazebo",  # its elements are judged one by one, as those of the next
    "transmission",
    "mujoco",
    "ros2_control",
    "sensor",
    "camera",
    "gripper",
    "drake:collision_filter_group",
    *("group", "group_state", "disable_collisions", "end_effector", "virtual_joint"),
    "safety_controller",
    # joints that close loops, see `cut_joints`
    *("loop", "loop_constraint", "loop_joint", "constraint", "coupling", "drake:ball_constraint"),
}
#: Elements of `<gazebo>` that move links or push them, unless they are zero or false.
_OF_GAZEBO = ("dampingFactor", "static", "kinematic", "buoyancy", "enable_wind")
#: Attributes of elements of `<mujoco>` in a URDF that change masses or forces.
_OF_MUJOCO = {
    "compiler": (
        *("settotalmass", "boundmass", "boundinertia", "balanceinertia", "inertiafromgeom"),
    ),
    "option": ("gravity", "density", "viscosity", "wind"),
}
#: Names of plugins that exert no force but a motor's.
_FORCELESS = re.compile(
    "altimeter|applyjointforce|battery|breadcrumb|bumper|camera|comms|contact|control|depth|"
    "detector|drive|forcetorque|gps|(?<![a-z])imu|label|laser|lidar|magnetometer|monitor|navsat|"
    "openni|p3d|physics|projector|publisher|(?<![a-z])ray|range|scene|sensor|sonar|steering|"
    "trajectory|usercommands|video"
)


def unread(root: ET.Element) -> Iterator[Problem]:
    """Problems of elements that act in other tools: not read here, or not a number."""
    named = {e.get("name", "") for e in root if e.tag in ("link", "joint", "frame")}
    for element in root:
        if element.tag == "gazebo":
            yield from _gazebo(element, named)
        elif element.tag == "transmission":
            yield from _transmission(element, named)
        elif element.tag == "mujoco":
            yield from _mujoco(element)
        elif element.tag == "ros2_control":
            yield from _ros2_control(element, _single_joints(root))
        elif element.tag not in _HARMLESS:
            texts = {text for part in element.iter() for text in (*part.attrib.values(), part.text)}
            if names := sorted(named & texts):
                yield warning(f"<{element.tag}>", f"of {listed(names)} is not read")
    yield from _of_joints(root)
    if not is_weightless(root):
        for name in sorted(_without_gravity(root)):
            text = "gravity is off for this link only, which is not supported; it counts as on"
            yield warning(f"link {name}", text)


def _gazebo(element: ET.Element, named: set[str]) -> Iterator[Problem]:
    """Problems of a `<gazebo>`."""
    reference = element.get("reference", "")
    where = f"gazebo {reference}".strip()
    for tag in _OF_GAZEBO:
        for part in element.findall(tag):
            text = (part.text or "").strip()
            if not means(text, 0):
                yield warning(where, f"{tag} {text!r} is not read")
    for path in ("velocity_decay/linear", "velocity_decay/angular"):
        text = element.findtext(path, "0").strip()
        if not means(text, 0):
            yield warning(where, f"{path} {text!r} is not read")
    for part in (part for tag in SPRINGS.values() for part in element.findall(tag)):
        if numbers(part.text or "", 1) is None:
            yield error(where, f"{part.tag} {part.text or ''!r} is not a number")
        elif reference not in named:
            yield warning(where, f"{part.tag} is not read: {reference!r} is not in this file")
    yield from acting_plugins(element, where)


def acting_plugins(holder: ET.Element, where: str) -> Iterator[Problem]:
    """Warnings of plugins of Gazebo that may exert forces; those that close loops are read."""
    for plugin in holder.findall("plugin"):
        name = f"{plugin.get('name')} {plugin.get('filename')}"
        if is_detachable(plugin) and holder.tag == "gazebo":
            continue
        if not _FORCELESS.search(re.sub("[-_]", "", name.lower())):
            yield warning(where, f"plugin {name} is not read, nor any force of it")


def is_detachable(plugin: ET.Element) -> bool:
    """Whether a plugin of Gazebo welds two links."""
    return "detachable" in f"{plugin.get('name')} {plugin.get('filename')}".lower()


def _transmission(element: ET.Element, named: set[str]) -> Iterator[Problem]:
    """Problems of a `<transmission>`."""
    where = f"transmission {element.get('name', '')}".strip()
    for part in element.iter():
        if part.tag in _ROTORS and numbers(text := part.get("value", ""), 1) is None:
            yield error(where, f"{part.tag} {text!r} is not a number")
    for joint in element.findall("joint"):
        if joint.get("name") not in named:
            yield warning(where, f"{joint.get('name')!r} is not a joint of this file")


def _ros2_control(element: ET.Element, named: set[str]) -> Iterator[Problem]:
    """Warnings of joints of a `<ros2_control>` that cannot follow another joint as it says."""
    for joint in element.findall("joint"):
        name = joint.get("name", "")
        values = _parameters(joint)
        if "mimic" in values and not _can_follow(name, values, named):
            yield warning("ros2_control", f"joint {name}: mimic {values['mimic']!r} is not read")


def _parameters(joint: ET.Element) -> dict[str, str]:
    """The parameters of a joint of `<ros2_control>`."""
    return {p.get("name", ""): (p.text or "").strip() for p in joint.findall("param")}


def _can_follow(joint: str, values: Mapping[str, str], named: Collection[str]) -> bool:
    """Whether a joint of `<ros2_control>` can follow the joint that its parameters name."""
    factors = (values.get("multiplier", "1"), values.get("offset", "0"))
    are_numbers = all(numbers(factor, 1) is not None for factor in factors)
    return are_numbers and {joint, values["mimic"]} <= {*named} and joint != values["mimic"]


def _mujoco(element: ET.Element) -> Iterator[Problem]:
    """Warnings of a `<mujoco>`, which MuJoCo reads in a URDF."""
    for part in element:
        for key in _OF_MUJOCO.get(part.tag, ()):
            value = part.get(key)
            if value is not None and value not in ("false", "auto") and not means(value, 0):
                yield warning("<mujoco>", f"<{part.tag} {key}={value!r}> is not read")
    for tag in ("equality", "tendon", "actuator", "contact"):
        if element.find(tag) is not None:
            yield warning("<mujoco>", f"<{tag}> is not read; ClosedChain.from_mjcf reads an MJCF")


def _of_joints(root: ET.Element) -> Iterator[Problem]:
    """Warnings of attributes of joints that other tools add."""
    odd: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        for tag, known in (("dynamics", ("damping", "friction")), ("axis", ("xyz",))):
            for key, text in (pair for each in joint.findall(tag) for pair in each.items()):
                if key not in known and not means(text, 0):
                    odd.setdefault(f"{tag} {key}", []).append(joint.get("name", ""))
    for key, names in odd.items():
        yield warning(f"joints {', '.join(names)}", f"{key}=... is not read")


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
        rotor = parts.get(_ROTORS[0], 0.0)
        gear = parts.get(_ROTORS[1], 1.0)
        for name in (joint.get("name", "") for joint in element.findall("joint")):
            if rotor and gear and name in joints:
                values["armature"][name] = rotor * gear**2
    return values


def motors_of(root: ET.Element) -> tuple[str, ...]:
    """Joints that `<transmission>` or `<ros2_control>` drive: those with a command interface."""
    driven = [joint.get("name", "") for joint in root.findall("transmission/joint")]
    for joint in root.findall("ros2_control/joint"):
        if joint.find("command_interface") is not None:
            driven.append(joint.get("name", ""))
    followers = {follower for follower, _, _, _ in mimics_of(root)}
    free = _single_joints(root) - followers
    return tuple(name for name in dict.fromkeys(driven) if name in free)


def _single_joints(root: ET.Element) -> set[str]:
    """Names of the joints that move along or about one axis."""
    kinds = ("revolute", "continuous", "prismatic")
    return {j.get("name", "") for j in root.findall("joint") if j.get("type") in kinds}


def mimics_of(root: ET.Element) -> Iterator[tuple[str, str, str, str]]:
    """Joints that follow others by `<mimic>`, else by parameters of `<ros2_control>`.

    Each with the other joint, the multiplier and the offset.
    """
    followers = set[str]()
    for joint in root.findall("joint"):
        for mimic in joint.findall("mimic"):
            name = joint.get("name", "")
            followers.add(name)
            factor = mimic.get("multiplier", "1")
            offset = mimic.get("offset", "0")
            yield name, mimic.get("joint", ""), factor, offset
    single = _single_joints(root)
    for joint in root.findall("ros2_control/joint"):
        name = joint.get("name", "")
        values = _parameters(joint)
        if "mimic" in values and name not in followers and _can_follow(name, values, single):
            followers.add(name)
            yield name, values["mimic"], values.get("multiplier", "1"), values.get("offset", "0")


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

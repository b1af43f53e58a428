# SPDX-License-Identifier: BSD-2-Clause
"""Warnings of elements of a URDF that exert forces in other tools and that are not read here."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator

from ..summaries import listed
from .problems import Problem, error, numbers, stands_for, warning
from .tool_elements import (
    GEAR_RATIO,
    ROTOR_INERTIA,
    SPRINGS,
    is_weld,
    joined_plugin_name,
    mimic_of_ros2_control,
    one_axis_joints,
    plugin_name,
    ros2_control_parameters,
)

#: Elements of a robot that need no warning: they exert no force, or other modules read them.
#: Any other element may act. It gets a warning if it names a link, a joint or a frame.
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
    # joints that close loops, which `loop_elements` reads
    "loop",
    "loop_constraint",
    "loop_joint",
    "constraint",
    "coupling",
    "drake:ball_constraint",
}


def unread_elements(root: ET.Element) -> Iterator[Problem]:
    """Warnings of elements of a `<robot>` that act in other tools and are not read.

    Numbers that cannot be read are errors.
    """
    known_names = {e.get("name", "") for e in root if e.tag in ("link", "joint", "frame")}
    joints = {joint.get("name", "") for joint in root.findall("joint")}
    for element in root:
        if element.tag == "gazebo":
            yield from _gazebo(element, joints)
        elif element.tag == "transmission":
            yield from _transmission(element, joints)
        elif element.tag == "mujoco":
            yield from _mujoco(element)
        elif element.tag == "ros2_control":
            yield from _ros2_control(element, one_axis_joints(root))
        elif element.tag not in _HARMLESS:
            names = sorted(known_names & texts_of(element))
            if names:
                yield warning(f"<{element.tag}>", f"of {listed(names)} is not read")
    yield from _attributes_of_joints(root)


def texts_of(element: ET.Element) -> set[str]:
    """All attributes and texts of an element and of those in it, without white space around.

    Empty ones are left out: they are no names.
    """
    texts = set[str]()
    for part in element.iter():
        texts.update(text.strip() for text in [*part.attrib.values(), part.text or ""])
    return texts - {""}


# --- Gazebo -----------------------------------------------------------------------------------

#: Elements of `<gazebo>` that move links or push them, unless they are zero or false.
_ACTING_OF_GAZEBO = (
    "dampingFactor",
    "static",
    "kinematic",
    "buoyancy",
    "enable_wind",
    "velocity_decay/linear",
    "velocity_decay/angular",
)


def _gazebo(element: ET.Element, joints: set[str]) -> Iterator[Problem]:
    """Problems of a `<gazebo>`. `joints` are the names of all joints, which can have a spring."""
    reference = element.get("reference", "")
    where = f"gazebo {reference}".strip()
    for path in _ACTING_OF_GAZEBO:
        for part in element.findall(path):
            text = (part.text or "").strip()
            if not stands_for(text, 0):  # neither zeros nor false
                yield warning(where, f"{path} {text!r} is not read")
    for tag in SPRINGS.values():
        for part in element.findall(tag):
            text = part.text or ""
            if numbers(text, 1) is None:
                yield error(where, f"{tag} {text!r} is not a number")
            elif reference not in joints:
                yield warning(where, f"{tag} is not read: {reference!r} is no joint of this file")
    for plugin in element.findall("plugin"):
        if not is_weld(plugin):  # `loop_elements` reads welds
            yield from plugin_problem(plugin, where)


#: Parts of `joined_plugin_name` by which plugins are known that exert no force, or only drive
#: motors.
_FORCELESS = re.compile(
    "altimeter|applyjointforce|battery|breadcrumb|bumper|camera|comms|contact|control|depth|"
    "detector|drive|forcetorque|gps|label|laser|lidar|magnetometer|monitor|navsat|openni|p3d|"
    "physics|projector|publisher|range|scene|sensor|sonar|steering|trajectory|usercommands|video"
)
#: The same for the short words imu and ray, which are searched in `plugin_name` instead: there the
#: ends of words can be seen. Written small, a word starts at the
#: beginning or after a character that is no letter, as in `gpu_ray`. With a capital letter it may
#: start anywhere, as in `GpuRay`. No small letter follows it. So `array` and `Rayleigh` do not
#: contain the word `ray`.
_FORCELESS_WORDS = re.compile("((?<![A-Za-z])(imu|ray)|Imu|IMU|Ray)(?![a-z])")


def plugin_problem(plugin: ET.Element, where: str) -> Iterator[Problem]:
    """A warning of a plugin of Gazebo, in a URDF or an SDF, that may exert forces."""
    name = plugin_name(plugin)
    is_forceless = _FORCELESS.search(joined_plugin_name(plugin)) or _FORCELESS_WORDS.search(name)
    if not is_forceless:
        yield warning(where, f"plugin {name} is not read, nor any force of it")


# --- Transmissions, ros2_control and MuJoCo -----------------------------------------------------


def _transmission(element: ET.Element, joints: set[str]) -> Iterator[Problem]:
    """Problems of a `<transmission>`."""
    where = f"transmission {element.get('name', '')}".strip()
    for part in element.iter():
        if part.tag in (ROTOR_INERTIA, GEAR_RATIO):
            text = part.get("value", "")
            if numbers(text, 1) is None:
                yield error(where, f"{part.tag} {text!r} is not a number")
    for joint in element.findall("joint"):
        if joint.get("name") not in joints:
            yield warning(where, f"{joint.get('name')!r} is not a joint of this file")


def _ros2_control(element: ET.Element, candidates: set[str]) -> Iterator[Problem]:
    """Warnings of joints of a `<ros2_control>` that cannot follow another joint as it says.

    `candidates` are the joints of one axis, which can follow each other.
    """
    for joint in element.findall("joint"):
        leader = ros2_control_parameters(joint).get("mimic")
        if leader is not None and mimic_of_ros2_control(joint, candidates) is None:
            name = joint.get("name", "")
            yield warning("ros2_control", f"joint {name}: mimic {leader!r} is not read")


#: Attributes that change masses or forces, by the elements of `<mujoco>` that have them.
_ACTING_OF_MUJOCO = {
    "compiler": (
        "settotalmass",
        "boundmass",
        "boundinertia",
        "balanceinertia",
        "inertiafromgeom",
    ),
    "option": ("gravity", "density", "viscosity", "wind"),
}
#: Flags of `<option>` in `<mujoco>` that switch forces or closures off.
_FLAGS_OF_MUJOCO = (
    "gravity",
    "spring",
    "damper",
    "passive",
    "frictionloss",
    "equality",
    "constraint",
)


def _mujoco(element: ET.Element) -> Iterator[Problem]:
    """Warnings of a `<mujoco>`, which MuJoCo reads in a URDF."""
    for part in element:
        for key in _ACTING_OF_MUJOCO.get(part.tag, ()):
            value = part.get(key)
            if value is not None and not _changes_nothing(key, value):
                yield warning("<mujoco>", f"<{part.tag} {key}={value!r}> is not read")
    for flags in element.findall("option/flag"):
        for key in _FLAGS_OF_MUJOCO:
            if flags.get(key) == "disable":
                yield warning("<mujoco>", f"<flag {key}='disable'> is not read")
    for tag in ("equality", "tendon", "actuator", "contact"):
        if element.find(tag) is not None:
            yield warning("<mujoco>", f"<{tag}> is not read; ClosedChain.from_mjcf reads an MJCF")


def _changes_nothing(key: str, value: str) -> bool:
    """Whether an attribute of `_ACTING_OF_MUJOCO` acts as if it were not there."""
    if value in ("false", "auto"):  # texts of defaults
        return True
    if key == "settotalmass":
        # The default is below zero, and changes no masses.
        mass = numbers(value, 1)
        return mass is not None and bool(mass[0] <= 0)
    if key == "gravity":
        gravity = numbers(value, 3)
        return gravity is not None and gravity.tolist() == [0.0, 0.0, -9.81]  # MuJoCo's default
    return stands_for(value, 0)


# --- Joints and links ---------------------------------------------------------------------------

#: The attributes of these elements of a joint that are read; other tools add more.
_READ_OF_JOINT = {"dynamics": ("damping", "friction"), "axis": ("xyz",)}


def _attributes_of_joints(root: ET.Element) -> Iterator[Problem]:
    """Warnings of attributes of joints that other tools add, each with all its joints."""
    joints_by_attribute = dict[str, list[str]]()
    for joint in root.findall("joint"):
        for tag, known in _READ_OF_JOINT.items():
            for element in joint.findall(tag):
                for key, text in element.items():
                    if key in known or stands_for(text, 0):
                        continue
                    joints = joints_by_attribute.setdefault(f"{tag} {key}", [])
                    joints.append(joint.get("name", ""))
    for attribute, joints in joints_by_attribute.items():
        yield warning(f"joints {', '.join(joints)}", f"{attribute}=... is not read")

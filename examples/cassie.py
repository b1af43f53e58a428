# SPDX-License-Identifier: BSD-2-Clause
"""Agility's Cassie as an MJCF, out of the numbers in the package example-robot-data.

Its SDF holds poses, inertias and springs. Pinocchio from PyPI reads no SDF, and
that file ends each Achilles rod in a hinge at the heel, which jams the leg when its springs are
stiff. Agility's own MuJoCo model has a ball at the hip and a point at the heel; so has this one.
"""

import importlib.metadata
import xml.etree.ElementTree as ET
from itertools import product

import numpy as np
import pinocchio as pin

MOTORS = [
    f"{side}-{joint}-op"
    for side in ("left", "right")
    for joint in ("roll", "yaw", "pitch", "knee", "foot")
]
#: Free joint of the pelvis, springs that count as stiff, rods between two balls.
HELD = [
    "pelvis",
    *(
        f"{side}-{spring}-joint"
        for side in ("left", "right")
        for spring in ("knee-shin", "tarsus-spring")
    ),
    "left-pitch-rod-joint_wx",
    "right-pitch-rod-joint_wx",
]
#: Ends of the cylinder that is the sole, in the foot's axes, and its radius, [m].
FOOT = {"toe": (0.0791, -0.0126, 0.0), "heel": (-0.0591, 0.1026, 0.0)}
SOLE = 0.0168


def mjcf(floor: float | None = None) -> str:
    """The whole robot, floating; above a floor at some height with balls at toes and heels."""
    model = _sdf().find("model")
    links = {link.get("name"): link for link in model.findall("link")}
    joints = {joint.get("name"): joint for joint in model.findall("joint")}
    carriers = {j.findtext("child"): j for j in joints.values() if j.get("type") == "revolute"}
    for side in ("left", "right"):  # the rod hangs on the hip; its other end is a point
        carriers[f"{side}-achilles-rod"] = joints[f"{side}-pitch-rod-joint"]
    root = ET.Element("mujoco", model="cassie")
    world = ET.SubElement(root, "worldbody")
    bodies = {"pelvis": _body(world, links["pelvis"], pin.SE3.Identity())}
    ET.SubElement(bodies["pelvis"], "freejoint")
    waiting = [name for name in links if name in carriers]
    while waiting:
        name = waiting.pop(0)
        joint = carriers[name]
        ball = joint.get("type") == "ball"
        parent = joint.findtext("child" if ball else "parent")
        if parent not in bodies:
            waiting.append(name)
            continue
        body = _body(bodies[parent], links[name], _pose(links[parent]))
        axis = {} if ball else {"axis": joint.findtext("axis/xyz")}
        spring = joint.findtext("axis/dynamics/spring_stiffness") or "0"
        damping = joint.findtext("axis/dynamics/damping") or "0"
        kind = "ball" if ball else "hinge"
        ET.SubElement(
            body,
            "joint",
            name=joint.get("name"),
            type=kind,
            stiffness=spring,
            damping=damping,
            **axis,
        )
        bodies[name] = body
    for side, end in product(("left", "right"), FOOT):
        foot = bodies[f"{side}-foot"]
        at = _text(FOOT[end])
        ET.SubElement(foot, "site", name=f"{side}-{end}", pos=at)
        if floor is not None:
            ET.SubElement(foot, "geom", size=_text([SOLE]), pos=at)
    if floor is not None:
        height = _text([0, 0, floor])
        ET.SubElement(world, "geom", type="plane", size="9 9 1", pos=height, contype="2")
    closures = ET.SubElement(root, "equality")
    for side in ("left", "right"):
        for end in ("achilles-spring", "plantar-foot"):
            joint = joints[f"{side}-{end}-joint"]
            first = joint.findtext("child")
            second = joint.findtext("parent")
            anchor = _text(_pose(joint).translation)
            ET.SubElement(closures, "connect", body1=first, body2=second, anchor=anchor)
    motors = ET.SubElement(root, "actuator")
    for name in MOTORS:
        ET.SubElement(motors, "motor", joint=name)
    return ET.tostring(root, encoding="unicode")


def _sdf() -> ET.Element:
    files = importlib.metadata.files("example-robot-data")
    (path,) = [file for file in files if file.name == "cassie_v2.sdf"]
    return ET.parse(path.locate()).getroot()


def _body(parent: ET.Element, link: ET.Element, carrier: pin.SE3) -> ET.Element:
    """A body with its mass; `carrier` is the parent's pose in the robot."""
    pose = carrier.actInv(_pose(link))
    body = ET.SubElement(
        parent, "body", name=link.get("name"), pos=_text(pose.translation), quat=_quaternion(pose)
    )
    inertial = link.find("inertial")
    inertia = inertial.find("inertia")
    ET.SubElement(
        body,
        "inertial",
        pos=_text(_pose(inertial).translation),
        mass=inertial.findtext("mass"),
        fullinertia=" ".join(
            inertia.findtext(k) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        ),
    )
    return body


def _pose(element: ET.Element) -> pin.SE3:
    numbers = np.array((element.findtext("pose") or "0 0 0 0 0 0").split(), dtype=float)
    # Right angles stand there with five digits; the axes of a foot would be parallel to 1e-7 only.
    rounded = np.abs(numbers[3:]) == 1.5708
    angles = np.where(rounded, np.copysign(np.pi / 2, numbers[3:]), numbers[3:])
    return pin.SE3(pin.rpy.rpyToMatrix(*angles), numbers[:3])


def _quaternion(pose: pin.SE3) -> str:
    x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
    return _text([w, x, y, z])


def _text(numbers) -> str:
    return " ".join(repr(float(x)) for x in numbers)

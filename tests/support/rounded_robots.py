# SPDX-License-Identifier: BSD-2-Clause
"""Robots as CAD writes them: link frames anywhere on their axes, numbers of a few digits.

In files their joints turn about or slide along one axis.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import sst_pin
from sst_pin import ClosedChain, Closure, robots
from tests.support.by_hand import at
from tests.support.planar_bars import planar


class Plan(NamedTuple):
    """What a robot is made from; its model has a home with closed loops."""

    model: pin.Model
    closures: tuple[Closure, ...]
    motors: tuple[str, ...]

    def chain(self, **options) -> ClosedChain:
        """The robot."""
        return ClosedChain(self.model, self.closures, self.motors, **options)


def plan_of(chain: ClosedChain, kind: str | None = None) -> Plan:
    """The plan of a robot, all its closures of one kind where it is given."""
    model = pin.Model(chain.model)
    model.referenceConfigurations["home"] = chain.home
    closures = [replace(c, kind=kind) if kind else c for c in chain.closures]
    return Plan(model, tuple(closures), chain.motor_names)


def axis_of(joint: pin.JointModel) -> np.ndarray | None:
    """The axis of a joint of one coordinate in its own frame."""
    name = joint.shortname()
    if joint.nv > 1:
        return None
    if name[-1] in "XYZ":
        return np.eye(3)["XYZ".index(name[-1])]
    return np.array(joint.extract().axis)


def drawn_by_cad(plan: Plan, seed: int, width: float = 0.1) -> Plan:
    """The same robot: its base elsewhere, link frames turned about and shifted along their axes.

    Joints of one coordinate are at zero at home.
    """
    random, old = np.random.default_rng(seed), plan.model
    model, data = pin.Model(old), old.createData()
    home = np.array(old.referenceConfigurations["home"])
    pin.forwardKinematics(old, data, home)
    places = list(data.liMi)
    R = pin.exp3(random.uniform(-1.5, 1.5, 3))
    ways = [pin.SE3(R, width * random.uniform(-3, 3, 3)).inverse()]
    for j, joint in enumerate(list(old.joints)[1:], 1):
        axis = axis_of(joint)
        if axis is None:
            places[j], axis = old.jointPlacements[j], np.zeros(3)
        else:
            home[joint.idx_q] = 0.0
        turn = pin.exp3(axis * random.uniform(-3, 3))
        ways.append(pin.SE3(turn, width * axis * random.uniform(-1, 1)))
    for j in range(1, model.njoints):
        model.jointPlacements[j] = ways[model.parents[j]].inverse() * places[j] * ways[j]
        model.inertias[j] = ways[j].inverse().act(model.inertias[j])
    for frame in model.frames:
        frame.placement = ways[frame.parentJoint].inverse() * frame.placement
    model.gravity.linear = R @ old.gravity.linear
    model.friction[:] = 0  # its sign would hang on the last digit of a rate
    model.referenceConfigurations["home"] = home
    return plan._replace(model=model)


def rpy_of(M: pin.SE3, digits: int) -> pin.SE3:
    """A placement whose angles of roll, pitch and yaw have a few digits."""
    angles = pin.rpy.matrixToRpy(M.rotation).round(digits)
    return pin.SE3(pin.rpy.rpyToMatrix(angles), M.translation.round(digits))


def rounded(plan: Plan, digits: int) -> Plan:
    """The robot whose placements have a few digits behind the point."""
    model = pin.Model(plan.model)
    for j in range(1, model.njoints):
        model.jointPlacements[j] = rpy_of(model.jointPlacements[j], digits)
    for frame in model.frames:
        frame.placement = rpy_of(frame.placement, digits)
    return plan._replace(model=model)


def _turn(axis: int, angle: float) -> np.ndarray:
    return pin.exp3(angle * np.eye(3)[axis])


def bar(kind: str = "3d", across: float = 0.0, tilt: float = 0.0, tilted: str = "") -> Plan:
    """A four-bar of 0.4 m, its closure off the plane, or one of its axes tilted."""
    bars = [("crank", "universe", 0.0, 0.1), ("coupler", "crank", 0.1, 0.3)]
    model = planar([*bars, ("rocker", "universe", 0.4, 0.25)])
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    if tilted:
        j = model.getJointId(tilted)
        turn = pin.SE3(_turn(0, tilt), np.zeros(3))
        model.jointPlacements[j] = model.jointPlacements[j] * turn
    for frame in model.frames:
        if frame.name == "coupler_end":
            frame.placement = frame.placement * at(0, 0, across)
    # The coupler of 0.3 m and the rocker of 0.25 m meet at angles to the way between their starts.
    x, y = 0.4 - 0.1 * np.cos(1.2), -0.1 * np.sin(1.2)
    way, length = np.arctan2(y, x), np.hypot(x, y)
    at_crank = np.arccos((length**2 + 0.3**2 - 0.25**2) / (2 * 0.3 * length))
    at_ground = np.arccos((length**2 + 0.25**2 - 0.3**2) / (2 * 0.25 * length))
    home = [1.2, way + at_crank - 1.2, way + np.pi - at_ground]
    model.referenceConfigurations["home"] = np.array(home)
    return Plan(model, (Closure("coupler_end", "rocker_end", kind),), ("crank",))


PLANS: dict[str, Callable[[], Plan]] = {
    "four-bar": lambda: plan_of(robots.four_bar()),
    "four-bar with hinge": lambda: plan_of(robots.four_bar(), "hinge"),
    "4-RRR": lambda: plan_of(robots.planar_4rrr()),
    "spherical 3-RRR": lambda: plan_of(robots.agile_wrist()),
    "scissor": lambda: plan_of(robots.scissor_lift()),
    "SST": lambda: plan_of(sst_pin.SST()),
}


def _text(numbers: np.ndarray, digits: int) -> str:
    return " ".join(f"{x:.{digits}f}" for x in np.ravel(numbers))


_ENTRIES = "ixx", "ixy", "iyy", "ixz", "iyz", "izz"


def urdf_of(plan: Plan, digits: int) -> tuple[str, str]:
    """URDF and YAML of a robot, placements with so many digits."""
    model, robot = plan.model, ET.Element("robot", name="rounded")
    ET.SubElement(robot, "link", name="universe")

    def placed(name: str, kind: str, bearer: int, link: str, place: pin.SE3) -> ET.Element:
        joint = ET.SubElement(robot, "joint", name=name, type=kind)
        ET.SubElement(joint, "parent", link=model.names[bearer])
        ET.SubElement(joint, "child", link=link)
        rpy = _text(pin.rpy.matrixToRpy(place.rotation), digits)
        ET.SubElement(joint, "origin", xyz=_text(place.translation, digits), rpy=rpy)
        return joint

    for j in range(1, model.njoints):
        name, body, joint = model.names[j], model.inertias[j], model.joints[j]
        inertial = ET.SubElement(ET.SubElement(robot, "link", name=name), "inertial")
        ET.SubElement(inertial, "mass", value=f"{body.mass:.17g}")
        ET.SubElement(inertial, "origin", xyz=_text(body.lever, 12))
        entries = zip(_ENTRIES, _lower(body.inertia), strict=True)
        ET.SubElement(inertial, "inertia", {key: f"{x:.17g}" for key, x in entries})
        kind = "prismatic" if joint.shortname().startswith("JointModelP") else "revolute"
        element = placed(name, kind, model.parents[j], name, model.jointPlacements[j])
        ET.SubElement(element, "axis", xyz=_text(axis_of(joint), 12))
        ET.SubElement(element, "limit", lower="-50", upper="50", effort="1e3", velocity="1e3")
    for name in dict.fromkeys(end for c in plan.closures for end in (c.frame_a, c.frame_b)):
        frame = model.frames[model.getFrameId(name)]
        ET.SubElement(robot, "link", name=name)
        placed(f"to_{name}", "fixed", frame.parentJoint, name, frame.placement)
    pairs = ", ".join(f"[{c.frame_a}, {c.frame_b}]" for c in plan.closures)
    kinds, motors = ", ".join(c.kind for c in plan.closures), ", ".join(plan.motors)
    gravity = _text(model.gravity.linear, 15).replace(" ", ", ")
    yaml = f"closed_loop: [{pairs}]\ntype: [{kinds}]\nname_mot: [{motors}]\ngravity: [{gravity}]\n"
    return ET.tostring(robot, encoding="unicode"), yaml


def _lower(matrix: np.ndarray) -> np.ndarray:
    return matrix[np.tril_indices(3)]

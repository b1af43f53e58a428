# SPDX-License-Identifier: BSD-2-Clause
"""Forces along lines, motors and contacts of a robot in an MJCF."""

from xml.etree.ElementTree import SubElement

import numpy as np
import pinocchio as pin

from ..model.conventions import NO_LIMIT
from ..model.lines import LineForce
from ..model.mechanism import Mechanism
from ..model.tree import frame_named
from .mjcf_attributes import pose_attributes
from .mjcf_document import MjcfDocument
from .urdf_writer import numbers

#: Radius of the sphere that stands for a contact point without a radius, [m].
_POINT = 1e-9
#: Attributes of geoms that touch only the geoms with which they form pairs.
_ONLY_IN_PAIRS = {"contype": "0", "conaffinity": "0"}


def add_lines(document: MjcfDocument, mechanism: Mechanism) -> None:
    """Add forces along lines as tendons."""
    for line in mechanism.lines.forces:
        _add_line(document, line)


def _add_line(document: MjcfDocument, line: LineForce) -> None:
    """Add a force along a line as a tendon."""
    attributes = {"name": line.name}

    # Spring and preload. The force stiffness * (length - rest length) + preload is the force of a
    # spring alone with another rest length. MuJoCo has no negative rest lengths.
    rest_length = 0.0
    if line.stiffness:
        rest_length = line.rest_length - line.preload / line.stiffness
        attributes["stiffness"] = numbers([line.stiffness])
        attributes["springlength"] = numbers([rest_length])
    if rest_length < 0 or (line.preload and not line.stiffness):
        text = f"its preload {line.preload:g} N: a tendon of MuJoCo has no constant force"
        document.problems.append(f"line {line}: {text}")
    if line.pulls_only:
        # With two spring lengths, the spring of a tendon has no force between them.
        attributes["springlength"] = numbers([0, rest_length])
        if line.damping or not line.stiffness:
            text = "a slack tendon of MuJoCo has no spring force, but its damper acts"
            document.problems.append(f"line {line}: {text}")

    # The other numbers.
    if line.damping:
        attributes["damping"] = numbers([line.damping])
    if line.coulomb_friction:
        attributes["frictionloss"] = numbers([line.coulomb_friction])
    if line.mass:
        attributes["armature"] = numbers([line.mass])
    if line.lower or line.upper < NO_LIMIT:
        attributes["range"] = numbers([line.lower, min(line.upper, NO_LIMIT)])
    if line.velocity < NO_LIMIT:
        document.notes.append(f"line {line}: its largest velocity is left out")
    if line.mass and _joins_branches(document.model, line):
        text = "its mass: MuJoCo leaves out the inertia of a tendon between two branches"
        document.problems.append(f"line {line}: {text}")
    document.add_line_tendon(attributes, line.frame_a, line.frame_b)


def _joins_branches(model: pin.Model, line: LineForce) -> bool:
    """Whether both ends of a line move relative to the last body that carries both.

    Example: a line between two legs.
    """
    frame_a = frame_named(model, line.frame_a)
    frame_b = frame_named(model, line.frame_b)
    supports_a = set(model.supports[frame_a.parentJoint])
    supports_b = set(model.supports[frame_b.parentJoint])
    return not supports_a <= supports_b and not supports_b <= supports_a


def add_motors(document: MjcfDocument, mechanism: Mechanism) -> None:
    """Add motors, each with a control that is its force."""
    joint_names = document.names_by_rate()
    for k, name in enumerate(mechanism.motor_names):
        # Factors from the motor's force to the forces on rates, shape (nv,), and on lines.
        on_rates = mechanism.actuation[:, k]
        on_lines = mechanism.lines.actuation[:, k]
        rates = np.flatnonzero(on_rates)
        lines = np.flatnonzero(on_lines)
        has_joints_for_all_rates = all(int(rate) in joint_names for rate in rates)
        motor = {"name": name}
        if not len(rates) and len(lines) == 1:
            line = mechanism.lines.forces[lines[0]]
            motor |= _motor_on_line(document, name, line, float(on_lines[lines[0]]))
        elif len(lines) or not has_joints_for_all_rates:
            text = "it acts on more than hinges and slides, or one line"
            document.problems.append(f"motor {name}: {text}")
        elif len(rates) == 1 and on_rates[rates[0]] == 1:
            motor |= _motor_in_joint(mechanism, joint_names[int(rates[0])], int(rates[0]))
        else:
            factors = {joint_names[int(rate)]: float(on_rates[rate]) for rate in rates}
            motor["tendon"] = document.add_sum_tendon(name, factors)
        SubElement(document.section("actuator"), "motor", motor)


def _motor_on_line(
    document: MjcfDocument, motor: str, line: LineForce, factor: float
) -> dict[str, str]:
    """Attributes of a motor that acts on one line by a factor; a note on a factor other than 1."""
    attributes = {"tendon": line.name}
    if factor != 1:
        attributes["gear"] = numbers([factor])
        text = "its factor is a gear; from_mjcf reads a motor with the factor 1"
        document.notes.append(f"motor {motor}: {text}")
    if line.effort < NO_LIMIT:
        largest = line.effort / abs(factor)
        attributes["ctrlrange"] = numbers([-largest, largest])
    return attributes


def _motor_in_joint(mechanism: Mechanism, joint: str, rate: int) -> dict[str, str]:
    """Attributes of a motor in a hinge or a slide."""
    attributes = {"joint": joint}
    effort = float(mechanism.model.upperEffortLimit[rate])
    if 0 < effort < NO_LIMIT:
        attributes["ctrlrange"] = numbers([-effort, effort])
    return attributes


def add_contacts(document: MjcfDocument, mechanism: Mechanism) -> None:
    """Add spheres and planes that touch in pairs, and ropes as tendons of limited length."""
    contacts = mechanism.contacts
    planes = dict[str, str]()  # name of the plane at each ground
    for contact in contacts.points:
        frame = frame_named(document.model, contact.frame)
        ground = frame_named(document.model, contact.ground)
        if ground.parentJoint:
            text = "its ground moves, but planes of MuJoCo are fixed to the world"
            document.problems.append(f"contact {contact}: {text}")
            continue
        if contact.restitution:
            document.notes.append(f"contact {contact}: its restitution is left out")
        if contact.ground not in planes:
            planes[contact.ground] = f"{contact.ground} plane"
            plane = {"name": planes[contact.ground], "type": "plane", "size": "1 1 1"}
            pose = pose_attributes(ground.placement)
            SubElement(document.base, "geom", plane | _ONLY_IN_PAIRS | pose)
        sphere = {"name": f"{contact} sphere", "type": "sphere", "mass": "0"}
        sphere |= {"size": numbers([max(contact.radius, _POINT)])}
        place = pin.SE3(np.eye(3), frame.placement.translation)
        document.add_geom(frame.parentJoint, sphere | _ONLY_IN_PAIRS | pose_attributes(place))
        pair = {"name": contact.name, "geom1": sphere["name"], "geom2": planes[contact.ground]}
        # Coefficients of friction along both tangents; the others are of torsion and rolling.
        sliding = [contact.friction, contact.friction, 0, 0, 0]
        pair |= {"condim": "3", "friction": numbers(sliding)}
        SubElement(document.section("contact"), "pair", pair)
    for rope in contacts.ropes:
        attributes = {"name": rope.name, "range": numbers([0, rope.length])}
        document.add_line_tendon(attributes, rope.frame_a, rope.frame_b)

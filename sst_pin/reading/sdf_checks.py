# SPDX-License-Identifier: BSD-2-Clause
"""Checks of a model of an SDF: names, and parts that cannot be read or are not read."""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence

from ..summaries import listed
from .acting_elements import plugin_problem, texts_of
from .joint_graph import WORLD
from .problems import is_true, stands_for, warning
from .sdf_joints import DRAKE_MIMIC, has_one_axis
from .sdf_model import SdfModel
from .tool_elements import is_weld, is_weld_within


def check(model: SdfModel) -> None:
    """Add problems of names, and of parts of the robot that are not in its links and joints."""
    _require_distinct_names(model)
    for part in model.element.findall("include"):
        name = part.get("name") or part.findtext("uri") or ""
        text = "parts of a model in other files are not supported; write them into this file"
        model.problems.append(f"<include> {name}: {text}")
    for link in model.links.values():
        if is_true(link.findtext("kinematic")):
            model.refuse(link, "a kinematic link, moved without forces, is not supported")
        inertial = link.find("inertial")
        if inertial is not None and is_true(inertial.get("auto")):
            text = "the inertia of shapes (auto) is not computed; write mass and inertia"
            model.refuse(link, text)


def _require_distinct_names(model: SdfModel) -> None:
    """Add problems of links, joints or frames without a name, or with the same name."""
    for tag in ("link", "joint", "frame"):
        counts = Counter(e.get("name", "") for e in model.element.findall(tag))
        for name, count in counts.items():
            if not name:
                model.problems.append(f"{tag}: {count} without a name")
            elif count > 1:
                model.problems.append(f"{tag} {name}: {count} have this name")
    canonical = model.element.get("canonical_link")
    if canonical and canonical not in model.links:
        model.problems.append(f"model: its canonical_link {canonical} is not one of its links")


def note_unread(model: SdfModel, worlds: Sequence[ET.Element]) -> None:
    """Add warnings of parts of a model and its world that may act and are not read."""
    for world in worlds:
        _note_rest_of_world(model, world)
    for parent in (*worlds, model.element):
        for plugin in parent.findall("plugin"):
            if is_weld(plugin) and is_weld_within(plugin, model.name):
                continue  # `sdf_joints` reads it
            model.notes += plugin_problem(plugin, parent.tag)
    _note_forces_of_medium(model)
    _note_elements_of_tools(model)
    _note_poses_in_world(model)


def _note_rest_of_world(model: SdfModel, world: ET.Element) -> None:
    """Warn of elements of the world that may touch or hold the model."""
    for include in world.findall("include"):
        text = f"{include.findtext('uri', '').strip()} is not read"
        model.notes.append(warning("<include> in <world>", text))
    for joint in world.findall("joint"):
        text = "a joint of the world is not read; put it into the model"
        model.notes.append(warning(f"joint {joint.get('name')}", text))


def _note_forces_of_medium(model: SdfModel) -> None:
    """Warn of a medium around the links, such as water: its damping, its mass, and wind."""
    has_wind = is_true(model.element.findtext("enable_wind"))
    for link in model.links.values():
        where = f"link {link.get('name')}"
        for path in ("velocity_decay/linear", "velocity_decay/angular"):
            if model.number(link, path, 0.0):
                model.notes.append(warning(where, f"<{path}> is not read"))
        if link.find("inertial/fluid_added_mass") is not None:
            model.notes.append(warning(where, "<fluid_added_mass> is not read"))
        if is_true(link.findtext("enable_wind")):
            has_wind = True
    if has_wind:
        model.notes.append(warning("model", "wind is not read"))


#: Elements of a model that need no warning: they exert no force, or other functions read them.
#: Any other element may act. It gets a warning if it names a link, a joint or a frame.
_HARMLESS = {
    "allow_auto_disable",
    "enable_wind",
    "frame",
    "gripper",
    "include",
    "joint",
    "link",
    "model",
    "plugin",
    "pose",
    "self_collide",
    "static",
    "drake:collision_filter_group",
    "drake:ball_constraint",  # `sdf` reads it
}
#: Elements of other tools in a joint that are about its motor, whose torque is an argument.
_OF_MOTORS = {"drake:controller_gains"}


def _note_elements_of_tools(model: SdfModel) -> None:
    """Warn of elements that other tools add, such as bushings and rotors of Drake."""
    joints = model.element.findall("joint")
    known_names = {part.get("name", "") for part in (*joints, *model.element.findall("frame"))}
    known_names.update(model.links)
    for element in model.element:
        if element.tag in _HARMLESS:
            continue
        names = sorted(known_names & texts_of(element))
        if names:
            text = f"of {listed(names)} is not read"
            model.notes.append(warning(f"<{element.tag}>", text))
    for joint in joints:
        where = f"joint {joint.get('name')}"
        if joint.find("mimic") is not None:
            model.notes.append(warning(where, "<mimic> is not read; put it into <axis>"))
        for part in joint.iter():
            if ":" not in part.tag or part.tag in _OF_MOTORS:
                continue
            if part is joint.find(DRAKE_MIMIC) and has_one_axis(joint):  # `sdf_joints` reads it
                continue
            # Without a text, the numbers may be in attributes or elements.
            if part.attrib or len(part) or not stands_for(part.text or "", 0):
                model.notes.append(warning(where, f"<{part.tag}> is not read"))


def _note_poses_in_world(model: SdfModel) -> None:
    """Warn of parts whose pose is relative to the world."""
    for element in model.element.iter():
        pose = element.find("pose")
        if pose is None or element is model.element:
            continue
        if pose.get("relative_to") == WORLD:
            where = f"{element.tag} {element.get('name', '')}".strip()
            text = "its pose is relative to the world, which other tools refuse"
            model.notes.append(warning(where, text))

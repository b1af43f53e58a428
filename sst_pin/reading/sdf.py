# SPDX-License-Identifier: BSD-2-Clause
"""Reads an SDF as the elements of a URDF.

An SDF has models, perhaps in a world; one of them is read. `sdf_joints` and `sdf_links` read its
parts, `sdf_frames` has the poses.
"""

import re
import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import DescriptionError
from .joint_graph import WORLD, JointGraph
from .problems import Problem, is_true, numbers
from .sdf_checks import check, note_unread
from .sdf_joints import joints_of, welds_of
from .sdf_links import add_links
from .sdf_model import SdfModel


class SdfContent(NamedTuple):
    """A model of an SDF; its base is the world of the SDF."""

    graph: JointGraph
    gravity: Array  #: Of the world, shape (3,), [m/s^2].
    notes: list[Problem]  #: Warnings of content that is not read, or missing and has a default.


def read_sdf(root: ET.Element, source: str, name: str | None = None) -> SdfContent:
    """Read a model of an SDF, by its name; an error names all problems."""
    axes_in_model = _minor_version(root, source) < _AXES_IN_JOINT
    worlds = root.findall("world")
    if len(worlds) > 1:
        raise DescriptionError(source, [f"{len(worlds)} worlds; one is needed"])
    element = _chosen_model(root, source, name)
    model = SdfModel(element, is_in_world=element not in root.findall("model"))

    # The functions below add to the problems and the notes of the model.
    check(model)
    note_unread(model, worlds)
    gravity = _gravity(root, model)
    joints = [*joints_of(model, axes_in_model), *welds_of(model)]

    # The tree of these joints, then links and frames.
    frames = model.frames
    world = frames.pose_in_model(WORLD)
    poses = {link: world.actInv(frames.pose_in_model(link)) for link in model.links}
    frame_elements = model.element.findall("frame")
    frame_names = [frame.get("name", "") for frame in frame_elements]
    graph = JointGraph(model.name, joints, poses, frame_names)
    add_links(model, graph)
    for ball in model.element.findall("drake:ball_constraint"):
        graph.add_ball_constraint({part.tag: (part.text or "").strip() for part in ball})
    for frame in frame_elements:
        frame_name = frame.get("name", "")
        link = frames.link_of(frame_name)
        if link:
            graph.add_frame(frame_name, link, frames.relative_pose(link, frame_name))
        else:
            model.refuse(frame, "it is not attached to a link of this model")
    problems = dict.fromkeys([*model.problems, *graph.problems])  # each once
    if problems:
        raise DescriptionError(source, problems)
    return SdfContent(graph, gravity, [*model.notes, *graph.notes])


#: From this minor version on, axes are in the frame of the joint by default; before, of the model.
_AXES_IN_JOINT = 5


def _minor_version(root: ET.Element, source: str) -> int:
    """The minor number of the SDF's version 1.x."""
    version = root.get("version", "1.7").strip()
    match = re.fullmatch(r"1\.(\d+)(\.\d+)?", version)
    if match is None:
        raise DescriptionError(source, [f"version {version!r} is none of SDF, such as 1.12"])
    return int(match[1])


def _chosen_model(root: ET.Element, source: str, name: str | None) -> ET.Element:
    """The model of this name; without a name, the only model that is not static."""
    models = [*root.findall("model"), *root.findall("world/model")]
    moving = [model for model in models if not is_true(model.findtext("static"))]
    names = ", ".join(model.get("name", "") for model in moving)
    if name is None:
        candidates = moving
    else:
        candidates = [model for model in models if model.get("name") == name]
    if len(candidates) == 1:
        return candidates[0]
    if name is not None:
        text = f"{len(candidates)} models are named {name}; the models are {names}"
    elif candidates:
        text = f"{len(candidates)} models that move: {names}; model= chooses one, --model in "
        text += "the shell"
    else:
        text = "no model that moves; one is needed"
    raise DescriptionError(source, [text])


def _gravity(root: ET.Element, model: SdfModel) -> Array:
    """The gravity of the world, shape (3,), [m/s^2]; a problem if it is no vector."""
    text = root.findtext("world/gravity")
    if text is None:
        text = root.findtext("world/physics/gravity")  # until version 1.4
    if text is None:
        text = "0 0 -9.81"
    gravity = numbers(text, 3)
    if gravity is None:
        model.problems.append(f"gravity {text!r} is not three numbers")
        return np.zeros(3)
    return gravity

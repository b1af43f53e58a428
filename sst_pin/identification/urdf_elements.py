# SPDX-License-Identifier: BSD-2-Clause
"""Elements of a URDF that identified numbers are written into: origins, links, meshes."""

import os
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..errors import DescriptionWarning
from ..reading import RobotFile, Urdf, read_urdf
from ..reading.joint_graph import origin_of
from ..reading.problems import placement


def joint_origin(joint: ET.Element) -> pin.SE3:
    """The pose of a joint's frame in the frame of its parent link."""
    origin = joint.find("origin")
    if origin is None:
        return pin.SE3.Identity()
    xyz = np.array(origin.get("xyz", "0 0 0").split(), float)
    rpy = np.array(origin.get("rpy", "0 0 0").split(), float)
    return placement(xyz, rpy)


def set_joint_origin(joint: ET.Element, pose: pin.SE3) -> None:
    """Write the pose of a joint's frame in the frame of its parent link."""
    origin = joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    origin.attrib.update(origin_of(pose))


def link_frames(model: pin.Model) -> dict[str, pin.Frame]:
    """The frames of the links in a model, by their names."""
    return {frame.name: frame for frame in model.frames if frame.type == pin.FrameType.BODY}


def link_frame(joint: ET.Element, end: str, links: Mapping[str, pin.Frame]) -> pin.Frame | None:
    """The frame of the link at an end of a joint, "parent" or "child".

    None if the model has no such link: then the URDF describes another robot.
    """
    element = joint.find(end)
    if element is None:
        return None
    return links.get(element.get("link", ""))


def text_for_folder(root: ET.Element, source: Path, folder: Path) -> str:
    """The text of a URDF for another folder: relative paths of meshes lead to the same files.

    Args:
        root: The URDF; its paths are changed.
        source: The folder that the paths are relative to.
        folder: The folder that they shall be relative to.
    """
    if source != folder:
        for element in [*root.iter("mesh"), *root.iter("texture")]:
            name = element.get("filename", "")
            if name and "://" not in name and not Path(name).is_absolute():
                new_name = os.path.relpath(source / name, folder)
                element.set("filename", Path(new_name).as_posix())
    return ET.tostring(root, encoding="unicode", xml_declaration=True)


def read_again(urdf: Urdf) -> RobotFile:
    """The robot of a changed URDF, with the YAML beside the first one, without its warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DescriptionWarning)
        return read_urdf(urdf)

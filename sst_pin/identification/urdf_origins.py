# SPDX-License-Identifier: BSD-2-Clause
"""Writes calibrated placements of joints and frames into the URDF that a robot was read from."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import pinocchio as pin

from ..errors import DescriptionError
from ..reading import Urdf
from ..summaries import listed
from .urdf_elements import joint_origin, read_again, set_joint_origin, text_for_folder

#: Largest difference of placements that are read back, as in `pinocchio.SE3.isApprox`.
_EQUAL = 1e-9


def carriers_of(root: ET.Element, model: pin.Model) -> dict[str, ET.Element]:
    """For joints and links of a model, by name, the joint of a URDF whose origin places them.

    Joints and links without such a joint are left out.
    """
    joints = root.findall("joint")
    carriers = {joint.get("name", ""): joint for joint in joints}
    # The frame of a link is the frame of the joint that the link is the child of.
    for joint in joints:
        child = joint.find("child")
        if child is not None:
            carriers.setdefault(child.get("link", ""), joint)
    # A universal joint of the YAML is two joints of the model, such as NAME_X and NAME_Y. The first
    # of them has the placement of NAME.
    for name, parent in zip(model.names, model.parents, strict=True):
        universal, _, axis = name.rpartition("_")
        is_part = name not in carriers and universal in carriers and axis in ("X", "Y", "Z")
        follows_other_part = model.names[parent].rpartition("_")[0] == universal
        if is_part and not follows_other_part:
            carriers[name] = carriers[universal]
    return carriers


def with_origins(
    urdf: str | Path, model: pin.Model, changes: Mapping[str, pin.SE3], folder: Path
) -> str:
    """The text of a URDF in which joints and frames are displaced; it is read back and compared.

    Args:
        urdf: The URDF.
        model: The robot with the placements that shall result.
        changes: Displacements of joints and frames in their own axes, by name.
        folder: The folder that the text is for.
    """
    root = Urdf.read(urdf).root
    carriers = carriers_of(root, model)
    missing = [place for place in changes if place not in carriers]
    if missing:
        problem = f"no joint carries {listed(missing)}"
        cure = "calibrate(..., urdf=) leaves out such errors"
        raise DescriptionError(str(urdf), [f"{problem}; {cure}"])
    for place, change in changes.items():
        joint = carriers[place]
        set_joint_origin(joint, joint_origin(joint) * change)

    # Read it back.
    model_again = read_again(Urdf(ET.tostring(root, encoding="unicode"), str(urdf))).model
    placements = dict(zip(model_again.names, model_again.jointPlacements, strict=True))
    different = []
    for name, placement in zip(model.names, model.jointPlacements, strict=True):
        if name in placements and not placements[name].isApprox(placement, _EQUAL):
            different.append(name)
    if different:
        problem = f"it is another robot: {listed(different)} are elsewhere"
        raise DescriptionError(str(urdf), [problem])
    return text_for_folder(root, Path(urdf).resolve().parent, folder.resolve())

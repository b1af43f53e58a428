# SPDX-License-Identifier: BSD-2-Clause
"""Numbers found by measurements, in the URDF that a robot was read from."""

import warnings
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..closed_chain import ClosedChain
from ..errors import DescriptionError, DescriptionWarning
from ..files import as_path, text_writer, write_files
from ..reading import Urdf
from ..reading.urdf_checks import ENTRIES
from ..summaries import listed


def write_urdf(chain: ClosedChain, urdf: str | Path, path: str | Path, force: bool = False) -> None:
    """Write a URDF with the inertias and the friction of a robot, such as one identified.

    Links that move as one body, as those at fixed joints, get one inertia, in the first of them
    that had one. Masses, mass centres, inertias, `damping` and `friction` change, nothing else.

    Args:
        chain: The robot, as `with_parameters` gives it.
        urdf: The URDF that it was read from.
        path: The new file; a YAML with the closures has to have its name.
        force: Whether an existing file may be replaced.

    Raises:
        DescriptionError: If the URDF cannot be read, or is not that of the robot.
        OutputError: If the file cannot be written, or exists.

    Warns:
        DescriptionWarning: For parameters that a URDF cannot have: rotors, springs, forces along
            lines, friction of joints with several freedoms.

    Example:
        >>> chain = sst_pin.ClosedChain.from_urdf(sst_pin.URDF_PATH)
        >>> rubbing = chain.with_parameters({"mu_1.viscous": 0.3})
        >>> sst_pin.identification.write_urdf(rubbing, sst_pin.URDF_PATH, "found.urdf")
    """
    write_files({as_path(path): text_writer(with_dynamics(chain, urdf))}, force)


def with_dynamics(chain: ClosedChain, urdf: str | Path) -> str:
    """The text that `write_urdf` writes."""
    root, model = Urdf.read(urdf).root, chain.mechanism.model
    links = {link.get("name"): link for link in root.findall("link")}
    bodies = [f for f in model.frames if f.type == pin.FrameType.BODY and f.name in links]
    for j, inertia in enumerate(list(model.inertias)[1:], 1):
        moved = [frame for frame in bodies if frame.parentJoint == j]
        if not moved and inertia.mass:
            raise DescriptionError(str(urdf), [f"no link is moved by joint {model.names[j]}"])
        heavy = [frame for frame in moved if links[frame.name].find("inertial") is not None]
        for frame in heavy:
            links[frame.name].remove(links[frame.name].find("inertial"))  # type: ignore[arg-type]
        if inertia.mass:
            bearer = (heavy or moved)[0]
            links[bearer.name].append(_inertial(bearer.placement.actInv(inertia)))
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    alone = [j for j in range(1, model.njoints) if model.joints[j].nv == 1]
    written = [j for j in alone if model.names[j] in joints]
    friction = chain.mechanism.friction
    for j in written:
        joint, k = joints[model.names[j]], model.joints[j].idx_v
        numbers = {"damping": friction.viscous[k], "friction": friction.coulomb[k]}
        dynamics = joint.find("dynamics")
        if dynamics is None and any(numbers.values()):
            dynamics = ET.SubElement(joint, "dynamics")
        if dynamics is not None:
            dynamics.attrib.update({key: repr(float(x)) for key, x in numbers.items()})
    kept = {f"{model.names[j]}.{kind}" for j in written for kind in ("viscous", "coulomb")}
    theta, inertial = chain.dynamic_parameters, 10 * (model.njoints - 1)
    others = zip(theta.names[inertial:], theta.values[inertial:], strict=True)
    if left := [name for name, value in others if value and name not in kept]:
        problem = f"a URDF has no place for {listed(left)}"
        warnings.warn(f"{problem}; give them again when it is read", DescriptionWarning, 3)
    return ET.tostring(root, encoding="unicode", xml_declaration=True)


def with_origins(urdf: str | Path, moved: Mapping[str, pin.SE3]) -> str:
    """The text of a URDF in which joints, by the name of the joint or its child, are moved."""
    root = Urdf.read(urdf).root
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    for joint in root.findall("joint[child]"):
        joints.setdefault(joint.find("child").get("link"), joint)  # type: ignore[union-attr]
    for place, by in moved.items():
        if place not in joints:
            raise DescriptionError(str(urdf), [f"no joint bears {place}"])
        origin = joints[place].find("origin")
        if origin is None:
            origin = ET.SubElement(joints[place], "origin")
        xyz, rpy = (np.array(origin.get(k, "0 0 0").split(), float) for k in ("xyz", "rpy"))
        new = pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz) * by
        origin.set("xyz", _numbers(new.translation))
        origin.set("rpy", _numbers(pin.rpy.matrixToRpy(new.rotation)))
    return ET.tostring(root, encoding="unicode", xml_declaration=True)


def _inertial(inertia: pin.Inertia) -> ET.Element:
    inertial = ET.Element("inertial")
    ET.SubElement(inertial, "origin", xyz=_numbers(inertia.lever), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(float(inertia.mass)))
    upper = inertia.inertia[np.triu_indices(3)].tolist()
    ET.SubElement(inertial, "inertia", dict(zip(ENTRIES, map(repr, upper), strict=True)))
    return inertial


def _numbers(vector: ArrayLike) -> str:
    return " ".join(map(repr, np.asarray(vector, float).tolist()))

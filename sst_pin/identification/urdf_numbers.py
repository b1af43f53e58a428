# SPDX-License-Identifier: BSD-2-Clause
"""Writes identified numbers into the URDF that a robot was read from."""

import os
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..dynamics.regressor import OF_BODY
from ..engine import require_robot
from ..errors import DescriptionError, DescriptionWarning, warn_caller
from ..files import as_path, text_writer, write_files
from ..reading import RobotFile, Urdf, read_urdf
from ..reading.inertia_checks import ENTRIES
from ..reading.joint_graph import origin_of
from ..reading.problems import placement
from ..summaries import listed

#: Smaller differences of placements are rounding.
_ROUNDING = 1e-12
#: Largest difference of parameters that are read back, relative to the largest of their kind.
_EQUAL = 1e-9


def write_urdf(chain: ClosedChain, urdf: str | Path, path: str | Path, force: bool = False) -> None:
    """Write a URDF with the inertias and the friction of a robot, such as one identified.

    Links that are fixed to each other get one inertia, in the first of them that had one. Locked
    joints become fixed. Otherwise only masses, mass centres, inertias, `damping`, `friction` and
    relative paths of meshes and textures change.

    Args:
        chain: The robot, as `with_parameters` gives it.
        urdf: The URDF that it was read from.
        path: The new file. Give the YAML with the closures the same name.
        force: Whether an existing file may be replaced.

    Raises:
        DescriptionError: If the URDF describes another robot.

    Warns:
        DescriptionWarning: For parameters that differ when the file is read again, with the YAML of
            the first: rotors, springs, forces along lines, different friction in one joint.

    Example:
        >>> chain = sst_pin.ClosedChain.from_urdf(sst_pin.URDF_PATH)
        >>> rubbing = chain.with_parameters({"mu_1.viscous": 0.3})
        >>> sst_pin.identification.write_urdf(rubbing, sst_pin.URDF_PATH, "found.urdf")
    """
    require_robot("chain", chain)
    folder = as_path(path).parent
    write_files({as_path(path): text_writer(with_dynamics(chain, urdf, folder))}, force)


def with_dynamics(chain: ClosedChain, urdf: str | Path, folder: Path) -> str:
    """The text that `write_urdf` writes to a folder, read back and compared."""
    source = Urdf.read(urdf)
    root = source.root
    model = chain.mechanism.model
    partly_locked = _fix_locked(root, model)
    _put_bodies(root, model, str(urdf))
    _put_friction(root, chain)
    text = ET.tostring(root, encoding="unicode", xml_declaration=True)
    lost = [f"{name} (lock it again)" for name in partly_locked]
    lost += _differences(chain, Urdf(text, str(urdf)), partly_locked)
    if lost:
        cure = f"write them into {Path(urdf).stem}.yaml beside it"
        warn_caller(f"a URDF cannot store {listed(lost)}; {cure}", DescriptionWarning)
    return _with_meshes(root, Path(urdf).resolve().parent, folder.resolve())


def _put_bodies(root: ET.Element, model: pin.Model, urdf: str) -> None:
    """Give each body of the model to the first link with an inertia that moves with it."""
    links = {link.get("name"): link for link in root.findall("link")}
    bodies = [f for f in model.frames if f.type == pin.FrameType.BODY and f.name in links]
    for j, inertia in enumerate(list(model.inertias)[1:], 1):
        moving = [frame for frame in bodies if frame.parentJoint == j]
        if not moving and inertia.mass:
            raise DescriptionError(urdf, [f"no link is moved by joint {model.names[j]}"])
        with_inertia = []
        for frame in moving:
            inertial = links[frame.name].find("inertial")
            if inertial is not None:
                links[frame.name].remove(inertial)
                with_inertia.append(frame)
        if inertia.mass:
            carrier = with_inertia[0] if with_inertia else moving[0]
            links[carrier.name].append(_inertial(carrier.placement.actInv(inertia)))


def _put_friction(root: ET.Element, chain: ClosedChain) -> None:
    """Give each joint its friction; none where the rates of a joint have different friction."""
    friction = chain.mechanism.friction
    space = chain.mechanism.space
    for joint in root.findall("joint"):
        rates: list[int] = []
        for part in _series(joint, chain.mechanism.model):
            rates.extend(space.rates[part])
        if not rates:
            continue
        damping = _common_value(friction.viscous[rates])
        dry_friction = _common_value(friction.coulomb[rates])
        dynamics = joint.find("dynamics")
        if dynamics is None and (damping or dry_friction):
            dynamics = ET.SubElement(joint, "dynamics")
        if dynamics is not None:
            dynamics.set("damping", repr(damping))
            dynamics.set("friction", repr(dry_friction))


def _common_value(values: Array) -> float:
    """The value that all have; 0 if they differ."""
    return float(values[0]) if np.ptp(values) == 0 else 0.0


def _differences(
    chain: ClosedChain, urdf: Urdf, partly_locked: Mapping[str, Sequence[str]]
) -> list[str]:
    """Names of the parameters that a URDF, with the YAML beside it, gives other values.

    `partly_locked` has the joints of which single rates are locked, with their series in the model;
    these have names of their own and are not compared.
    """
    again = ClosedChain.from_description(_read_again(urdf)).dynamic_parameters
    values = dict(zip(again.names, again.values, strict=True))
    theta = chain.dynamic_parameters
    kinds = np.array([name.rpartition(".")[2] for name in theta.names])
    joints = [name.rpartition(".")[0] for name in theta.names]
    parts = set[str]()
    for series in partly_locked.values():
        parts.update(series)
    lost = []
    for k, name in enumerate(theta.names):
        largest = np.abs(theta.values[kinds == kinds[k]]).max()
        difference = abs(values.get(name, 0.0) - theta.values[k])
        if difference > _EQUAL * largest and joints[k] not in parts:
            lost.append(name)
    bodies = [name for name in lost if name.rpartition(".")[2] in OF_BODY]
    if bodies:
        raise DescriptionError(urdf.source, [f"it is another robot: {listed(bodies)} differ"])
    return lost


def _with_meshes(root: ET.Element, source: Path, folder: Path) -> str:
    """The text of a URDF for another folder: relative paths of meshes lead to the same files."""
    for element in [*root.iter("mesh"), *root.iter("texture")]:
        name = element.get("filename", "")
        if name and "://" not in name and not Path(name).is_absolute() and source != folder:
            element.set("filename", Path(os.path.relpath(source / name, folder)).as_posix())
    return ET.tostring(root, encoding="unicode", xml_declaration=True)


def carriers_of(root: ET.Element, model: pin.Model) -> dict[str, ET.Element]:
    """Joints of a URDF by the joints and links whose placements in the model they store."""
    carriers = {joint.get("name", ""): joint for joint in root.findall("joint")}
    for joint in root.findall("joint"):
        child = joint.find("child")
        if child is not None:
            carriers.setdefault(child.get("link", ""), joint)
    # The first part of a universal joint in the YAML, such as NAME_X, has the placement of NAME.
    for name, parent in zip(model.names, model.parents, strict=True):
        whole, _, axis = name.rpartition("_")
        is_part = name not in carriers and whole in carriers and axis in ("X", "Y", "Z")
        is_first = model.names[parent].rpartition("_")[0] != whole
        if is_part and is_first:
            carriers[name] = carriers[whole]
    return carriers


def with_origins(
    urdf: str | Path, model: pin.Model, changes: Mapping[str, pin.SE3], folder: Path
) -> str:
    """The text of a URDF, for a folder, in which places are displaced; it is read and compared.

    `changes` are the displacements of joints and frames in their own axes, by name; `model` has the
    placements that result.
    """
    root = Urdf.read(urdf).root
    joints = carriers_of(root, model)
    missing = [place for place in changes if place not in joints]
    if missing:
        problem = f"no joint carries {listed(missing)}"
        cure = "calibrate(..., urdf=) leaves out such errors"
        raise DescriptionError(str(urdf), [f"{problem}; {cure}"])
    for place, change in changes.items():
        _set_origin(joints[place], _origin(joints[place]) * change)
    again = _read_again(Urdf(ET.tostring(root, encoding="unicode"), str(urdf))).model
    placements = dict(zip(again.names, again.jointPlacements, strict=True))
    differ = []
    for name, wanted in zip(model.names, model.jointPlacements, strict=True):
        if name in placements and not placements[name].isApprox(wanted, _EQUAL):
            differ.append(name)
    if differ:
        raise DescriptionError(str(urdf), [f"it is another robot: {listed(differ)} are elsewhere"])
    return _with_meshes(root, Path(urdf).resolve().parent, folder.resolve())


def _read_again(urdf: Urdf) -> RobotFile:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DescriptionWarning)
        return read_urdf(urdf)


def _fix_locked(root: ET.Element, model: pin.Model) -> dict[str, list[str]]:
    """Make joints of a URDF fixed that are locked in the robot, where they are locked.

    Returns the joints of which single rates are locked, which a URDF cannot store, with the joints
    of the model that are left of each.
    """
    links = _links_of(model)
    partly_locked = dict[str, list[str]]()
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        series = _series(joint, model)
        suffixes = [part.removeprefix(f"{name}_") for part in series if part != name]
        # Parts of partly locked joints are named by their rates, such as NAME_wx; those of
        # universal joints in the YAML come in pairs with capitals, NAME_X and NAME_Y.
        if suffixes and (len(series) == 1 or suffixes[0].islower()):
            partly_locked[name] = series
        parent, child = _ends(joint, links)
        if series or joint.get("type") == "fixed" or parent is None or child is None:
            continue
        joint.set("type", "fixed")
        joint[:] = [part for part in joint if part.tag in ("origin", "parent", "child")]
        pose = parent.placement.actInv(child.placement)
        if not _origin(joint).isApprox(pose, _ROUNDING):
            _set_origin(joint, pose)
    return partly_locked


def _series(joint: ET.Element, model: pin.Model) -> list[str]:
    """The joints of the model between the links of a joint of a URDF; none if it is fixed."""
    parent, child = _ends(joint, _links_of(model))
    if parent is None or child is None:
        return []
    series = list[str]()
    j = child.parentJoint
    while j not in (0, parent.parentJoint):
        series.insert(0, model.names[j])
        j = model.parents[j]
    if j != parent.parentJoint:  # the URDF of another robot
        return []
    return series


def _links_of(model: pin.Model) -> dict[str, pin.Frame]:
    return {f.name: f for f in model.frames if f.type == pin.FrameType.BODY}


def _ends(
    joint: ET.Element, links: Mapping[str, pin.Frame]
) -> tuple[pin.Frame | None, pin.Frame | None]:
    """The frames of the parent and the child of a joint; None in the URDF of another robot."""
    return _link_frame(joint.find("parent"), links), _link_frame(joint.find("child"), links)


def _link_frame(end: ET.Element | None, links: Mapping[str, pin.Frame]) -> pin.Frame | None:
    """The frame of the link that an end of a joint names."""
    if end is None:
        return None
    return links.get(end.get("link", ""))


def _origin(joint: ET.Element) -> pin.SE3:
    """The pose of a joint's frame in the frame of its parent link."""
    origin = joint.find("origin")
    if origin is None:
        return pin.SE3.Identity()
    xyz = np.array(origin.get("xyz", "0 0 0").split(), float)
    rpy = np.array(origin.get("rpy", "0 0 0").split(), float)
    return placement(xyz, rpy)


def _set_origin(joint: ET.Element, pose: pin.SE3) -> None:
    """Write the pose of a joint's frame in the frame of its parent link."""
    origin = joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    origin.attrib.update(origin_of(pose))


def _inertial(inertia: pin.Inertia) -> ET.Element:
    """An `<inertial>` with a mass, its centre and its moments."""
    inertial = ET.Element("inertial")
    ET.SubElement(inertial, "origin", origin_of(pin.SE3(np.eye(3), inertia.lever)))
    ET.SubElement(inertial, "mass", value=repr(float(inertia.mass)))
    upper = inertia.inertia[np.triu_indices(3)].tolist()
    ET.SubElement(inertial, "inertia", dict(zip(ENTRIES, map(repr, upper), strict=True)))
    return inertial

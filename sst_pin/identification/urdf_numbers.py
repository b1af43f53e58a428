# SPDX-License-Identifier: BSD-2-Clause
"""Writes identified numbers into the URDF that a robot was read from."""

import os
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..closed_chain import ClosedChain
from ..dynamics.regressor import OF_BODY
from ..errors import DescriptionError, DescriptionWarning, warn_caller
from ..files import as_path, text_writer, write_files
from ..reading import RobotFile, Urdf, read_urdf
from ..reading.joint_graph import origin_of
from ..reading.urdf_checks import ENTRIES
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
        path: The new file; a YAML with the closures has to have its name.
        force: Whether an existing file may be replaced.

    Raises:
        DescriptionError: If the URDF is not that of the robot.

    Warns:
        DescriptionWarning: For parameters that differ when the file is read again, with the YAML of
            the first: rotors, springs, forces along lines, different friction in one joint.

    Example:
        >>> chain = sst_pin.ClosedChain.from_urdf(sst_pin.URDF_PATH)
        >>> rubbing = chain.with_parameters({"mu_1.viscous": 0.3})
        >>> sst_pin.identification.write_urdf(rubbing, sst_pin.URDF_PATH, "found.urdf")
    """
    folder = as_path(path).parent
    write_files({as_path(path): text_writer(with_dynamics(chain, urdf, folder))}, force)


def with_dynamics(chain: ClosedChain, urdf: str | Path, folder: Path) -> str:
    """The text that `write_urdf` writes to a folder, read back and compared."""
    source = Urdf.read(urdf)
    root = source.root
    model = chain.mechanism.model
    partly = _fix_locked(root, model)
    _put_bodies(root, model, str(urdf))
    _put_friction(root, chain)
    text = ET.tostring(root, encoding="unicode", xml_declaration=True)
    lost = [f"{name} (lock it again)" for name in partly]
    lost += _differences(chain, Urdf(text, str(urdf)), partly)
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
        heavy = [frame for frame in moving if links[frame.name].find("inertial") is not None]
        for frame in heavy:
            links[frame.name].remove(links[frame.name].find("inertial"))  # type: ignore[arg-type]
        if inertia.mass:
            carrier = (heavy or moving)[0]
            links[carrier.name].append(_inertial(carrier.placement.actInv(inertia)))


def _put_friction(root: ET.Element, chain: ClosedChain) -> None:
    """Give each joint its friction; none where the rates of a joint have different friction."""
    friction = chain.mechanism.friction
    space = chain.mechanism.space
    for joint in root.findall("joint"):
        series = _series(joint, chain.mechanism.model)
        rates = [k for part in series for k in space.rates[part]]
        pairs = {"damping": friction.viscous[rates], "friction": friction.coulomb[rates]}
        numbers = {key: x[0] if np.ptp(x) == 0 else 0.0 for key, x in pairs.items() if len(x)}
        dynamics = joint.find("dynamics")
        if dynamics is None and any(numbers.values()):
            dynamics = ET.SubElement(joint, "dynamics")
        if dynamics is not None:
            dynamics.attrib.update({key: repr(float(x)) for key, x in numbers.items()})


def _differences(chain: ClosedChain, urdf: Urdf, partly: Mapping[str, Sequence[str]]) -> list[str]:
    """Names of the parameters that a URDF, with the YAML beside it, gives other values."""
    again = ClosedChain.from_description(_read_again(urdf)).dynamic_parameters
    values = dict(zip(again.names, again.values, strict=True))
    theta = chain.dynamic_parameters
    words = np.array([name.rpartition(".")[2] for name in theta.names])
    sizes = np.array([np.abs(theta.values[words == word]).max() for word in words])
    away = np.abs([values.get(name, 0.0) for name in theta.names] - theta.values)
    joints = [name.rpartition(".")[0] for name in theta.names]
    parts = [part for series in partly.values() for part in series]
    differ = (away > _EQUAL * sizes) & ~np.isin(joints, parts)
    lost = [theta.names[k] for k in np.flatnonzero(differ)]
    if bodies := [name for name in lost if name.rpartition(".")[2] in OF_BODY]:
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
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    for joint in root.findall("joint[child]"):
        joints.setdefault(joint.find("child").get("link", ""), joint)  # type: ignore[union-attr]
    for name, parent in zip(model.names, model.parents, strict=True):
        whole, _, axis = name.rpartition("_")  # a part of a universal joint in the YAML
        first = model.names[parent].rpartition("_")[0] != whole
        if name not in joints and whole in joints and axis in ("X", "Y", "Z") and first:
            joints[name] = joints[whole]
    return joints


def with_origins(
    urdf: str | Path, model: pin.Model, moved: Mapping[str, pin.SE3], folder: Path
) -> str:
    """The text of a URDF for a folder in which places of a model are moved, read back, compared."""
    root = Urdf.read(urdf).root
    joints = carriers_of(root, model)
    if lost := [place for place in moved if place not in joints]:
        problem = f"no joint carries {listed(lost)}; calibrate(..., urdf=) leaves out such errors"
        raise DescriptionError(str(urdf), [problem])
    for place, by in moved.items():
        _place(joints[place], _origin(joints[place]) * by)
    again = _read_again(Urdf(ET.tostring(root, encoding="unicode"), str(urdf))).model
    places = zip(model.names, model.jointPlacements, strict=True)
    theirs = dict(zip(again.names, again.jointPlacements, strict=True))
    if lost := [x for x, place in places if not theirs.get(x, place).isApprox(place, _EQUAL)]:
        raise DescriptionError(str(urdf), [f"it is another robot: {listed(lost)} are elsewhere"])
    return _with_meshes(root, Path(urdf).resolve().parent, folder.resolve())


def _read_again(urdf: Urdf) -> RobotFile:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DescriptionWarning)
        return read_urdf(urdf)


def _fix_locked(root: ET.Element, model: pin.Model) -> dict[str, list[str]]:
    """Make joints of a URDF fixed that are locked in the robot, where they are locked.

    Returns the joints of which single rates are locked, which a URDF cannot say, with the joints
    that are left of each.
    """
    links = _links_of(model)
    partly = dict[str, list[str]]()
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        series = _series(joint, model)
        suffixes = [part.removeprefix(f"{name}_") for part in series if part != name]
        if suffixes and (len(series) == 1 or suffixes[0].islower()):
            partly[name] = series
        a, b = _ends(joint, links)
        if series or joint.get("type") == "fixed" or a is None or b is None:
            continue
        joint.set("type", "fixed")
        joint[:] = [child for child in joint if child.tag in ("origin", "parent", "child")]
        place = a.placement.actInv(b.placement)
        if not _origin(joint).isApprox(place, _ROUNDING):
            _place(joint, place)
    return partly


def _series(joint: ET.Element, model: pin.Model) -> list[str]:
    """The joints of the model between the links of a joint of a URDF; none if it is fixed."""
    a, b = _ends(joint, _links_of(model))
    if a is None or b is None:
        return []
    series = list[str]()
    j = b.parentJoint
    while j not in (0, a.parentJoint):
        series.insert(0, model.names[j])
        j = model.parents[j]
    return series if j == a.parentJoint else []


def _links_of(model: pin.Model) -> dict[str, pin.Frame]:
    return {f.name: f for f in model.frames if f.type == pin.FrameType.BODY}


def _ends(
    joint: ET.Element, links: Mapping[str, pin.Frame]
) -> tuple[pin.Frame | None, pin.Frame | None]:
    """The frames of the parent and the child of a joint; None in the URDF of another robot."""
    parent, child = joint.find("parent"), joint.find("child")
    names = ("" if end is None else end.get("link", "") for end in (parent, child))
    a, b = (links.get(name) for name in names)
    return a, b


def _origin(joint: ET.Element) -> pin.SE3:
    origin = joint.find("origin")
    texts = ("0 0 0" if origin is None else origin.get(k, "0 0 0") for k in ("xyz", "rpy"))
    xyz, rpy = (np.array(text.split(), float) for text in texts)
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _place(joint: ET.Element, place: pin.SE3) -> None:
    origin = joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    origin.attrib.update(origin_of(place))


def _inertial(inertia: pin.Inertia) -> ET.Element:
    inertial = ET.Element("inertial")
    ET.SubElement(inertial, "origin", origin_of(pin.SE3(np.eye(3), inertia.lever)))
    ET.SubElement(inertial, "mass", value=repr(float(inertia.mass)))
    upper = inertia.inertia[np.triu_indices(3)].tolist()
    ET.SubElement(inertial, "inertia", dict(zip(ENTRIES, map(repr, upper), strict=True)))
    return inertial

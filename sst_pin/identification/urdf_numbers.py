# SPDX-License-Identifier: BSD-2-Clause
"""Writes inertias and friction of a robot into the URDF that it was read from.

The joint NAME of a URDF can be one, several or no joints of the model, in series between its two
links:
- Most joints are one joint of the model, NAME.
- A universal joint, which the YAML declares, is two joints with capitals, NAME_X and NAME_Y.
- If only some rates of a joint are locked, each free rate is a joint with small letters, such as
  NAME_wx. A URDF cannot store such a joint.
- A fixed or locked joint is no joint of the model.
"""

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
from ..model.weight_shares import WHOLE_WEIGHT, checked_shares
from ..reading import Urdf
from ..reading.inertia_checks import ENTRIES
from ..reading.joint_graph import origin_of
from ..summaries import listed
from .urdf_elements import (
    joint_origin,
    link_frame,
    link_frames,
    read_again,
    set_joint_origin,
    text_for_folder,
)

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
            the first: rotors, springs, forces along lines, different friction in one joint, shares
            of the weights of links that become one.

    Example:
        >>> chain = sst_pin.ClosedChain.from_urdf(sst_pin.URDF_PATH)
        >>> rubbing = chain.with_parameters({"mu_1.viscous": 0.3})
        >>> sst_pin.identification.write_urdf(rubbing, sst_pin.URDF_PATH, "found.urdf")
    """
    require_robot("chain", chain)
    folder = as_path(path).parent
    write_files({as_path(path): text_writer(with_dynamics(chain, urdf, folder))}, force)


def with_dynamics(chain: ClosedChain, urdf: str | Path, folder: Path) -> str:
    """The text that `write_urdf` writes to a folder.

    It is read back: a warning names the parameters that then differ from those of the robot.
    """
    source = Urdf.read(urdf)
    root = source.root
    model = chain.mechanism.model
    partly_locked = _partly_locked_joints(root, model)
    _fix_locked_joints(root, model)
    _put_bodies(root, model, str(urdf))
    _put_friction(root, chain)

    text = ET.tostring(root, encoding="unicode", xml_declaration=True)
    lost = [f"{name} (lock it again)" for name in partly_locked]
    lost += _differences(chain, Urdf(text, str(urdf)), partly_locked)
    if lost:
        cure = f"write them into {Path(urdf).stem}.yaml beside it"
        warn_caller(f"a URDF cannot store {listed(lost)}; {cure}", DescriptionWarning)
    return text_for_folder(root, Path(urdf).resolve().parent, folder.resolve())


def _series(joint: ET.Element, links: Mapping[str, pin.Frame], model: pin.Model) -> list[str]:
    """Names of the joints of the model between the two links of a joint of a URDF.

    The list is empty for a fixed or locked joint, and for links that the model does not have.
    """
    parent = link_frame(joint, "parent", links)
    child = link_frame(joint, "child", links)
    if parent is None or child is None:
        return []
    # From the child link towards the base, up to the joint that moves the parent link.
    series = list[str]()
    j = child.parentJoint
    while j not in (0, parent.parentJoint):
        series.insert(0, model.names[j])
        j = model.parents[j]
    if j != parent.parentJoint:  # the base was reached first: the URDF of another robot
        return []
    return series


def _partly_locked_joints(root: ET.Element, model: pin.Model) -> dict[str, list[str]]:
    """The joints of a URDF of which only some rates are locked, by their names.

    The values are the names of the joints of the model that stand for their free rates.
    """
    links = link_frames(model)
    partly_locked = dict[str, list[str]]()
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        series = _series(joint, links, model)
        if not series or series == [name]:
            continue
        # The names NAME_X and NAME_Y of a universal joint end with capitals.
        is_universal = len(series) > 1 and not series[0].removeprefix(f"{name}_").islower()
        if not is_universal:
            partly_locked[name] = series
    return partly_locked


def _fix_locked_joints(root: ET.Element, model: pin.Model) -> None:
    """Make joints that are locked in the robot fixed, at the positions where they are locked."""
    links = link_frames(model)
    for joint in root.findall("joint"):
        parent = link_frame(joint, "parent", links)
        child = link_frame(joint, "child", links)
        if parent is None or child is None:
            continue
        if joint.get("type") == "fixed" or _series(joint, links, model):
            continue
        joint.set("type", "fixed")
        joint[:] = [part for part in joint if part.tag in ("origin", "parent", "child")]
        pose = parent.placement.actInv(child.placement)
        if not joint_origin(joint).isApprox(pose, _ROUNDING):
            set_joint_origin(joint, pose)


def _put_bodies(root: ET.Element, model: pin.Model, urdf: str) -> None:
    """Write the inertia of each body of the model into one of its links.

    A body consists of all links that one joint moves; they are fixed to each other. Its inertia is
    written into the first of these links that had an inertia, or else into the first link. The
    other links of the body lose their inertias.
    """
    elements = {element.get("name"): element for element in root.findall("link")}
    frames = [frame for frame in link_frames(model).values() if frame.name in elements]
    for j in range(1, model.njoints):
        inertia = model.inertias[j]
        frames_of_body = [frame for frame in frames if frame.parentJoint == j]
        if not frames_of_body and inertia.mass:
            raise DescriptionError(urdf, [f"no link is moved by joint {model.names[j]}"])
        frames_with_inertia = []
        for frame in frames_of_body:
            inertial = elements[frame.name].find("inertial")
            if inertial is not None:
                elements[frame.name].remove(inertial)
                frames_with_inertia.append(frame)
        if inertia.mass:
            carrier = frames_with_inertia[0] if frames_with_inertia else frames_of_body[0]
            elements[carrier.name].append(_inertial(carrier.placement.actInv(inertia)))


def _inertial(inertia: pin.Inertia) -> ET.Element:
    """An `<inertial>` with a mass, its centre and its moments."""
    inertial = ET.Element("inertial")
    ET.SubElement(inertial, "origin", origin_of(pin.SE3(np.eye(3), inertia.lever)))
    ET.SubElement(inertial, "mass", value=repr(float(inertia.mass)))
    upper_triangle = inertia.inertia[np.triu_indices(3)].tolist()
    moments = dict(zip(ENTRIES, map(repr, upper_triangle), strict=True))
    ET.SubElement(inertial, "inertia", moments)
    return inertial


def _put_friction(root: ET.Element, chain: ClosedChain) -> None:
    """Write the friction of each joint, [N m s/rad] and [N m], or [N s/m] and [N].

    A URDF has one number for all rates of a joint. Where the rates have different friction, 0 is
    written.
    """
    friction = chain.mechanism.friction
    space = chain.mechanism.space
    model = chain.mechanism.model
    links = link_frames(model)
    for joint in root.findall("joint"):
        rates = list[int]()
        for part in _series(joint, links, model):
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
    """Names of the parameters that have other values when the URDF and its YAML are read again.

    Raises a `DescriptionError` if these are parameters of bodies, because then the URDF describes
    another robot. `partly_locked` is the result of `_partly_locked_joints`. The joints in its
    values have other names in the URDF, so they are not compared.
    """
    not_compared = set[str]()
    for series in partly_locked.values():
        not_compared.update(series)
    chain_again = ClosedChain.from_description(read_again(urdf))
    parameters_again = chain_again.dynamic_parameters
    value_again = dict(zip(parameters_again.names, parameters_again.values, strict=True))

    theta = chain.dynamic_parameters
    kinds = np.array([name.rpartition(".")[2] for name in theta.names])
    different = []
    for k, name in enumerate(theta.names):
        largest = np.abs(theta.values[kinds == kinds[k]]).max()
        difference = abs(value_again.get(name, 0.0) - theta.values[k])
        joint = name.rpartition(".")[0]
        if difference > _EQUAL * largest and joint not in not_compared:
            different.append(name)
    of_bodies = [name for name in different if name.rpartition(".")[2] in OF_BODY]
    if of_bodies:
        raise DescriptionError(urdf.source, [f"it is another robot: {listed(of_bodies)} differ"])

    # Links that are fixed to each other are one link now, but their shares of the weight may differ
    # (see `model.weight_shares`). Each array is [share; offset], where the offset is a length.
    shares = checked_shares(chain.weight_shares)
    shares_again = checked_shares(chain_again.weight_shares)
    length = chain.mechanism.length
    allowed = _EQUAL * np.array([1.0, length, length, length])
    for joint in shares | shares_again:
        share = shares.get(joint, WHOLE_WEIGHT)
        share_again = shares_again.get(joint, WHOLE_WEIGHT)
        if (np.abs(share - share_again) > allowed).any() and joint not in not_compared:
            different.append(f"{joint}: {chain.weight_shares.get(joint, 1.0)} in weight_shares")
    return different

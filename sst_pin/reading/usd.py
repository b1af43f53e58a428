# SPDX-License-Identifier: BSD-2-Clause
"""A USD with rigid bodies and joints to the elements of a URDF: what is no tree closes loops."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import DescriptionError, MissingExtraError
from .sdf import origin_of, text_of

Array = NDArray[np.float64]

#: Types of joints, and what a URDF calls them.
_KINDS = {
    "PhysicsRevoluteJoint": "revolute",
    "PhysicsPrismaticJoint": "prismatic",
    "PhysicsSphericalJoint": "ball",
    "PhysicsFixedJoint": "fixed",
}
#: Attributes of PhysX that act and are not read, and what they mean.
_ACTING = {
    "physxJoint:armature": "an armature",
    "physxJoint:jointFriction": "friction",
    "physxRigidBody:linearDamping": "damping in space",
    "physxRigidBody:angularDamping": "damping in space",
    "physxRigidBody:disableGravity": "no weight",
}
#: How far bodies may be drawn from where a joint lets them be, [m] and [rad].
_APART = 1e-4
_WORLD = "world"


def is_usd(path: Path) -> bool:
    """Whether a file is a USD, by its ending."""
    return path.suffix.lower() in (".usd", ".usda", ".usdc", ".usdz")


class _Joint(NamedTuple):
    """A joint of the file.

    Attributes:
        name: Its name.
        kind: What a URDF calls it; "ball" for three freedoms.
        links: Names of the two bodies; the world is "world".
        places: Its frame on both bodies, in metres.
        axis: Axis of the motion of the second body, in the frames.
        limits: Limits of the motion, [rad] or [m].
        driven: Whether it has a drive.
        cut: Whether the file leaves it out of the tree.
    """

    name: str
    kind: str
    links: tuple[str, str]
    places: tuple[pin.SE3, pin.SE3]
    axis: Array
    limits: tuple[float, float]
    driven: bool = False
    cut: bool = False


class Usd:
    """The robot of a USD.

    Attributes:
        gravity: Acceleration of gravity, shape (3,), [m/s^2].
        balls: Names of the ball joints in the tree, which a URDF does not have.
        poses: The configuration that the bodies are drawn in, as "home", by joint.

    Raises:
        DescriptionError: With every problem found.
        MissingExtraError: Without usd-core, `sst-pin[usd]`.
    """

    def __init__(self, path: Path) -> None:
        try:
            from pxr import Tf, Usd, UsdGeom, UsdPhysics
        except ImportError:
            raise MissingExtraError("usd-core", "usd") from None
        try:
            self._stage = Usd.Stage.Open(str(path))
        except Tf.ErrorException as error:
            text = error.args[0].commentary.strip()
            raise DescriptionError(str(path), [f"the USD cannot be read: {text}"]) from None
        self._physics = UsdPhysics
        self._unit = UsdGeom.GetStageMetersPerUnit(self._stage)
        self._kilograms = UsdPhysics.GetStageKilogramsPerUnit(self._stage)
        self._world = UsdGeom.XformCache()
        self._problems: list[str] = []
        prims = [p for p in self._stage.Traverse() if p.IsActive()]
        self._bodies = {p.GetPath(): p for p in prims if self._moves(p)}
        self._names = _names(self._bodies.values())
        self._at = {name: self._place(self._bodies[path]) for path, name in self._names.items()}
        joints = [p for p in prims if p.IsA(UsdPhysics.Joint) and self._enabled(p)]
        named = _names(joints)
        self._joints = [j for p in joints if (j := self._joint(p, named[p.GetPath()]))]
        self.gravity = self._gravity(UsdGeom.GetStageUpAxis(self._stage), prims)
        self.balls: list[str] = []
        self.poses: dict[str, dict[str, list[float]]] = {}
        if not self._bodies:
            self._problems.append("no prim has PhysicsRigidBodyAPI")
        self._source = str(path)

    def urdf(self) -> ET.Element:
        """The elements of a URDF, its base the world of the USD."""
        urdf = ET.Element("robot", name=Path(self._source).stem)
        ET.SubElement(urdf, "link", name=_WORLD)
        here = pin.SE3.Identity()
        own, left = {_WORLD: here}, list(self._joints)
        drawn: dict[str, list[float]] | None = {}
        while not self._at.keys() <= own.keys():
            found = next(_next(left, own), None)
            if found is None:  # nothing holds this body: it floats
                link = next(name for name in self._at if name not in own)
                name = "floating_base" if len(own) == 1 else f"{link}_floats"
                ends = (_WORLD, link), (here, here)
                found = _Joint(name, "floating", *ends, axis=np.zeros(3), limits=(0.0, 0.0))
            else:
                left.remove(found)
            values = self._branch(urdf, found, own)
            drawn = None if drawn is None or values is None else drawn | {found.name: values}
        for joint in left:
            if joint.driven:
                self._problems.append(f"{joint.name}: closes a loop and has a drive: cut another")
            _cut(urdf, joint, own)
        for path, name in self._names.items():
            self._link(urdf, self._bodies[path], name, own[name])
        if self._problems:
            raise DescriptionError(self._source, list(dict.fromkeys(self._problems)))
        if drawn is not None:
            self.poses = {"home": drawn}
        return urdf

    # --- prims ------------------------------------------------------------------------------

    def _moves(self, prim: Any) -> bool:
        body = self._physics.RigidBodyAPI(prim)
        if not (prim.HasAPI(self._physics.RigidBodyAPI) and body.GetRigidBodyEnabledAttr().Get()):
            return False
        return not body.GetKinematicEnabledAttr().Get()

    def _enabled(self, prim: Any) -> bool:
        return bool(self._physics.Joint(prim).GetJointEnabledAttr().Get())

    def _matrix(self, prim: Any) -> Array:
        """From coordinates of a prim to those of the world, [m]; they are columns."""
        matrix = np.array(self._world.GetLocalToWorldTransform(prim)).T
        matrix[:3] *= self._unit
        return matrix

    def _place(self, prim: Any) -> pin.SE3:
        """Where a prim is, without its scale."""
        matrix = self._matrix(prim)
        sizes = np.linalg.norm(matrix[:3, :3], axis=0)
        R = matrix[:3, :3] / np.where(sizes > 0, sizes, 1)
        if np.abs(R.T @ R - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0:
            self._problems.append(f"{prim.GetPath()}: its transform shears, mirrors or is singular")
            return pin.SE3.Identity()
        U, _, Vt = np.linalg.svd(R)
        return pin.SE3(U @ Vt, matrix[:3, 3])

    def _gravity(self, up: str, prims: list[Any]) -> Array:
        down = -np.eye(3)["XYZ".index(up)]
        for prim in prims:
            if prim.IsA(self._physics.Scene):
                scene = self._physics.Scene(prim)
                direction = np.array(scene.GetGravityDirectionAttr().Get(), float)
                size = scene.GetGravityMagnitudeAttr().Get()
                if np.linalg.norm(direction) > 0:
                    down = direction / np.linalg.norm(direction)
                if np.isfinite(size) and size >= 0:
                    return down * size * self._unit
        return down * 9.81

    # --- joints -----------------------------------------------------------------------------

    def _joint(self, prim: Any, name: str) -> _Joint | None:
        joint, kind = self._physics.Joint(prim), _KINDS.get(prim.GetTypeName())
        if kind is None:
            known = ", ".join(_KINDS)
            self._told(prim, f"type {prim.GetTypeName()} is not supported; supported: {known}")
            return None
        self._refuse_acting(prim)
        for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
            if schema.startswith(("PhysxMimicJoint", "PhysxTendon")):
                self._told(prim, f"{schema} is not read")
        links, places = [], []
        for side in "01":
            targets = getattr(joint, f"GetBody{side}Rel")().GetTargets()
            target = self._stage.GetPrimAtPath(targets[0]) if targets else None
            if targets and not target:
                self._told(prim, f"body{side}: no prim {targets[0]}")
                return None
            p = np.array(getattr(joint, f"GetLocalPos{side}Attr")().Get(), float)
            R = _rotation(getattr(joint, f"GetLocalRot{side}Attr")().Get())
            place = pin.SE3(R, p * self._unit)
            if target:
                matrix = self._matrix(target)
                place = pin.SE3(
                    self._place(target).rotation @ R, matrix[:3, :3] @ p + matrix[:3, 3]
                )
            while target and target.GetPath() not in self._bodies:
                target = target.GetParent()
            links.append(self._names[target.GetPath()] if target else _WORLD)
            places.append(self._at[links[-1]].actInv(place) if target else place)
        if links[0] == links[1]:
            if links[0] != _WORLD:
                self._told(prim, f"connects {links[0]} with itself")
            return None
        axis, limits = np.eye(3)[2], (-np.inf, np.inf)
        if kind in ("revolute", "prismatic"):
            turns = kind == "revolute"
            schema = getattr(self._physics, "RevoluteJoint" if turns else "PrismaticJoint")(prim)
            axis = np.eye(3)["XYZ".index(schema.GetAxisAttr().Get())]
            unit = np.pi / 180 if turns else self._unit
            low, high = schema.GetLowerLimitAttr().Get(), schema.GetUpperLimitAttr().Get()
            limits = (low * unit, high * unit)
            if low > high:
                self._told(prim, "its lower limit is above the upper one")
        driven = any(prim.HasAPI(self._physics.DriveAPI, key) for key in ("angular", "linear"))
        cut = bool(joint.GetExcludeFromArticulationAttr().Get())
        ends = (links[0], links[1]), (places[0], places[1])
        return _Joint(name, kind, *ends, axis, limits, driven, cut)

    def _branch(
        self, urdf: ET.Element, joint: _Joint, own: dict[str, pin.SE3]
    ) -> list[float] | None:
        """A joint of the tree, and its position where the bodies are drawn, if it reaches there."""
        (parent, child), (at_parent, at_child), sign = joint.links, joint.places, 1.0
        if child in own:
            parent, child, at_parent, at_child, sign = child, parent, at_child, at_parent, -1.0
        own[child] = at_child
        floats = joint.kind == "floating"
        endless = joint.kind == "revolute" and np.isinf(joint.limits).any()
        shown = {"ball": "revolute"}.get(joint.kind, "continuous" if endless else joint.kind)
        made = ET.SubElement(urdf, "joint", name=joint.name, type=shown)
        ET.SubElement(made, "parent", link=parent)
        ET.SubElement(made, "child", link=child)
        ET.SubElement(made, "origin", origin_of(own[parent].actInv(at_parent)))
        here = self._at.get(parent, pin.SE3.Identity()) * at_parent
        way = here.actInv(self._at[child] * at_child)
        if floats:
            return [*way.translation, *pin.Quaternion(way.rotation).coeffs()]
        if any(j.driven for j in self._joints):
            made.set("independent", str(joint.driven).lower())
        axis = sign * joint.axis
        ET.SubElement(made, "axis", xyz=text_of(axis))
        if joint.kind != "fixed":
            low, high = np.clip(joint.limits, -1e9, 1e9)
            limit = {"lower": low, "upper": high, "effort": 0.0, "velocity": 0.0}
            ET.SubElement(made, "limit", {key: repr(float(x)) for key, x in limit.items()})
        if joint.kind == "ball":
            self.balls.append(joint.name)
            value = list(pin.Quaternion(way.rotation).coeffs())
            left = np.abs(way.translation).max()
        else:
            turn, slide = axis @ pin.log3(way.rotation), axis @ way.translation
            turn *= joint.kind == "revolute"
            slide *= joint.kind == "prismatic"
            motion = pin.SE3(pin.exp3(turn * axis), slide * axis)
            left = np.abs(pin.log6(motion.actInv(way)).vector).max()
            value = [] if joint.kind == "fixed" else [float(turn + slide)]
        return value if left < _APART else None

    # --- bodies -----------------------------------------------------------------------------

    def _link(self, urdf: ET.Element, prim: Any, name: str, own: pin.SE3) -> None:
        made, mass = ET.SubElement(urdf, "link", name=name), self._physics.MassAPI(prim)
        self._refuse_acting(prim)
        kilograms, moments = mass.GetMassAttr().Get(), mass.GetDiagonalInertiaAttr().Get()
        center, axes = mass.GetCenterOfMassAttr().Get(), mass.GetPrincipalAxesAttr().Get()
        known = {
            "mass": bool(kilograms),
            "diagonalInertia": moments is not None and any(moments),
            "centerOfMass": center is not None and bool(np.isfinite(center).all()),
        }
        if missing := ", ".join(f"physics:{key}" for key, there in known.items() if not there):
            self._told(prim, f"no {missing}, which USD takes from shapes; write it")
            return
        matrix = self._matrix(prim)
        c = matrix[:3, :3] @ np.array(center, float) + matrix[:3, 3]
        R = _rotation(axes) if axes is not None and axes.GetLength() > 0 else np.eye(3)
        place = own.actInv(pin.SE3(R, self._at[name].actInv(c)))
        part = ET.SubElement(made, "inertial")
        ET.SubElement(part, "origin", origin_of(place))
        ET.SubElement(part, "mass", value=repr(float(kilograms) * self._kilograms))
        values = np.array(moments, float) * self._kilograms * self._unit**2
        entries = dict(zip(("ixx", "iyy", "izz"), values.tolist(), strict=True))
        entries |= dict.fromkeys(("ixy", "ixz", "iyz"), 0.0)
        ET.SubElement(part, "inertia", {key: repr(x) for key, x in entries.items()})

    def _refuse_acting(self, prim: Any) -> None:
        for key, words in _ACTING.items():
            attribute = prim.GetAttribute(key)
            if attribute and attribute.HasAuthoredValue() and attribute.Get():
                self._told(prim, f"{key}: {words} is not read")

    def _told(self, prim: Any, text: str) -> None:
        self._problems.append(f"{prim.GetPath()}: {text}")


def _next(joints: list[_Joint], own: dict[str, pin.SE3]) -> Iterator[_Joint]:
    """Joints that add a body to the tree: first those with drives, then those of early bodies."""
    for some in ([j for j in joints if j.driven], joints):
        for link in own:
            for joint in some:
                a, b = joint.links
                if not joint.cut and link in (a, b) and (a in own) != (b in own):
                    yield joint


def _cut(urdf: ET.Element, joint: _Joint, own: dict[str, pin.SE3]) -> None:
    """A joint that closes a loop."""
    cut = ET.SubElement(urdf, "constraint", name=joint.name, type=joint.kind)
    for side, link, place in zip(("parent", "child"), joint.links, joint.places, strict=True):
        ET.SubElement(cut, side, link=link)
        ET.SubElement(cut, f"{side}_origin", origin_of(own[link].actInv(place)))
        ET.SubElement(cut, f"{side}_axis", xyz=text_of(joint.axis))


def _names(prims: Any) -> dict[Any, str]:
    """Names of prims by path: their own where no other has it."""
    prims = list(prims)
    own = [prim.GetName() for prim in prims]
    return {
        prim.GetPath(): name if own.count(name) == 1 else str(prim.GetPath())[1:].replace("/", "_")
        for prim, name in zip(prims, own, strict=True)
    }


def _rotation(quaternion: Any) -> Array:
    x = np.array([*quaternion.GetImaginary(), quaternion.GetReal()], float)
    return np.asarray(pin.Quaternion(x).normalized().matrix())

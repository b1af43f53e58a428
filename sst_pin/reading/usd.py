# SPDX-License-Identifier: BSD-2-Clause
"""A USD with rigid bodies and joints to the elements of a URDF."""

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError, MissingExtraError
from .joint_graph import WORLD, Axis, GraphJoint, JointGraph

#: Types of joints, and what a URDF calls them.
_KINDS = {
    "PhysicsRevoluteJoint": "revolute",
    "PhysicsPrismaticJoint": "prismatic",
    "PhysicsSphericalJoint": "ball",
    "PhysicsFixedJoint": "fixed",
}
#: What PhysX, MuJoCo and Newton add to UsdPhysics: types, schemas and properties of prims.
_ADDED = re.compile("physx|mjc|newton", re.I)
#: Those that move nothing: contacts, solvers, limits, pictures, schemas that only have properties.
_HARMLESS = re.compile(
    r"collision|contact|material|site|imageable|keyframe|scene|articulation|report|trigger|solver|"
    r"solref|solimp|iteration|threshold|sleep|ccd|cfm|slop|projection|max|limit|frcrange|margin|"
    r"group|compiler|timestep|mjc:option:(?!density|viscosity|wind)|"
    r"^(physx|mjc|newton)(joint|jointaxis|rigidbody|body)api",
    re.I,
)
#: Properties that are usually 1; others change nothing at 0.
_USUALLY_ONE = re.compile("scale|enable|flag", re.I)
#: How far bodies may be drawn from where a joint lets them be, [m] and [rad].
_APART = 1e-4


def is_usd(path: Path) -> bool:
    """Whether a file is a USD, by its ending."""
    return path.suffix.lower() in (".usd", ".usda", ".usdc", ".usdz")


def usd_graph(path: Path) -> JointGraph:
    """The robot of a USD, its base the world; "home" is where its bodies are drawn."""
    return _Reader(path).graph()


class _Reader:
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
        self._path, self._problems = path, list[str]()
        self._unit = UsdGeom.GetStageMetersPerUnit(self._stage)
        self._kilograms = UsdPhysics.GetStageKilogramsPerUnit(self._stage)
        self._world, self._physics = UsdGeom.XformCache(), UsdPhysics
        self._down = -np.eye(3)["XYZ".index(UsdGeom.GetStageUpAxis(self._stage))]
        self._prims = [prim for prim in self._stage.Traverse() if prim.IsActive()]
        moving = [p for p in self._prims if _get(p, "rigidBodyEnabled")]
        moving = [p for p in moving if not _get(p, "kinematicEnabled")]
        self._bodies = {p.GetPath(): p for p in moving if p.HasAPI(UsdPhysics.RigidBodyAPI)}
        self._names = _names(self._bodies.values())
        self._at = {name: self._place(self._bodies[path]) for path, name in self._names.items()}

    def graph(self) -> JointGraph:
        """The robot as joints between bodies."""
        for prim in self._prims:
            self._refuse_added(prim)
        if not self._bodies:
            self._problems.append("no prim has PhysicsRigidBodyAPI")
        joints = [p for p in self._prims if p.IsA(self._physics.Joint) and _get(p, "jointEnabled")]
        found = [self._joint(prim, _names(joints)[prim.GetPath()]) for prim in joints]
        rest = dict.fromkeys(self._at, pin.SE3.Identity())
        graph = JointGraph(self._path.stem, [joint for joint in found if joint], rest)
        for path, name in self._names.items():
            self._link(graph, self._bodies[path], name)
        graph.gravity = self._gravity()
        if problems := dict.fromkeys([*self._problems, *graph.problems]):
            raise DescriptionError(str(self._path), problems)
        drawn = {joint.name: self._drawn(joint, swap) for joint, swap in graph.branches}
        if None not in drawn.values():
            graph.poses = {"home": {name: value or [] for name, value in drawn.items()}}
        return graph

    def _matrix(self, prim: Any) -> Array:
        """The matrix from coordinates of a prim, as columns, to those of the world, [m]."""
        matrix = np.array(self._world.GetLocalToWorldTransform(prim)).T
        matrix[:3] *= self._unit
        return matrix

    def _place(self, prim: Any) -> pin.SE3:
        """Where a prim is, without its scale."""
        matrix = self._matrix(prim)
        sizes = np.linalg.norm(matrix[:3, :3], axis=0)
        R = matrix[:3, :3] / np.where(sizes > 0, sizes, 1)
        if np.abs(R.T @ R - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0:
            self._told(prim, "its transform shears, mirrors or is singular")
            return pin.SE3.Identity()
        U, _, Vt = np.linalg.svd(R)
        return pin.SE3(U @ Vt, matrix[:3, 3])

    def _gravity(self) -> Array:
        found = []
        for scene in (prim for prim in self._prims if prim.IsA(self._physics.Scene)):
            direction = np.array(_get(scene, "gravityDirection"), float)
            size, length = _get(scene, "gravityMagnitude"), np.linalg.norm(direction)
            size = size * self._unit if np.isfinite(size) and size >= 0 else 9.81
            found.append(size * (direction / length if length > 0 else self._down))
        if any(not np.allclose(g, found[0]) for g in found):
            self._problems.append("several scenes with different gravity")
        return np.asarray(found[0] if found else 9.81 * self._down)

    def _joint(self, prim: Any, name: str) -> GraphJoint | None:
        kind = _KINDS.get(prim.GetTypeName())
        if kind is None:
            text = f"type {prim.GetTypeName()} is not supported; supported: {', '.join(_KINDS)}"
            self._told(prim, text)
            return None
        links, places = [], []
        for side in "01":
            targets = prim.GetRelationship(f"physics:body{side}").GetTargets()
            target = self._stage.GetPrimAtPath(targets[0]) if targets else None
            if targets and not target:
                self._told(prim, f"body{side}: no prim {targets[0]}")
                return None
            p, R = np.array(_get(prim, f"localPos{side}"), float), _get(prim, f"localRot{side}")
            place = pin.SE3(_rotation(R), p * self._unit)
            if target:
                matrix, R = self._matrix(target), self._place(target).rotation @ place.rotation
                place = pin.SE3(R, matrix[:3, :3] @ p + matrix[:3, 3])
            while target and target.GetPath() not in self._bodies:
                target = target.GetParent()
            links.append(self._names[target.GetPath()] if target else WORLD)
            places.append(self._at[links[-1]].actInv(place) if target else place)
        if links[0] == links[1]:
            if links[0] != WORLD:
                self._told(prim, f"connects {links[0]} with itself")
            return None
        axis = Axis()
        if kind in ("revolute", "prismatic"):
            unit = np.pi / 180 if kind == "revolute" else self._unit
            low, high = (_get(prim, f"{end}Limit") * unit for end in ("lower", "upper"))
            axis = Axis(np.eye(3)["XYZ".index(_get(prim, "axis"))], {"lower": low, "upper": high})
            if low > high:
                self._told(prim, "its lower limit is above the upper one")
        driven = any(prim.HasAPI(self._physics.DriveAPI, key) for key in ("angular", "linear"))
        ends = (links[0], links[1]), (places[0], places[1])
        cut = bool(_get(prim, "excludeFromArticulation"))
        return GraphJoint(name, kind, *ends, (axis,), driven, cut)

    def _drawn(self, joint: GraphJoint, swap: bool) -> list[float] | None:
        """The position of a joint where the bodies are drawn, if it reaches there."""
        places = zip(joint.links, joint.places, strict=True)
        here, there = (self._at.get(link, pin.SE3.Identity()) * place for link, place in places)
        way, axis = here.actInv(there), joint.axes[0].direction
        pose = [*way.translation, *pin.Quaternion(way.rotation).coeffs()]
        if joint.kind == "floating":
            return pose
        turn, slide = axis @ pin.log3(way.rotation), axis @ way.translation
        reached, value = {
            "ball": (pin.SE3(way.rotation, np.zeros(3)), pose[3:]),
            "revolute": (pin.SE3(pin.exp3(turn * axis), np.zeros(3)), [float(turn)]),
            "prismatic": (pin.SE3(np.eye(3), slide * axis), [float(slide)]),
            "fixed": (pin.SE3.Identity(), []),
        }[joint.kind]
        if joint.kind == "ball" and swap:
            value = [*(-x for x in pose[3:6]), pose[6]]
        return value if np.abs(pin.log6(reached.actInv(way)).vector).max() < _APART else None

    def _link(self, graph: JointGraph, prim: Any, name: str) -> None:
        kilograms, moments = _get(prim, "mass"), _get(prim, "diagonalInertia")
        center, axes = _get(prim, "centerOfMass"), _get(prim, "principalAxes")
        known = {
            "mass": bool(kilograms),
            "diagonalInertia": moments is not None and any(moments),
            "centerOfMass": center is not None and bool(np.isfinite(center).all()),
        }
        if missing := ", ".join(f"physics:{key}" for key, there in known.items() if not there):
            self._told(prim, f"no {missing}, which USD takes from shapes; write it")
            return
        matrix = self._matrix(prim)
        c = self._at[name].actInv(matrix[:3, :3] @ np.array(center, float) + matrix[:3, 3])
        R = _rotation(axes) if axes is not None and axes.GetLength() > 0 else np.eye(3)
        values = np.array(moments, float) * self._kilograms * self._unit**2
        entries = dict(zip(("ixx", "iyy", "izz"), values.tolist(), strict=True))
        entries |= dict.fromkeys(("ixy", "ixz", "iyz"), 0.0)
        graph.add_link(name, pin.SE3(R, c), float(kilograms) * self._kilograms, entries)

    def _refuse_added(self, prim: Any) -> None:
        """Refuse what others add to UsdPhysics, unless it is known to move nothing."""
        found = {prim.GetTypeName(), *prim.GetPrimTypeInfo().GetAppliedAPISchemas()}
        for part in prim.GetAuthoredProperties():
            name, value = part.GetName(), part.Get() if hasattr(part, "Get") else "a prim"
            usual = bool(_USUALLY_ONE.search(name))
            if value is not None and not np.array_equal(np.array(value, object), usual):
                found.add(name)
        for name in filter(_ADDED.match, sorted(found)):
            if not _HARMLESS.search(name):
                self._told(prim, f"{name} is not read")

    def _told(self, prim: Any, text: str) -> None:
        self._problems.append(f"{prim.GetPath()}: {text}")


def _get(prim: Any, key: str) -> Any:
    """An attribute of UsdPhysics, by default the value of its schema; None without one."""
    attribute = prim.GetAttribute(f"physics:{key}")
    return attribute.Get() if attribute else None


def _names(prims: Iterable[Any]) -> dict[Any, str]:
    """Names of prims by path: their own where no other has it."""
    paths = {prim.GetPath(): prim.GetName() for prim in prims}
    counts = Counter(paths.values())
    whole = {path: str(path)[1:].replace("/", "_") for path in paths}
    return {path: name if counts[name] == 1 else whole[path] for path, name in paths.items()}


def _rotation(quaternion: Any) -> Array:
    x = np.array([*quaternion.GetImaginary(), quaternion.GetReal()], float)
    return np.asarray(pin.Quaternion(x).normalized().matrix())

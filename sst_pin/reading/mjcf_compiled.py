# SPDX-License-Identifier: BSD-2-Clause
"""An MJCF as MuJoCo compiles it: names of its elements, disabled flags, locked joints."""

import xml.etree.ElementTree as ET
from collections.abc import Collection
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError, MissingExtraError
from ..summaries import listed

#: Types of joints, as `mjtJoint` has them.
FREE, BALL, SLIDE, HINGE = range(4)
#: Flags that the flag "constraint" disables too.
_CONSTRAINTS = ("equality", "frictionloss", "limit")
#: First bytes of a file that Git LFS has not fetched.
_POINTER = b"version https://git-lfs"


class Compiled:
    """A compiled model, `mj`, with the problems and the notes that its readers find."""

    def __init__(self, path: Path, locked: Collection[str]) -> None:
        try:
            import mujoco
        except ImportError:
            raise MissingExtraError("mujoco", "mjcf") from None
        self.mujoco = mujoco
        self.source = str(path)
        self.locked = set(locked)
        self.problems = list[str]()
        self.notes = list[str]()
        first = _first_element(path)
        if first not in ("", "mujoco"):  # MuJoCo reads a URDF, which has no closures
            text = f"an MJCF starts with <mujoco>, not with <{first}>"
            cure = "; ClosedChain.from_urdf reads a URDF or an SDF"
            raise DescriptionError(self.source, [f"not an MJCF: {text}{cure}"])
        try:
            self.mj: Any = mujoco.MjModel.from_xml_path(self.source)
        except ValueError as error:
            self.mj = self._without_shapes(path, str(error))
        try:
            self.mj.names.decode()
        except UnicodeDecodeError as error:
            raise DescriptionError(self.source, [f"names that are not UTF-8: {error}"]) from None
        self._bodies = {self.mj.body(body).name: body for body in range(1, self.mj.nbody)}

    def _without_shapes(self, path: Path, error: str) -> Any:
        """The model without meshes and textures whose files are missing, if no mass is of them."""
        refused = DescriptionError(self.source, [f"MuJoCo refuses it: {error}"])
        try:
            spec = self.mujoco.MjSpec.from_file(self.source)
        except (AttributeError, ValueError):  # an old MuJoCo, or another fault
            raise refused from None
        meshes, textures = _delete_missing_files(spec, path.parent)
        always_from_shapes = (
            spec.compiler.inertiafromgeom == self.mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        )
        problems = _delete_shapes(spec, meshes, always_from_shapes)
        if problems:
            raise DescriptionError(self.source, problems)
        if not meshes and not textures:
            raise refused
        try:
            mj = spec.compile()
        except ValueError as other:
            raise DescriptionError(self.source, [f"MuJoCo refuses it: {other}"]) from None
        files = listed(sorted(meshes | textures))
        self.notes.append(f"files of {files} are missing; the robot is read without these shapes")
        return mj

    def disabled(self, flag: str) -> bool:
        """Whether a flag of the options is "disable"; not every MuJoCo has every flag."""
        if flag in _CONSTRAINTS and self.disabled("constraint"):
            return True
        bit = getattr(self.mujoco.mjtDisableBit, f"mjDSBL_{flag.upper()}", 0)
        return bool(self.mj.opt.disableflags & int(bit))

    @cached_property
    def gravcomp(self) -> float | None:
        """The share of the weights that is compensated, if it is one for all bodies; else None."""
        mj = self.mj
        if getattr(mj, "jnt_actgravcomp", np.zeros(0)).any():  # the motors compensate
            return None
        moving = mj.body_weldid > 0
        shares = set(mj.body_gravcomp[moving & (mj.body_mass > 0)].tolist())
        return shares.pop() if len(shares) == 1 else None

    def name(self, kind: str, i: int) -> str:
        """Name of an element; one without a name is called after its kind and number.

        A site beside the body of the same name is called `NAME_site`: the name is the body's frame.
        """
        name = getattr(self.mj, kind)(i).name or f"{kind}_{i}"
        return f"{name}_site" if kind == "site" and self._is_beside_body(i, name) else name

    def _is_beside_body(self, site: int, name: str) -> bool:
        """Whether a site has the name of a body whose frame is elsewhere."""
        body = self._bodies.get(name)
        if body is None:
            return False
        at = pose_of(self.mj.site_pos[site], self.mj.site_quat[site])
        return body != self.mj.site_bodyid[site] or at != pin.SE3.Identity()

    def joint(self, joint: int) -> str:
        """Name of a joint; one without a name is called after its body."""
        body = self.mj.jnt_bodyid[joint]
        number = joint - self.mj.body_jntadr[body]
        suffix = f"_{number}" if number else ""
        return self.mj.joint(joint).name or self.name("body", body) + suffix

    def rates(self, joint: int) -> list[str]:
        """Names of the rates of a ball or a free joint, by which they are locked."""
        slides = ["vx", "vy", "vz"] if self.mj.jnt_type[joint] == FREE else []
        turns = ["wx", "wy", "wz"] if self.mj.jnt_type[joint] in (BALL, FREE) else []
        return [f"{self.joint(joint)}_{rate}" for rate in slides + turns]

    def locked_rates(self, joint: int) -> list[int]:
        """Indices of the rates of a ball or a free joint that are locked."""
        return [k for k, name in enumerate(self.rates(joint)) if name in self.locked]

    def is_locked(self, joint: int) -> bool:
        """Whether a joint is locked as a whole."""
        return self.joint(joint) in self.locked

    def wraps(self, tendon: int) -> range:
        """Indices of the sites or joints of a tendon."""
        first = self.mj.tendon_adr[tendon]
        return range(first, first + self.mj.tendon_num[tendon])

    def is_spatial(self, tendon: int) -> bool:
        """Whether a tendon is a line in space, not a sum of joints."""
        kinds = self.mj.wrap_type[self.wraps(tendon)]
        return bool((kinds != int(self.mujoco.mjtWrap.mjWRAP_JOINT)).any())

    @cached_property
    def tendon_armature(self) -> Array:
        """Inertias of the tendons, shape (tendons,); not every MuJoCo has them."""
        return np.asarray(getattr(self.mj, "tendon_armature", np.zeros(self.mj.ntendon)))

    def needs_joint(self, tendon: int) -> bool:
        """Whether a fixed tendon has forces, or inertia that couples joints."""
        if self.is_spatial(tendon):
            return False
        shares = self.coefficients(tendon)
        if not shares:  # locked joints alone
            return False
        mj = self.mj
        forces = [
            mj.tendon_stiffness[tendon] and not self.disabled("spring"),
            mj.tendon_damping[tendon] and not self.disabled("damper"),
            mj.tendon_frictionloss[tendon] and not self.disabled("frictionloss"),
        ]
        return any(forces) or bool(self.tendon_armature[tendon] and len(shares) > 1)

    def tendon_length(self, tendon: int, qpos: Array) -> float:
        """Length of a fixed tendon: the sum of coefficients times positions, locked ones too."""
        wraps = self.wraps(tendon)
        joints = self.mj.wrap_objid[wraps]
        moving = np.array([not self.is_locked(joint) for joint in joints], dtype=bool)
        addresses = self.mj.jnt_qposadr[joints]
        positions = np.where(moving, qpos[addresses], self.mj.qpos0[addresses])
        return float(self.mj.wrap_prm[wraps] @ positions)

    def forces_of_free_joint(self, joint: int) -> list[str]:
        """What a free joint has that depends on the axes of its rates, in words."""
        mj = self.mj
        dof = mj.jnt_dofadr[joint]
        words = list[str]()
        if mj.dof_armature[dof]:
            words.append("armature")
        if mj.dof_frictionloss[dof] and not self.disabled("frictionloss"):
            words.append("frictionloss")
        if mj.jnt_stiffness[joint] and not self.disabled("spring"):
            words.append("a spring")
        return words

    def coefficients(self, tendon: int) -> dict[int, float]:
        """Coefficients of a fixed tendon by joint, without locked joints."""
        shares = dict[int, float]()
        for k in self.wraps(tendon):
            joint = int(self.mj.wrap_objid[k])
            share = float(self.mj.wrap_prm[k])
            if share and not self.is_locked(joint):
                shares[joint] = share
        return shares


def _delete_missing_files(spec: Any, folder: Path) -> tuple[set[str], set[str]]:
    """Delete meshes and textures whose files are missing; returns the names of both."""
    meshes = set[str]()
    for mesh in list(spec.meshes):
        if _is_missing(folder / spec.meshdir, mesh):
            meshes.add(mesh.name or Path(mesh.file).stem)
            spec.delete(mesh)
    missing_textures = [t for t in spec.textures if _is_missing(folder / spec.texturedir, t)]
    textures = {texture.name or Path(texture.file).stem for texture in missing_textures}
    for material in list(spec.materials):
        material.textures = ["" if name in textures else name for name in material.textures]
    for texture in missing_textures:
        spec.delete(texture)
    return meshes, textures


def _delete_shapes(spec: Any, meshes: Collection[str], always_from_shapes: bool) -> list[str]:
    """Delete the shapes of some meshes; problems name bodies that get their mass from one."""
    problems = list[str]()
    for body in spec.bodies:
        for geom in [geom for geom in body.geoms if geom.meshname in meshes]:
            if body.name != "world" and (always_from_shapes or not body.explicitinertial):
                text = f"its mass is that of the mesh {geom.meshname}, whose file is missing"
                problems.append(f"body {body.name}: {text}")
            spec.delete(geom)
    return list(dict.fromkeys(problems))


def _is_missing(folder: Path, asset: Any) -> bool:
    """Whether the file of a mesh or a texture is missing, or a pointer of Git LFS to it."""
    if not asset.file:
        return False
    path = folder / asset.file
    if not path.is_file():
        return True
    with path.open("rb") as file:
        return file.read(len(_POINTER)) == _POINTER


def _first_element(path: Path) -> str:
    """The name of an XML's root; empty if Python cannot read the file."""
    with suppress(ET.ParseError, OSError, ValueError), path.open("rb") as file:
        for _, element in ET.iterparse(file, events=("start",)):
            return str(element.tag)
    return ""


def pose_of(position: Array, quaternion: Array) -> pin.SE3:
    """A placement from MuJoCo's position and quaternion w, x, y, z."""
    return pin.SE3(pin.Quaternion(*quaternion).normalized().matrix(), position)

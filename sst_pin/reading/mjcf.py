# SPDX-License-Identifier: BSD-2-Clause
"""MJCF to a Pinocchio model, closures and motors, by way of MuJoCo's own compiler.

MuJoCo resolves defaults, angles, meshes and inertias; what it has compiled is carried over number
by number. Coordinates of hinges and slides are MuJoCo's `qpos`, `ref` included.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arrays import names
from ..chain.closures import Closure
from ..errors import DescriptionError, DescriptionWarning, MissingExtraError, UnknownNameError
from ..files import as_path
from .urdf import MOST_JOINTS

Array = NDArray[np.float64]


class Mjcf(NamedTuple):
    """What an MJCF says of a closed chain.

    Attributes:
        model: The tree.
        closures: Its active `connect` and `weld` equalities.
        actuated: Joints with an actuator, in the order of the actuators.
    """

    model: pin.Model
    closures: tuple[Closure, ...]
    actuated: tuple[str, ...]


def read_mjcf(path: str | Path, locked: Sequence[str] = ()) -> Mjcf:
    """Read a robot; see `ClosedChain.from_mjcf`."""
    try:
        import mujoco
    except ImportError:
        raise MissingExtraError("mujoco", "mjcf") from None
    path, locked = as_path(path), names("locked", locked)
    try:
        compiled = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise DescriptionError(str(path), [f"not an MJCF: {error}"]) from None
    try:
        compiled.names.decode()
    except UnicodeDecodeError as error:
        raise DescriptionError(str(path), [f"names that are not UTF-8: {error}"]) from None
    return _Reader(mujoco, compiled, str(path), locked).read()


class _Reader:
    """One pass over a compiled model."""

    def __init__(self, mujoco: Any, compiled: Any, source: str, locked: Sequence[str]) -> None:
        self._mj, self._source, self._locked = compiled, source, set(locked)
        self._mujoco = mujoco
        self._model = pin.Model()
        self._model.name = compiled.names.split(b"\0")[0].decode()
        weightless = self._disabled("gravity")
        self._model.gravity.linear = np.zeros(3) if weightless else compiled.opt.gravity
        #: Of each body: the joint that bears it and its placement there.
        self._bodies = [(0, pin.SE3.Identity())]
        #: Of each coordinate: the degree of freedom in MuJoCo.
        self._dofs: list[int] = []
        self._problems: list[str] = []

    def read(self) -> Mjcf:
        """Tree, closures, motors."""
        mj, model = self._mj, self._model
        if problems := [*self._impossible(), *self._switched_off()]:
            raise DescriptionError(self._source, problems)
        known = [name for j in range(mj.njnt) for name in (self._name(j), *self._coordinates(j))]
        for name in self._locked.difference(known):
            raise UnknownNameError("joint", name, dict.fromkeys(known))
        names = Counter(name for j in range(mj.njnt) for name in self._coordinates(j))
        if twice := [name for name, count in names.items() if count > 1]:
            text = f"joints without a name are called like their bodies: {', '.join(twice)} are two"
            raise DescriptionError(self._source, [text])
        for body in range(1, mj.nbody):
            self._add_body(body)
        self._add_sites()
        closures, motors = tuple(self._closures()), tuple(dict.fromkeys(self._motors()))
        self._problems += self._forces()
        if self._problems:
            raise DescriptionError(self._source, self._problems)
        if model.njoints - 1 > MOST_JOINTS:
            text = f"{model.njoints - 1} moving joints; no more than {MOST_JOINTS} are computed"
            raise DescriptionError(self._source, [text])
        if left_out := list(self._left_out()):
            text = "\n  ".join([f"{self._source}:", *left_out])
            warnings.warn(text, DescriptionWarning, stacklevel=4)
        # What a ball has about every axis cannot be told coordinate by coordinate.
        joints = mj.dof_jntid[self._dofs]
        simple = ~self._balls[joints]
        limited = simple & (mj.jnt_limited[joints] != 0) & (not self._disabled("limit"))
        model.lowerPositionLimit = np.where(limited, mj.jnt_range[joints, 0], -np.inf)
        model.upperPositionLimit = np.where(limited, mj.jnt_range[joints, 1], np.inf)
        model.armature = mj.dof_armature[self._dofs] * simple
        damped, rubbing = not self._disabled("damper"), not self._disabled("frictionloss")
        model.damping = mj.dof_damping[self._dofs] * simple * damped
        model.friction = mj.dof_frictionloss[self._dofs] * simple * rubbing
        return Mjcf(model, closures, motors)

    def _disabled(self, flag: str) -> bool:
        """Whether a flag of the options is "disable"; not every MuJoCo has every flag."""
        bit = getattr(self._mujoco.mjtDisableBit, f"mjDSBL_{flag.upper()}", 0)
        return bool(self._mj.opt.disableflags & int(bit))

    def _impossible(self) -> Iterator[str]:
        """Numbers that MuJoCo lets pass."""
        mj = self._mj
        for kind, fields in _NUMBERS.items():
            for field in fields:
                array = getattr(mj, f"{kind}_{field}")
                odd = np.isnan(array) if field == "range" else ~np.isfinite(array)
                for i in map(int, np.unique(np.nonzero(odd)[0])):
                    yield f"{self._owner(kind, i)}: {field} is not finite"
                if kind == "dof":
                    for i in map(int, np.flatnonzero(array < 0)):
                        yield f"{self._owner(kind, i)}: {field} {array[i]:g} is negative"
        for what, array in (("gravity", mj.opt.gravity), ("a joint's ref", mj.qpos0)):
            if not np.isfinite(array).all():
                yield f"{what} is not finite"

    def _owner(self, kind: str, i: int) -> str:
        """What the row of a field belongs to."""
        mj = self._mj
        if kind == "eq":
            return mj.equality(i).name or f"equality_{i}"
        if kind == "site":
            return f"site {self._site(i)}"
        if kind == "body":
            return f"body {mj.body(i).name or i}"
        return f"joint {self._name(mj.dof_jntid[i] if kind == 'dof' else i)}"

    def _switched_off(self) -> Iterator[str]:
        """Flags without which there is no closed chain with motors."""
        for flag in ("constraint", "equality", "actuation"):
            if self._disabled(flag):
                yield f'<flag {flag}="disable">: there is no {_SWITCHED_OFF[flag]} then'

    # --- the tree ---------------------------------------------------------------------------

    def _add_body(self, body: int) -> None:
        mj = self._mj
        parent, placement = self._bodies[mj.body_parentid[body]]
        placement = placement * _pose(mj.body_pos[body], mj.body_quat[body])
        first = mj.body_jntadr[body]
        for joint in range(first, first + mj.body_jntnum[body]):
            parent, placement = self._add_joint(joint, parent, placement)
        self._bodies.append((parent, placement))
        R = _pose(mj.body_ipos[body], mj.body_iquat[body]).rotation
        inertia = pin.Inertia(
            mj.body_mass[body], mj.body_ipos[body], R * mj.body_inertia[body] @ R.T
        )
        self._model.appendBodyToJoint(parent, inertia, placement)

    def _add_joint(self, joint: int, parent: int, placement: pin.SE3) -> tuple[int, pin.SE3]:
        """The joint that bears the body now, and the body's placement there."""
        mj, kinds, name = self._mj, self._mujoco.mjtJoint, self._name(joint)
        kind, axis = kinds(mj.jnt_type[joint]), mj.jnt_axis[joint]
        if kind == kinds.mjJNT_FREE and name not in self._locked:
            self._problems.append(self._free(joint))
        if kind == kinds.mjJNT_FREE or name in self._locked:
            return parent, placement
        anchor = pin.SE3(np.eye(3), mj.jnt_pos[joint])
        reference = mj.qpos0[mj.jnt_qposadr[joint]]
        if kind == kinds.mjJNT_HINGE:
            models = [_along(axis, _REVOLUTE, pin.JointModelRevoluteUnaligned)]
            zero = pin.SE3(pin.AngleAxis(-reference, axis).matrix(), np.zeros(3))
        elif kind == kinds.mjJNT_SLIDE:
            models = [_along(axis, _PRISMATIC, pin.JointModelPrismaticUnaligned)]
            zero = pin.SE3(np.eye(3), -reference * axis)
        else:
            models = [model() for model in _REVOLUTE]
            zero = pin.SE3.Identity()
        at = placement * anchor * zero
        for k, (model, coordinate) in enumerate(zip(models, self._coordinates(joint), strict=True)):
            if coordinate not in self._locked:
                parent = self._model.addJoint(parent, model, at, coordinate)
                at = pin.SE3.Identity()
                self._dofs.append(mj.jnt_dofadr[joint] + k)
        return parent, at * anchor.inverse()

    def _free(self, joint: int) -> str:
        """What to do about a free joint, of a base or of a platform that legs carry."""
        mj, kinds, name = self._mj, self._mujoco.mjtObj, self._name(joint)
        own = mj.body_rootid[mj.jnt_bodyid[joint]]
        for i in range(mj.neq):
            ends = [mj.eq_obj1id[i], mj.eq_obj2id[i]]
            if mj.eq_objtype[i] == int(kinds.mjOBJ_SITE):
                ends = [mj.site_bodyid[end] for end in ends]
            elif mj.eq_objtype[i] != int(kinds.mjOBJ_BODY):
                continue
            roots = {int(mj.body_rootid[end]) for end in ends}
            if mj.eq_active0[i] and own in roots and len(roots) == 2:
                return (
                    f"joint {name}: free, and {self._owner('eq', i)} joins what it bears to other "
                    "bodies, as legs carry a platform: give it three slides and a ball instead, "
                    "or hang it on one of the legs"
                )
        return (
            f"joint {name}: free, but a closed chain stands on a fixed base; "
            f"locked=[{name!r}] holds it where it is"
        )

    def _add_sites(self) -> None:
        """As frames."""
        mj = self._mj
        for site in range(mj.nsite):
            place = _pose(mj.site_pos[site], mj.site_quat[site])
            self._add_frame(self._site(site), mj.site_bodyid[site], place)

    def _site(self, site: int) -> str:
        return self._mj.site(site).name or f"site_{site}"

    def _add_frame(self, name: str, body: int, place: pin.SE3) -> None:
        if self._model.existFrame(name):
            self._problems.append(f"frame {name}: there are two; sites and ends of equalities")
            return
        parent, placement = self._bodies[body]
        kind = pin.FrameType.OP_FRAME
        self._model.addFrame(pin.Frame(name, parent, placement * place, kind))

    @property
    def _balls(self) -> NDArray[np.bool_]:
        """Which joints are balls."""
        return np.asarray(self._mj.jnt_type) == int(self._mujoco.mjtJoint.mjJNT_BALL)

    def _name(self, joint: int) -> str:
        """Of a joint; a nameless one is called like its body."""
        mj, body = self._mj, self._mj.jnt_bodyid[joint]
        number = joint - mj.body_jntadr[body]
        nameless = mj.body(body).name or f"body_{body}"
        return mj.joint(joint).name or (f"{nameless}_{number}" if number else nameless)

    def _coordinates(self, joint: int) -> list[str]:
        """Names of the joints with one coordinate that a joint becomes."""
        name = self._name(joint)
        if self._balls[joint]:
            return [f"{name}_{axis}" for axis in "XYZ"]
        return [name]

    # --- loops and motors -------------------------------------------------------------------

    def _closures(self) -> Iterator[Closure]:
        mj, kinds = self._mj, self._mujoco.mjtEq
        site = self._mujoco.mjtObj.mjOBJ_SITE
        for i in range(mj.neq):
            if not mj.eq_active0[i]:
                continue
            name, kind = self._owner("eq", i), kinds(mj.eq_type[i])
            if kind not in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
                what = kind.name.removeprefix("mjEQ_").lower()
                self._problems.append(f"{name}: couples by {what}; connect and weld close loops")
                continue
            first, second, data = mj.eq_obj1id[i], mj.eq_obj2id[i], mj.eq_data[i]
            turns = kind == kinds.mjEQ_CONNECT or not data[_TORQUESCALE]  # freely
            how = "3d" if turns else "6d"
            if mj.eq_objtype[i] == int(site):
                yield Closure(self._site(first), self._site(second), how)
                continue
            if kind == kinds.mjEQ_CONNECT:
                places = [pin.SE3(np.eye(3), data[:3]), pin.SE3(np.eye(3), data[3:6])]
            else:  # pose of the second body in the first, anchor in the second
                places = [_pose(data[3:6], data[6:10]), pin.SE3(np.eye(3), data[:3])]
            ends = f"{name}_A", f"{name}_B"
            for end, body, place in zip(ends, (first, second), places, strict=True):
                self._add_frame(end, body, place)
            yield Closure(*ends, how)

    def _motors(self) -> Iterator[str]:
        mj, trn = self._mj, self._mujoco.mjtTrn
        for i in range(mj.nu):
            joint, name = mj.actuator_trnid[i, 0], mj.actuator(i).name or f"actuator_{i}"
            bearer = trn(mj.actuator_trntype[i])
            if bearer not in (trn.mjTRN_JOINT, trn.mjTRN_JOINTINPARENT):
                what = bearer.name.removeprefix("mjTRN_").lower()
                self._problems.append(f"{name}: an actuator on a {what}, not on a joint")
            elif self._name(joint) in self._locked or self._in_disabled_group(i):
                continue
            elif not mj.actuator_gear[i, 0]:
                self._problems.append(f"{name}: its gear is 0, it moves nothing")
            elif self._balls[joint]:
                self._problems.append(f"{name}: an actuator on a ball joint")
            else:
                yield self._name(joint)

    def _in_disabled_group(self, actuator: int) -> bool:
        return bool(self._mj.opt.disableactuator >> self._mj.actuator_group[actuator] & 1)

    def _forces(self) -> Iterator[str]:
        """What the dynamics would overlook."""
        mj = self._mj
        for joint in range(mj.njnt):
            name = self._name(joint)
            springs = mj.jnt_stiffness[joint] and not self._disabled("spring")
            if springs and name not in self._locked:
                yield (
                    f"joint {name}: a spring; locked=[{name!r}] holds it at its reference, "
                    "stiffness 0 leaves it out"
                )
        for field, (what, flag) in _FORCES.items():
            if self._disabled(flag):
                continue
            if np.any(getattr(mj, field, 0)):  # not every MuJoCo has every field
                yield f"{what} is not in the dynamics here"
        if mj.opt.density or mj.opt.viscosity:
            yield "a medium around the robot is not in the dynamics here"

    def _left_out(self) -> Iterator[str]:
        """What has no place in the coordinates of balls."""
        mj = self._mj
        flags = {"damping": "damper", "frictionloss": "frictionloss", "armature": ""}
        for joint in map(int, np.flatnonzero(self._balls)):
            name, dof = self._name(joint), mj.jnt_dofadr[joint]
            for what, flag in flags.items():
                value = getattr(mj, f"dof_{what}")[dof]
                if value and not self._disabled(flag) and name not in self._locked:
                    yield f"joint {name}: {what} {value:g} of a ball joint is left out"


_REVOLUTE = pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ
_PRISMATIC = pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ


def _along(axis: Array, aligned: Sequence[type], unaligned: type) -> Any:
    """A joint with an axis, of the simple kind where the axis is x, y or z."""
    for model, direction in zip(aligned, np.eye(3), strict=True):
        if np.array_equal(axis, direction):
            return model()
    return unaligned(axis)


#: Fields of a compiled model, the forces they stand for, and the flag that disables them.
_FORCES = {
    "jnt_stiffnesspoly": ("the polynomial of a spring", "spring"),
    "dof_dampingpoly": ("the polynomial of a damper", "damper"),
    "body_gravcomp": ("compensation of gravity", "gravity"),
    "tendon_stiffness": ("the stiffness of a tendon", "spring"),
    "tendon_damping": ("the damping of a tendon", "damper"),
    "tendon_frictionloss": ("the friction of a tendon", "frictionloss"),
    "tendon_armature": ("the armature of a tendon", ""),
    "actuator_damping": ("the damping of an actuator", ""),
    "actuator_armature": ("the armature of an actuator", ""),
}
#: Numbers that come over, by what they belong to.
_NUMBERS = {
    "body": ("pos", "quat", "ipos", "iquat", "mass", "inertia"),
    "jnt": ("pos", "axis", "range", "stiffness"),
    "dof": ("armature", "damping", "frictionloss"),
    "site": ("pos", "quat"),
    "eq": ("data",),
}
_SWITCHED_OFF = {"constraint": "closure", "equality": "closure", "actuation": "motor"}
#: Where `eq_data` of a weld has what its torque is scaled by: with 0 it lets the bodies turn.
_TORQUESCALE = 10


def _pose(position: Array, quaternion: Array) -> pin.SE3:
    """Of MuJoCo's w, x, y, z."""
    return pin.SE3(pin.Quaternion(*quaternion).normalized().matrix(), position)

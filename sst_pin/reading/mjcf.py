# SPDX-License-Identifier: BSD-2-Clause
"""MJCF to a Pinocchio model, closures and motors, by way of MuJoCo's own compiler.

MuJoCo resolves defaults, angles, meshes and inertias; what it has compiled is carried over number
by number. Coordinates of hinges and slides are MuJoCo's `qpos`, `ref` included. Balls and free
joints are Pinocchio's: a quaternion has its scalar last, MuJoCo's first; the linear rates of a free
joint are along the body's axes, MuJoCo's `qvel` has them along the world's. Angular rates are in
body axes in both.
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from copy import copy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arrays import names
from ..chain.closures import Closure, Constraint, Coupling
from ..chain.draft import Motor
from ..chain.lines import LineForce
from ..errors import DescriptionError, DescriptionWarning, MissingExtraError, UnknownNameError
from ..files import as_path
from .described import Described, naming
from .shapes import MjcfShapes, pose_of
from .urdf import MOST_JOINTS

Array = NDArray[np.float64]


def read_mjcf(
    path: str | Path, locked: Sequence[str] = (), actuated: Sequence[Motor] | None = None
) -> Described:
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
    if _first_element(path) == "robot":  # MuJoCo reads a URDF, which has no closures
        text = "an MJCF starts with <mujoco>, not with <robot>; ClosedChain.from_urdf reads a URDF"
        raise DescriptionError(str(path), [f"not an MJCF: {text}"])
    try:
        compiled.names.decode()
    except UnicodeDecodeError as error:
        raise DescriptionError(str(path), [f"names that are not UTF-8: {error}"]) from None
    return _Reader(mujoco, compiled, str(path), locked).read(actuated)


def _first_element(path: Path) -> str:
    """The name of an XML's root; empty where MuJoCo reads it more leniently than Python."""
    with suppress(ET.ParseError), path.open("rb") as file:
        for _, element in ET.iterparse(file, events=("start",)):
            return str(element.tag)
    return ""


class _Reader:
    """One pass over a compiled model."""

    def __init__(self, mujoco: Any, compiled: Any, source: str, locked: Sequence[str]) -> None:
        self._mj = compiled
        self._source, self._locked = source, set(locked)
        self._mujoco = mujoco
        self._model = pin.Model()
        self._model.name = compiled.names.split(b"\0")[0].decode()
        weightless = self._disabled("gravity")
        self._model.gravity.linear = np.zeros(3) if weightless else compiled.opt.gravity
        #: For each body: the joint that bears it and its placement there.
        self._bodies = [(0, pin.SE3.Identity())]
        #: For each rate: the degree of freedom in MuJoCo.
        self._dofs: list[int] = []
        self._rest: list[float] = []
        #: For each coordinate: its address in `qpos`; for a single turn of a ball the ball's.
        self._addresses: list[int] = []
        #: The axes of the coordinates that are single turns of balls, by index.
        self._turns: dict[int, int] = {}
        self._problems: list[str] = []

    def read(self, actuated: Sequence[Motor] | None) -> Described:
        """Tree, closures, motors; given ones replace those of the file."""
        mj, model = self._mj, self._model
        if problems := [*self._impossible(), *self._switched_off()]:
            raise DescriptionError(self._source, problems)
        known = [name for j in range(mj.njnt) for name in (self._name(j), *self._axes(j))]
        with naming(self._source):
            for name in self._locked.difference(known):
                raise UnknownNameError("joint", name, dict.fromkeys(known))
        names = Counter(self._name(j) for j in range(mj.njnt))
        if twice := [name for name, count in names.items() if count > 1]:
            text = f"a joint without a name gets its body's name: several joints {', '.join(twice)}"
            raise DescriptionError(self._source, [text])
        for body in range(1, mj.nbody):
            self._add_body(body)
        self._add_sites()
        closures = tuple(self._closures())
        motors = tuple(self._motors()) if actuated is None else actuated
        lines = tuple(self._lines(motors))
        self._add_body_frames()
        self._problems += list(self._forces()) or self._unread_forces()
        if self._problems:
            raise DescriptionError(self._source, self._problems)
        if model.njoints - 1 > MOST_JOINTS:
            text = f"{model.njoints - 1} moving joints; at most {MOST_JOINTS} are supported"
            raise DescriptionError(self._source, [text])
        joints = mj.dof_jntid[self._dofs]
        one = np.isin(mj.jnt_type[joints], (_HINGE, _SLIDE))
        limited = one & (mj.jnt_limited[joints] != 0) & (not self._disabled("limit"))
        at = [joint.idx_q for joint in list(model.joints)[1:] if joint.nv == 1]
        single = np.array([joint.idx_v for joint in list(model.joints)[1:] if joint.nv == 1], int)
        ranges = np.where(limited[:, None], mj.jnt_range[joints], [-np.inf, np.inf])[single]
        model.lowerPositionLimit = np.full(model.nq, -np.inf)
        model.upperPositionLimit = np.full(model.nq, np.inf)
        model.lowerPositionLimit[at], model.upperPositionLimit[at] = ranges.T
        model.armature = mj.dof_armature[self._dofs]
        model.damping = mj.dof_damping[self._dofs] * (not self._disabled("damper"))
        model.friction = mj.dof_frictionloss[self._dofs] * (not self._disabled("frictionloss"))
        for key in range(mj.nkey):
            if name := mj.key(key).name:
                q = mj.key_qpos[key][self._addresses]
                for i, turn in self._turns.items():
                    address = self._addresses[i]
                    q[i] = _turns_of(mj.key_qpos[key][address : address + 4])[turn]
                model.referenceConfigurations[name] = pin.normalize(model, q)
        stiffness = mj.jnt_stiffness[joints] * (not self._disabled("spring"))
        shapes, rest = MjcfShapes(mj, self._bodies), np.array(self._rest)
        found = self._source, model, closures, motors, shapes, stiffness, rest
        return Described(*found, forces=lines)

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
        """Name of the element that a row of a field belongs to."""
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
        placement = placement * pose_of(mj.body_pos[body], mj.body_quat[body])
        first = mj.body_jntadr[body]
        for joint in range(first, first + mj.body_jntnum[body]):
            parent, placement = self._add_joint(joint, parent, placement)
        self._bodies.append((parent, placement))
        R = pose_of(mj.body_ipos[body], mj.body_iquat[body]).rotation
        inertia = pin.Inertia(
            mj.body_mass[body], mj.body_ipos[body], R * mj.body_inertia[body] @ R.T
        )
        self._model.appendBodyToJoint(parent, inertia, placement)

    def _add_joint(self, joint: int, parent: int, placement: pin.SE3) -> tuple[int, pin.SE3]:
        """The joint that bears the body now, and the body's placement there."""
        mj, name = self._mj, self._name(joint)
        kind, axis, address = mj.jnt_type[joint], mj.jnt_axis[joint], mj.jnt_qposadr[joint]
        if name in self._locked:
            return parent, placement
        anchor = pin.SE3(np.eye(3), mj.jnt_pos[joint])
        reference, rest = mj.qpos0[address], [mj.qpos_spring[address]]
        zero, names, addresses = pin.SE3.Identity(), [name], [address]
        if kind == _FREE:
            models, placement = [pin.JointModelFreeFlyer()], pin.SE3.Identity()
            rest = [0.0] * 6 + [1.0]
            addresses = [*range(address, address + 3), *_scalar_last(address + 3)]
        elif kind == _HINGE:
            models = [_along(axis, _REVOLUTE, pin.JointModelRevoluteUnaligned)]
            zero = pin.SE3(pin.AngleAxis(-reference, axis).matrix(), np.zeros(3))
        elif kind == _SLIDE:
            models = [_along(axis, _PRISMATIC, pin.JointModelPrismaticUnaligned)]
            zero = pin.SE3(np.eye(3), -reference * axis)
        elif self._locked.isdisjoint(self._axes(joint)):
            models = [pin.JointModelSpherical()]
            addresses = _scalar_last(address)
            rest = mj.qpos_spring[addresses].tolist()
        else:  # a ball that is held about some axis turns about the others, one after the other
            axes = self._axes(joint)
            left = [k for k, axis in enumerate(axes) if axis not in self._locked]
            models, names = [_REVOLUTE[k]() for k in left], [axes[k] for k in left]
            rest, addresses = [0.0] * len(left), [address] * len(left)
            self._turns |= {len(self._addresses) + i: k for i, k in enumerate(left)}
            if left and mj.jnt_stiffness[joint] and not self._disabled("spring"):
                self._problems.append(
                    f"joint {name}: a ball with a spring can only be locked as a whole"
                )
        at, dof = placement * anchor * zero, mj.jnt_dofadr[joint]
        for model, called in zip(models, names, strict=True):
            parent, at = self._model.addJoint(parent, model, at, called), pin.SE3.Identity()
            self._model.addJointFrame(parent)
            self._dofs += range(dof, dof + model.nv)
            dof += model.nv
        self._rest += rest
        self._addresses += addresses
        return parent, at * anchor.inverse()

    def _add_sites(self) -> None:
        """Make frames of the sites."""
        mj = self._mj
        for site in range(mj.nsite):
            place = pose_of(mj.site_pos[site], mj.site_quat[site])
            self._add_frame(self._site(site), mj.site_bodyid[site], place)

    def _add_body_frames(self) -> None:
        """Make frames of the bodies; a joint or site with the name of a body keeps the name."""
        for body in range(1, self._mj.nbody):
            name = self._mj.body(body).name
            if name and not self._model.existFrame(name):
                parent, placement = self._bodies[body]
                self._model.addFrame(pin.Frame(name, parent, placement, pin.FrameType.BODY))

    def _site(self, site: int) -> str:
        return self._mj.site(site).name or f"site_{site}"

    def _add_frame(self, name: str, body: int, place: pin.SE3) -> None:
        if self._model.existFrame(name):
            self._problems.append(
                f"frame {name}: two frames (sites, ends of equalities) have this name"
            )
            return
        parent, placement = self._bodies[body]
        kind = pin.FrameType.OP_FRAME
        self._model.addFrame(pin.Frame(name, parent, placement * place, kind))

    def _name(self, joint: int) -> str:
        """Name of a joint; one without a name is called after its body."""
        mj, body = self._mj, self._mj.jnt_bodyid[joint]
        number = joint - mj.body_jntadr[body]
        nameless = mj.body(body).name or f"body_{body}"
        return mj.joint(joint).name or (f"{nameless}_{number}" if number else nameless)

    def _axes(self, joint: int) -> list[str]:
        """Names by which a ball is held about single axes."""
        ball = self._mj.jnt_type[joint] == _BALL
        return [f"{self._name(joint)}_{axis}" for axis in "XYZ"] if ball else []

    # --- loops and motors -------------------------------------------------------------------

    def _closures(self) -> Iterator[Constraint]:
        mj, kinds = self._mj, self._mujoco.mjtEq
        site = self._mujoco.mjtObj.mjOBJ_SITE
        for i in range(mj.neq):
            if not mj.eq_active0[i]:
                continue
            name, kind = self._owner("eq", i), kinds(mj.eq_type[i])
            first, second, data = mj.eq_obj1id[i], mj.eq_obj2id[i], mj.eq_data[i]
            if kind in (kinds.mjEQ_JOINT, kinds.mjEQ_TENDON):
                length = self._joint_length if kind == kinds.mjEQ_JOINT else self._tendon_length
                yield from self._coupling(name, length(first), length(second), data[:5])
                continue
            if kind not in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
                what = kind.name.removeprefix("mjEQ_").lower()
                text = (
                    'only connect, weld, joint and tendon are supported; active="false" disables it'
                )
                self._problems.append(f"{name}: an equality of kind {what}; {text}")
                continue
            turns = kind == kinds.mjEQ_CONNECT or not data[_TORQUESCALE]  # freely
            how = "3d" if turns else "6d"
            if mj.eq_objtype[i] == int(site):
                yield Closure(self._site(first), self._site(second), how)
                continue
            if kind == kinds.mjEQ_CONNECT:
                places = [pin.SE3(np.eye(3), data[:3]), pin.SE3(np.eye(3), data[3:6])]
            else:  # pose of the second body in the first, anchor in the second
                places = [pose_of(data[3:6], data[6:10]), pin.SE3(np.eye(3), data[:3])]
            ends = f"{name}_A", f"{name}_B"
            for end, body, place in zip(ends, (first, second), places, strict=True):
                self._add_frame(end, body, place)
            yield Closure(*ends, how)

    def _joint_length(self, joint: int) -> _Length:
        """A joint as a tendon of its own; -1 is none."""
        if joint < 0:
            return _Length({}, 0.0)
        return self._unlocked({joint: 1.0})

    def _tendon_length(self, tendon: int) -> _Length:
        """A fixed tendon, the sum of joints; -1 is none."""
        mj = self._mj
        if tendon < 0:
            return _Length({}, 0.0)
        if self._is_spatial(tendon):
            text = "a spatial tendon in an equality; only fixed tendons are supported there"
            self._problems.append(f"{self._tendon(tendon)}: {text}")
            return _Length({}, 0.0)
        wraps = self._wraps(tendon)
        return self._unlocked({mj.wrap_objid[k]: mj.wrap_prm[k] for k in wraps})

    def _tendon(self, tendon: int) -> str:
        return self._mj.tendon(tendon).name or f"tendon_{tendon}"

    def _wraps(self, tendon: int) -> range:
        """Indices of what a tendon runs through."""
        first = self._mj.tendon_adr[tendon]
        return range(first, first + self._mj.tendon_num[tendon])

    def _is_spatial(self, tendon: int) -> bool:
        kinds = self._mj.wrap_type[self._wraps(tendon)]
        return bool((kinds != int(self._mujoco.mjtWrap.mjWRAP_JOINT)).any())

    def _lines(self, motors: Sequence[Motor]) -> Iterator[LineForce]:
        """Spatial tendons with a spring or a damper, and those that are motors."""
        mj = self._mj
        driven = {x for motor in motors for x in ([motor] if isinstance(motor, str) else motor)}
        for tendon in filter(self._is_spatial, range(mj.ntendon)):
            name = self._tendon(tendon)
            stiffness = mj.tendon_stiffness[tendon] * (not self._disabled("spring"))
            damping = mj.tendon_damping[tendon] * (not self._disabled("damper"))
            if mj.tendon_limited[tendon] and not self._disabled("limit"):
                text = f"{self._source}: tendon {name}: its limits are ignored"
                warnings.warn(text, DescriptionWarning, stacklevel=5)
            if not (stiffness or damping or name in driven):
                continue
            shortest, longest = mj.tendon_lengthspring[tendon]
            if problem := self._no_line(tendon):
                self._problems.append(f"tendon {name}: {problem}")
            elif stiffness and shortest != longest:
                text = "a springlength with a dead band is not supported; give one number"
                self._problems.append(f"tendon {name}: {text}")
            else:
                ends = (self._site(mj.wrap_objid[k]) for k in self._wraps(tendon))
                rest = shortest if stiffness else 0.0
                with naming(self._source):
                    yield LineForce(
                        *ends, stiffness=stiffness, rest_length=rest, damping=damping, name=name
                    )

    def _no_line(self, tendon: int) -> str:
        """Why a spatial tendon is not a line between two sites."""
        kinds = self._mj.wrap_type[self._wraps(tendon)]
        if (kinds != int(self._mujoco.mjtWrap.mjWRAP_SITE)).any():
            return "a tendon with pulleys or around geoms is not supported"
        if len(kinds) != 2:
            return f"a tendon through {len(kinds)} sites is not supported; two are"
        joints = (self._name(j) for j in range(self._mj.njnt))
        return "a joint has this name too; rename one" * (self._tendon(tendon) in joints)

    def _unlocked(self, shares: Mapping[int, float]) -> _Length:
        """Shares of joints by name, and what they add up to with all joints at their reference."""
        free = {j: share for j, share in shares.items() if self._name(j) not in self._locked}
        start = sum(share * self._mj.qpos0[self._mj.jnt_qposadr[j]] for j, share in free.items())
        return _Length({self._name(j): float(s) for j, s in free.items() if s}, float(start))

    def _coupling(
        self, name: str, first: _Length, second: _Length, coefficients: Array
    ) -> Iterator[Coupling]:
        """The coupling that makes first - start a polynomial of second - start."""
        zero, linear = np.zeros(2), not coefficients[2:].any()
        if not first.shares and linear and coefficients[1]:  # 0 = c_0 + c_1 (second - start)
            first, second = second, first
            coefficients = np.array([-coefficients[0] / coefficients[1]])
        if not (first.shares or second.shares or coefficients[0]):
            return  # all joints that it couples are locked
        joint = max(first.shares, key=lambda name: abs(first.shares[name]), default="")
        shares = {n: np.array([0.0, -share]) for n, share in first.shares.items()}
        offset, polynomial = first.start, np.polynomial.Polynomial(coefficients)
        if len(second.shares) == 1:
            ((other, share),) = second.shares.items()
            moved = polynomial(np.polynomial.Polynomial([-second.start, share]))
            shares[other] = np.polynomial.polynomial.polyadd(shares.get(other, zero), moved.coef)
        else:
            offset += polynomial(-second.start)
            for n, share in second.shares.items():
                shares[n] = shares.get(n, zero) + np.array([0.0, coefficients[1] * share])
        own = shares.pop(joint, zero)
        solvable = own[1] and not own[2:].any() and (linear or len(second.shares) < 2)
        if not solvable:
            text = f"{name}: this equality cannot be solved for a joint: "
            text += "lock both sides or none, and use polynomials of one joint only"
            self._problems.append(text)
            return
        lead = -own[1]
        others = {n: tuple(np.trim_zeros(c, "b") / lead) for n, c in shares.items()}
        yield Coupling(joint, others, float((offset + own[0]) / lead))

    def _motors(self) -> Iterator[Motor]:
        mj, trn = self._mj, self._mujoco.mjtTrn
        seen: set[tuple[bool, int]] = set()
        for i in range(mj.nu):
            index, name = mj.actuator_trnid[i, 0], mj.actuator(i).name or f"actuator_{i}"
            acts_on = trn(mj.actuator_trntype[i])
            tendon = acts_on == trn.mjTRN_TENDON
            if not tendon and acts_on not in (trn.mjTRN_JOINT, trn.mjTRN_JOINTINPARENT):
                what = acts_on.name.removeprefix("mjTRN_").lower()
                text = "not on a joint or a tendon"
                self._problems.append(f"{name}: an actuator on a {what}, {text}")
            elif (
                (tendon, index) in seen
                or self._in_disabled_group(i)
                or (not tendon and self._name(index) in self._locked)
            ):
                continue
            elif not tendon and mj.jnt_type[index] not in (_HINGE, _SLIDE):
                text = "use hinges in series instead, or name the motors by actuated="
                self._problems.append(f"{name}: an actuator on a ball or a free joint; {text}")
            elif not mj.actuator_gear[i, 0]:
                self._problems.append(f"{name}: its gear is 0, so it moves nothing")
            elif tendon and self._is_spatial(index):
                sites = self._mj.wrap_objid[self._wraps(index)]
                bearers = {self._bodies[body][0] for body in mj.site_bodyid[sites]}
                if len(bearers) > 1 or self._no_line(index):
                    yield self._tendon(index)
            elif tendon:
                if shares := self._tendon_length(index).shares:
                    yield shares
            else:
                yield self._name(index)
            seen.add((tendon, index))

    def _in_disabled_group(self, actuator: int) -> bool:
        return bool(self._mj.opt.disableactuator >> self._mj.actuator_group[actuator] & 1)

    def _forces(self) -> Iterator[str]:
        """What the dynamics would overlook."""
        mj = self._mj
        for joint in map(int, np.flatnonzero(mj.jnt_type == _FREE)):
            name, dof = self._name(joint), mj.jnt_dofadr[joint]
            for field, flag in (("armature", ""), ("frictionloss", "frictionloss")):
                value = getattr(mj, f"dof_{field}")[dof]
                if value and name not in self._locked and not self._disabled(flag):
                    yield f"joint {name}: a free joint with {field}; use <freejoint> instead"
        for field, (what, flag) in _FORCES.items():
            if self._disabled(flag):
                continue
            values = np.asarray(getattr(mj, field, 0))  # not every MuJoCo has every field
            if field in _OF_LINES:
                values = values[[not self._is_spatial(tendon) for tendon in range(mj.ntendon)]]
            if values.any():
                yield f"{what} is not supported"
        if mj.opt.density or mj.opt.viscosity:
            yield "a medium (density, viscosity, wind) is not supported"
        for body in map(int, np.flatnonzero(getattr(mj, "body_plugin", np.empty(0)) >= 0)):
            name, plugin = self._owner("body", body), mj.plugin(mj.body_plugin[body]).name
            yield f"{name}: a plugin{f' {plugin}' * bool(plugin)} with forces is not supported"

    def _unread_forces(self) -> Iterator[str]:
        """Joints on which MuJoCo's passive forces are not those of their springs and dampers."""
        mj, mujoco = copy(self._mj), self._mujoco
        mj.jnt_stiffness[:], mj.dof_damping[:] = 0, 0
        mj.tendon_stiffness[:], mj.tendon_damping[:] = 0, 0
        mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        data, random = mujoco.MjData(mj), np.random.default_rng(0)
        moving, acting = np.isin(np.arange(mj.nv), self._dofs), np.zeros(mj.nv, dtype=bool)
        for step, rates in random.normal(size=(3, 2, mj.nv)):
            data.qpos, data.qvel = mj.qpos0, rates * moving
            mujoco.mj_integratePos(mj, data.qpos, 0.3 * step * moving, 1)
            mujoco.mj_fwdPosition(mj, data)
            mujoco.mj_fwdVelocity(mj, data)
            acting |= moving & (data.qfrc_passive != 0)
        for joint in dict.fromkeys(map(int, mj.dof_jntid[acting])):
            yield f"joint {self._name(joint)}: a passive force of MuJoCo on it is not supported"


class _Length(NamedTuple):
    """A sum of joints by name, and its value with all joints at their reference."""

    shares: dict[str, float]
    start: float


_REVOLUTE = pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ
_PRISMATIC = pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ


def _scalar_last(address: int) -> list[int]:
    """Addresses of a quaternion's entries in Pinocchio's order."""
    return [address + 1, address + 2, address + 3, address]


def _turns_of(quaternion: Array) -> Array:
    """Angles of successive turns about x, y, z that give a ball's orientation, shape (3,)."""
    R = pose_of(np.zeros(3), quaternion).rotation
    return -pin.rpy.matrixToRpy(R.T)


def _along(axis: Array, aligned: Sequence[type], unaligned: type) -> Any:
    """A joint with an axis, of the simple kind where the axis is x, y or z."""
    for model, direction in zip(aligned, np.eye(3), strict=True):
        if np.array_equal(axis, direction):
            return model()
    return unaligned(axis)


#: Fields of a compiled model, the forces that they cause, and the flag that disables them.
_FORCES = {
    "jnt_stiffnesspoly": ("the polynomial of a spring", "spring"),
    "jnt_springyield": ("the yield of a spring", "spring"),
    "tendon_springyield": ("the yield of a tendon's spring", "spring"),
    "dof_dampingpoly": ("the polynomial of a damper", "damper"),
    "body_gravcomp": ("compensation of gravity", "gravity"),
    "tendon_stiffness": ("the stiffness of a fixed tendon", "spring"),
    "tendon_damping": ("the damping of a fixed tendon", "damper"),
    "tendon_frictionloss": ("the friction of a tendon", "frictionloss"),
    "tendon_armature": ("the armature of a tendon", ""),
    "tendon_stiffnesspoly": ("the polynomial of a tendon's spring", "spring"),
    "tendon_dampingpoly": ("the polynomial of a tendon's damper", "damper"),
    "flex_edgestiffness": ("the stiffness of a flex's edges", "spring"),
    "flex_edgedamping": ("the damping of a flex's edges", "damper"),
    "flex_stiffness": ("the elasticity of a flex", "spring"),
    "flex_bending": ("the bending stiffness of a flex", "spring"),
    "actuator_dampingpoly": ("the polynomial of an actuator's damper", ""),
    "actuator_damping": ("the damping of an actuator", ""),
    "actuator_armature": ("the armature of an actuator", ""),
}
#: Those that spatial tendons may have.
_OF_LINES = ("tendon_stiffness", "tendon_damping")
#: Numbers that come over, by what they belong to.
_NUMBERS = {
    "body": ("pos", "quat", "ipos", "iquat", "mass", "inertia"),
    "jnt": ("pos", "axis", "range", "stiffness"),
    "dof": ("armature", "damping", "frictionloss"),
    "site": ("pos", "quat"),
    "eq": ("data",),
}
#: Types of joints, as `mjtJoint` has them.
_FREE, _BALL, _SLIDE, _HINGE = range(4)
_SWITCHED_OFF = {"constraint": "closure", "equality": "closure", "actuation": "motor"}
#: Index of a weld's scale of torque in `eq_data`; with 0 it lets the bodies turn.
_TORQUESCALE = 10

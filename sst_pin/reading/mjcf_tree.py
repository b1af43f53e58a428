# SPDX-License-Identifier: BSD-2-Clause
"""The tree of a compiled MJCF as a Pinocchio model.

Hinges and slides have the coordinates of MuJoCo's `qpos`, which include `ref`. Balls and free
joints have Pinocchio's coordinates. In Pinocchio a quaternion has its scalar last, in MuJoCo first.
In Pinocchio the linear rates of a free joint are in axes of the body, in MuJoCo in axes of the
world. Angular rates are in axes of the body in both. Where the difference matters, because the
joint has a spring, dry friction or armature, the free joint becomes three slides and a ball.
Damping is the same for all six rates, and so the same in all axes.

A fixed tendon with forces or inertia becomes a joint of a body without mass. `closures_of` couples
the joint: its position is the length of the tendon. So springs, dampers, friction and armature of
the tendon are those of the joint.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..loops.loops import Loops
from ..model.closures import Constraint
from ..model.joint_series import SLIDES, TURNS, PartlyLocked, Series
from ..model.loop_groups import longest_offset
from ..model.thresholds import CLOSURE_TOLERANCE
from .mjcf_compiled import BALL, FREE, HINGE, SLIDE, Compiled, pose_of


class _Coordinates(NamedTuple):
    """How the positions of one of MuJoCo's joints follow from `qpos`."""

    #: Indices in `qpos`, in Pinocchio's order.
    addresses: list[int]
    #: The pose of a free joint that is locked in part, relative to which its remaining joints move;
    #: None for other joints.
    reference: pin.SE3 | None
    #: Its joints in the Pinocchio model.
    series: Series


class _JointKind(NamedTuple):
    """What a joint of MuJoCo is in Pinocchio."""

    #: The joint, unless some of its rates are locked or it is split.
    model: Any
    #: Indices of its coordinates in `qpos`, in Pinocchio's order.
    addresses: list[int]
    #: The placement of its body on the parent at `qpos0`; for a free joint where its pose begins.
    placement: pin.SE3
    #: The motion of the joint from `qpos0` to position zero.
    to_zero: pin.SE3 = pin.SE3.Identity()
    #: See `_Coordinates`.
    reference: pin.SE3 | None = None
    #: Whether it becomes joints of one rate and a ball.
    is_split: bool = False


class JointSprings(NamedTuple):
    """Springs of the joints."""

    stiffness: Array  #: Shape (nv,).
    reference: Array  #: The configuration in which they are relaxed, shape (nq,).


class MjcfTree:
    """The tree, with frames at sites and bodies.

    Attributes:
        model: The Pinocchio model.
        bodies: For each body of MuJoCo the joint that moves it, and its placement on this joint.
        dofs: For each rate of the model, its degree of freedom in MuJoCo; rates of tendons, which
            come last, have none.
        tendons: Indices of the fixed tendons that have a joint.
    """

    def __init__(self, compiled: Compiled) -> None:
        mj = compiled.mj
        self._compiled = compiled
        self.model = pin.Model()
        self.dofs = list[int]()
        self.model.name = mj.names.split(b"\0")[0].decode()
        if compiled.disabled("gravity"):
            self.model.gravity.linear = np.zeros(3)
        else:
            compensated = compiled.gravcomp or 0.0  # the same share of all weights
            self.model.gravity.linear = mj.opt.gravity * (1 - compensated)
        self.bodies = [(0, pin.SE3.Identity())]
        self._frame_names = {"universe"}
        self._coordinates = list[_Coordinates]()
        for body in range(1, mj.nbody):
            self._add_body(body)
        for site in range(mj.nsite):
            place = pose_of(mj.site_pos[site], mj.site_quat[site])
            self.add_frame(compiled.name("site", site), mj.site_bodyid[site], place)
        self.tendons = list[int]()
        for tendon in range(mj.ntendon):
            if compiled.needs_joint(tendon):
                self._add_tendon(tendon)

    def _add_tendon(self, tendon: int) -> None:
        """Add a joint for a fixed tendon: a hinge if all its joints are hinges, else a slide."""
        compiled = self._compiled
        name = compiled.name("tendon", tendon)
        if self.model.existJointName(name):
            compiled.problems.append(f"tendon {name}: a joint has this name too; rename one")
            return
        kinds = {int(compiled.mj.jnt_type[joint]) for joint in compiled.coefficients(tendon)}
        joint = pin.JointModelRX() if kinds == {int(HINGE)} else pin.JointModelPX()
        self.model.addJointFrame(self.model.addJoint(0, joint, pin.SE3.Identity(), name))
        self.tendons.append(tendon)

    def _add_body(self, body: int) -> None:
        """Add a body with its joints in series, behind its parent."""
        mj = self._compiled.mj
        parent, placement = self.bodies[mj.body_parentid[body]]
        placement = placement * pose_of(mj.body_pos[body], mj.body_quat[body])
        first = mj.body_jntadr[body]
        for joint in range(first, first + mj.body_jntnum[body]):
            if not self._compiled.is_locked(joint):
                parent, placement = self._add_joint(joint, parent, placement)
        self.bodies.append((parent, placement))
        # MuJoCo has principal moments in axes at the mass centre.
        center = mj.body_ipos[body]
        R = pose_of(center, mj.body_iquat[body]).rotation
        inertia = pin.Inertia(mj.body_mass[body], center, R * mj.body_inertia[body] @ R.T)
        self.model.appendBodyToJoint(parent, inertia, placement)

    def _add_joint(self, joint: int, parent: int, placement: pin.SE3) -> tuple[int, pin.SE3]:
        """Add a joint; returns the last joint of its series and the body's placement there.

        `placement` is the placement of the body at `qpos0`, relative to joint `parent`.
        """
        kind = self._joint_kind(joint, placement)
        locked = self._compiled.locked_rates(joint)
        if locked or kind.is_split:
            series: Series = PartlyLocked(kind.model, dict.fromkeys(locked, 0.0))
        else:
            series = Series.whole(kind.model)
        # The joint turns about its anchor on the body. Its parts follow each other; the body stands
        # behind the last one.
        mj = self._compiled.mj
        anchor = pin.SE3(np.eye(3), mj.jnt_pos[joint])
        first_dof = mj.jnt_dofadr[joint]
        part_placement = kind.placement * anchor * kind.to_zero
        for part in series.parts:
            name = self._compiled.joint(joint) + part.suffix
            parent = self.model.addJoint(parent, part.joint, part_placement * part.place, name)
            self.model.addJointFrame(parent)
            self.dofs += [first_dof + rate for rate in part.rates]
            part_placement = pin.SE3.Identity()
        self._coordinates.append(_Coordinates(kind.addresses, kind.reference, series))
        return parent, part_placement * series.place * anchor.inverse()

    def _joint_kind(self, joint: int, placement: pin.SE3) -> _JointKind:
        """What a joint of MuJoCo is in Pinocchio, for a placement of its body at `qpos0`."""
        mj = self._compiled.mj
        axis = mj.jnt_axis[joint]
        address = mj.jnt_qposadr[joint]
        at_qpos0 = mj.qpos0[address]  # of a hinge or a slide
        if mj.jnt_type[joint] == FREE:
            addresses = [*range(address, address + 3), *_scalar_last(address + 3)]
            reference = None
            in_world = pin.SE3.Identity()  # the coordinates are the pose in the world
            if self._compiled.locked_rates(joint):
                reference = pin.XYZQUATToSE3(mj.qpos0[addresses])
                in_world = reference
            is_split = bool(self._compiled.forces_of_free_joint(joint))
            model = pin.JointModelFreeFlyer()
            return _JointKind(model, addresses, in_world, reference=reference, is_split=is_split)
        if mj.jnt_type[joint] == HINGE:
            model = _along(axis, TURNS, pin.JointModelRevoluteUnaligned)
            to_zero = pin.SE3(pin.AngleAxis(-at_qpos0, axis).matrix(), np.zeros(3))
            return _JointKind(model, [address], placement, to_zero)
        if mj.jnt_type[joint] == SLIDE:
            model = _along(axis, SLIDES, pin.JointModelPrismaticUnaligned)
            return _JointKind(model, [address], placement, pin.SE3(np.eye(3), -at_qpos0 * axis))
        return _JointKind(pin.JointModelSpherical(), _scalar_last(address), placement)

    def add_frame(self, name: str, body: int, place: pin.SE3) -> None:
        """Add a frame that is fixed to a body."""
        if name in self._frame_names:
            text = "two frames (sites, ends of equalities) have this name"
            self._compiled.problems.append(f"frame {name}: {text}")
            return
        self._frame_names.add(name)
        parent, placement = self.bodies[body]
        self.model.addFrame(pin.Frame(name, parent, placement * place, pin.FrameType.OP_FRAME))

    def add_body_frames(self) -> None:
        """Add the frames of the bodies.

        A joint with the name of a body has a frame too; `frame_id` prefers the body's frame.
        """
        for body, (parent, placement) in enumerate(self.bodies[1:], start=1):
            name = self._compiled.mj.body(body).name
            # A site with the name of the body has a frame already; it is at the body's frame.
            if name and name not in self._frame_names:
                self.model.addFrame(pin.Frame(name, parent, placement, pin.FrameType.BODY))

    def add_numbers(self) -> JointSprings:
        """Put limits, friction, rotors and keyframes into the model; returns the springs."""
        compiled = self._compiled
        mj = compiled.mj
        model = self.model
        joints = mj.dof_jntid[self.dofs]  # of each rate
        self._add_position_limits(joints)
        tendons = self.tendons
        of_joints = mj.dof_armature[self.dofs] + self._tendon_armature()
        model.armature = np.append(of_joints, compiled.tendon_armature[tendons])
        model.damping = np.zeros(model.nv)
        model.friction = np.zeros(model.nv)
        stiffness = np.zeros(model.nv)
        if not compiled.disabled("damper"):
            model.damping = np.append(mj.dof_damping[self.dofs], mj.tendon_damping[tendons])
        if not compiled.disabled("frictionloss"):
            of_joints = mj.dof_frictionloss[self.dofs]
            model.friction = np.append(of_joints, mj.tendon_frictionloss[tendons])
        if not compiled.disabled("spring"):
            stiffness = np.append(mj.jnt_stiffness[joints], mj.tendon_stiffness[tendons])
        spring_reference = self._configuration(mj.qpos_spring)
        if tendons:
            spring_reference[-len(tendons) :] = mj.tendon_lengthspring[tendons, 0]
        for name, qpos in self._keyframes():
            model.referenceConfigurations[name] = pin.normalize(model, self._configuration(qpos))
        return JointSprings(stiffness, spring_reference)

    def _tendon_armature(self) -> Array:
        """Inertia of fixed tendons with one joint, m c^2 for the coefficient c, shape (nv,)."""
        mj = self._compiled.mj
        armature = np.zeros(len(self.dofs))
        for tendon in map(int, np.flatnonzero(self._compiled.tendon_armature)):
            if self._compiled.is_spatial(tendon) or tendon in self.tendons:
                continue
            coefficients = self._compiled.coefficients(tendon)  # of one joint; of none if locked
            for joint, coefficient in coefficients.items():
                rate = self.dofs.index(mj.jnt_dofadr[joint])
                armature[rate] += self._compiled.tendon_armature[tendon] * coefficient**2
        return armature

    def _add_position_limits(self, joints: Array) -> None:
        """Put the ranges of hinges and slides into the model; `joints` has one for each rate."""
        compiled = self._compiled
        mj = compiled.mj
        model = self.model
        has_limit = mj.jnt_limited[joints] != 0
        if compiled.disabled("limit"):
            has_limit[:] = False
        is_ball = mj.jnt_type[joints] == BALL
        for joint in dict.fromkeys(map(int, joints[has_limit & is_ball])):
            compiled.notes.append(f"joint {compiled.joint(joint)}: the limit of a ball is ignored")
        model.lowerPositionLimit = np.full(model.nq, -np.inf)
        model.upperPositionLimit = np.full(model.nq, np.inf)
        for joint in list(model.joints)[1:]:
            rate = joint.idx_v
            if rate < len(joints) and joint.nv == 1 and has_limit[rate] and not is_ball[rate]:
                lower, upper = mj.jnt_range[joints[rate]]
                model.lowerPositionLimit[joint.idx_q] = lower
                model.upperPositionLimit[joint.idx_q] = upper

    def add_home(self, closures: Sequence[Constraint]) -> None:
        """Make `qpos0` the home if it closes the loops and no keyframe is named home."""
        model = self.model
        if not model.nv or "home" in model.referenceConfigurations:
            return
        q = pin.normalize(model, self._configuration(self._compiled.mj.qpos0))
        loops = Loops(model, closures)
        loops.evaluate(q)
        length = longest_offset(model, range(1, model.njoints), closures, ground=False) or 1.0
        if np.abs(loops.f).max(initial=0.0) <= CLOSURE_TOLERANCE * length:
            model.referenceConfigurations["home"] = q

    def _configuration(self, qpos: Array) -> Array:
        """The configuration q of the Pinocchio model for MuJoCo's `qpos`."""
        parts = [np.empty(0)]  # so that a model without joints has an empty configuration
        for coordinates in self._coordinates:
            q = qpos[coordinates.addresses]
            if coordinates.reference is not None:
                pose = pin.XYZQUATToSE3(q)
                q = pin.SE3ToXYZQUAT(coordinates.reference.actInv(pose))
            parts += coordinates.series.positions(q)
        lengths = [self._compiled.tendon_length(tendon, qpos) for tendon in self.tendons]
        parts.append(np.array(lengths))
        return np.concatenate(parts)

    def _keyframes(self) -> Iterator[tuple[str, Array]]:
        """Names and `qpos` of the keyframes that have a name."""
        mj = self._compiled.mj
        for key in range(mj.nkey):
            name = mj.key(key).name
            if name:
                self._check_mocap_bodies(key)
                self._note_locked_joints(key)
                yield name, mj.key_qpos[key]

    def _check_mocap_bodies(self, key: int) -> None:
        """Report the bodies that a keyframe moves by `mocap`; here they are fixed."""
        compiled = self._compiled
        mj = compiled.mj
        positions = mj.key_mpos[key].reshape(-1, 3)
        quaternions = mj.key_mquat[key].reshape(-1, 4)
        for body in map(int, np.flatnonzero(mj.body_mocapid >= 0)):
            mocap = mj.body_mocapid[body]
            pose = [*positions[mocap], *quaternions[mocap]]
            if not np.allclose(pose, [*mj.body_pos[body], *mj.body_quat[body]]):
                text = f"it moves the mocap body {compiled.name('body', body)}"
                where = f"key {mj.key(key).name}"
                compiled.problems.append(f"{where}: {text}, which is fixed here")

    def _note_locked_joints(self, key: int) -> None:
        """Note the locked joints to which a keyframe gives another position."""
        compiled = self._compiled
        mj = compiled.mj
        sizes = {FREE: 7, BALL: 4, HINGE: 1, SLIDE: 1}
        for joint in filter(compiled.is_locked, range(mj.njnt)):
            address = mj.jnt_qposadr[joint]
            entries = slice(address, address + sizes[int(mj.jnt_type[joint])])
            if not np.allclose(mj.key_qpos[key][entries], mj.qpos0[entries]):
                text = f"{compiled.joint(joint)} is locked elsewhere; its value is left out"
                compiled.notes.append(f"key {mj.key(key).name}: {text}")


def _scalar_last(address: int) -> list[int]:
    """Addresses of a quaternion's entries x, y, z, w; MuJoCo has w, x, y, z."""
    return [address + 1, address + 2, address + 3, address]


def _along(axis: Array, aligned: Sequence[type], unaligned: type) -> Any:
    """A joint with an axis: a class of `aligned` if the axis is x, y or z, else `unaligned`."""
    for model, direction in zip(aligned, np.eye(3), strict=True):
        if np.array_equal(axis, direction):
            return model()
    return unaligned(axis)

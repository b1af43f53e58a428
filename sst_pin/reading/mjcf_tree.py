# SPDX-License-Identifier: BSD-2-Clause
"""The tree of a compiled MJCF as a Pinocchio model.

Coordinates of hinges and slides are MuJoCo's `qpos`, `ref` included. Balls and free joints are
Pinocchio's: a quaternion has its scalar last, MuJoCo's first; the linear rates of a free joint are
along the body's axes, MuJoCo's `qvel` has them along the world's. Angular rates are in body axes in
both.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..loops.loops import Loops
from ..model.closures import Constraint
from ..model.joint_series import SLIDES, TURNS, PartlyLocked, Series
from ..model.loop_groups import longest_offset
from ..model.thresholds import CLOSURE_TOLERANCE
from .mjcf_compiled import BALL, FREE, HINGE, SLIDE, Compiled, pose_of


class MjcfTree:
    """The tree, with frames at sites and bodies.

    `bodies` has for each body the joint that bears it and its placement there, `dofs` for each rate
    its degree of freedom in MuJoCo, `rest` where the joints' springs are at rest.
    """

    def __init__(self, compiled: Compiled) -> None:
        self._compiled, mj = compiled, compiled.mj
        self.model, self.rest, self.dofs = pin.Model(), np.empty(0), list[int]()
        self.model.name = mj.names.split(b"\0")[0].decode()
        weightless = compiled.disabled("gravity")
        gravity = np.zeros(3) if weightless else mj.opt.gravity * (1 - (compiled.gravcomp or 0.0))
        self.model.gravity.linear = gravity
        self.bodies = [(0, pin.SE3.Identity())]
        self._points = {"universe"}
        #: For each joint its addresses in `qpos`; the reference pose, if it is free and locked in
        #: part, else None; and its joints in this model.
        self._series: list[tuple[list[int], pin.SE3 | None, Series]] = []
        for body in range(1, mj.nbody):
            self._add_body(body)
        for site in range(mj.nsite):
            place = pose_of(mj.site_pos[site], mj.site_quat[site])
            self.add_frame(compiled.name("site", site), mj.site_bodyid[site], place)

    def _add_body(self, body: int) -> None:
        mj = self._compiled.mj
        parent, placement = self.bodies[mj.body_parentid[body]]
        placement = placement * pose_of(mj.body_pos[body], mj.body_quat[body])
        first = mj.body_jntadr[body]
        for joint in range(first, first + mj.body_jntnum[body]):
            if not self._compiled.is_locked(joint):
                parent, placement = self._add_joint(joint, parent, placement)
        self.bodies.append((parent, placement))
        center = mj.body_ipos[body]
        R = pose_of(center, mj.body_iquat[body]).rotation
        inertia = pin.Inertia(mj.body_mass[body], center, R * mj.body_inertia[body] @ R.T)
        self.model.appendBodyToJoint(parent, inertia, placement)

    def _add_joint(self, joint: int, parent: int, placement: pin.SE3) -> tuple[int, pin.SE3]:
        """The joint that bears the body now, and the body's placement there."""
        compiled, mj = self._compiled, self._compiled.mj
        kind, axis, address = mj.jnt_type[joint], mj.jnt_axis[joint], mj.jnt_qposadr[joint]
        anchor = pin.SE3(np.eye(3), mj.jnt_pos[joint])
        reference, addresses, start = mj.qpos0[address], [address], None
        zero, locked = pin.SE3.Identity(), compiled.locked_rates(joint)
        if kind == FREE:
            model, placement = pin.JointModelFreeFlyer(), pin.SE3.Identity()
            addresses = [*range(address, address + 3), *_scalar_last(address + 3)]
            if locked:
                placement = start = pin.XYZQUATToSE3(mj.qpos0[addresses])
        elif kind == HINGE:
            model = _along(axis, TURNS, pin.JointModelRevoluteUnaligned)
            zero = pin.SE3(pin.AngleAxis(-reference, axis).matrix(), np.zeros(3))
        elif kind == SLIDE:
            model = _along(axis, SLIDES, pin.JointModelPrismaticUnaligned)
            zero = pin.SE3(np.eye(3), -reference * axis)
        else:
            model, addresses = pin.JointModelSpherical(), _scalar_last(address)
        series = PartlyLocked(model, dict.fromkeys(locked, 0.0)) if locked else Series.whole(model)
        at, dof = placement * anchor * zero, mj.jnt_dofadr[joint]
        for part in series.parts:
            name = compiled.joint(joint) + part.suffix
            parent = self.model.addJoint(parent, part.joint, at * part.place, name)
            self.model.addJointFrame(parent)
            self.dofs += [dof + k for k in part.rates]
            at = pin.SE3.Identity()
        self._series.append((addresses, start, series))
        return parent, at * series.place * anchor.inverse()

    def add_frame(self, name: str, body: int, place: pin.SE3) -> None:
        """A frame that is fixed to a body."""
        if name in self._points:
            text = "two frames (sites, ends of equalities) have this name"
            self._compiled.problems.append(f"frame {name}: {text}")
            return
        self._points.add(name)
        parent, at = self.bodies[body]
        self.model.addFrame(pin.Frame(name, parent, at * place, pin.FrameType.OP_FRAME))

    def add_body_frames(self) -> None:
        """Frames of the bodies, where MuJoCo has them.

        A joint of the same name has a frame of its own; `frame_id` prefers the body's.
        """
        for body, (parent, placement) in enumerate(self.bodies[1:], start=1):
            name = self._compiled.mj.body(body).name
            if name and name not in self._points:  # else a site with this name stands here
                self.model.addFrame(pin.Frame(name, parent, placement, pin.FrameType.BODY))

    def add_numbers(self) -> Array:
        """Put limits, friction, rotors and keyframes into the model; returns springs' stiffness."""
        compiled, mj, model = self._compiled, self._compiled.mj, self.model
        joints = mj.dof_jntid[self.dofs]
        limited = (mj.jnt_limited[joints] != 0) & (not compiled.disabled("limit"))
        balls = mj.jnt_type[joints] == BALL
        for joint in dict.fromkeys(map(int, joints[limited & balls])):
            compiled.notes.append(f"joint {compiled.joint(joint)}: the limit of a ball is ignored")
        ranges = np.where((limited & ~balls)[:, None], mj.jnt_range[joints], [-np.inf, np.inf])
        model.lowerPositionLimit = np.full(model.nq, -np.inf)
        model.upperPositionLimit = np.full(model.nq, np.inf)
        for joint in (joint for joint in list(model.joints)[1:] if joint.nv == 1):
            low, high = ranges[joint.idx_v]
            model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q] = low, high
        model.armature = mj.dof_armature[self.dofs]
        model.damping = mj.dof_damping[self.dofs] * (not compiled.disabled("damper"))
        model.friction = mj.dof_frictionloss[self.dofs] * (not compiled.disabled("frictionloss"))
        for name, qpos in self._poses():
            model.referenceConfigurations[name] = pin.normalize(model, self._configuration(qpos))
        self.rest = self._configuration(mj.qpos_spring)
        return np.asarray(mj.jnt_stiffness[joints] * (not compiled.disabled("spring")))

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
        """Our coordinates for MuJoCo's."""
        parts = [np.empty(0)]
        for addresses, start, series in self._series:
            q = qpos[addresses]
            if start is not None:
                q = pin.SE3ToXYZQUAT(start.actInv(pin.XYZQUATToSE3(q)))
            parts += series.positions(q)
        return np.concatenate(parts)

    def _poses(self) -> Iterator[tuple[str, Array]]:
        """Named keyframes; a note says where they move a locked joint."""
        compiled, mj = self._compiled, self._compiled.mj
        for key in range(mj.nkey):
            where, qpos = f"key {mj.key(key).name}", mj.key_qpos[key]
            if where == "key ":
                continue
            for body in map(int, np.flatnonzero(mj.body_mocapid >= 0)):
                poses = mj.key_mpos[key].reshape(-1, 3), mj.key_mquat[key].reshape(-1, 4)
                at = np.hstack([pose[mj.body_mocapid[body]] for pose in poses])
                if not np.allclose(at, [*mj.body_pos[body], *mj.body_quat[body]]):
                    text = f"it moves the mocap body {compiled.name('body', body)}"
                    compiled.problems.append(f"{where}: {text}, which is fixed here")
            for joint in filter(compiled.is_locked, range(mj.njnt)):
                address = mj.jnt_qposadr[joint]
                size = {FREE: 7, BALL: 4}.get(int(mj.jnt_type[joint]), 1)
                entries = slice(address, address + size)
                if not np.allclose(qpos[entries], mj.qpos0[entries]):
                    text = f"{compiled.joint(joint)} is locked elsewhere; its value is left out"
                    compiled.notes.append(f"{where}: {text}")
            yield mj.key(key).name, qpos


def _scalar_last(address: int) -> list[int]:
    """Addresses of a quaternion's entries in Pinocchio's order."""
    return [address + 1, address + 2, address + 3, address]


def _along(axis: Array, aligned: Sequence[type], unaligned: type) -> Any:
    """A joint with an axis, of the simple kind if the axis is x, y or z."""
    for model, direction in zip(aligned, np.eye(3), strict=True):
        if np.array_equal(axis, direction):
            return model()
    return unaligned(axis)

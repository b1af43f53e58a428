# SPDX-License-Identifier: BSD-2-Clause
"""The tree of a compiled MJCF as a Pinocchio model.

Hinges and slides have the coordinates of MuJoCo's `qpos`, so that their positions at the reference
configuration `qpos0` are what the file calls `ref`. Balls and free joints have Pinocchio's
coordinates. In Pinocchio a quaternion has its scalar last, in MuJoCo first. In Pinocchio the linear
rates of a free joint are in axes of the body, in MuJoCo in axes of the world. Angular rates are in
axes of the body in both. Where the difference matters, because the joint has a spring, dry friction
or armature, the free joint becomes three slides and a ball.

A fixed tendon with forces or inertia becomes a joint of a body without mass. `mjcf_closures`
couples the joint: its position is the length of the tendon. So springs, dampers, friction and
armature of the tendon are those of the joint. The joints of tendons come last, after those of the
file.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.joint_series import SLIDES, TURNS, PartlyLocked, Series
from ..model.weight_shares import Link, shares_of_links
from .mjcf_compiled import BALL, FREE, HINGE, Compiled, pose_of


class _JointKind(NamedTuple):
    """What a joint of MuJoCo is in Pinocchio."""

    #: The joint of Pinocchio. If rates are locked or it is split, joints in series replace it.
    joint_model: Any
    #: Indices of its coordinates in `qpos`, in Pinocchio's order.
    addresses: list[int]
    #: Where the motion of the body begins, relative to the joint before it. For a hinge, a slide or
    #: a ball it is the body's placement at `qpos0`. For a free joint it is the identity, as its
    #: coordinates are the pose in the world. For a free joint with locked rates it is `reference`.
    placement: pin.SE3
    #: The motion of the joint from `qpos0` to position zero: MuJoCo places the body at `qpos0`,
    #: Pinocchio at position zero.
    to_zero: pin.SE3 = pin.SE3.Identity()
    #: For a free joint with locked rates: its pose in the world at `qpos0`, where its positions are
    #: zero. None for other joints.
    reference: pin.SE3 | None = None
    #: Whether a free joint becomes three slides and a ball.
    is_split: bool = False


class _JointInTree(NamedTuple):
    """A joint of MuJoCo in the tree."""

    kind: _JointKind
    #: The joints in series that it has in the Pinocchio model.
    series: Series


class BodyInTree(NamedTuple):
    """Where a body of MuJoCo is in the tree."""

    joint: int  #: The joint that moves it; 0 for the base.
    placement: pin.SE3  #: The body's placement on this joint.


class MjcfTree:
    """The tree, with frames at sites and bodies.

    Attributes:
        model: The Pinocchio model.
        bodies: Where each body of MuJoCo is in the tree.
        dofs: For each rate of the model, its degree of freedom in MuJoCo; without the rates of
            tendons, which come last and have none.
        tendons: Indices of the fixed tendons that have a joint.
    """

    def __init__(self, compiled: Compiled) -> None:
        mj = compiled.mj
        self._compiled = compiled
        self.model = pin.Model()
        self.model.name = mj.names.split(b"\0")[0].decode()
        if compiled.disabled("gravity"):
            self.model.gravity.linear = np.zeros(3)
        elif compiled.gravcomp is None:
            # The bodies have no common compensated share; `weight_shares` has those of each.
            self.model.gravity.linear = mj.opt.gravity
        else:
            self.model.gravity.linear = mj.opt.gravity * (1 - compiled.gravcomp)
        self.bodies = [BodyInTree(0, pin.SE3.Identity())]
        self.dofs = list[int]()
        self.tendons = list[int]()
        self._joints = list[_JointInTree]()
        self._frame_names = {"universe"}
        for body in range(1, mj.nbody):
            self._add_body(body)
        for site in range(mj.nsite):
            place = pose_of(mj.site_pos[site], mj.site_quat[site])
            self.add_frame(compiled.name("site", site), mj.site_bodyid[site], place)
        for tendon in range(mj.ntendon):
            if compiled.needs_joint(tendon):
                self._add_tendon(tendon)

    def configuration(self, qpos: Array) -> Array:
        """The configuration q of the Pinocchio model for MuJoCo's `qpos`."""
        parts = [np.empty(0)]  # so that a model without joints has an empty configuration
        for kind, series in self._joints:
            q = qpos[kind.addresses]
            if kind.reference is not None:  # its positions are relative to this pose
                pose = pin.XYZQUATToSE3(q)
                q = pin.SE3ToXYZQUAT(kind.reference.actInv(pose))
            parts += series.positions(q)
        lengths = [self._compiled.tendon_length(tendon, qpos) for tendon in self.tendons]
        parts.append(np.array(lengths))
        return np.concatenate(parts)

    def weight_shares(self) -> dict[str, Array]:
        """The shares of weights that `gravcomp` leaves, by joint; see `model.weight_shares`.

        Empty if the share is the same for all bodies, because the model's gravity includes it then.
        """
        if self._compiled.gravcomp is not None:
            return {}
        mj = self._compiled.mj
        links = list[Link]()
        for body, (joint, placement) in enumerate(self.bodies):
            center = placement.act(mj.body_ipos[body])
            share = 1 - float(self._compiled.body_gravcomp[body])
            links.append(Link(joint, float(mj.body_mass[body]), center, share))
        return shares_of_links(self.model, links)

    def by_rate(self, of_dofs: Array, of_tendons: Array) -> Array:
        """One number for each rate of the model, shape (nv,).

        `of_dofs` has a number for each degree of freedom of MuJoCo, `of_tendons` for each tendon.
        """
        return np.append(of_dofs[self.dofs], of_tendons[self.tendons])

    # --- bodies and joints --------------------------------------------------------------------

    def _add_body(self, body: int) -> None:
        """Add a body with its joints in series after the joint of its parent."""
        mj = self._compiled.mj
        # The last joint that moves the body so far, and the placement of the body on it.
        last_joint, parent_on_joint = self.bodies[mj.body_parentid[body]]
        placement = parent_on_joint * pose_of(mj.body_pos[body], mj.body_quat[body])
        first = mj.body_jntadr[body]
        for joint in range(first, first + mj.body_jntnum[body]):
            if not self._compiled.is_locked(joint):
                last_joint, placement = self._add_joint(joint, last_joint, placement)
        self.bodies.append(BodyInTree(last_joint, placement))
        # MuJoCo has principal moments, whose axes are the columns of R: R diag(moments) R^T.
        center = mj.body_ipos[body]
        R = pose_of(center, mj.body_iquat[body]).rotation
        R_times_moments = R * mj.body_inertia[body]  # each column times its moment
        inertia = pin.Inertia(mj.body_mass[body], center, R_times_moments @ R.T)
        self.model.appendBodyToJoint(last_joint, inertia, placement)

    def _add_joint(self, joint: int, parent: int, placement: pin.SE3) -> tuple[int, pin.SE3]:
        """Add a joint; returns the last joint of its series and the body's placement on it.

        `placement` is the placement of the body at `qpos0`, relative to joint `parent`.
        """
        kind = self._joint_kind(joint, placement)
        locked = self._compiled.locked_rates(joint)
        if locked or kind.is_split:
            # Without locked rates, `PartlyLocked` splits a free joint into three slides and a ball.
            series: Series = PartlyLocked(kind.joint_model, dict.fromkeys(locked, 0.0))
        else:
            series = Series.whole(kind.joint_model)
        # The joint turns about its anchor, a point of the body. The first part of the series is at
        # this point, placed where it is at position zero. Each part moves the next one. The last
        # part moves the body, whose placement on it is `series.place * anchor.inverse()`. If each
        # rate is locked by its own name, there are no parts. (A joint that is locked as a whole
        # does not come here.)
        mj = self._compiled.mj
        anchor = pin.SE3(np.eye(3), mj.jnt_pos[joint])
        first_dof = mj.jnt_dofadr[joint]
        part_placement = kind.placement * anchor * kind.to_zero
        for part in series.parts:
            name = self._compiled.joint_name(joint) + part.suffix
            parent = self.model.addJoint(parent, part.joint, part_placement * part.place, name)
            self.model.addJointFrame(parent)
            self.dofs += [first_dof + rate for rate in part.rates]
            part_placement = pin.SE3.Identity()
        self._joints.append(_JointInTree(kind, series))
        return parent, part_placement * series.place * anchor.inverse()

    def _joint_kind(self, joint: int, placement: pin.SE3) -> _JointKind:
        """What a joint of MuJoCo is in Pinocchio, for a placement of its body at `qpos0`."""
        mj = self._compiled.mj
        address = mj.jnt_qposadr[joint]
        if mj.jnt_type[joint] == FREE:
            return self._free_joint(joint)
        if mj.jnt_type[joint] == BALL:
            return _JointKind(pin.JointModelSpherical(), _scalar_last(address), placement)
        axis = mj.jnt_axis[joint]
        at_qpos0 = mj.qpos0[address]
        if mj.jnt_type[joint] == HINGE:
            model = _along(axis, TURNS, pin.JointModelRevoluteUnaligned)
            to_zero = pin.SE3(pin.AngleAxis(-at_qpos0, axis).matrix(), np.zeros(3))
        else:  # a slide
            model = _along(axis, SLIDES, pin.JointModelPrismaticUnaligned)
            to_zero = pin.SE3(np.eye(3), -at_qpos0 * axis)
        return _JointKind(model, [address], placement, to_zero)

    def _free_joint(self, joint: int) -> _JointKind:
        """What a free joint is in Pinocchio.

        Its coordinates are the pose of its body in the world. If rates are locked, the joint moves
        the body relative to the pose at `qpos0`, so that the locked positions are zero.
        """
        mj = self._compiled.mj
        first = mj.jnt_qposadr[joint]
        addresses = [*range(first, first + 3), *_scalar_last(first + 3)]
        reference = None
        placement = pin.SE3.Identity()
        if self._compiled.locked_rates(joint):
            reference = pin.XYZQUATToSE3(mj.qpos0[addresses])
            placement = reference
        return _JointKind(
            joint_model=pin.JointModelFreeFlyer(),
            addresses=addresses,
            placement=placement,
            reference=reference,
            is_split=bool(self._compiled.forces_of_free_joint(joint)),
        )

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

    # --- frames -------------------------------------------------------------------------------

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
        """Add the frames of the bodies, after all other frames.

        A joint with the name of a body has a frame too; `frame_id` prefers the body's frame.
        """
        for body, (parent, placement) in enumerate(self.bodies[1:], start=1):
            name = self._compiled.mj.body(body).name
            # If a site has the name of the body, it is at the body's frame: `Compiled.name` renames
            # other sites. The frame of this site exists already.
            if name and name not in self._frame_names:
                self.model.addFrame(pin.Frame(name, parent, placement, pin.FrameType.BODY))


def _scalar_last(address: int) -> list[int]:
    """Addresses of a quaternion's entries x, y, z, w; MuJoCo has w, x, y, z."""
    return [address + 1, address + 2, address + 3, address]


def _along(axis: Array, aligned: Sequence[type], unaligned: type) -> Any:
    """A joint with an axis.

    `aligned` has the classes of Pinocchio for the axes x, y and z, `unaligned` is the class for
    other axes.
    """
    for joint_class, direction in zip(aligned, np.eye(3), strict=True):
        if np.array_equal(axis, direction):
            return joint_class()
    return unaligned(axis)

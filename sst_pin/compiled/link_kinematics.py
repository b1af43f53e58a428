# SPDX-License-Identifier: BSD-2-Clause
"""Placements and motions of the links of a tree, on CasADi's symbols.

Vectors of a link are in the axes of its own frame. Letters of this module, of a link relative to
its parent, to another ancestor, or to the world:

- R, p: the orientation (R takes vectors of the link to the axes of the ancestor) and the origin;
- u, omega: the velocity of the origin and the angular velocity;
- a, alpha: the acceleration of the origin and the angular acceleration;
- S: the twists [u; omega] of the link relative to its parent at a unit of each rate of its joint.

A point at r from the origin of a link has the acceleration a + U r with

    U = skew(alpha) + skew(omega) skew(omega).

Here a is the second derivative of the position of the origin, not the linear part of a spatial
acceleration. So the recursion from link to link needs no linear velocity.

Joints may have small *displacements* along their rates, which are symbols with the value zero.
Expressions are right to first order in the displacements. Their derivatives by the displacements
are the derivatives by q along the rates, also for joints with quaternions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin
from casadi import SX

from ..arrays import Array
from .links import Link, LinkTree, clean
from .symbols import Sparse, add, angle, column, rotation_vector, sparse, sx

#: Number of the last coordinates of a joint that form a unit vector: a quaternion, or the cosine
#: and the sine of an angle.
_UNIT = {"ball": 4, "free": 4, "planar": 2, "unbounded": 2}
_ZERO = SX(3, 1)


@dataclass(frozen=True)
class LinkMotion:
    """Angular velocity and accelerations of a link, in its axes.

    The robot moves with rates v. The accelerations are the rates, along this motion, of the
    velocities that some rates v_k give to the link. Mostly v_k = v, and these are the accelerations
    of the motion. For the rate of a column of L, v_k is this column.

    Attributes:
        omega: Angular velocity for v.
        omega_k: Angular velocity for v_k.
        alpha: Rate of omega_k.
        a: Rate of the velocity of the origin for v_k.
    """

    omega: SX = _ZERO
    omega_k: SX = _ZERO
    alpha: SX = _ZERO
    a: SX = _ZERO

    @cached_property
    def U(self) -> SX:
        """The matrix U: a point at r from the origin has the acceleration a + U r."""
        return ca.skew(self.alpha) + ca.skew(self.omega_k) @ ca.skew(self.omega)


class Placement(NamedTuple):
    """Orientation R (I + skew(theta)) and origin p of a link in its parent."""

    R: SX
    p: SX
    #: Small rotation vector in the axes of the link, by the displacement of its joint.
    theta: SX

    def to_link(self, x: SX) -> SX:
        """A vector of the parent in the axes of the link."""
        y = self.R.T @ x
        return y - ca.cross(self.theta, y)

    def to_parent(self, x: SX) -> SX:
        """A vector of the link in the axes of the parent."""
        return self.R @ (x + ca.cross(self.theta, x))


class MovingFrame(NamedTuple):
    """A frame as it moves relative to a base, one of the links, in the axes of the base."""

    p: SX
    R: SX
    #: Columns of its Jacobian by rate: the twist [u; omega] at a unit of the rate.
    columns: Sparse


class Kinematics:
    """Symbols of a tree and the expressions of its kinematics.

    Args:
        model: The tree; a joint without compiled equations is refused.
        displaced: Whether joints have small displacements.
        acceleration: Acceleration of link 0, in its axes; zero by default.

    Attributes:
        tree: The links.
        q: The configuration, shape (nq,).
        displacement: The displacements, shape (nv,), or (0,) without them.
        pose: Function (base, link), by indices of links: R and p of the link in an ancestor of it,
            the base.
    """

    def __init__(
        self, model: pin.Model, displaced: bool = False, acceleration: SX | None = None
    ) -> None:
        self._acceleration = SX(3, 1) if acceleration is None else acceleration
        self.tree = LinkTree.of(model)
        self.q = SX.sym("q", model.nq)
        self.displacement = SX.sym("displacement", model.nv if displaced else 0)
        self._displacements: Sparse = dict(enumerate(ca.vertsplit(self.displacement)))
        # `cache` keeps the result for each base and link, so that each expression is made once.
        self.pose = cache(self._pose)
        self._undisplaced_pose = cache(self._undisplaced_pose_of)
        self._link_displacement = cache(self._link_displacement_of)
        self._joint_axes = cache(self._joint_axes_of)
        #: The v and dv of the last call of `relative_motion`, and its results for them by base and
        #: link. Several rows of closures need the same motions.
        self._last_motions: tuple[Sparse, Sparse, dict[tuple[int, int], LinkMotion]] = {}, {}, {}

    # --- placements ---------------------------------------------------------------------------

    @cached_property
    def placements(self) -> list[tuple[SX, SX]]:
        """R and p of each link in its parent, without displacements."""
        placements = []
        for link in self.tree.links:
            R, p = _joint_placement(link, [self.q[k] for k in link.q])
            R_before = sx(link.R)
            placements.append((R_before @ R, sx(link.p) + R_before @ p))
        return placements

    @cached_property
    def _displaced_placements(self) -> list[Placement]:
        """The placement of each link in its parent, with the displacement of its joint."""
        placements = []
        for link, (R, p) in zip(self.tree.links, self.placements, strict=True):
            shift, theta = _joint_twist(link, self._displacements)
            placements.append(Placement(R, p + R @ shift, theta))
        return placements

    def _pose(self, base: int, link: int) -> tuple[SX, SX]:
        """See `pose` of the class."""
        R, p = self._undisplaced_pose(base, link)
        if not self._displacements:
            return R, p
        shift, theta = self._link_displacement(base, link)
        return R @ (SX.eye(3) + ca.skew(theta)), p + R @ shift

    def _undisplaced_pose_of(self, base: int, link: int) -> tuple[SX, SX]:
        """`pose` without displacements."""
        if link == base:
            return SX.eye(3), SX(3, 1)
        R, p = self._undisplaced_pose(base, self.tree.links[link].parent)
        R_link, p_link = self.placements[link]
        return R @ R_link, p + R @ p_link

    def _link_displacement_of(self, base: int, link: int) -> tuple[SX, SX]:
        """Shift and turn of a link relative to a base by the displacements of all joints between.

        Both are in the axes of the link. They follow from link to link as twists do, because they
        are small.
        """
        if link == base:
            return SX(3, 1), SX(3, 1)
        of_parent = self._link_displacement(base, self.tree.links[link].parent)
        return self._next_twist(link, of_parent, self._displacements)

    # --- coordinates --------------------------------------------------------------------------

    @cached_property
    def moved_q(self) -> SX:
        """The coordinates with the displacements of the joints, to first order."""
        return self.q + self.q_rates(self._displacements)

    def difference(self, reference: Mapping[int, SX]) -> Sparse:
        """The smallest rates that lead from a reference configuration to q in unit time.

        The result is `pin.difference(model, reference, q)` for the joints whose coordinates are in
        `reference`.

        Args:
            reference: Coordinates by their index in q.
        """
        q = self.moved_q
        step = Sparse()
        for link in self.tree.links:
            indices = [i for i in link.q if i in reference]
            if indices and link.kind == "ball":
                rotation = _relative(ca.vertcat(*(reference[i] for i in indices)), q[indices])
                turns = ca.vertsplit(rotation_vector(rotation))
                step |= dict(zip(link.v, turns, strict=True))
            elif indices and link.kind == "unbounded":
                # The cosine and the sine of the difference of two angles.
                i, j = indices
                (k,) = link.v
                c = reference[i]
                s = reference[j]
                step[k] = angle(c * q[i] + s * q[j], c * q[j] - s * q[i])
            else:
                for i in indices:
                    rate = link.v[i - link.q.start]
                    step[rate] = q[i] - reference[i]
        return step

    def q_rates(self, v: Sparse) -> SX:
        """Rates of the entries of q, shape (nq,), for rates v of the joints."""
        rates = SX(self.q.numel(), 1)
        for link in self.tree.links[1:]:
            entries = self.q[link.q.start : link.q.stop]
            rates[link.q.start : link.q.stop] = _q_rates_of(link, entries, column(v, link.v))
        return rates

    @property
    def unit_gaps(self) -> list[SX]:
        """Squared lengths of the unit vectors among the coordinates, less one."""
        return [ca.sumsqr(self.q[part]) - 1 for part in self._units]

    def normalized(self, q: SX) -> SX:
        """q with its unit vectors nearer to length one.

        With the squared length s, the factor (3 - s) / 2 is 1 / sqrt(s) to first order around 1.
        """
        q = SX(q)
        for part in self._units:
            q[part] *= (3 - ca.sumsqr(q[part])) / 2
        return q

    @property
    def _units(self) -> list[slice]:
        """The entries of q that form each unit vector."""
        return [
            slice(link.q.stop - _UNIT[link.kind], link.q.stop)
            for link in self.tree.links
            if link.kind in _UNIT
        ]

    # --- velocities ---------------------------------------------------------------------------

    def twist(self, base: int, link: int, v: Sparse) -> tuple[SX, SX]:
        """u and omega of a link relative to one of its ancestors, in the axes of the link."""
        if link == base:
            return SX(3, 1), SX(3, 1)
        return self._next_twist(link, self.twist(base, self.tree.links[link].parent, v), v)

    def _next_twist(self, link: int, of_parent: tuple[SX, SX], v: Sparse) -> tuple[SX, SX]:
        """u and omega of a link from those of its parent, each in the axes of its own link."""
        placement = self._displaced_placements[link]
        u_joint, omega_joint = _joint_twist(self.tree.links[link], v)
        u_parent, omega_parent = of_parent
        u = placement.to_link(u_parent + ca.cross(omega_parent, placement.p)) + u_joint
        return u, placement.to_link(omega_parent) + omega_joint

    def _joint_axes_of(self, base: int, link: int) -> list[tuple[SX, SX]]:
        """u and omega of a link relative to its parent at a unit of each rate, axes of the base."""
        R, _ = self.pose(base, link)
        return [(R @ sx(twist[:3]), R @ sx(twist[3:])) for twist in self.tree.links[link].S.T]

    def moving_frame(self, base: int, frame: pin.Frame) -> MovingFrame:
        """A frame of the tree as it moves relative to an ancestor of its link."""
        link = self.tree.link_of[frame.parentJoint]
        R, p_link = self.pose(base, link)
        p = p_link + R @ sx(frame.placement.translation)
        columns: Sparse = {}
        path = self.tree.ancestors(link)
        for i in path[path.index(base) + 1 :]:
            _, p_joint = self.pose(base, i)
            axes = zip(self.tree.links[i].v, self._joint_axes(base, i), strict=True)
            for k, (u, omega) in axes:
                column = ca.vertcat(u + ca.cross(omega, p - p_joint), omega)
                # A mimic joint shares its rate with the joint that it follows.
                columns[k] = columns[k] + column if k in columns else column
        return MovingFrame(p, R @ sx(frame.placement.rotation), columns)

    # --- accelerations ------------------------------------------------------------------------

    def motions(
        self, v: Sparse, dv: Sparse, gravity: SX | None = None, v_k: Sparse | None = None
    ) -> list[LinkMotion]:
        """Motions of all links.

        Args:
            v: Rates of the motion.
            dv: Rate of v_k along the motion.
            gravity: If given, link 0 accelerates against gravity. Then a mass times its
                acceleration is the force that moves the mass and carries its weight.
            v_k: Rates of the velocity that is differentiated, v by default; see `LinkMotion`.
        """
        of_base = LinkMotion() if gravity is None else LinkMotion(a=-gravity)
        if v_k is None:
            v_k = v
        motions = [of_base]
        for i, link in enumerate(self.tree.links[1:], start=1):
            motions.append(self._next_motion(i, motions[link.parent], v, v_k, dv))
        return motions

    def relative_motion(self, base: int, link: int, v: Sparse, dv: Sparse) -> LinkMotion:
        """Motion of a link relative to one of its ancestors."""
        last_v, last_dv, motions = self._last_motions
        # No caller changes v and dv afterwards, so the same dictionaries mean the same motion.
        if last_v is not v or last_dv is not dv:
            motions = {}
            self._last_motions = v, dv, motions
        if (base, link) not in motions:
            if link == base == 0:
                motions[base, link] = LinkMotion(a=self._acceleration)
            elif link == base:
                motions[base, link] = LinkMotion()
            else:
                of_parent = self.relative_motion(base, self.tree.links[link].parent, v, dv)
                motions[base, link] = self._next_motion(link, of_parent, v, v, dv)
        return motions[base, link]

    def _next_motion(
        self, i: int, of_parent: LinkMotion, v: Sparse, v_k: Sparse, dv: Sparse
    ) -> LinkMotion:
        """Motion of link i from that of its parent, in the axes of the link.

        Quantities of the parent are primed here. The joint has the twists [u_j; omega_j] = S v,
        [u_jk; omega_jk] = S v_k and [du_j; domega_j] = S dv. The origin of the link in its parent
        is p. The velocities of the link are

            omega   = omega' + omega_j,   omega_k = omega_k' + omega_jk,
            u_k     = u_k' + omega_k' x p + u_jk.

        Their rates follow with p_dot = omega' x p + u_j. S is constant in the link, which turns
        with omega:

            alpha   = alpha' + omega x omega_jk + domega_j
            a       = a' + U' p + omega_k' x u_j + omega x u_jk + du_j
        """
        link = self.tree.links[i]
        placement = self._displaced_placements[i]
        to_link = placement.to_link
        u_joint, omega_joint = _joint_twist(link, v)
        du_joint, domega_joint = _joint_twist(link, dv)
        omega = to_link(of_parent.omega) + omega_joint
        if v_k is v:
            u_joint_k = u_joint
            omega_joint_k = omega_joint
            omega_k = omega
        else:
            u_joint_k, omega_joint_k = _joint_twist(link, v_k)
            omega_k = to_link(of_parent.omega_k) + omega_joint_k
        alpha = to_link(of_parent.alpha) + ca.cross(omega, omega_joint_k) + domega_joint
        a = to_link(of_parent.a + of_parent.U @ placement.p) + du_joint
        if link.S[:3].any():  # the joint slides: Coriolis acceleration
            a += ca.cross(to_link(of_parent.omega_k), u_joint) + ca.cross(omega, u_joint_k)
        return LinkMotion(omega=omega, omega_k=omega_k, alpha=alpha, a=a)

    # --- forces -------------------------------------------------------------------------------

    def joint_wrenches(self, needed: Sequence[SX]) -> list[SX]:
        """The wrench of each joint on all links that it carries, by link.

        The entry of link 0 is the wrench of the ground on the whole robot. Wrenches are
        [force; moment] about the origin of a link, in its axes.

        Args:
            needed: The wrench that each link needs.
        """
        wrenches = list(needed)
        for i in range(len(self.tree.links) - 1, 0, -1):
            parent = self.tree.links[i].parent
            placement = self._displaced_placements[i]
            force, moment = map(placement.to_parent, ca.vertsplit(wrenches[i], 3))
            of_lever = ca.vertcat(SX(3, 1), ca.cross(placement.p, force))
            wrenches[parent] = wrenches[parent] + ca.vertcat(force, moment) + of_lever
        return wrenches

    def joint_forces(self, needed: Sequence[SX]) -> Sparse:
        """Forces along the rates: S^T times the wrench of each joint.

        Args:
            needed: The wrench that each link needs.
        """
        tau: Sparse = {}
        wrenches = self.joint_wrenches(needed)
        for i in range(len(wrenches) - 1, -1, -1):
            link = self.tree.links[i]
            tau = add(tau, sparse(link.v, sx(link.S).T @ wrenches[i]))
        return tau


def _relative(a: SX, b: SX) -> SX:
    """The rotation from orientation a to orientation b, all as quaternions (x, y, z, w).

    Its axis has the same components in the axes of a and of b.
    """
    vector = a[3] * b[:3] - b[3] * a[:3] - ca.cross(a[:3], b[:3])
    return ca.vertcat(vector, ca.dot(a, b))


def _joint_twist(link: Link, x: Sparse) -> list[SX]:
    """Linear and angular part of S x, for the rates x of a link's own joint."""
    return ca.vertsplit(sx(link.S) @ column(x, link.v), 3)


def _joint_placement(link: Link, q: list[SX]) -> tuple[SX, SX]:
    """R and p of the joint of a link at its coordinates q, without `link.R` and `link.p`.

    Positions come first in q, then an angle or a unit vector: cosine and sine, or a quaternion.
    """
    kind = link.kind
    S = link.S
    R = SX.eye(3)
    p = SX(3, 1)
    if kind in ("slide", "screw"):
        p = sx(S[:3, 0]) * q[0]
    elif kind in ("slides", "free"):
        p = ca.vertcat(*q[:3])
    elif kind == "planar":
        p = ca.vertcat(*q[:2], 0)
    if kind in ("turn", "screw"):
        (factor,) = clean(np.linalg.norm(S[3:], axis=0)).tolist()  # 1 except for a mimic joint
        R = _rotation(S[3:, 0] / factor, ca.cos(factor * q[0]), ca.sin(factor * q[0]))
    elif kind in ("unbounded", "planar"):
        R = _rotation(S[3:, -1], q[-2], q[-1])
    elif kind in ("ball", "free"):
        vector = ca.vertcat(*q[-4:-1])
        w = q[-1]
        W = ca.skew(vector)
        R = SX.eye(3) + 2 * (w * W + W @ W)
    return R, p


def _q_rates_of(link: Link, q: SX, v: SX) -> SX:
    """Rates of the coordinates q of a joint for its rates v = [u; omega], in the axes of the link.

    The cosine and the sine of an angle have the rates

        c_dot = -s omega,  s_dot = c omega.

    A quaternion with the vector e and the scalar w has the rates

        e_dot = (w omega + e x omega) / 2,  w_dot = -e . omega / 2.

    Positions before a unit vector are in the axes of the parent and have the rates R u.
    """
    if link.kind not in _UNIT:
        return v
    if _UNIT[link.kind] == 2:
        c, s = q[-2], q[-1]
        unit_rates = ca.vertcat(-s, c) * v[-1]
    else:
        e, w = q[-4:-1], q[-1]
        omega = v[-3:]
        unit_rates = ca.vertcat(w * omega + ca.cross(e, omega), -ca.dot(e, omega)) / 2
    positions = q.numel() - _UNIT[link.kind]
    if not positions:
        return unit_rates
    R, _ = _joint_placement(link, ca.vertsplit(q))
    return ca.vertcat(R[:positions, :positions] @ v[:positions], unit_rates)


def _rotation(axis: Array, cosine: SX, sine: SX) -> SX:
    """The rotation about a unit vector by an angle (Rodrigues)."""
    along = np.outer(axis, axis)
    return sx(np.eye(3) - along) * cosine + sx(along) + ca.skew(sx(axis)) * sine

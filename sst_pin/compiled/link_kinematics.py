# SPDX-License-Identifier: BSD-2-Clause
"""Placements and motions of the links of a tree, on CasADi's symbols.

Every vector of a link is in the axes of its own frame. Accelerations are those of points, so that
no linear velocity is needed: a point at r from a link's origin has the acceleration a + U r with
U = skew(alpha) + skew(omega) skew(omega).
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

#: Number of the last coordinates of a joint that form a unit vector.
_UNIT = {"ball": 4, "free": 4, "planar": 2, "unbounded": 2}
_ZERO = SX(3, 1)


@dataclass(frozen=True)
class LinkMotion:
    """Rates and accelerations of a link, axes of the link."""

    omega: SX = _ZERO
    #: The angular velocity of the motion that is differentiated: `omega`, except for columns of L.
    omega_k: SX = _ZERO
    alpha: SX = _ZERO
    #: Acceleration of the origin.
    a: SX = _ZERO

    @cached_property
    def U(self) -> SX:
        """Acceleration of the points of the link less that of its origin: U r."""
        return ca.skew(self.alpha) + ca.skew(self.omega_k) @ ca.skew(self.omega)


class Placement(NamedTuple):
    """A link in its parent: its orientation R, its origin p, then a small turn in its axes."""

    R: SX
    p: SX
    turn: SX

    def to_link(self, x: SX) -> SX:
        """A vector of the parent in the axes of the link."""
        y = self.R.T @ x
        return y - ca.cross(self.turn, y)

    def to_parent(self, x: SX) -> SX:
        """A vector of the link in the axes of the parent."""
        return self.R @ (x + ca.cross(self.turn, x))


class Point(NamedTuple):
    """A frame as it moves relative to a link, axes of that link."""

    p: SX
    R: SX
    #: [linear; angular] velocity per rate.
    columns: Sparse


class Kinematics:
    """Symbols of a tree; a joint without compiled equations is refused.

    If `displaced`, joints have small displacements along their rates, to first order: derivatives
    by `displacement` at zero are those by q along the rates. `lift` is the acceleration of link 0.
    """

    def __init__(self, model: pin.Model, displaced: bool = False) -> None:
        self.lift = SX(3, 1)
        self.tree = LinkTree.of(model)
        self.q = SX.sym("q", model.nq)
        self.displacement = SX.sym("displacement", model.nv if displaced else 0)
        self._displaced: Sparse = dict(enumerate(ca.vertsplit(self.displacement)))
        # Each pair of an ancestor and a link has its expressions once.
        self.pose = cache(self._pose)
        self._undisplaced_pose = cache(self._pose_as_is)
        self._displacement = cache(self._displacement_of)
        self._axes = cache(self._axes_of)
        #: Relative motions at the last rates v and dv: rows of closures ask for the same ones.
        self._motions_at: tuple[Sparse, Sparse, dict[tuple[int, int], LinkMotion]] = {}, {}, {}

    @cached_property
    def placements(self) -> list[tuple[SX, SX]]:
        """Orientation and origin of each link in its parent."""
        placements = []
        for link in self.tree.links:
            R, d = _joint_placement(link, [self.q[k] for k in link.q])
            before = sx(link.R)
            placements.append((before @ R, sx(link.p) + before @ d))
        return placements

    @cached_property
    def _displaced_placements(self) -> list[Placement]:
        """Placements with the displacements of the joints."""
        placements = []
        for link, (R, p) in zip(self.tree.links, self.placements, strict=True):
            u, turn = _joint_motion(link, self._displaced)
            placements.append(Placement(R, p + R @ u, turn))
        return placements

    @cached_property
    def moved_q(self) -> SX:
        """The coordinates with the displacements of the joints, to first order."""
        return self.q + self.q_rates(self._displaced)

    def difference(self, reference: Mapping[int, SX]) -> Sparse:
        """Smallest displacements of joints from a reference, by index in q, along their rates."""
        q = self.moved_q
        step = Sparse()
        for link in self.tree.links:
            at = [i for i in link.q if i in reference]
            if at and link.kind == "ball":
                turned = _relative(ca.vertcat(*(reference[i] for i in at)), q[at])
                step |= zip(link.v, ca.vertsplit(rotation_vector(turned)), strict=True)
            elif at and link.kind == "unbounded":
                (i, j), (k,) = at, link.v
                c, s = reference[i], reference[j]
                step[k] = angle(c * q[i] + s * q[j], c * q[j] - s * q[i])
            else:
                step |= {link.v[i - link.q.start]: q[i] - reference[i] for i in at}
        return step

    def _pose(self, base: int, link: int) -> tuple[SX, SX]:
        """Orientation and origin of a link, in the axes of one of its ancestors."""
        R, p = self._undisplaced_pose(base, link)
        if not self._displaced:
            return R, p
        u, turn = self._displacement(base, link)
        return R @ (SX.eye(3) + ca.skew(turn)), p + R @ u

    def _displacement_of(self, base: int, link: int) -> tuple[SX, SX]:
        """Displacement and turn of a link relative to one of its ancestors, axes of the link."""
        if link == base:
            return SX(3, 1), SX(3, 1)
        before = self._displacement(base, self.tree.links[link].parent)
        return self._next_twist(link, before, self._displaced)

    def _axes_of(self, base: int, link: int) -> list[tuple[SX, SX]]:
        """Linear and angular part of the twist of each rate of a link, axes of an ancestor."""
        R, _ = self.pose(base, link)
        return [(R @ sx(S[:3]), R @ sx(S[3:])) for S in self.tree.links[link].S.T]

    def _pose_as_is(self, base: int, link: int) -> tuple[SX, SX]:
        """Orientation and origin of a link in an ancestor, without displacements."""
        if link == base:
            return SX.eye(3), SX(3, 1)
        R, p = self._undisplaced_pose(base, self.tree.links[link].parent)
        R_link, p_link = self.placements[link]
        return R @ R_link, p + R @ p_link

    def twist(self, base: int, link: int, v: Sparse) -> tuple[SX, SX]:
        """Velocity of a link's origin and angular velocity, relative to one of its ancestors."""
        if link == base:
            return SX(3, 1), SX(3, 1)
        return self._next_twist(link, self.twist(base, self.tree.links[link].parent, v), v)

    def _next_twist(self, link: int, before: tuple[SX, SX], v: Sparse) -> tuple[SX, SX]:
        """Twist of a link from that of its parent."""
        placement = self._displaced_placements[link]
        joint_u, joint_turn = _joint_motion(self.tree.links[link], v)
        u, turn = before
        u = placement.to_link(u + ca.cross(turn, placement.p)) + joint_u
        return u, placement.to_link(turn) + joint_turn

    def point(self, base: int, frame: pin.Frame) -> Point:
        """A frame of the tree as it moves relative to an ancestor of its link."""
        link = self.tree.link_of[frame.parentJoint]
        R, o = self.pose(base, link)
        p = o + R @ sx(frame.placement.translation)
        columns: Sparse = {}
        path = self.tree.ancestors(link)
        for i in path[path.index(base) + 1 :]:
            lever = p - self.pose(base, i)[1]
            for k, (u, turn) in zip(self.tree.links[i].v, self._axes(base, i), strict=True):
                column = ca.vertcat(u + ca.cross(turn, lever), turn)
                # A mimic joint shares its rate with the joint that it follows.
                columns[k] = columns[k] + column if k in columns else column
        return Point(p, R @ sx(frame.placement.rotation), columns)

    def motions(
        self, v: Sparse, dv: Sparse, gravity: SX | None = None, v_k: Sparse | None = None
    ) -> list[LinkMotion]:
        """Motions of all links; v_k are the rates of the velocity that is differentiated, or v."""
        motions = [LinkMotion() if gravity is None else LinkMotion(a=-gravity)]
        for i, link in enumerate(self.tree.links[1:], start=1):
            motions.append(self._next(i, motions[link.parent], v, v if v_k is None else v_k, dv))
        return motions

    def relative_motion(self, base: int, link: int, v: Sparse, dv: Sparse) -> LinkMotion:
        """LinkMotion of a link relative to one of its ancestors."""
        last_v, last_dv, known = self._motions_at
        if last_v is not v or last_dv is not dv:
            known = {}
            self._motions_at = v, dv, known
        if (base, link) not in known:
            if link == base:
                known[base, link] = LinkMotion() if base else LinkMotion(a=self.lift)
            else:
                before = self.relative_motion(base, self.tree.links[link].parent, v, dv)
                known[base, link] = self._next(link, before, v, v, dv)
        return known[base, link]

    def _next(self, i: int, before: LinkMotion, v: Sparse, v_k: Sparse, dv: Sparse) -> LinkMotion:
        """LinkMotion of link i from that of its parent."""
        link = self.tree.links[i]
        placement = self._displaced_placements[i]
        to_link = placement.to_link
        u, turn = _joint_motion(link, v)
        du, dturn = _joint_motion(link, dv)
        omega = to_link(before.omega) + turn
        if v_k is v:
            u_k = u
            turn_k = turn
            omega_k = omega
        else:
            u_k, turn_k = _joint_motion(link, v_k)
            omega_k = to_link(before.omega_k) + turn_k
        alpha = to_link(before.alpha) + ca.cross(omega, turn_k) + dturn
        a = to_link(before.a + before.U @ placement.p) + du
        if link.S[:3].any():  # the joint slides: Coriolis acceleration
            a += ca.cross(to_link(before.omega_k), u) + ca.cross(omega, u_k)
        return LinkMotion(omega, omega_k, alpha, a)

    def carried(self, wrenches: Sequence[SX]) -> list[SX]:
        """Wrench of each joint on all that it carries, from what each link needs; ground first.

        Wrenches are [force; moment] about the origin of a link, in its axes.
        """
        carried = list(wrenches)
        for i in range(len(self.tree.links) - 1, 0, -1):
            parent = self.tree.links[i].parent
            placement = self._displaced_placements[i]
            F, N = map(placement.to_parent, ca.vertsplit(carried[i], 3))
            lever = ca.vertcat(SX(3, 1), ca.cross(placement.p, F))
            carried[parent] = carried[parent] + ca.vertcat(F, N) + lever
        return carried

    def transmitted(self, wrenches: Sequence[SX]) -> Sparse:
        """Forces along the rates, from what each link needs."""
        tau: Sparse = {}
        pairs = zip(self.tree.links, self.carried(wrenches), strict=True)
        for link, wrench in reversed(list(pairs)):
            tau = add(tau, sparse(link.v, sx(link.S).T @ wrench))
        return tau

    def q_rates(self, v: Sparse) -> SX:
        """Rates of the entries of q, those of quaternions and cosine-sine pairs among them."""
        q = self.q
        rates = SX(q.numel(), 1)
        for link in self.tree.links[1:]:
            first = link.q.start
            last = link.q.stop
            link_rates = column(v, link.v)
            if link.kind not in _UNIT:
                rates[first:last] = link_rates
            elif link.kind in ("unbounded", "planar"):
                c, s = q[last - 2], q[last - 1]
                rates[last - 2 : last] = ca.vertcat(-s, c) * link_rates[-1]
            else:
                vector = q[last - 4 : last - 1]
                w = q[last - 1]
                omega = link_rates[-3:]
                turned = w * omega + ca.cross(vector, omega)
                rates[last - 4 : last] = ca.vertcat(turned, -ca.dot(vector, omega)) / 2
            if link.kind in ("planar", "free"):
                R, _ = _joint_placement(link, [q[i] for i in link.q])
                size = len(link.q) - _UNIT[link.kind]
                rates[first : first + size] = R[:size, :size] @ link_rates[:size]
        return rates

    @property
    def unit_gaps(self) -> list[SX]:
        """Squares of the unit vectors among the coordinates, less one."""
        return [ca.sumsqr(self.q[part]) - 1 for part in self._units]

    def normalized(self, q: SX) -> SX:
        """q with its unit vectors nearer to length one, by a step of Newton's method."""
        q = SX(q)
        for part in self._units:
            q[part] *= (3 - ca.sumsqr(q[part])) / 2
        return q

    @property
    def _units(self) -> list[slice]:
        return [
            slice(link.q.stop - _UNIT[link.kind], link.q.stop)
            for link in self.tree.links
            if link.kind in _UNIT
        ]


def _relative(a: SX, b: SX) -> SX:
    """The turn from one quaternion (x, y, z, w) to another, axes of either."""
    vector = a[3] * b[:3] - b[3] * a[:3] - ca.cross(a[:3], b[:3])
    return ca.vertcat(vector, ca.dot(a, b))


def _joint_motion(link: Link, x: Sparse) -> list[SX]:
    """Linear and angular part of a link's own rates, axes of the link."""
    return ca.vertsplit(sx(link.S) @ column(x, link.v), 3)


def _joint_placement(link: Link, q: list[SX]) -> tuple[SX, SX]:
    """Orientation and displacement of a joint."""
    kind = link.kind
    S = link.S
    R = SX.eye(3)
    d = SX(3, 1)
    if kind in ("slide", "screw"):
        d = sx(S[:3, 0]) * q[0]
    elif kind in ("slides", "free"):
        d = ca.vertcat(*q[:3])
    elif kind == "planar":
        d = ca.vertcat(*q[:2], 0)
    if kind in ("turn", "screw"):
        (factor,) = clean(np.linalg.norm(S[3:], axis=0)).tolist()
        R = _turn(S[3:, 0] / factor, ca.cos(factor * q[0]), ca.sin(factor * q[0]))
    elif kind in ("unbounded", "planar"):
        R = _turn(S[3:, -1], q[-2], q[-1])
    elif kind in ("ball", "free"):
        vector = ca.vertcat(*q[-4:-1])
        w = q[-1]
        W = ca.skew(vector)
        R = SX.eye(3) + 2 * (w * W + W @ W)
    return R, d


def _turn(axis: Array, cosine: SX, sine: SX) -> SX:
    along = np.outer(axis, axis)
    return sx(np.eye(3) - along) * cosine + sx(along) + ca.skew(sx(axis)) * sine

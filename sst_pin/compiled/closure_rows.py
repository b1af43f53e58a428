# SPDX-License-Identifier: BSD-2-Clause
"""Rows of each kind of constraint: Phi v = 0, residuals, accelerations."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import casadi as ca
import pinocchio as pin
from casadi import SX
from numpy.polynomial.polynomial import polyder

from ..model.closures import Brake, Constraint, Coupling, Distance, Rolling
from ..model.joint_space import JointSpace
from ..model.tree import frame_named, joint_id
from .link_kinematics import Kinematics
from .symbols import Sparse, add, is_zero, sx

#: Linear and angular velocity of a link relative to an ancestor, by their indices, link's axes.
Twists = Callable[[int, int], tuple[SX, SX]]


class End(NamedTuple):
    """One of the two frames that a row connects; vectors in the axes of a link, the base."""

    base: int
    link: int
    #: The origin of the frame.
    point: SX
    #: What the velocity of the origin and the angular velocity of the frame add to Phi v.
    rate: Callable[[SX, SX], SX]


class FrameMotion(NamedTuple):
    """Motion of a frame relative to the base of its row, in the axes of the base."""

    omega: SX
    #: Angular acceleration, and acceleration of the origin.
    alpha: SX
    a: SX


@dataclass(frozen=True)
class Row:
    """One equation of a constraint."""

    #: Coefficients of the rates, by index.
    Phi: Sparse
    #: Phi v, from the rates v and the twists that they give to links.
    velocity: Callable[[Sparse, Twists], SX]
    #: Phi v_dot + Phi_dot v, from v and v_dot.
    acceleration: Callable[[Sparse, Sparse], SX]
    #: Zero when the loop is closed; None for a row that constrains rates only.
    residual: SX | None
    #: The term of the row in the squared residual. Rows that share one have it in the first of
    #: them, and zero in the others.
    squared_gap: SX
    #: The frames by whose velocities Phi v is known; empty if it is known by the rates only.
    ends: tuple[End, ...] = ()


def closure_rows(kinematics: Kinematics, model: pin.Model, closure: Constraint) -> Iterable[Row]:
    """The rows of one constraint."""
    if isinstance(closure, Coupling):
        return [_coupling(kinematics, model, closure)]
    if isinstance(closure, Rolling):
        return _Pair(kinematics, model, closure.plane, closure.wheel).rolling(closure)
    if isinstance(closure, Brake):
        if closure.frames is None:
            return [_brake(model, closure)]
        return [_Pair(kinematics, model, *closure.frames).held_length()]
    pair = _Pair(kinematics, model, closure.frame_a, closure.frame_b)
    if isinstance(closure, Distance):
        return [pair.distance(closure.distance)]
    return pair.rows_along(closure.held)


def by_twists(rows: Sequence[Row], v: Sparse) -> tuple[list[SX], dict[int, SX]]:
    """Phi v row by row, and symbols for the twists of links: gradients by them are wrenches.

    A row does not change if all links move as one body. So twists relative to the world serve as
    well as those relative to the base of a row, and the base gets its wrench in the same way.
    """
    twists: dict[int, SX] = {}

    def twist(_: int, link: int) -> tuple[SX, SX]:
        twist = twists.setdefault(link, SX.sym("twist", 6))
        return twist[:3], twist[3:]

    return [SX(row.velocity(v, twist)) for row in rows], twists


def line(kinematics: Kinematics, model: pin.Model, a: str, b: str) -> tuple[SX, Row]:
    """Length of the line between the origins of two frames, and its row.

    The row has the rate of the length, and its second derivative as `acceleration`.
    """
    pair = _Pair(kinematics, model, a, b)
    return pair.length, pair.held_length()


class _Pair:
    """Rows between two frames; vectors in the axes of the last link that both hang on, the base.

    `kinematics.pose(i, j)` are R and p of link j in link i: R takes vectors from the axes of j to
    those of i.
    """

    def __init__(self, kinematics: Kinematics, model: pin.Model, a: str, b: str) -> None:
        self._kinematics = kinematics
        tree = kinematics.tree
        self._frames = [frame_named(model, name) for name in (a, b)]
        self._links = [tree.link_of[frame.parentJoint] for frame in self._frames]
        paths = [tree.ancestors(link) for link in self._links]
        self._base = [i for i, j in zip(*paths, strict=False) if i == j][-1]
        self.a, self.b = (kinematics.point(self._base, frame) for frame in self._frames)
        self.d = self.b.p - self.a.p

    def _motions(self, v: Sparse, dv: Sparse) -> tuple[FrameMotion, FrameMotion]:
        """Motion of A and of B."""
        motions = []
        for link, frame in zip(self._links, self._frames, strict=True):
            R, _ = self._kinematics.pose(self._base, link)
            x = self._kinematics.relative_motion(self._base, link, v, dv)
            a = R @ (x.a + x.U @ sx(frame.placement.translation))
            motions.append(FrameMotion(R @ x.omega, R @ x.alpha, a))
        return motions[0], motions[1]

    def _velocity(self, v: Sparse) -> SX:
        """Velocity of the origin of B less that of A."""
        velocity = SX(3, 1)
        for sign, point in ((-1, self.a), (1, self.b)):
            for k, twist in point.columns.items():
                if k in v:
                    velocity += sign * twist[:3] * v[k]
        return velocity

    def _row(
        self, of_a: Callable[[SX, SX], SX], of_b: Callable[[SX, SX], SX] | None = None
    ) -> tuple[Sparse, Callable[[Sparse, Twists], SX], tuple[End, ...]]:
        """Coefficients, velocity and ends of a row, from functions of the velocities of A and B."""
        of_b = of_b or of_a
        row = {k: of_b(twist[:3], twist[3:]) for k, twist in self.b.columns.items()}
        row = add(row, {k: -of_a(x[:3], x[3:]) for k, x in self.a.columns.items()})

        def velocity(v: Sparse, twists: Twists) -> SX:
            value = SX(0)
            ends = zip((-1, 1), (of_a, of_b), self._links, self._frames, strict=True)
            for sign, of, link, frame in ends:
                R, _ = self._kinematics.pose(self._base, link)
                u, turn = twists(self._base, link)
                at_frame = u + ca.cross(turn, sx(frame.placement.translation))
                value += sign * of(R @ at_frame, R @ turn)
            return value

        a = End(self._base, self._links[0], self.a.p, lambda u, turn: -of_a(u, turn))
        b = End(self._base, self._links[1], self.b.p, of_b)
        return {k: entry for k, entry in row.items() if not entry.is_zero()}, velocity, (a, b)

    def rows_along(self, directions: tuple[bool, ...]) -> Iterator[Row]:
        """Rows for the held motions of B, in the axes of A.

        If all translations, or all rotations, are held, any axes do: the rows have those in which
        their expressions are short.
        """
        if all(directions[:3]):
            yield from map(self._coincide, range(3))
        else:
            yield from (self._slide(k) for k in range(3) if directions[k])
        turns = [k for k in range(3) if directions[3 + k]]
        if len(turns) == 3:
            yield from self._turned_alike()
        elif len(turns) == 2:
            (k,) = set(range(3)) - set(turns)
            i, j = (k + 1) % 3, (k + 2) % 3
            apart = ca.sumsqr(self.a.R[:, k] - self.b.R[:, k])  # the squared angle of the axes
            # For each turn an axis of A, an axis of B and a sign, as in `loops.rows._RightAngles`:
            # each row is the turn of B about the positive axis of A.
            of_turn = {i: (j, k, -1.0), j: (i, k, 1.0)}
            for t in turns:
                yield self._angle(*of_turn[t], apart if t == turns[0] else SX(0))
        elif turns:
            i, j = (turns[0] + 1) % 3, (turns[0] + 2) % 3
            yield self._angle(i, j, -1.0, ca.dot(self.a.R[:, i], self.b.R[:, j]) ** 2)

    def _coincide(self, k: int) -> Row:
        """The origins have the same coordinate k."""
        Phi, velocity, ends = self._row(lambda u, _: u[k])

        def acceleration(v: Sparse, dv: Sparse) -> SX:
            a, b = self._motions(v, dv)
            return b.a[k] - a.a[k]

        return Row(Phi, velocity, acceleration, self.d[k], self.d[k] ** 2, ends)

    def _slide(self, k: int) -> Row:
        """Axis k of A stays at a right angle to the line from A to B."""
        n = self.a.R[:, k]
        d = self.d
        Phi, velocity, ends = self._row(
            lambda u, turn: ca.dot(n, u + ca.cross(turn, d)), lambda u, _: ca.dot(n, u)
        )

        def acceleration(v: Sparse, dv: Sparse) -> SX:
            a, b = self._motions(v, dv)
            apart = ca.cross(a.omega, ca.cross(a.omega, d)) - ca.cross(a.alpha, d)
            return ca.dot(n, b.a - a.a + apart - 2 * ca.cross(a.omega, self._velocity(v)))

        return Row(Phi, velocity, acceleration, ca.dot(n, d), ca.dot(n, d) ** 2, ends)

    def _turned_alike(self) -> Iterator[Row]:
        """B does not turn relative to A."""
        # Link C carries the last joint of B's branch. In its axes, the axes of the last two joints
        # are constant, so that Phi has few terms. R_a are the axes of A's link in C if the loop is
        # closed, where both frames have the same axes: through B, not through A's own branch. Phi
        # and the acceleration use R_a; the residual and the gap measure how wrong it is.
        kinematics = self._kinematics
        links = self._kinematics.tree.links
        (link_a, link_b), (frame_a, frame_b) = self._links, self._frames
        C = link_b
        if link_b != self._base and links[link_b].kind == "turn":
            C = links[link_b].parent
        R_b, _ = kinematics.pose(C, link_b)
        R_a = R_b @ sx(frame_b.placement.rotation @ frame_a.placement.rotation.T)
        turns = self._turns(C, R_a)
        C_through_A = kinematics.pose(self._base, link_a)[0] @ R_a.T
        C_through_B, _ = kinematics.pose(self._base, C)
        difference = C_through_B - C_through_A
        # Two columns of a rotation determine the third.
        gap = ca.sumsqr(difference[:, 0]) + ca.sumsqr(difference[:, 2])
        R = C_through_A.T @ C_through_B

        def velocity(v: Sparse, twists: Twists, row: int) -> SX:
            (_, turn_a), (_, turn_b) = (twists(self._base, link) for link in self._links)
            return (R_b @ turn_b - R_a @ turn_a)[row]

        def acceleration(v: Sparse, dv: Sparse, row: int) -> SX:
            # The angular velocity of B relative to A is zero, so that the turning of the axes of C,
            # in which it is written, does not count.
            of_a = kinematics.relative_motion(self._base, link_a, v, dv)
            of_b = kinematics.relative_motion(self._base, C, v, dv)
            alpha = of_b.alpha - R_a @ of_a.alpha
            if link_b != C:
                (k,) = links[link_b].v
                turn = R_b @ sx(links[link_b].S[3:, 0])
                alpha += turn * dv.get(k, 0) + ca.cross(of_b.omega, turn * v.get(k, 0))
            return alpha[row]

        for row in range(3):
            i, j = (row + 1) % 3, (row + 2) % 3
            residual = (R[j, i] - R[i, j]) / 2
            Phi = {k: turn[row] for k, turn in turns.items() if not is_zero(turn[row])}
            changes = partial(velocity, row=row), partial(acceleration, row=row)
            yield Row(Phi, *changes, residual, gap if row == 0 else SX(0))

    def _turns(self, C: int, R_a: SX) -> Sparse:
        """Angular velocity of B relative to A by each rate, axes of C; R_a is A's link in C."""
        kinematics, turns, (link_a, link_b) = self._kinematics, Sparse(), self._links
        for link in (link_a, link_b):
            path = kinematics.tree.ancestors(link)
            for i in path[path.index(self._base) + 1 :]:
                if link == link_a:
                    R = -R_a @ kinematics.pose(i, link_a)[0].T
                elif i in kinematics.tree.ancestors(C):
                    R = kinematics.pose(i, C)[0].T
                else:
                    R, _ = kinematics.pose(C, i)
                x = kinematics.tree.links[i]
                columns = zip(x.v, x.S.T, strict=True)
                turns = add(turns, {k: R @ sx(S[3:]) for k, S in columns})
        return turns

    def _angle(self, i: int, j: int, sign: float, gap: SX) -> Row:
        """Axis i of A stays at a right angle to axis j of B."""
        n = self.a.R[:, i]
        m = self.b.R[:, j]
        across = sign * ca.cross(m, n)
        Phi, velocity, ends = self._row(lambda _, turn: ca.dot(across, turn))

        def acceleration(v: Sparse, dv: Sparse) -> SX:
            a, b = self._motions(v, dv)
            n_dot, m_dot = ca.cross(a.omega, n), ca.cross(b.omega, m)
            n_ddot = ca.cross(a.alpha, n) + ca.cross(a.omega, n_dot)
            m_ddot = ca.cross(b.alpha, m) + ca.cross(b.omega, m_dot)
            return sign * (ca.dot(n, m_ddot) + ca.dot(m, n_ddot) + 2 * ca.dot(n_dot, m_dot))

        return Row(Phi, velocity, acceleration, sign * ca.dot(n, m), gap, ends)

    def distance(self, length: float) -> Row:
        """The origins stay at a distance: (d.d - l^2) / 2 l.

        It needs no root. It equals |d| - l to first order, and Phi is the same in a closed loop.
        """
        unit = self.d / length
        Phi, velocity, ends = self._row(lambda u, _: ca.dot(unit, u))

        def acceleration(v: Sparse, dv: Sparse) -> SX:
            a, b = self._motions(v, dv)
            return ca.dot(unit, b.a - a.a) + ca.sumsqr(self._velocity(v)) / length

        residual = (ca.dot(unit, self.d) - length) / 2
        return Row(Phi, velocity, acceleration, residual, residual**2, ends)

    @property
    def length(self) -> SX:
        """The distance of the origins."""
        return ca.sqrt(ca.sumsqr(self.d))

    def held_length(self) -> Row:
        """The distance of the origins keeps the value that it has."""
        length = self.length
        unit = self.d / length
        Phi, velocity, ends = self._row(lambda u, _: ca.dot(unit, u))

        def acceleration(v: Sparse, dv: Sparse) -> SX:
            a, b = self._motions(v, dv)
            u = self._velocity(v)
            along = ca.dot(unit, u)
            return ca.dot(unit, b.a - a.a) + (ca.sumsqr(u) - along**2) / length

        return Row(Phi, velocity, acceleration, None, SX(0), ends)

    def rolling(self, closure: Rolling) -> Iterator[Row]:
        """B touches the x-y plane of A and does not slip; A's axes give the rows."""
        normal = self.a.R[:, 2]
        axle = self.b.R[:, 2]
        radius = closure.radius
        across = normal if closure.ball else normal - ca.dot(normal, axle) * axle
        size = ca.sqrt(ca.sumsqr(across))
        up = normal if closure.ball else across / size
        contact = self.d - radius * up  # from the origin of A

        def slip_rate(v: Sparse, dv: Sparse) -> SX:
            # The slip velocity is zero, so that its rate alone counts, whatever the axes do.
            a, b = self._motions(v, dv)
            up_dot = normal_dot = ca.cross(a.omega, normal)
            if not closure.ball:
                axle_dot = ca.cross(b.omega, axle)
                along = ca.dot(normal_dot, axle) + ca.dot(normal, axle_dot)
                g = normal_dot - along * axle - ca.dot(normal, axle) * axle_dot
                up_dot = (g - up * ca.dot(up, g)) / size
            at_b = b.a - ca.cross(b.alpha, radius * up) - ca.cross(b.omega, radius * up_dot)
            at_a = a.a + ca.cross(a.alpha, contact)
            return at_b - at_a - ca.cross(a.omega, self._velocity(v) - radius * up_dot)

        for k in range(3):
            n = self.a.R[:, k]

            def of_a(u: SX, turn: SX, n: SX = n) -> SX:
                return ca.dot(n, u + ca.cross(turn, contact))

            def of_b(u: SX, turn: SX, n: SX = n) -> SX:
                return ca.dot(n, u - ca.cross(turn, radius * up))

            def acceleration(v: Sparse, dv: Sparse, n: SX = n) -> SX:
                return ca.dot(n, slip_rate(v, dv))

            height = ca.dot(n, contact) if k == 2 else None
            gap = SX(0) if height is None else height**2
            Phi, velocity, ends = self._row(of_a, of_b)
            yield Row(Phi, velocity, acceleration, height, gap, ends)


def _brake(model: pin.Model, closure: Brake) -> Row:
    """A rate that is held."""
    (rate,) = JointSpace(model).rates_of([closure.name]).tolist()

    def velocity(v: Sparse, twists: Twists) -> SX:
        return SX(v.get(rate, 0))

    def acceleration(v: Sparse, dv: Sparse) -> SX:
        return SX(dv.get(rate, 0))

    return Row({rate: SX(1)}, velocity, acceleration, None, SX(0))


def _coupling(kinematics: Kinematics, model: pin.Model, closure: Coupling) -> Row:
    """A joint that follows polynomials of others."""
    terms: dict[str, tuple[float, ...]] = {closure.joint: (0.0, 1.0)}
    terms |= {name: tuple(-c for c in p) for name, p in closure.polynomials.items()}
    residual = SX(-closure.offset)
    Phi: Sparse = {}
    second: Sparse = {}
    for name, coefficients in terms.items():
        joint = model.joints[joint_id(model, name)]
        q = kinematics.moved_q[joint.idx_q]
        powers = [polyder(coefficients, k) for k in range(3)]
        value, slope, curvature = (SX(ca.polyval(ca.DM(p[::-1]), q)) for p in powers)
        residual += value
        if not slope.is_zero():
            Phi[joint.idx_v], second[joint.idx_v] = slope, curvature

    def velocity(v: Sparse, twists: Twists) -> SX:
        return sum((c * v[k] for k, c in Phi.items() if k in v), SX(0))

    def acceleration(v: Sparse, dv: Sparse) -> SX:
        linear = (c * dv[k] for k, c in Phi.items() if k in dv)
        return sum(linear, sum((c * v[k] ** 2 for k, c in second.items() if k in v), SX(0)))

    return Row(Phi, velocity, acceleration, residual, residual**2)

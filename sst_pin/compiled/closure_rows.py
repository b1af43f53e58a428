# SPDX-License-Identifier: BSD-2-Clause
"""The rows of closures on CasADi's symbols: Phi, Phi v, Phi v_dot + Phi_dot v, and the residual.

`loops` has the same rows in numbers. `closure_rows` makes the rows of a closure. Those between two
frames A and B are made by `_FramePair`, `_EqualOrientation` and `_Rolling`, those of joints by
`_brake` and `_coupling`.

Rows between two frames depend only on how A and B move relative to the *base*: the last link that
carries both frames. All vectors of such a row are in the axes of the base, unless another link is
named:

- R and p are the axes (in columns) and the origin of a frame, and d = p_B - p_A;
- u is the velocity of the origin of a frame, omega its angular velocity, a and alpha are the rates
  of u and omega, all relative to the base.

A row is a linear function of these velocities, Phi v = g_B(u_B, omega_B) - g_A(u_A, omega_A).
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
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

#: A function (base, link), by indices of links: the linear and the angular velocity of the link
#: relative to the base, in the axes of the link.
Twists = Callable[[int, int], tuple[SX, SX]]
#: A linear function g(u, omega) of the velocities of a frame.
VelocityFunction = Callable[[SX, SX], SX]
#: Phi v_dot + Phi_dot v as a function of v and v_dot.
Acceleration = Callable[[Sparse, Sparse], SX]


class End(NamedTuple):
    """One of the two frames of a row; vectors are in the axes of the base."""

    #: Index of the base.
    base: int
    #: Index of the link of the frame.
    link: int
    #: The origin of the frame, from the origin of the base.
    point: SX
    #: The term of the frame in Phi v: g_B for frame B, -g_A for frame A.
    rate: VelocityFunction


@dataclass(frozen=True)
class Row:
    """One equation of a closure: one row of Phi."""

    #: The entries of the row of Phi, by rate.
    Phi: Sparse
    #: Phi v, as a function of v and the twists of links at v. A row between two frames uses only
    #: the twists, so that the gradient by the twist of a link is the wrench on this link. A row of
    #: a joint uses only v.
    velocity: Callable[[Sparse, Twists], SX]
    acceleration: Acceleration
    #: Zero when the loop is closed; None for a row that constrains rates only.
    residual: SX | None
    #: The term of the row in a sum of squares that is zero only when the loops are closed. A
    #: residual can also be zero in an open loop, for instance if two axes are opposite instead of
    #: equal; this term is not. Rows may share one term: the first of them has it, the others have
    #: zero.
    squared_gap: SX
    #: Frames A and B of a row that `_FramePair` makes, by which `shared_links` couples loops.
    #: Empty for other rows.
    ends: tuple[End, ...] = ()


def closure_rows(kinematics: Kinematics, model: pin.Model, closure: Constraint) -> Iterable[Row]:
    """The rows of one closure, in the order of `closure.rows`."""
    if isinstance(closure, Coupling):
        return [_coupling(kinematics, model, closure)]
    if isinstance(closure, Rolling):
        return _Rolling(_FramePair(kinematics, model, closure.plane, closure.wheel), closure).rows()
    if isinstance(closure, Brake):
        if closure.frames is None:
            return [_brake(model, closure)]
        return [_FramePair(kinematics, model, *closure.frames).held_length()]
    pair = _FramePair(kinematics, model, closure.frame_a, closure.frame_b)
    if isinstance(closure, Distance):
        return [pair.distance(closure.distance)]
    return pair.held_motions(closure.held)


def length_and_row(kinematics: Kinematics, model: pin.Model, a: str, b: str) -> tuple[SX, Row]:
    """Length |d| of the line between the origins of the frames a and b, and a row for the length.

    Phi v of the row is the rate of the length. The acceleration of the row is the second derivative
    of the length.
    """
    pair = _FramePair(kinematics, model, a, b)
    return pair.length, pair.held_length()


def velocities_by_twists(rows: Sequence[Row], v: Sparse) -> tuple[list[SX], dict[int, SX]]:
    """Phi v of each row on symbols for the twists of links, and these symbols by link.

    The gradient of Phi v by the twist of a link is the wrench of the row on this link.

    The symbols are twists relative to the world, not to the base of each row. Phi v is the same,
    because it does not change if all links move as one body. In this way the base gets its wrench
    too.
    """
    twists: dict[int, SX] = {}

    def twist(_: int, link: int) -> tuple[SX, SX]:
        symbols = twists.setdefault(link, SX.sym("twist", 6))
        return symbols[:3], symbols[3:]

    return [SX(row.velocity(v, twist)) for row in rows], twists


# --- rows between two frames ----------------------------------------------------------------------


class _FrameMotion(NamedTuple):
    """Motion of a frame relative to the base, in the axes of the base."""

    #: Angular velocity.
    omega: SX
    #: Angular acceleration.
    alpha: SX
    #: Acceleration of the origin.
    acceleration: SX


@dataclass(frozen=True)
class _RightAngle:
    """An axis n of A that stays at a right angle to an axis m of B.

    The residual is sign n . m. Its rate is Phi v = sign (m x n) . (omega_B - omega_A). In a closed
    loop m x n is the third axis or its opposite. The sign is such that Phi v is the rate about the
    third axis itself.
    """

    #: Number of the axis n: 0, 1 or 2.
    axis_of_a: int
    #: Number of the axis m.
    axis_of_b: int
    sign: float


class _FramePair:
    """Two frames A and B, and the rows that constrain their relative motion.

    Attributes:
        base: Index of the last link that carries both frames.
        a, b: Frames A and B as they move relative to the base: p, R, and the columns of their
            Jacobian, which are the twist [u; omega] at a unit of each rate.
        d: Vector from the origin of A to that of B.
    """

    def __init__(self, kinematics: Kinematics, model: pin.Model, a: str, b: str) -> None:
        self.kinematics = kinematics
        tree = kinematics.tree
        self.frame_a = frame_named(model, a)
        self.frame_b = frame_named(model, b)
        self.link_a = tree.link_of[self.frame_a.parentJoint]
        self.link_b = tree.link_of[self.frame_b.parentJoint]
        # The base is the last link that the paths from the world to both links share.
        paths = zip(tree.ancestors(self.link_a), tree.ancestors(self.link_b), strict=False)
        self.base = [i for i, j in paths if i == j][-1]
        self.a = kinematics.moving_frame(self.base, self.frame_a)
        self.b = kinematics.moving_frame(self.base, self.frame_b)
        self.d = self.b.p - self.a.p

    @property
    def length(self) -> SX:
        """|d|."""
        return ca.sqrt(ca.sumsqr(self.d))

    def motions(self, v: Sparse, dv: Sparse) -> tuple[_FrameMotion, _FrameMotion]:
        """Motion of A and of B at the rates v and accelerations dv of the tree."""

        def motion(link: int, frame: pin.Frame) -> _FrameMotion:
            R, _ = self.kinematics.pose(self.base, link)
            of_link = self.kinematics.relative_motion(self.base, link, v, dv)
            # A point at r from the origin of the link has the acceleration a + U r.
            a = of_link.a + of_link.U @ sx(frame.placement.translation)
            return _FrameMotion(
                omega=R @ of_link.omega, alpha=R @ of_link.alpha, acceleration=R @ a
            )

        return motion(self.link_a, self.frame_a), motion(self.link_b, self.frame_b)

    def d_dot(self, v: Sparse) -> SX:
        """The rate of d: u_B - u_A."""
        d_dot = SX(3, 1)
        for k, twist in self.a.columns.items():
            if k in v:
                d_dot -= twist[:3] * v[k]
        for k, twist in self.b.columns.items():
            if k in v:
                d_dot += twist[:3] * v[k]
        return d_dot

    def row(
        self,
        *,
        g_a: VelocityFunction,
        g_b: VelocityFunction,
        acceleration: Acceleration,
        residual: SX | None,
        squared_gap: SX,
    ) -> Row:
        """The row with Phi v = g_B(u_B, omega_B) - g_A(u_A, omega_A).

        The other arguments are those of `Row`.
        """
        # Entry k of Phi is Phi v for a unit of the rate k.
        of_b = {k: g_b(twist[:3], twist[3:]) for k, twist in self.b.columns.items()}
        of_a = {k: -g_a(twist[:3], twist[3:]) for k, twist in self.a.columns.items()}
        Phi = {k: entry for k, entry in add(of_b, of_a).items() if not entry.is_zero()}

        def g_of_frame(g: VelocityFunction, link: int, frame: pin.Frame, twists: Twists) -> SX:
            """g(u, omega) of a frame from the twist of its link."""
            R, _ = self.kinematics.pose(self.base, link)
            u_link, omega = twists(self.base, link)
            u = u_link + ca.cross(omega, sx(frame.placement.translation))
            return g(R @ u, R @ omega)

        def velocity(v: Sparse, twists: Twists) -> SX:
            of_frame_a = g_of_frame(g_a, self.link_a, self.frame_a, twists)
            of_frame_b = g_of_frame(g_b, self.link_b, self.frame_b, twists)
            return of_frame_b - of_frame_a

        end_a = End(self.base, self.link_a, self.a.p, lambda u, omega: -g_a(u, omega))
        end_b = End(self.base, self.link_b, self.b.p, g_b)
        return Row(
            Phi=Phi,
            velocity=velocity,
            acceleration=acceleration,
            residual=residual,
            squared_gap=squared_gap,
            ends=(end_a, end_b),
        )

    # --- closures by joints -----------------------------------------------------------------------

    def held_motions(self, held: tuple[bool, ...]) -> Iterator[Row]:
        """Rows for the motions of B along and about x, y, z of A that are held.

        If all three translations are held, their rows may be along any three axes, and likewise the
        rows of three rotations about any three axes. Then the axes are chosen that give short
        expressions.
        """
        if all(held[:3]):
            for axis in range(3):
                yield self._equal_position(axis)
        else:
            for axis in range(3):
                if held[axis]:
                    yield self._no_slide(axis)

        held_turns = [axis for axis in range(3) if held[3 + axis]]
        if len(held_turns) == 3:
            yield from _EqualOrientation(self).rows()
        elif len(held_turns) == 2:
            yield from self._parallel_axes(held_turns)
        elif len(held_turns) == 1:
            # B does not turn about x if y of A stays at a right angle to z of B, and so on. The
            # sign is -1, because m x n = z x y = -x.
            axis_of_a = (held_turns[0] + 1) % 3
            axis_of_b = (held_turns[0] + 2) % 3
            squared_gap = ca.dot(self.a.R[:, axis_of_a], self.b.R[:, axis_of_b]) ** 2
            yield self._right_angle(_RightAngle(axis_of_a, axis_of_b, sign=-1.0), squared_gap)

    def _equal_position(self, k: int) -> Row:
        """The origins have the same coordinate k in the base: d_k = 0, Phi v = u_B,k - u_A,k."""

        def acceleration(v: Sparse, dv: Sparse) -> SX:
            of_a, of_b = self.motions(v, dv)
            return of_b.acceleration[k] - of_a.acceleration[k]

        return self.row(
            g_a=lambda u, _: u[k],
            g_b=lambda u, _: u[k],
            acceleration=acceleration,
            residual=self.d[k],
            squared_gap=self.d[k] ** 2,
        )

    def _no_slide(self, k: int) -> Row:
        """Axis k of A, n, stays at a right angle to d: n . d = 0.

        The axis turns with A, n_dot = omega_A x n. So for any vector r the rate of n . r is
        n . (r_dot - omega_A x r). This gives Phi v = n . (d_dot - omega_A x d), and its rate

            n . (d_ddot - alpha_A x d + omega_A x (omega_A x d) - 2 omega_A x d_dot).
        """
        n = self.a.R[:, k]
        d = self.d

        def acceleration(v: Sparse, dv: Sparse) -> SX:
            of_a, of_b = self.motions(v, dv)
            d_ddot = of_b.acceleration - of_a.acceleration
            omega = of_a.omega
            of_turn = ca.cross(omega, ca.cross(omega, d)) - ca.cross(of_a.alpha, d)
            return ca.dot(n, d_ddot + of_turn - 2 * ca.cross(omega, self.d_dot(v)))

        return self.row(
            g_a=lambda u, omega: ca.dot(n, u + ca.cross(omega, d)),
            g_b=lambda u, _: ca.dot(n, u),
            acceleration=acceleration,
            residual=ca.dot(n, d),
            squared_gap=ca.dot(n, d) ** 2,
        )

    def _parallel_axes(self, held_turns: Sequence[int]) -> Iterator[Row]:
        """Two rows: B may turn about its axis k only, which stays parallel to axis k of A."""
        (k,) = set(range(3)) - set(held_turns)
        i = (k + 1) % 3
        j = (k + 2) % 3
        # Axis k of B stays at a right angle to the axes i and j of A. The right angle to axis j
        # holds the turn about i, and the other way round.
        right_angles = {i: _RightAngle(j, k, sign=-1.0), j: _RightAngle(i, k, sign=1.0)}
        # Both residuals are zero also if the axes k are opposite. So the gap of both rows is the
        # difference of the axes k. For a small angle its square is the squared angle.
        squared_gap = ca.sumsqr(self.a.R[:, k] - self.b.R[:, k])
        first, second = held_turns
        yield self._right_angle(right_angles[first], squared_gap)
        yield self._right_angle(right_angles[second], SX(0))

    def _right_angle(self, axes: _RightAngle, squared_gap: SX) -> Row:
        """sign n . m = 0; see `_RightAngle`.

        The acceleration is the second derivative of the residual,
        sign (n . m_ddot + m . n_ddot + 2 n_dot . m_dot).
        """
        n = self.a.R[:, axes.axis_of_a]
        m = self.b.R[:, axes.axis_of_b]
        across = axes.sign * ca.cross(m, n)

        def acceleration(v: Sparse, dv: Sparse) -> SX:
            of_a, of_b = self.motions(v, dv)
            n_dot = ca.cross(of_a.omega, n)
            m_dot = ca.cross(of_b.omega, m)
            n_ddot = ca.cross(of_a.alpha, n) + ca.cross(of_a.omega, n_dot)
            m_ddot = ca.cross(of_b.alpha, m) + ca.cross(of_b.omega, m_dot)
            second = ca.dot(n, m_ddot) + ca.dot(m, n_ddot) + 2 * ca.dot(n_dot, m_dot)
            return axes.sign * second

        return self.row(
            g_a=lambda _, omega: ca.dot(across, omega),
            g_b=lambda _, omega: ca.dot(across, omega),
            acceleration=acceleration,
            residual=axes.sign * ca.dot(n, m),
            squared_gap=squared_gap,
        )

    # --- rods and brakes of lines -----------------------------------------------------------------

    def distance(self, length: float) -> Row:
        """The origins stay at a distance l: (d . d - l^2) / (2 l) = 0.

        This residual needs no root. It equals |d| - l to first order, and Phi is the same in a
        closed loop: Phi v = d . d_dot / l.
        """
        unit = self.d / length

        def acceleration(v: Sparse, dv: Sparse) -> SX:
            of_a, of_b = self.motions(v, dv)
            d_ddot = of_b.acceleration - of_a.acceleration
            return ca.dot(unit, d_ddot) + ca.sumsqr(self.d_dot(v)) / length

        residual = (ca.dot(unit, self.d) - length) / 2
        return self.row(
            g_a=lambda u, _: ca.dot(unit, u),
            g_b=lambda u, _: ca.dot(unit, u),
            acceleration=acceleration,
            residual=residual,
            squared_gap=residual**2,
        )

    def held_length(self) -> Row:
        """The rate of |d| is zero; any length is allowed.

        With the unit vector e = d / |d|, Phi v = e . d_dot. The rate of e is
        (d_dot - (e . d_dot) e) / |d|, so that the rate of Phi v is

            e . d_ddot + (d_dot . d_dot - (e . d_dot)^2) / |d|.
        """
        length = self.length
        unit = self.d / length

        def acceleration(v: Sparse, dv: Sparse) -> SX:
            of_a, of_b = self.motions(v, dv)
            d_ddot = of_b.acceleration - of_a.acceleration
            d_dot = self.d_dot(v)
            along = ca.dot(unit, d_dot)
            return ca.dot(unit, d_ddot) + (ca.sumsqr(d_dot) - along**2) / length

        return self.row(
            g_a=lambda u, _: ca.dot(unit, u),
            g_b=lambda u, _: ca.dot(unit, u),
            acceleration=acceleration,
            residual=None,
            squared_gap=SX(0),
        )


class _Rolling:
    """A wheel or ball B that touches the x-y plane of A and does not slip.

    `up` is the unit vector from the contact to the centre of B. For a ball it is the normal n of
    the plane. For a disc with the axle z it lies in the disc: up = g / |g| with g = n - (n . z) z.
    With the radius r, the contact is at p_B - r up. The slip is the velocity of B at the contact
    less that of A,

        slip = u_B - omega_B x r up - (u_A + omega_A x c),   c = d - r up,

    where c is the vector from the origin of A to the contact. Phi v of the three rows is the slip
    along the axes x, y, z of A. The third row also has a residual, the height of the contact above
    the plane.
    """

    def __init__(self, pair: _FramePair, closure: Rolling) -> None:
        self._pair = pair
        self._is_ball = closure.ball
        self._radius = closure.radius
        self._normal = pair.a.R[:, 2]
        self._axle = pair.b.R[:, 2]
        if self._is_ball:
            self._up = self._normal
        else:
            g = self._normal - ca.dot(self._normal, self._axle) * self._axle
            self._g_length = ca.sqrt(ca.sumsqr(g))
            self._up = g / self._g_length
        self._c = pair.d - self._radius * self._up

    def rows(self) -> Iterator[Row]:
        """The rows "slip x", "slip y" and "height"."""
        yield self._row_along(self._pair.a.R[:, 0], height=None)
        yield self._row_along(self._pair.a.R[:, 1], height=None)
        yield self._row_along(self._normal, height=ca.dot(self._normal, self._c))

    def _row_along(self, n: SX, height: SX | None) -> Row:
        """The row of the slip along an axis n of A."""
        squared_gap = SX(0)
        if height is not None:
            squared_gap = height**2
        return self._pair.row(
            g_a=lambda u, omega: ca.dot(n, u + ca.cross(omega, self._c)),
            g_b=lambda u, omega: ca.dot(n, u - ca.cross(omega, self._radius * self._up)),
            acceleration=lambda v, dv: ca.dot(n, self._slip_rate(v, dv)),
            residual=height,
            squared_gap=squared_gap,
        )

    def _slip_rate(self, v: Sparse, dv: Sparse) -> SX:
        """Rate of the slip velocity.

        The axes of A turn. But the slip is zero, so its components along turning axes have the same
        rates as those along fixed axes.
        """
        of_a, of_b = self._pair.motions(v, dv)
        r = self._radius
        up_dot = self._up_rate(of_a, of_b)
        c_dot = self._pair.d_dot(v) - r * up_dot
        # The rate of each term of the slip; that of omega_A x c has two terms.
        at_b = (
            of_b.acceleration
            - ca.cross(of_b.alpha, r * self._up)
            - ca.cross(of_b.omega, r * up_dot)
        )
        at_a = of_a.acceleration + ca.cross(of_a.alpha, self._c)
        return at_b - at_a - ca.cross(of_a.omega, c_dot)

    def _up_rate(self, of_a: _FrameMotion, of_b: _FrameMotion) -> SX:
        """Rate of `up`: n_dot for a ball, else (g_dot - (up . g_dot) up) / |g|."""
        n_dot = ca.cross(of_a.omega, self._normal)
        if self._is_ball:
            return n_dot
        z_dot = ca.cross(of_b.omega, self._axle)
        along = ca.dot(n_dot, self._axle) + ca.dot(self._normal, z_dot)  # rate of n . z
        g_dot = n_dot - along * self._axle - ca.dot(self._normal, self._axle) * z_dot
        return (g_dot - self._up * ca.dot(self._up, g_dot)) / self._g_length


class _EqualOrientation:
    """Three rows: frame B has the orientation of frame A, Phi v = omega_B - omega_A.

    In this class the letters A, B and C stand for links: A carries the first frame, B the second
    one. R_XY is the rotation that takes vectors from the axes of link Y to those of link X.

    The rows are the components of Phi v along the axes of link C. Any axes would do; these give
    short expressions. C is the parent of B if the joint between them is revolute. Then this joint
    and the joint of C have axes that are constant in C. Otherwise C is B itself.

    Phi and the acceleration need the rotation R_CA. In a closed loop both frames have the same
    axes. So R_CA depends on no joint of the branch from the base to A:

        R_CA = R_CB R_b R_a^T,

    with the orientations R_a and R_b of the frames on their links, which are numbers. This is right
    in closed loops only, which suffices for Phi and the acceleration. The residual compares both
    branches.
    """

    def __init__(self, pair: _FramePair) -> None:
        self._kinematics = pair.kinematics
        self._base = pair.base
        self._link_a = pair.link_a
        self._link_b = pair.link_b
        links = self._kinematics.tree.links
        #: Whether C is the parent of B, so that a revolute joint is between them; else C is B.
        self._c_is_parent = self._link_b != self._base and links[self._link_b].kind == "turn"
        self._link_c = links[self._link_b].parent if self._c_is_parent else self._link_b
        self._R_CB, _ = self._kinematics.pose(self._link_c, self._link_b)
        R_a = pair.frame_a.placement.rotation
        R_b = pair.frame_b.placement.rotation
        self._R_CA = self._R_CB @ sx(R_b @ R_a.T)

    def rows(self) -> Iterator[Row]:
        """The rows, about the axes x, y, z of C."""
        # The orientation of C in the base, by way of each branch.
        R_base_A, _ = self._kinematics.pose(self._base, self._link_a)
        C_through_A = R_base_A @ self._R_CA.T
        C_through_B, _ = self._kinematics.pose(self._base, self._link_c)
        # Two rotations are equal if two columns are equal, which determine the third.
        difference = C_through_B - C_through_A
        squared_gap = ca.sumsqr(difference[:, 0]) + ca.sumsqr(difference[:, 2])
        # R is the identity in a closed loop. For a small rotation R, the axial vector of its skew
        # part (R - R^T) / 2 is the rotation vector.
        R = C_through_A.T @ C_through_B
        omega_columns = add(self._minus_omega_a(), self._omega_b())
        for axis in range(3):
            i = (axis + 1) % 3
            j = (axis + 2) % 3
            yield self._row_about(
                axis,
                omega_columns,
                residual=(R[j, i] - R[i, j]) / 2,
                squared_gap=squared_gap if axis == 0 else SX(0),
            )

    def _row_about(self, axis: int, omega_columns: Sparse, residual: SX, squared_gap: SX) -> Row:
        """The row about one axis of C.

        Args:
            axis: Number of the axis.
            omega_columns: omega_B - omega_A for a unit of each rate, by its index, in axes of C.
            residual: As in `Row`.
            squared_gap: As in `Row`.
        """

        def velocity(v: Sparse, twists: Twists) -> SX:
            _, omega_a = twists(self._base, self._link_a)
            _, omega_b = twists(self._base, self._link_b)
            return (self._R_CB @ omega_b - self._R_CA @ omega_a)[axis]

        return Row(
            Phi={k: omega[axis] for k, omega in omega_columns.items() if not is_zero(omega[axis])},
            velocity=velocity,
            acceleration=lambda v, dv: self._acceleration(v, dv)[axis],
            residual=residual,
            squared_gap=squared_gap,
        )

    def _minus_omega_a(self) -> Sparse:
        """-omega_A for a unit of each rate, in the axes of C."""
        columns = Sparse()
        for i in self._branch(self._link_a):
            R_iA, _ = self._kinematics.pose(i, self._link_a)
            columns = add(columns, self._axes_of_joint(i, -self._R_CA @ R_iA.T))
        return columns

    def _omega_b(self) -> Sparse:
        """omega_B for a unit of each rate, in the axes of C."""
        columns = Sparse()
        for i in self._branch(self._link_c):
            R_iC, _ = self._kinematics.pose(i, self._link_c)
            columns = add(columns, self._axes_of_joint(i, R_iC.T))
        if self._c_is_parent:
            columns = add(columns, self._axes_of_joint(self._link_b, self._R_CB))
        return columns

    def _branch(self, link: int) -> list[int]:
        """The links from the base, which is left out, to a link."""
        path = self._kinematics.tree.ancestors(link)
        return path[path.index(self._base) + 1 :]

    def _axes_of_joint(self, i: int, R: SX) -> Sparse:
        """The angular velocity of link i in its parent at a unit of each rate of its joint.

        R takes vectors from the axes of link i to those of the result.
        """
        link = self._kinematics.tree.links[i]
        return {k: R @ sx(S[3:]) for k, S in zip(link.v, link.S.T, strict=True)}

    def _acceleration(self, v: Sparse, dv: Sparse) -> SX:
        """Rate of omega_B - omega_A, in the axes of C.

        The axes of C turn, but as omega_B - omega_A is zero, the rate of its components is
        alpha_B - alpha_A.
        """
        of_a = self._kinematics.relative_motion(self._base, self._link_a, v, dv)
        of_c = self._kinematics.relative_motion(self._base, self._link_c, v, dv)
        difference = of_c.alpha - self._R_CA @ of_a.alpha
        if self._c_is_parent:
            # alpha_B = alpha_C + axis v_dot + omega_C x axis v; the axis is fixed in C.
            joint = self._kinematics.tree.links[self._link_b]
            (k,) = joint.v
            axis = self._R_CB @ sx(joint.S[3:, 0])
            difference += axis * dv.get(k, 0) + ca.cross(of_c.omega, axis * v.get(k, 0))
        return difference


# --- rows of joints -------------------------------------------------------------------------------


def _brake(model: pin.Model, closure: Brake) -> Row:
    """A rate that is held: Phi v = v_k."""
    (rate,) = JointSpace(model).rates_of([closure.name]).tolist()

    def velocity(v: Sparse, twists: Twists) -> SX:
        return SX(v.get(rate, 0))

    def acceleration(v: Sparse, dv: Sparse) -> SX:
        return SX(dv.get(rate, 0))

    return Row(
        Phi={rate: SX(1)},
        velocity=velocity,
        acceleration=acceleration,
        residual=None,
        squared_gap=SX(0),
    )


def _coupling(kinematics: Kinematics, model: pin.Model, closure: Coupling) -> Row:
    """A joint that follows polynomials p_k of others: q - offset - sum p_k(q_k) = 0.

    Let P_k(q_k) = q_k for the joint itself and P_k = -p_k for the others. Then Phi v is the sum of
    P_k' v_k. Its rate is the sum of P_k' v_dot_k + P_k'' v_k^2.
    """
    P: dict[str, tuple[float, ...]] = {closure.joint: (0.0, 1.0)}
    for name, coefficients in closure.polynomials.items():
        P[name] = tuple(-c for c in coefficients)
    residual = SX(-closure.offset)
    slopes: Sparse = {}  # P_k', by rate
    curvatures: Sparse = {}  # P_k'', by rate
    for name, coefficients in P.items():
        joint = model.joints[joint_id(model, name)]
        q = kinematics.moved_q[joint.idx_q]
        derivatives = [polyder(coefficients, order) for order in range(3)]
        # `polyder` has the coefficient of the lowest power first, CasADi that of the highest.
        value, slope, curvature = (SX(ca.polyval(ca.DM(p[::-1]), q)) for p in derivatives)
        residual += value
        if not slope.is_zero():
            slopes[joint.idx_v] = slope
            curvatures[joint.idx_v] = curvature

    def velocity(v: Sparse, twists: Twists) -> SX:
        return sum((c * v[k] for k, c in slopes.items() if k in v), SX(0))

    def acceleration(v: Sparse, dv: Sparse) -> SX:
        of_v = sum((c * v[k] ** 2 for k, c in curvatures.items() if k in v), SX(0))
        return sum((c * dv[k] for k, c in slopes.items() if k in dv), of_v)

    return Row(
        Phi=slopes,
        velocity=velocity,
        acceleration=acceleration,
        residual=residual,
        squared_gap=residual**2,
    )

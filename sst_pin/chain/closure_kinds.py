# SPDX-License-Identifier: BSD-2-Clause
"""The kinds of closures, all closures of a kind at once.

Each row of a closure is a wrench-like vector W in world axes with W . (twist of B - twist of A) =
0, twists reduced at the world's origin. Arrays of both ends run B, A: shape (2, k, ...) for k
closures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from .closures import Closure, Constraint, Coupling, Distance, Rolling
from .vectors import cross, skew

Array = NDArray[np.float64]
_AXES = np.eye(3)


class Ends(NamedTuple):
    """Frames B and A of the closures of a kind.

    Attributes:
        frames: Their placements, B and A of each closure.
        p: Origins, shape (2, k, 3).
        R: Axes, shape (2, k, 3, 3), for kinds with `axes`.
    """

    frames: Sequence[tuple[pin.SE3, pin.SE3]]
    p: Array
    R: Array


class Rates(NamedTuple):
    """Motion of the frames of a kind, world axes.

    Attributes:
        p: Velocities of their origins, shape (2, k, 3).
        omega: Angular velocities, shape (2, k, 3).
    """

    p: Array
    omega: Array


class Kind(Protocol):
    """Closures of one kind.

    Attributes:
        fixed: Whether W stays as it is.
        axes: Whether the axes of the frames count, not their origins alone.
        same_row: Whether W is the same at B and A.
    """

    fixed: bool
    axes: bool
    same_row: bool

    def constant(self, W: Array) -> None:
        """Fill what stays of W, shape (2, k, rows, 6), zero before."""

    def residual(self, ends: Ends) -> Array:
        """f, shape (k, rows)."""

    def wrenches(self, ends: Ends, W: Array) -> None:
        """Fill what moves of W; not asked of fixed ones."""

    def wrench_rates(self, ends: Ends, rates: Rates, W_dot: Array) -> None:
        """Fill the rate of W, zero before, likewise."""


class Welds:
    """6d: the displacement from A to B as a screw in world axes; its rate is the relative twist."""

    fixed, axes, same_row = True, False, True
    held = np.eye(6)

    def residual(self, ends: Ends) -> Array:
        """As `Kind.residual`."""
        return np.array([pin.log6(B * A.inverse()).vector for B, A in ends.frames])

    def constant(self, W: Array) -> None:
        """As `Kind.constant`."""
        W[:] = self.held

    def wrenches(self, ends: Ends, W: Array) -> None:
        """As `Kind.wrenches`."""

    def wrench_rates(self, ends: Ends, rates: Rates, W_dot: Array) -> None:
        """As `Kind.wrench_rates`."""


class Orientations(Welds):
    """orientation: the rotation from A to B, world axes."""

    held = np.eye(6)[3:]

    def residual(self, ends: Ends) -> Array:
        """As `Kind.residual`."""
        return np.array([pin.log3(B.rotation @ A.rotation.T) for B, A in ends.frames])


class Points:
    """3d: the origins coincide; rows in world axes at each origin."""

    fixed = axes = same_row = False

    def residual(self, ends: Ends) -> Array:
        """As `Kind.residual`."""
        return ends.p[0] - ends.p[1]

    def constant(self, W: Array) -> None:
        """As `Kind.constant`."""
        W[..., :3] = _AXES

    def wrenches(self, ends: Ends, W: Array) -> None:
        """As `Kind.wrenches`."""
        W[..., 3:] = skew(-ends.p)

    def wrench_rates(self, ends: Ends, rates: Rates, W_dot: Array) -> None:
        """As `Kind.wrench_rates`."""
        W_dot[..., 3:] = skew(-rates.p)


class Masked:
    """Any choice of held motions of B in the axes of A.

    Args:
        held: Of the six motions [linear; angular].

    Attributes:
        slides: Axes of A along which B does not slide.
        orientation: Whether no turn is free.
        angles: (i, j, sign) of axes i of A and j of B that stay at a right angle.
    """

    fixed, axes, same_row = False, True, True

    def __init__(self, held: Sequence[bool]) -> None:
        self.slides = [k for k in range(3) if held[k]]
        turns = [k for k in range(3) if held[3 + k]]
        self.orientation = len(turns) == 3
        # An axis a of A and an axis b of B that stay at a right angle: with one free turn about k,
        # the two others of A against k of B; with one held turn k, the two others of A and B.
        self.angles: list[tuple[int, int, float]] = []
        self._along: int | None = None
        if len(turns) == 2:
            (self._along,) = set(range(3)) - set(turns)
            i, j = (self._along + 1) % 3, (self._along + 2) % 3
            # The turn about i moves b = k against a = j, by minus its rate; about j against i.
            of_turn = {i: (j, self._along, -1.0), j: (i, self._along, 1.0)}
            self.angles = [of_turn[k] for k in turns]
        elif len(turns) == 1:
            (k,) = turns
            self.angles = [((k + 1) % 3, (k + 2) % 3, -1.0)]
        self._i = [i for i, _, _ in self.angles]
        self._j = [j for _, j, _ in self.angles]
        self._signs = np.array([sign for _, _, sign in self.angles])

    def residual(self, ends: Ends) -> Array:
        """As `Kind.residual`."""
        R_b, R_a = ends.R
        slid = np.matmul((ends.p[0] - ends.p[1])[:, None], R_a)[:, 0, self.slides]
        if self.orientation:
            turned = [pin.log3(B @ A.T) for B, A in zip(R_b, R_a, strict=True)]
            return np.concatenate((slid, turned), axis=1)
        R = np.matmul(R_a.transpose(0, 2, 1), R_b)
        angles = self._signs * R[:, self._i, self._j]
        if self._along is not None:
            for k in np.flatnonzero(R[:, self._along, self._along] < 0):
                # The axes are opposed: lead on in the same direction, over the right angle.
                size = float(np.linalg.norm(angles[k]))
                angles[k] -= 2 * (angles[k] / size if size else np.eye(len(self.angles))[0])
        return np.concatenate((slid, angles), axis=1)

    def constant(self, W: Array) -> None:
        """As `Kind.constant`."""
        if self.orientation:
            W[:, :, len(self.slides) :, 3:] = _AXES

    def wrenches(self, ends: Ends, W: Array) -> None:
        """As `Kind.wrenches`."""
        a, b = self._axes(ends)
        slid = len(self.slides)
        if slid:
            n = a[:, self.slides]
            W[:, :, :slid, :3] = n
            W[:, :, :slid, 3:] = cross(ends.p[0][:, None], n)
        if self.angles:
            W[:, :, slid:, 3:] = self._signs[:, None] * cross(b[:, self._j], a[:, self._i])

    def wrench_rates(self, ends: Ends, rates: Rates, W_dot: Array) -> None:
        """As `Kind.wrench_rates`."""
        a, b = self._axes(ends)
        slid, omega_b, omega_a = len(self.slides), *rates.omega[:, :, None]
        if slid:
            n = a[:, self.slides]
            n_dot = cross(omega_a, n)
            W_dot[:, :, :slid, :3] = n_dot
            moved = cross(rates.p[0][:, None], n) + cross(ends.p[0][:, None], n_dot)
            W_dot[:, :, :slid, 3:] = moved
        if self.angles:
            a, b = a[:, self._i], b[:, self._j]
            moved = cross(cross(omega_b, b), a) + cross(b, cross(omega_a, a))
            W_dot[:, :, slid:, 3:] = self._signs[:, None] * moved

    def _axes(self, ends: Ends) -> tuple[Array, Array]:
        """Of A and of B, one a row, shapes (k, 3, 3)."""
        R_b, R_a = ends.R
        return R_a.transpose(0, 2, 1), R_b.transpose(0, 2, 1)


class Rods:
    """The distance of the origins.

    Args:
        lengths: Of each rod, shape (k,).
    """

    fixed = axes = same_row = False

    def __init__(self, lengths: Array) -> None:
        self._lengths = lengths

    def residual(self, ends: Ends) -> Array:
        """As `Kind.residual`."""
        distances = np.linalg.norm(ends.p[0] - ends.p[1], axis=1)
        return np.asarray(distances - self._lengths)[:, None]

    def constant(self, W: Array) -> None:
        """As `Kind.constant`."""

    def wrenches(self, ends: Ends, W: Array) -> None:
        """As `Kind.wrenches`."""
        u, _ = _unit(ends.p[0] - ends.p[1])
        W[:, :, 0, :3] = u
        W[:, :, 0, 3:] = cross(ends.p, u)

    def wrench_rates(self, ends: Ends, rates: Rates, W_dot: Array) -> None:
        """As `Kind.wrench_rates`."""
        u, length = _unit(ends.p[0] - ends.p[1])
        u_dot = _unit_rate(u, length, rates.p[0] - rates.p[1])
        W_dot[:, :, 0, :3] = u_dot
        W_dot[:, :, 0, 3:] = cross(rates.p, u) + cross(ends.p, u_dot)


class Wheels:
    """Rows x, y, z of the plane: velocity of the wheel at the contact, relative to the plane.

    Args:
        radii: Of each wheel, shape (k,).
        balls: Whether they are balls.

    Attributes:
        radii, balls: As given.
    """

    fixed, axes, same_row = False, True, True

    def __init__(self, radii: Array, balls: bool) -> None:
        self.radii, self.balls = radii, balls

    def residual(self, ends: Ends) -> Array:
        """As `Kind.residual`."""
        f = np.zeros((len(self.radii), 3))
        n = ends.R[1, :, :, 2]
        f[:, 2] = _dot(n, self._contact(ends) - ends.p[1])[:, 0]
        return f

    def constant(self, W: Array) -> None:
        """As `Kind.constant`."""

    def wrenches(self, ends: Ends, W: Array) -> None:
        """As `Kind.wrenches`."""
        axes = ends.R[1].transpose(0, 2, 1)
        W[..., :3] = axes
        W[..., 3:] = cross(self._contact(ends)[:, None], axes)

    def wrench_rates(self, ends: Ends, rates: Rates, W_dot: Array) -> None:
        """As `Kind.wrench_rates`."""
        up, z, size = self._up(ends)
        omega_b, omega_a = rates.omega
        axes = ends.R[1].transpose(0, 2, 1)
        axes_dot = cross(omega_a[:, None], axes)
        n, n_dot = axes[:, 2], axes_dot[:, 2]
        g_dot = n_dot
        if not self.balls:
            z_dot = cross(omega_b, z)
            g_dot = n_dot - (_dot(n_dot, z) + _dot(n, z_dot)) * z - _dot(n, z) * z_dot
        contact_dot = rates.p[0] - self.radii[:, None] * _unit_rate(up, size, g_dot)
        W_dot[..., :3] = axes_dot
        moved = cross(contact_dot[:, None], axes)
        W_dot[..., 3:] = moved + cross(self._contact(ends)[:, None], axes_dot)

    def _contact(self, ends: Ends) -> Array:
        return ends.p[0] - self.radii[:, None] * self._up(ends)[0]

    def _up(self, ends: Ends) -> tuple[Array, Array, Array]:
        """From the contact to the centre as unit vectors, and what they are made of."""
        z, n = ends.R[..., 2]
        up, size = _unit(n if self.balls else n - _dot(n, z) * z)
        return up, z, size


_NAMED: dict[Any, Callable[[], Kind]] = {
    "6d": Welds,
    "orientation": Orientations,
    "3d": Points,
}


def kinds_of(closures: Sequence[Constraint]) -> Iterator[tuple[Kind, list[int]]]:
    """The kinds there are, each with the indices of its closures; couplings apart."""
    groups: dict[Any, list[int]] = {}
    for index, closure in enumerate(closures):
        if not isinstance(closure, Coupling):
            groups.setdefault(_key(closure), []).append(index)
    for members in groups.values():
        yield kind_of([closures[i] for i in members]), members


def kind_of(alike: Sequence[Any]) -> Kind:
    """The kind of closures that are alike."""
    first = alike[0]
    if isinstance(first, Distance):
        return Rods(np.array([rod.distance for rod in alike]))
    if isinstance(first, Rolling):
        return Wheels(np.array([wheel.radius for wheel in alike]), first.ball)
    return _NAMED[first.kind]() if _named(first) else Masked(first.held)


def _key(closure: Closure | Distance | Rolling) -> Any:
    if isinstance(closure, Distance):
        return Distance
    if isinstance(closure, Rolling):
        return Rolling, closure.ball
    return closure.kind if _named(closure) else closure.held


def _named(closure: Closure) -> bool:
    """Whether its kind has rows of its own; the others choose among motions in the axes of A."""
    return isinstance(closure.kind, str) and closure.kind in _NAMED


def _dot(a: Array, b: Array) -> Array:
    product: Array = (a * b).sum(axis=-1, keepdims=True)
    return product


def _unit(a: Array) -> tuple[Array, Array]:
    """Vectors over their lengths, and these, shapes (k, 3) and (k, 1)."""
    length = np.maximum(np.sqrt(_dot(a, a)), 1e-300)
    return a / length, length


def _unit_rate(u: Array, length: Array, rate: Array) -> Array:
    """Rate of `_unit`."""
    return (rate - u * _dot(u, rate)) / length

# SPDX-License-Identifier: BSD-2-Clause
"""Measurements from which a geometry is calibrated: poses, heights and distances.

Each measurement compares a frame B of the robot with a reference frame A in N configurations. Each
measured number gives a row of the equations A de = z: z is the measured minus the computed value,
and A de is the change of the computed value by changes de of errors of the geometry. Values of one
kind, positions or orientations, have the same unit and the same noise.

A measuring system whose base is at an unknown place needs a first guess of this place: the methods
`guess_of_base`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import KW_ONLY, dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, as_array, finite_array, positive_number, require_flags
from ..errors import InputError
from ..loops.frame_guide import rotations
from ..loops.vectors import skew

#: Poses do not determine a base if their positions are in a row: if their second principal extent,
#: squared, is below this part of the first one, squared.
_IN_A_ROW = 1e-8
#: A principal extent of positions, for distances from a point, counts as zero below this part of
#: the first one. If the third one is zero, the positions are in a plane: then errors of the
#: geometry decide on which side of the plane the point is.
_IN_A_PLANE = 1e-3
#: A point is in the plane if its height is below this part of its distance within the plane. The
#: height is the root of a difference of squares: an error of 0.5 % of the distance can look like a
#: height of sqrt(1.005^2 - 1) = 0.1 of it.
_ABOVE_PLANE = 0.1


class MeasuredFrames(NamedTuple):
    """The two frames of a measurement in N configurations, and their derivatives by k errors.

    Attributes:
        a, b: Placements of A and B in the base, shape (N, 4, 4).
        J_a, J_b: Their Jacobians, [linear; angular] in base axes, shape (N, 6, k).
    """

    a: Array
    b: Array
    J_a: Array
    J_b: Array

    def positions(self) -> tuple[Array, Array]:
        """The origin of B in A, shape (N, 3), and its derivatives, shape (N, 3, k).

        The position is p = R_a^T d with d = x_b - x_a in base axes. If A moves with the velocity
        v_a and the angular velocity w_a, and B with v_b, then p' = R_a^T (v_b - v_a - w_a x d).
        With -w_a x d = skew(d) w_a, and J_a and J_b in place of the velocities, this gives the
        derivatives by the errors.
        """
        R_a_transposed = self.a[:, :3, :3].mT
        d = self.b[:, :3, 3] - self.a[:, :3, 3]
        J = self.J_b[:, :3] - self.J_a[:, :3] + skew(d) @ self.J_a[:, 3:]
        return (R_a_transposed @ d[:, :, None])[..., 0], R_a_transposed @ J


class Rows(NamedTuple):
    """Rows of the equations A de = z for the values of one kind.

    Attributes:
        z: Measured minus computed values, shape (rows,), [m] or [rad].
        A: Derivatives of the computed values by k errors, shape (rows, k).
        are_angles: Whether the values are angles, [rad]; otherwise they are lengths, [m].
    """

    z: Array
    A: Array
    are_angles: bool = False


@dataclass(frozen=True, eq=False)
class Measurement(ABC):
    """A frame that was measured in several configurations: the base of all kinds.

    Attributes:
        frame: Name of the frame that was measured.
        x: Measured positions of the coordinates, shape (N, n), [rad] or [m].
        noise: Standard deviation of the measured values, [m], or of poses a tuple: of positions,
            [m], and of orientations, [rad]. By default, and for None in the tuple, it is estimated.
            Give it where there are few more values than errors.
        unknown_base: Whether the placement of the measuring system in the base is unknown. It is
            estimated as the errors `<name>_base.x` to `.rz`.
        unknown_target: Whether the place that was measured is unknown relative to the frame. It is
            estimated as the errors `<name>_target.x` to `.rz`.
        name: Name of the measuring system. Measurements with one name share what is unknown.
        start: As in `calibrate`, for these configurations.
    """

    frame: str
    x: ArrayLike
    _: KW_ONLY
    noise: float | tuple[float | None, float | None] | None = None
    unknown_base: bool = False
    unknown_target: bool = False
    name: str = "measured"
    start: ArrayLike | None = None

    def __post_init__(self) -> None:
        require_flags(unknown_base=self.unknown_base, unknown_target=self.unknown_target)

    @property
    def reference(self) -> str:
        """Name of the reference frame."""
        return f"{self.name}_base" if self.unknown_base else "universe"

    @property
    def end(self) -> str:
        """Name of the frame that is compared with the reference."""
        return f"{self.name}_target" if self.unknown_target else self.frame

    def count(self, coordinates: int) -> int:
        """N; raises an error unless x has a row of coordinates for each value."""
        angles = finite_array("x", self.x, (coordinates,))
        if angles.ndim != 2 or not len(angles):
            expected = f"(N, {coordinates}), with a row for each value"
            raise InputError("x", f"shape {angles.shape}, expected {expected}")
        return len(angles)

    def check_noise(self) -> None:
        """Refuse a noise that does not have one number for each kind of values.

        The measured values must have passed `count`: their shape says how many kinds there are.
        """
        numbers = len(self.noise) if isinstance(self.noise, tuple) else 1
        if self.noise is not None and numbers != self.number_of_kinds:
            if self.number_of_kinds == 2:
                raise InputError("noise", "of poses: two numbers, of positions and orientations")
            raise InputError("noise", f"{self.noise}, expected one number")

    @property
    def number_of_kinds(self) -> int:
        """Number of kinds of values: 1, or 2 for positions and orientations."""
        return 1

    @property
    def noise_of_kinds(self) -> list[float | None]:
        """The noise of each kind of values; None to estimate it."""
        if self.noise is None:
            return [None] * self.number_of_kinds
        stated = self.noise if isinstance(self.noise, tuple) else (self.noise,)
        return [None if x is None else positive_number("noise", x) for x in stated]

    @abstractmethod
    def rows(self, frames: MeasuredFrames) -> list[Rows]:
        """Rows for the values of each kind that were measured, the kinds in a fixed order."""

    def guess_of_base(self, b: Array) -> pin.SE3:
        """A first guess of the measuring system's placement in the base of the robot.

        b has the placements of the measured frame in the base, of the robot as drawn, (N, 4, 4).
        """
        return pin.SE3.Identity()


@dataclass(frozen=True, eq=False)
class Poses(Measurement):
    """Poses of a frame, or some entries of them, such as a laser tracker measures.

    Attributes:
        poses: Positions of the frame's origin, shape (N, 3), or poses, shape (N, 4, 4), in the
            axes of the measuring system, the base by default; [m]. NaN: not measured, such as one
            coordinate, or a whole orientation.

    Example:
        >>> poses = np.full((8, 3), np.nan)
        >>> poses[:, 2] = 0.35  # only z was measured
        >>> sst_pin.identification.Poses("platform", np.zeros((8, 3)), poses).name
        'measured'
    """

    poses: ArrayLike = ()

    def count(self, coordinates: int) -> int:
        """N; the poses must have the shape of poses, or of positions."""
        size = super().count(coordinates)
        array = as_array("poses", self.poses, ())
        if array.shape == (size, 3, 3):
            raise InputError("poses", "orientations alone; expected shapes (N, 3) or (N, 4, 4)")
        if array.shape not in ((size, 3), (size, 4, 4)):
            shapes = f"({size}, 3) or ({size}, 4, 4)"
            raise InputError("poses", f"shape {array.shape}, expected {shapes}")
        if np.isinf(array).any():
            raise InputError("poses", "an entry is infinite; NaN says that it was not measured")
        if array.ndim == 3:
            self._check_orientations(array)
        return size

    def _check_orientations(self, poses: Array) -> None:
        """Refuse orientations that are measured in part, and what is no homogeneous matrix."""
        R = poses[:, :3, :3]
        some_missing = np.isnan(R).any(axis=(1, 2))
        all_missing = np.isnan(R).all(axis=(1, 2))
        in_part = np.flatnonzero(some_missing & ~all_missing)
        if in_part.size:
            problem = f"pose {in_part[0]}: an orientation is measured whole, or is NaN"
            raise InputError("poses", problem)
        rotations("poses", R[~some_missing])
        last_row = np.array([0.0, 0.0, 0.0, 1.0])
        given = np.where(np.isnan(poses[:, 3]), last_row, poses[:, 3])
        if (given != last_row).any():
            raise InputError("poses", "the last row of a homogeneous matrix is 0, 0, 0, 1")

    @property
    def number_of_kinds(self) -> int:
        """1 for positions, shape (N, 3); 2 for poses, shape (N, 4, 4)."""
        return 1 if np.ndim(self.poses) == 2 else 2

    @property
    def measured_positions(self) -> Array:
        """Measured positions, shape (N, 3), [m]; NaN where they were not measured."""
        array = np.asarray(self.poses, dtype=float)
        return array if array.ndim == 2 else array[:, :3, 3]

    def rows(self, frames: MeasuredFrames) -> list[Rows]:
        """Rows for the positions, then for the orientations if the poses have them."""
        p, J = frames.positions()
        measured = self.measured_positions
        is_measured = np.isfinite(measured)
        kinds = [Rows((measured - p)[is_measured], J[is_measured])]
        array = np.asarray(self.poses, dtype=float)
        if array.ndim == 3:
            kinds.append(self._rows_of_orientations(frames, array[:, :3, :3]))
        return kinds

    def _rows_of_orientations(self, frames: MeasuredFrames, R_measured: Array) -> Rows:
        """Rows for the measured orientations of B in A, shape (N, 3, 3), three rows for each.

        The difference of two orientations is the rotation vector from the computed to the measured
        one, in the axes of A.
        """
        k = np.flatnonzero(np.isfinite(R_measured).all(axis=(1, 2)))
        R_a_transposed = frames.a[k, :3, :3].mT
        R_computed = R_a_transposed @ frames.b[k, :3, :3]
        z = []
        for computed, measured in zip(R_computed, R_measured[k], strict=True):
            in_axes_of_b = pin.log3(computed.T @ measured)
            z.append(computed @ in_axes_of_b)
        A = R_a_transposed @ (frames.J_b[k, 3:] - frames.J_a[k, 3:])
        return Rows(np.reshape(z, -1), A.reshape(-1, A.shape[2]), are_angles=True)

    def guess_of_base(self, b: Array) -> pin.SE3:
        """The rigid motion that maps the measured positions best onto those of b (Kabsch)."""
        measured = self.measured_positions
        k = np.isfinite(measured).all(axis=1)
        in_system = measured[k]
        in_base = b[k, :3, 3]
        if len(in_system) < 3:
            problem = "of an unknown system: at least three whole positions are needed"
            raise InputError("poses", problem)
        mean_in_system = in_system.mean(axis=0)
        mean_in_base = in_base.mean(axis=0)
        U, s, Vt = np.linalg.svd((in_base - mean_in_base).T @ (in_system - mean_in_system))
        if s[1] <= _IN_A_ROW * s[0]:
            raise InputError("poses", "of an unknown system: the positions are in a row")
        R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt  # a rotation, not a reflection
        return pin.SE3(R, mean_in_base - R @ mean_in_system)


@dataclass(frozen=True, eq=False)
class Heights(Measurement):
    """Positions of a frame along one direction, such as a touch probe or a dial gauge measures.

    Attributes:
        heights: Along the direction, from the origin of the measuring system, shape (N,), [m].
            NaN: not measured.
        direction: In the axes of the measuring system, shape (3,) or (N, 3); z by default.

    Example:
        >>> heights = sst_pin.identification.Heights("platform", np.zeros((7, 3)), np.zeros(7))
        >>> heights.direction
        (0.0, 0.0, 1.0)
    """

    heights: ArrayLike = ()
    direction: ArrayLike = (0.0, 0.0, 1.0)

    def count(self, coordinates: int) -> int:
        """N; there must be a height for each configuration."""
        size = super().count(coordinates)
        _values("heights", self.heights, size)
        directions = as_array("direction", self.direction, (3,))
        if directions.shape not in ((3,), (size, 3)):
            raise InputError("direction", f"shape {directions.shape}, expected (3,) or ({size}, 3)")
        if not directions.any(axis=-1).all():
            raise InputError("direction", "zero; a vector along the measured axis is needed")
        return size

    def rows(self, frames: MeasuredFrames) -> list[Rows]:
        """One kind: heights."""
        p, J = frames.positions()
        u = np.broadcast_to(np.asarray(self.direction, dtype=float), p.shape)
        u = u / np.linalg.norm(u, axis=1, keepdims=True)
        z = np.asarray(self.heights, dtype=float) - np.vecdot(u, p)
        k = np.isfinite(z)
        return [Rows(z[k], _along(u[k], J[k]))]


@dataclass(frozen=True, eq=False)
class Distances(Measurement):
    """Distances of two frames, such as a ball bar or a tape measures.

    Attributes:
        distances: Shape (N,), [m]; NaN: not measured.
        other: Name of the other frame, from which distances are measured.

    Example:
        >>> bar = sst_pin.identification.Distances("platform", np.zeros((5, 3)), np.ones(5))
        >>> bar.other
        'universe'
    """

    distances: ArrayLike = ()
    other: str = "universe"

    @property
    def reference(self) -> str:
        """Name of the other frame, or of the base of an unknown measuring system."""
        return f"{self.name}_base" if self.unknown_base else self.other

    def count(self, coordinates: int) -> int:
        """N; there must be a distance for each configuration."""
        size = super().count(coordinates)
        if not (_values("distances", self.distances, size)[np.isfinite(self.distances)] > 0).all():
            raise InputError("distances", "must be positive")
        return size

    def rows(self, frames: MeasuredFrames) -> list[Rows]:
        """One kind: distances."""
        p, J = frames.positions()
        lengths = np.linalg.norm(p, axis=1)
        z = np.asarray(self.distances, dtype=float) - lengths
        k = np.isfinite(z)
        if not lengths[k].all():
            raise InputError("distances", f"{self.reference} and {self.end} are in one place")
        u = p[k] / lengths[k, None]  # unit vectors from A to B, in axes of A
        return [Rows(z[k], _along(u, J[k]))]

    def guess_of_base(self, b: Array) -> pin.SE3:
        """The point at the measured distances from the frame's positions, without a rotation."""
        d = np.asarray(self.distances, dtype=float)
        k = np.isfinite(d)
        positions = b[k, :3, 3]
        if len(positions) < 4:
            raise InputError("distances", "of an unknown system: at least four values are needed")
        return pin.SE3(np.eye(3), _trilaterated(positions, d[k]))


def _along(u: Array, J: Array) -> Array:
    """Derivatives u^T J along directions u, shape (N, 3), of vectors with derivatives (N, 3, k)."""
    return (u[:, None, :] @ J)[:, 0]


def _trilaterated(positions: Array, d: Array) -> Array:
    """The point at distances d, shape (N,), from N positions, N >= 4: trilateration.

    Let r be a position and c the point, both relative to the mean of all positions. The equation
    |r - c|^2 = d^2 is

        2 r . c = g + |c|^2,    g = |r|^2 - d^2.

    The mean of r is zero. So the mean of these equations gives |c|^2 = -mean(g), and each equation
    minus the mean is linear in c: 2 r . c = g - mean(g).
    """
    mean = positions.mean(axis=0)
    r = positions - mean
    g = np.sum(r**2, axis=1) - d**2
    U, s, Vt = np.linalg.svd(r, full_matrices=False)
    if s[1] <= _IN_A_PLANE * s[0]:
        raise InputError("distances", "of an unknown system: the positions are in a row")
    # The components of c along the principal axes of the positions, which are the rows of Vt, solve
    # the linear equations 2 U diag(s) (Vt c) = g - mean(g).
    first, second, third = U.T @ (g - g.mean()) / (2 * np.maximum(s, 1e-300))
    # The third component is sensitive to errors where the positions are almost in a plane. Then it
    # follows from |c|^2, but for its sign.
    height = np.sqrt(max(-g.mean() - first**2 - second**2, 0.0))
    if s[2] <= _IN_A_PLANE * s[0]:
        if height > _ABOVE_PLANE * np.hypot(first, second):
            problem = "the positions are in a plane, and the other place is on one of its sides"
            cure = "give a frame near it, other="
            raise InputError("distances", f"of an unknown system: {problem}; {cure}")
        guesses = [[first, second, 0.0]]
    else:
        guesses = [[first, second, third], [first, second, height], [first, second, -height]]

    def misfit(c: Array) -> float:
        return float(np.sum((np.linalg.norm(r - c, axis=1) - d) ** 2))

    return np.asarray(mean + min((Vt.T @ guess for guess in guesses), key=misfit))


def _values(name: str, values: ArrayLike, size: int) -> Array:
    """Measured numbers, shape (N,); they are finite or NaN."""
    array = as_array(name, values, ())
    if array.shape != (size,) or np.isinf(array).any():
        problem = f"shape {array.shape}, expected ({size},), of finite numbers or NaN"
        raise InputError(name, problem)
    return array


def frames_of(measurements: Iterable[Measurement]) -> Iterator[str]:
    """Names of the frames that measurements compare."""
    for measurement in measurements:
        yield measurement.reference
        yield measurement.end


def unknown_frames(measurement: Measurement) -> list[str]:
    """Names of the frames whose placement is unknown."""
    names = []
    if measurement.unknown_base:
        names.append(measurement.reference)
    if measurement.unknown_target:
        names.append(measurement.end)
    return names

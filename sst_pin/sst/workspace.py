# SPDX-License-Identifier: BSD-2-Clause
"""Directions that the axis s of an SST can reach, with condition numbers.

The star has three degrees of freedom: the direction of s and the roll angle psi about s. A map
shows all directions, for one psi, or for the best psi of each direction.

With ideal joints the inverse kinematics has a solution for every orientation, except those in which
a leg is in the plane of its arc. The arcs limit a real machine; `check` defines these limits. All
maps are for the working branch, 0 < mu_k < pi.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Flags, single_array, whole_number
from ..errors import InputError
from ..files import Writer, as_path, require_ending, table_writer, write_files
from . import kinematics
from .arc_limits import arc_margins
from .platform_motion import orientation
from .robot import SST

#: |sin(mu_k)| below which the pose of leg k is not computed: gamma_k loses its digits.
_FLAT = 1e-6
#: Poses of a map.
_MOST = 100_000_000


class Chart(NamedTuple):
    """Lambert's azimuthal equal-area map of the sphere about a direction."""

    #: Right, up, and the direction in the middle of the map, rows of a (3, 3) array.
    axes: Array

    @classmethod
    def of_robot(cls, robot: SST) -> Chart:
        """A map about the middle of the base triangle, seen from outside, P_3 straight above it."""
        v = robot.geometry.R_0[:, :, 0]
        middle = v.sum(axis=0) / np.linalg.norm(v.sum(axis=0))
        up = v[2] - (v[2] @ middle) * middle
        up /= np.linalg.norm(up)
        return cls(np.array((np.cross(up, middle), up, middle)))

    def project(self, s: ArrayLike) -> Array:
        """Points of the map, shape (..., 2); half the sphere fills the disc of radius sqrt(2)."""
        right, up, ahead = np.moveaxis(np.asarray(s) @ self.axes.T, -1, 0)
        return np.stack([right, up], axis=-1) * np.sqrt(2 / (1 + ahead))[..., None]

    def directions(self, points: ArrayLike) -> Array:
        """Unit vectors of points of the map, shapes (..., 2) and (..., 3)."""
        points = np.asarray(points, dtype=float)
        square = (points**2).sum(axis=-1, keepdims=True)
        local = np.concatenate([points * np.sqrt(1 - square / 4), 1 - square / 2], axis=-1)
        return np.asarray(local @ self.axes)

    @staticmethod
    def grid(rings: int, spokes: int) -> Array:
        """Points that cover the half sphere ahead, shape (rings, spokes + 1, 2).

        The first ring is the middle itself, the last spoke is the first one again.
        """
        angle = np.linspace(0, np.pi / 2, rings)[:, None]
        turn = np.pi / 2 + np.linspace(0, 2 * np.pi, spokes + 1)
        radius = 2 * np.sin(angle / 2)
        return np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=-1)


@dataclass(frozen=True, eq=False)
class WorkspaceMap:
    """A map over the half sphere about the base triangle's middle.

    Each array is of shape (rings, spokes + 1), as `Chart.grid` lays its points out. Where several
    psi were asked for, a direction shows the one of least condition number on the arcs; where none
    is on the arcs, the one of least condition number.

    Attributes:
        theta: Longitude of s in the base, [rad].
        phi: Its colatitude, [rad].
        psi: Roll of the star about s, the paper's angle, [rad].
        reachable: Whether joint limits hold and no leg is in the plane of its arc.
        first_kind: min |sin(mu_k)|, 0 where a leg is in the plane of its arc.
        determinant: Determinant of A, rows y_2k; changes sign at singularities of the second kind.
            NaN where a leg is in the plane of its arc: A is not defined there.
        condition_number: Condition number of A; infinite where the direction is not reachable.
        margin: How far inside their arcs and joint limits all joints are, negative by how far one
            is outside, the largest over all psi, [rad]. NaN where a leg is in the plane of its arc.
        roll: Range of psi within the arcs, [rad]; 0 or 2 pi for a map at one psi.
    """

    theta: Array
    phi: Array
    psi: Array
    reachable: Flags
    first_kind: Array
    determinant: Array
    condition_number: Array
    margin: Array
    roll: Array

    @property
    def on_arcs(self) -> Flags:
        """Whether every slider is on its arcs and every joint within its limits."""
        return self.margin >= 0  # and never where it is NaN

    @property
    def s(self) -> Array:
        """The directions as unit vectors in base axes, shape (rings, spokes + 1, 3)."""
        return orientation(self.theta, self.phi)[..., 0]

    @property
    def best(self) -> tuple[int, int] | None:
        """Index of the least condition number on the arcs; None when nothing is on them."""
        if not self.on_arcs.any():
            return None
        condition = np.where(self.on_arcs, self.condition_number, np.inf)
        ring, spoke = np.unravel_index(int(condition.argmin()), condition.shape)
        return int(ring), int(spoke)

    @property
    def area(self) -> float:
        """Solid angle of the directions on the arcs, [sr]."""
        from scipy.integrate import trapezoid

        # Rings lie evenly in the angle from the middle: the trapezoidal rule with its sine.
        angle = np.linspace(0, np.pi / 2, len(self.margin))
        share = self.on_arcs[:, :-1].mean(axis=1) * np.sin(angle)
        return float(2 * np.pi * trapezoid(share, angle))

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write the map to a .csv, one row for each direction, or .npz, one array per attribute."""
        write_files({as_path(path): self.writer(path)}, force)

    def writer(self, path: str | Path) -> Writer:
        """A writer of the map in the format of the path's ending, .csv or .npz."""
        arrays: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        if require_ending(path, ".csv", ".npz") == ".npz":
            return lambda file: np.savez_compressed(file, **arrays)
        names = [f"{name}_rad" if name in _ANGLES else name for name in arrays]
        # The middle and the first spoke once, not once more for each spoke and at the end.
        rows = np.column_stack([array[1:, :-1].ravel() for array in arrays.values()])
        middle = [array[0, 0] for array in arrays.values()]
        return table_writer(names, np.vstack([middle, rows]))


_ANGLES = ("theta", "phi", "psi", "margin", "roll")


def workspace_at(robot: SST, psi: float = 0.0, rings: int = 151, spokes: int = 360) -> WorkspaceMap:
    """The map at one roll psi of the star, the paper's angle; about half a second.

    The poles of the base frame do not have this angle: curves of the map meet in z_0. `rings` are
    directions from the middle of the map to its edge, `spokes` those round it.
    """
    return _workspace(robot, single_array("psi", psi, ())[None], rings, spokes)


def workspace_over_rolls(
    robot: SST, rolls: int = 72, rings: int = 61, spokes: int = 180
) -> WorkspaceMap:
    """The map over the whole turn about s, each direction with its best psi; some seconds."""
    count = whole_number("rolls", rolls, 1)
    if count > _MOST:
        raise InputError("rolls", f"{count} are too many")
    return _workspace(robot, np.arange(count) * 2 * np.pi / count, rings, spokes)


def _workspace(robot: SST, psi: Array, rings: int, spokes: int) -> WorkspaceMap:
    from scipy.spatial.transform import Rotation

    size = whole_number("rings", rings, 3) * whole_number("spokes", spokes, 3) * len(psi)
    if size > _MOST:
        raise InputError("rings, spokes", f"{size} poses, at most {_MOST} fit into the memory")
    chart = Chart.of_robot(robot)
    s = chart.directions(chart.grid(rings, spokes))
    s[:, -1] = s[:, 0]  # to the last bit
    theta, phi = np.arctan2(s[..., 1], s[..., 0]), np.arccos(np.clip(s[..., 2], -1, 1))
    R = orientation(theta, phi)
    rolls = Rotation.from_euler("x", psi[:, None]).as_matrix()  # s is the x axis of {E}
    # One psi at a time: a million poses at once would fill the memory.
    poses = [_poses(robot, R @ roll) for roll in rolls]
    arrays = {name: np.stack([pose[name] for pose in poses]) for name in poses[0]}
    margin = arrays.pop("margin")
    kept = (margin >= 0) | ~(margin >= 0).any(axis=0)
    chosen = np.where(kept, arrays["condition_number"], np.inf).argmin(axis=0)[None]
    best = {name: np.take_along_axis(x, chosen, axis=0)[0] for name, x in arrays.items()}
    roll = _positive_share(margin) * 2 * np.pi
    psi = np.broadcast_to(psi[chosen[0]], theta.shape)
    return WorkspaceMap(theta, phi, psi, margin=np.fmax.reduce(margin), roll=roll, **best)


def _poses(robot: SST, R: Array) -> dict[str, NDArray[Any]]:
    """Quantities of the map at orientations of shape (..., 3, 3), flat legs included."""
    geometry, model = robot.geometry, robot.mechanism.model
    n = np.einsum("...ij,kj->...ki", R, geometry.arc_normals)
    first_kind = np.linalg.norm(np.cross(geometry.e, n), axis=-1).min(axis=-1)
    defined = first_kind > _FLAT
    legs = kinematics.legs_of_orientation(geometry, R[defined], (1, 1, 1))
    q = kinematics.joints_of_legs(geometry, legs)
    singular_values = np.linalg.svd(legs.y_2, compute_uv=False)
    limits = np.minimum(q - model.lowerPositionLimit, model.upperPositionLimit - q).min(axis=-1)
    with np.errstate(divide="ignore"):
        condition = singular_values[:, 0] / singular_values[:, -1]

    def everywhere(values: NDArray[Any], else_: float) -> NDArray[Any]:
        result = np.full(R.shape[:-2], else_, dtype=values.dtype)
        result[defined] = values
        return result

    return {
        "reachable": everywhere(limits >= 0, False),
        "first_kind": first_kind,
        "determinant": everywhere(np.linalg.det(legs.y_2), np.nan),
        "condition_number": everywhere(np.where(limits >= 0, condition, np.inf), np.inf),
        "margin": everywhere(np.minimum(limits, arc_margins(geometry, q).min(axis=-1)), np.nan),
    }


def _positive_share(margin: Array) -> Array:
    """Share of a closed round of samples, along the first axis, on which a function is positive.

    Between two samples it is taken for straight; NaN counts as negative.
    """
    here = np.where(np.isnan(margin), -1.0, margin)
    there = np.roll(here, -1, axis=0)
    above = np.maximum(here, 0) + np.maximum(there, 0)
    size = np.abs(here) + np.abs(there)
    return np.asarray((above / np.where(size > 0, size, 1)).mean(axis=0))

# SPDX-License-Identifier: BSD-2-Clause
"""A grid of poses in which two of x, y, z, roll, pitch and yaw change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arrays import Array, Flags
from ..errors import InputError

#: Components of a pose, in the order of a twist [linear; angular].
COMPONENTS = ("x", "y", "z", "roll", "pitch", "yaw")


def grid_axes(prescribed: Mapping[str, Array]) -> tuple[str, str]:
    """Names of the two components that are grids; anything else is refused."""
    axes = [name for name, values in prescribed.items() if values.ndim > 0]
    if len(axes) != 2 or any(prescribed[axis].ndim != 1 for axis in axes):
        raise InputError(", ".join(COMPONENTS), "exactly two of them must be arrays, of shape (N,)")
    for axis in axes:
        if len(prescribed[axis]) < 2 or (np.diff(prescribed[axis]) <= 0).any():
            raise InputError(axis, "a grid has two values or more, increasing")
    return axes[0], axes[1]


@dataclass(frozen=True)
class PoseGrid:
    """The wanted poses of a frame, on N x M points.

    The position of the frame is prescribed as a whole if x, y or z is given, its orientation as a
    whole if an angle is given. If only one of the two is prescribed, the other one is ignored.
    """

    #: A number or the values of a grid for each component that is given.
    prescribed: Mapping[str, Array]
    #: The two components that are grids.
    axes: tuple[str, str]

    @property
    def values(self) -> tuple[Array, Array]:
        """Values of both axes, shapes (N,) and (M,)."""
        return self.prescribed[self.axes[0]], self.prescribed[self.axes[1]]

    @property
    def shape(self) -> tuple[int, int]:
        """N and M."""
        first, second = self.values
        return len(first), len(second)

    @property
    def with_position(self) -> bool:
        """Whether the position is prescribed."""
        return not self.prescribed.keys().isdisjoint(COMPONENTS[:3])

    @property
    def with_orientation(self) -> bool:
        """Whether the orientation is prescribed."""
        return not self.prescribed.keys().isdisjoint(COMPONENTS[3:])

    @property
    def is_prescribed(self) -> Flags:
        """Which components of a twist [linear; angular] are prescribed, c of them, shape (6,)."""
        return np.repeat([self.with_position, self.with_orientation], 3)

    @property
    def names(self) -> NDArray[np.str_]:
        """Names of the prescribed components, shape (c,)."""
        return np.array(COMPONENTS)[self.is_prescribed]

    def component(self, name: str, default: float) -> Array:
        """The value of a component at each point, shape (N, M)."""
        first, second = np.meshgrid(*self.values, indexing="ij")
        if name == self.axes[0]:
            return first
        if name == self.axes[1]:
            return second
        return np.full(self.shape, self.prescribed.get(name, default))

    def poses(self, default_position: Array, orientation_at_zero: Array) -> Array:
        """Homogeneous matrices, shape (N, M, 4, 4).

        Args:
            default_position: x, y and z where they are not given, shape (3,).
            orientation_at_zero: The orientation where the angles are 0, shape (3, 3).
        """
        x0, y0, z0 = default_position
        positions = np.stack(
            [self.component("x", x0), self.component("y", y0), self.component("z", z0)], axis=-1
        )
        angles = np.stack([self.component(name, 0.0) for name in ("roll", "pitch", "yaw")], axis=-1)
        poses = np.empty((*self.shape, 4, 4))
        for point in np.ndindex(self.shape):
            rotation = pin.rpy.rpyToMatrix(angles[point]) @ orientation_at_zero
            poses[point] = pin.SE3(rotation, positions[point]).homogeneous
        return poses

    def point_of(self, pose: pin.SE3, orientation_at_zero: Array) -> Array:
        """Where a pose is on the grid, in steps of the grid along both axes, shape (2,)."""
        angles = pin.rpy.matrixToRpy(pose.rotation @ orientation_at_zero.T)
        components = dict(zip(COMPONENTS, [*pose.translation, *angles], strict=True))
        point = np.empty(2)
        for k, (axis, values) in enumerate(zip(self.axes, self.values, strict=True)):
            point[k] = np.interp(components[axis], values, np.arange(len(values)))
        return point

    def tangents(self) -> Array:
        """Derivatives of the poses by both axes, shape (N, M, c, 2), as twists in base axes.

        Only prescribed components of the twists [linear; angular] are returned.
        """
        return self._tangents(self.component("pitch", 0.0), self.component("yaw", 0.0))

    def tangents_at(self, pose: pin.SE3, orientation_at_zero: Array) -> Array:
        """Derivatives as those of `tangents`, at a pose off the grid too, shape (c, 2)."""
        angles = pin.rpy.matrixToRpy(pose.rotation @ orientation_at_zero.T)
        return self._tangents(angles[1], angles[2])

    def _tangents(self, pitch: Array, yaw: Array) -> Array:
        """Derivatives of poses by both axes for angles of shape (...), (..., c, 2)."""
        zero = np.zeros(np.shape(pitch))
        one = np.ones(np.shape(pitch))
        # The orientation is R_z(yaw) R_y(pitch) R_x(roll): the axis of each angle in base axes.
        rotation_axes = {
            "roll": [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)],
            "pitch": [-np.sin(yaw), np.cos(yaw), zero],
            "yaw": [zero, zero, one],
        }
        twists = np.zeros((*np.shape(pitch), 6, 2))
        for k, axis in enumerate(self.axes):
            if axis in rotation_axes:
                twists[..., 3:, k] = np.stack(rotation_axes[axis], axis=-1)
            else:
                twists[..., COMPONENTS.index(axis), k] = 1.0
        return twists[..., self.is_prescribed, :]

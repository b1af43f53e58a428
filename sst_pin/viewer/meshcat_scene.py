# SPDX-License-Identifier: BSD-2-Clause
"""A scene as Meshcat's commands, which stay in this process."""

from collections.abc import Callable, Iterator
from typing import Any

import meshcat
import numpy as np
import umsgpack
from meshcat.animation import Animation
from meshcat.geometry import MeshPhongMaterial, TriangularMeshGeometry
from scipy.spatial.transform import Rotation

from ..arrays import Array
from ..simulation.trajectories import Trajectory
from .robot_scene import Scene
from .scene_parts import Shape

#: Name of the robot's node in the tree of the page.
_ROOT = "robot"
#: Name of the ghost, which is a node below the robot. Its shapes are in one layer of this name.
_GHOST = "ghost"
#: Opacity of the ghost.
_FAINT = 0.3


class CommandBuffer:
    """Stands for Meshcat's connection to a browser, and keeps the last command for every node.

    `meshcat.Visualizer` calls it a window.
    """

    def __init__(self) -> None:
        #: Packed commands for the page, by type, node and property.
        self.commands: dict[tuple[str, str, str], bytes] = {}
        self.listener: Callable[[bytes], None] | None = None  #: Receives each command.

    def send(self, command: Any) -> None:
        """Receive a command of Meshcat."""
        message = command.lower()
        kind = message["type"]
        path = message.get("path", "")
        packed = umsgpack.packb(message)
        if kind == "delete":
            # The commands of this node and of all nodes below it.
            for key in list(self.commands):
                _, node, _ = key
                if f"{node}/".startswith(f"{path}/"):
                    del self.commands[key]
        else:
            # The new command goes to the end, so that an animation follows the nodes that it moves.
            key = (kind, path, message.get("property", ""))
            self.commands.pop(key, None)
            self.commands[key] = packed
        if self.listener is not None:
            self.listener(packed)


class MeshcatScene:
    """Draws motions of one robot by commands to `buffer`."""

    def __init__(self, scene: Scene) -> None:
        self.buffer = CommandBuffer()
        self._scene = scene
        self._root = meshcat.Visualizer(window=self.buffer)
        # The page has a grid and lights of its own.
        for node in ("/Grid", "/Axes", "/Lights"):
            self._root[node].set_property("visible", False)
        for shape in (*scene.shapes, *(arrow.shape for arrow in scene.arrows)):
            self._add(shape)
        self._animated = False  # whether the page plays a motion

    def place(self, q: Array, effort: Array) -> None:
        """Show a configuration with an effort (see `scene_parts`)."""
        if self._animated:
            self._root.set_animation(Animation())
            self._root[f"{_ROOT}/0/trail"].delete()
            self._root[f"{_ROOT}/{_GHOST}"].delete()
            self._animated = False
        for node, matrix in self._placements(q, effort).items():
            self._root[node].set_transform(matrix)

    def animate(
        self, motion: Trajectory, effort: Array, wanted: Array, ghost: Trajectory | None
    ) -> None:
        """Animate a motion of n samples, at least two, in the page.

        Args:
            motion: The motion.
            effort: Efforts at its samples, shape (n, size).
            wanted: Configurations of the reference path, shape (m, nq).
            ghost: A second motion, of a translucent robot.
        """
        self.place(motion.q[0], effort[0])
        self._animated = True
        animation = Animation(default_framerate=1)  # so that a frame number is a time, [s]
        matrices_of_samples = []
        for q, shares in zip(motion.q, effort, strict=True):
            matrices_of_samples.append(self._placements(q, shares))
        self._add_keys(animation, motion.t - motion.t[0], matrices_of_samples)
        if ghost is not None:
            self._add_ghost(animation, ghost.q, ghost.t - motion.t[0])
        if self._scene.point:
            self._add(self._scene.reference(wanted))
            self._add(self._scene.trail(motion.q))
        self._root.set_animation(animation)

    def _add_ghost(self, animation: Animation, configurations: Array, times: Array) -> None:
        """Add a translucent robot, and keyframes for its configurations at some times, [s]."""
        movers = list[str]()
        for shape in self._scene.moving_shapes:
            # A node for the ghost, a node for its layer, and below these the movers of the robot.
            mover = f"{_GHOST}/{_GHOST}/{shape.mover}"
            self._add(shape._replace(mover=mover, opacity=_FAINT * shape.opacity))
            if shape.mover not in movers:
                movers.append(shape.mover)
        matrices_of_samples = []
        for q in configurations:
            poses = self._scene.poses(q)
            matrices = {}
            for mover in movers:
                matrices[f"{_ROOT}/{_GHOST}/{_GHOST}/{mover}"] = poses[mover]
            matrices_of_samples.append(matrices)
        for node, matrix in matrices_of_samples[0].items():
            self._root[node].set_transform(matrix)
        self._add_keys(animation, times, matrices_of_samples)

    def _add_keys(
        self, animation: Animation, times: Array, matrices_of_samples: list[dict[str, Array]]
    ) -> None:
        """Add keyframes to an animation, for homogeneous matrices of nodes at some times, [s]."""
        for node in matrices_of_samples[0]:
            key = animation.at_frame(self._root[node], 0.0)
            for name, kind, values in _tracks([matrices[node] for matrices in matrices_of_samples]):
                for time, value in zip(times.tolist(), values, strict=True):
                    key.current_frame = time
                    key.set_property(name, kind, value)

    def _add(self, shape: Shape) -> None:
        """Add a shape as a node of the page."""
        vertices, faces = shape.mesh
        material = MeshPhongMaterial(
            color=int(shape.colour[1:], 16), opacity=shape.opacity, transparent=shape.opacity < 1
        )
        geometry = TriangularMeshGeometry(vertices.astype(np.float32), faces)
        node = self._root[f"{_ROOT}/{shape.node}"]
        node.set_object(geometry, material)
        node.set_transform(shape.at)

    def _placements(self, q: Array, effort: Array) -> dict[str, Array]:
        """Homogeneous matrices of all nodes that move."""
        matrices = self._scene.poses(q)
        matrices |= {arrow.shape.node: arrow.placement(effort) for arrow in self._scene.arrows}
        return {f"{_ROOT}/{node}": matrix for node, matrix in matrices.items()}


def _tracks(matrices: list[Array]) -> Iterator[tuple[str, str, list[list[float]]]]:
    """Tracks of a node: name, type and values over time. Values that do not change are left out.

    They are the position, the orientation as a quaternion x, y, z, w, and the scale of each axis.
    """
    # A = R diag(scale): the lengths of the columns of A are the scales, shape (n, 3). A mirrored
    # node has a negative determinant; a negative scale along y makes R a rotation.
    A = np.array(matrices)[:, :3, :3]
    scale = np.linalg.norm(A, axis=1)
    scale[np.linalg.det(A) < 0, 1] *= -1
    R = A / scale[:, None, :]  # each column of each matrix is divided by its scale
    position = np.array(matrices)[:, :3, 3]
    for name, kind, values in (
        ("position", "vector3", position),
        ("quaternion", "quaternion", Rotation.from_matrix(R).as_quat()),
        ("scale", "vector3", scale),
    ):
        if (np.ptp(values, axis=0) > 1e-12).any():  # less is rounding of numbers near one
            yield name, kind, values.tolist()

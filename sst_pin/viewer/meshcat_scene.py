# SPDX-License-Identifier: BSD-2-Clause
"""A robot in a Meshcat scene, drawn through Pinocchio's visualiser."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import meshcat
import numpy as np
import pinocchio as pin
from meshcat.animation import Animation
from meshcat.geometry import MeshLambertMaterial, TriangularMeshGeometry
from numpy.typing import NDArray
from pinocchio.visualize import MeshcatVisualizer

from ..chain.closed_chain import ClosedChain
from ..errors import InputError
from ..motion.trajectories import Trajectory
from ..robots import GalleryRobot
from .command_buffer import CommandBuffer
from .markers import Markers, Shape, parts
from .star import Star

Array = NDArray[np.float64]

#: Samples that a page is given at most.
_MOST_SAMPLES = 600
#: Of the camera, upwards, [degrees]; and whence it looks, in base axes.
_FIELD_OF_VIEW, _VIEW = 24.0, np.array((1.0, 0.7, 0.6))


class MeshcatScene:
    """Draws motions of one robot.

    Attributes:
        buffer: Takes the commands.
        markers: What is drawn beside the bodies; None for another robot than an SST.
        start: Configuration before one is asked for, shape (nq,).
        camera: Where the page's camera stands, what it looks at, its field of view.

    Args:
        robot: As for `Viewer`.
        visual_model: As for `Viewer`.
    """

    def __init__(self, robot: ClosedChain, visual_model: pin.GeometryModel | None) -> None:
        self.buffer = CommandBuffer()
        self.markers = Markers(robot) if isinstance(robot, Star) else None
        self._visualizer: Any
        with _bodies_of(robot, visual_model) as bodies:
            self._visualizer = MeshcatVisualizer(robot.model, None, bodies)
            self._visualizer.initViewer(viewer=meshcat.Visualizer(window=self.buffer))
            self._visualizer.loadViewerModel()
        self._root = self._visualizer.viewer
        for node in ("/Grid", "/Axes"):
            self._root[node].set_property("visible", False)
        for side in ("top_color", "bottom_color"):
            self._root["/Background"].set_property(side, [1.0, 1.0, 1.0])
        for shape in self.markers.shapes if self.markers else ():
            self._add(shape)
        self._animated = False
        self.start = (
            robot.home if isinstance(robot, (Star, GalleryRobot)) else pin.neutral(robot.model)
        )
        self.camera = self._camera(self.start)

    def place(self, q: Array, effort: Array) -> None:
        """Put everything where it is at a configuration.

        Args:
            q: Configuration, shape (nq,).
            effort: Motor torques as a share of the largest, shape (n,).
        """
        if self._animated:
            self._root.set_animation(Animation())
            self._root["sst/path"].delete()
            self._root["sst/trail"].delete()
            self._animated = False
        for node, matrix in self._placements(q, effort).items():
            self._root[node].set_transform(matrix)

    def animate(self, motion: Trajectory, wanted: Trajectory) -> Trajectory:
        """Let the page move everything along a motion.

        Args:
            motion: Of two samples at least.
            wanted: The motion whose path of E is the reference.

        Returns:
            The samples that the page knows.
        """
        motion = _thinned(motion)
        effort = motion.tau / (np.abs(motion.tau).max() or 1.0)
        self.place(motion.q[0], effort[0])
        self._animated = True
        times = motion.t - motion.t[0]
        animation = Animation(default_framerate=1)  # its frames are seconds
        placed = [self._placements(q, e) for q, e in zip(motion.q, effort, strict=True)]
        for node in placed[0]:
            key = animation.at_frame(self._root[node], 0.0)
            for name, kind, values in _tracks([matrices[node] for matrices in placed]):
                for key.current_frame, value in zip(times.tolist(), values, strict=True):
                    key.set_property(name, kind, value)
        if self.markers:
            self._add(self.markers.reference(_thinned(wanted).q))
            self._add(self.markers.trail(motion.q))
        self._root.set_animation(animation)
        return motion

    # --- inside -----------------------------------------------------------------------------

    def _add(self, shape: Shape) -> None:
        vertices, faces = shape.mesh
        material = MeshLambertMaterial(color=int(shape.colour[1:], 16))
        geometry = TriangularMeshGeometry(vertices.astype(np.float32), faces)
        self._root[f"sst/{shape.node}"].set_object(geometry, material)

    def _placements(self, q: Array, effort: Array) -> dict[str, Array]:
        """Homogeneous matrices of all nodes that move or have moved."""
        v = self._visualizer
        pin.forwardKinematics(v.model, v.data, q)
        pin.updateGeometryPlacements(v.model, v.data, v.visual_model, v.visual_data)
        bodies = zip(v.visual_model.geometryObjects, v.visual_data.oMg, strict=True)
        placed = {
            v.getViewerNodeName(body, pin.GeometryType.VISUAL): (
                where.homogeneous @ np.diag([*body.meshScale, 1.0])
            )
            for body, where in bodies
        }
        if self.markers:
            marked = self.markers.placements(q, effort)
            placed |= {f"sst/{node}": matrix for node, matrix in marked.items()}
        return placed

    def _camera(self, q: Array) -> dict[str, Any]:
        """A view that holds the robot at a configuration, whatever its size."""
        v = self._visualizer
        pin.forwardKinematics(v.model, v.data, q)
        pin.updateGeometryPlacements(v.model, v.data, v.visual_model, v.visual_data)
        corners = []
        for body, where in zip(v.visual_model.geometryObjects, v.visual_data.oMg, strict=True):
            body.geometry.computeLocalAABB()
            box = np.array([body.geometry.aabb_local.min_, body.geometry.aabb_local.max_])
            corners += [where.act(np.array(corner)) for corner in itertools.product(*box.T)]
        low, high = np.min(corners, axis=0), np.max(corners, axis=0)
        size = float(np.linalg.norm(high - low)) / 2
        target = (low + high) / 2 + (0, 0, 0.08 * size)  # boxes of arcs reach too low
        distance = 0.76 * size / np.sin(np.radians(_FIELD_OF_VIEW) / 2)
        position = target + distance * _VIEW / np.linalg.norm(_VIEW)
        return {"position": position.tolist(), "target": target.tolist(), "fov": _FIELD_OF_VIEW}


def _thinned(motion: Trajectory) -> Trajectory:
    if len(motion) <= _MOST_SAMPLES:
        return motion
    kept = np.linspace(0, len(motion) - 1, _MOST_SAMPLES).round().astype(int)
    t, q, va, aa, tau = (getattr(motion, name)[kept] for name in ("t", "q", "va", "aa", "tau"))
    return Trajectory(t, q, va, aa, tau, motion.joint_names, motion.actuated, motion.units)


def _tracks(matrices: list[Array]) -> Iterator[tuple[str, str, list[list[float]]]]:
    """What changes of position, quaternion and scale."""
    kinds = {"position": "vector3", "quaternion": "quaternion", "scale": "vector3"}
    for (name, kind), values in zip(kinds.items(), parts(np.array(matrices)), strict=True):
        if (np.ptp(values, axis=0) > 1e-12).any():
            yield name, kind, values.tolist()


@contextmanager
def _bodies_of(robot: ClosedChain, given: pin.GeometryModel | None) -> Iterator[pin.GeometryModel]:
    """Shapes of a robot's bodies, those that are given or its own.

    Raises:
        InputError: When there are neither.
    """
    if given is not None:
        yield given
    elif isinstance(robot, Star):
        with robot.shapes.geometry_model(robot.model) as model:
            yield model
    elif isinstance(robot, GalleryRobot):
        yield robot.visual_model
    else:
        raise InputError("visual_model", "a ClosedChain does not know its shapes; give them")

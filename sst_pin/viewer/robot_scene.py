# SPDX-License-Identifier: BSD-2-Clause
"""The scene of a robot for the viewers: shapes, arrows, labels, layers."""

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..description.colours import HUES
from ..errors import InputError
from ..loops.start import start_of
from ..model.appearance import drawn_frame
from . import sketch
from .scene_parts import Arrow, Dot, Pull, Shape, moved
from .triangles import body_shapes, tube

#: Layers that can be shown and hidden, in the order of their checkboxes.
LAYERS = (
    "bodies",
    "skeleton",
    "inertia",
    "torques",
    "trail",
    "axes",
    "frames",
    "contacts",
    "reactions",
)
_TRAIL = "#8E24AA"
_PATH = "#A9B0B6"
TRAIL_SIDES = 8
#: The largest arrow, as a share of the robot's length.
_ARROW = 0.45
#: Directions in which the robot's reach is computed, and samples of a motion for it.
_DIRECTIONS = 150
_SAMPLES = 60
#: Unit vectors are parallel if their cross product is smaller.
_PARALLEL = 1e-3


class Scene:
    """Shapes of a robot, in the order in which they are drawn; the arguments are as in `Viewer`.

    At first skeleton and masses are visible only if the bodies have no shapes. `scene_parts`
    explains shapes, arrows and movers.

    Attributes:
        start: The first configuration, shape (nq,).
        size: A length of the robot, [m].
        point: The frame whose path is drawn, or None.
        shapes: All shapes that do not change with the torques; those of the bodies come first.
        struts: Shapes that run from one body to another.
        touches: Places of the contacts, which move as no body does.
        arrows: Torques of the motors, then forces of reactions, then forces of contacts.
        reactions: Number of the forces of reactions: one for each joint and closure, or none.
        labels: Words in the scene.
        layers: The layers of this scene, and whether each is shown at first.
        face: Where the camera stands to see a planar robot face-on, seen from the robot; or None.
        ground: Height of the plane of all contacts in the world, if it is one level plane, or None.
    """

    def __init__(
        self,
        robot: ClosedChain,
        visual_model: pin.GeometryModel | None,
        *,
        axes: bool = False,
        frames: bool = False,
        frame: str | None = None,
        reactions: bool = False,
    ) -> None:
        if not isinstance(robot, ClosedChain):
            raise InputError("robot", f"a ClosedChain is needed, not {type(robot).__name__}")
        model = robot.mechanism.model
        self._model = model
        self._data = model.createData()

        # Shapes of the bodies.
        bodies = robot.visual_model if visual_model is None else visual_model
        self.shapes = list[Shape]()
        for body in bodies.geometryObjects:
            self.shapes += body_shapes(body)
        has_no_shapes = not self.shapes

        # The pose in which the robot is measured, and its size.
        self.start = start_of(robot.engine, chosen=True)
        self.point = robot.appearance.point if frame is None else drawn_frame(model, frame)
        rate_axes = sketch.axes_of(model, self._data, self.start)
        self.size = self._size(robot)
        size = self.size
        B = robot.actuation

        # Shapes beside those of the bodies. A joint has the colour of its first motor.
        colours = dict[int, str]()
        for rate, motor in np.argwhere(B):
            colours.setdefault(rate_axes[rate].joint, HUES[motor % len(HUES)])
        self.struts = list(sketch.struts(robot, rate_axes, size))
        self.touches = sketch.touches_of(robot)
        axes_and_frames, self.labels = sketch.labelled(robot, rate_axes, self.point, size)
        self.shapes += sketch.skeleton(robot, rate_axes, colours, size)
        self.shapes += sketch.masses(model)
        self.shapes += [strut.shape for strut in self.struts]
        self.shapes += sketch.contact_shapes(self.touches)
        self.shapes += axes_and_frames

        # Arrows, in the order of the effort.
        self.arrows: list[Arrow | Pull | Dot] = list(
            sketch.arrows_of(model, self._data, rate_axes, B, _ARROW * size)
        )
        self.reactions = model.njoints - 1 + len(robot.closures) if reactions else 0
        if reactions:
            self.arrows += sketch.pulls_of(robot, _ARROW * size)
        first = len(robot.motor_names) + 3 * self.reactions
        self.arrows += sketch.contact_forces_of(self.touches, first, _ARROW * size)

        # Layers, view and floor.
        present = {shape.layer for shape in self.shapes}
        present.update(arrow.shape.layer for arrow in self.arrows)
        if self.point:
            present.add("trail")
        self.face = self._face(rate_axes)
        self.ground = self._ground()
        # Others are shown at first.
        shown = {
            "skeleton": has_no_shapes,
            "inertia": has_no_shapes and self.face is None,
            "axes": axes,
            "frames": frames,
        }
        self.layers = {name: shown.get(name, True) for name in LAYERS if name in present}

    @property
    def moving(self) -> list[Shape]:
        """Shapes of the bodies that move, or of their skeleton where there are none."""
        layer = "bodies" if "bodies" in self.layers else "skeleton"
        return [shape for shape in self.shapes if shape.layer == layer and shape.mover != "0"]

    def poses(self, q: Array) -> dict[str, Array]:
        """Placements of the movers of the shapes: homogeneous matrices, with a scale for struts."""
        joints = self._joints(q)
        poses = {str(i): matrix for i, matrix in enumerate(joints)}
        poses |= {touch.node: touch.at(joints) for touch in self.touches}
        poses |= {strut.shape.mover: strut.at(joints) for strut in self.struts}
        return poses

    def outermost_points(self, q: Array, effort: Array, wanted: Array | None = None) -> Array:
        """The outermost points in many directions, of everything that is shown in a motion.

        `q` has shape (n, nq); `effort` are motor torques, then forces of reactions and of contacts,
        as shares of the largest, shape (n, ...); `wanted` are configurations of the reference path,
        q by default.
        """
        # The outermost points of each mover's shapes; arrows are at their largest in both senses.
        points_of_movers: dict[str, list[Array]] = {}

        def add(shape: Shape, at: Array) -> None:
            points = _farthest(moved(shape.mesh.vertices, at))
            points_of_movers.setdefault(shape.mover, []).append(points)

        for shape in self.shapes:
            if self.layers[shape.layer]:
                add(shape, shape.at)
        largest = np.abs(effort).max(axis=0)
        for arrow in self.arrows:
            add(arrow.shape, arrow.at(largest))
            add(arrow.shape, arrow.at(-largest))

        outermost = np.zeros((0, 3))
        if self.layers.get("trail"):
            outermost = self._path(q if wanted is None else np.vstack([q, wanted]))
        for i in np.unique(np.linspace(0, len(q) - 1, _SAMPLES).round().astype(int)):
            poses = self.poses(q[i])
            for mover, points in points_of_movers.items():
                placed = moved(np.vstack(points), poses[mover])
                outermost = np.vstack([outermost, placed])
            outermost = _farthest(outermost)
        return outermost

    def trail(self, q: Array) -> Shape:
        """The path of the point as a thick line, which the page draws up to the current time."""
        line = tube(self._path(q), 0.009 * self.size, TRAIL_SIDES)
        return Shape("0", "trail", "passed", line, _TRAIL)

    def reference(self, q: Array) -> Shape:
        """The path of the point as a thin line."""
        return Shape("0", "trail", "path", tube(self._path(q), 0.004 * self.size), _PATH)

    def _face(self, axes: list[sketch.Axis]) -> list[float] | None:
        """The normal of a robot whose joints all move it in parallel planes, else None."""
        joints = self._joints(self.start)
        rotation_axes = []
        slide_axes = []
        for axis in axes:
            direction = joints[axis.mover, :3, :3] @ axis.direction
            if axis.turns:
                rotation_axes.append(direction)
            else:
                slide_axes.append(direction)
        if not rotation_axes:
            return None
        normal = rotation_axes[0]
        if any(np.linalg.norm(np.cross(d, normal)) >= _PARALLEL for d in rotation_axes):
            return None
        if any(abs(d @ normal) > _PARALLEL for d in slide_axes):
            return None
        # From above, from the front, or from the right: the views of technical drawings.
        sign = 1.0 if normal @ (1, -1, 1) > 0 else -1.0
        x, y, z = sign * normal
        if np.hypot(x, y) < _PARALLEL:
            y = -1e-4  # a view from above needs a direction that is up
        return [float(x), float(y), float(z)]

    def _ground(self) -> float | None:
        """The height of the one level plane that contacts touch in the world."""
        heights = set[float]()
        for touch in self.touches:
            plane = touch.ground.placement
            is_level = plane.rotation[2, 2] > 1 - _PARALLEL**2
            if touch.ground.parentJoint == 0 and is_level:
                heights.add(float(plane.translation[2]))
        return heights.pop() if len(heights) == 1 else None

    def _joints(self, q: Array) -> Array:
        """Placements of the joints, homogeneous, shape (joints, 4, 4)."""
        pin.forwardKinematics(self._model, self._data, q)
        return np.array([at.homogeneous for at in self._data.oMi])

    def _path(self, q: Array) -> Array:
        """Positions of the point at configurations q, shape (n, nq): (n, 3), [m]."""
        assert self.point is not None
        poses = np.array([self._joints(x)[self.point.joint] for x in q])
        return poses[:, :3, :3] @ self.point.placement.translation + poses[:, :3, 3]

    def _size(self, robot: ClosedChain) -> float:
        """A length of the robot, [m]: given, or a quarter of the diagonal of its bounding box."""
        if robot.appearance.size is not None:
            return robot.appearance.size
        poses = self._joints(self.start)
        points = []
        for shape in self.shapes:
            on_body = moved(shape.mesh.vertices, shape.at)
            points.append(moved(on_body, poses[int(shape.mover)]))
        if not points:
            for of_body, pose in zip(sketch.joined_points(robot), poses, strict=True):
                if of_body:
                    points.append(moved(np.array(of_body), pose))
        diagonal = np.linalg.norm(np.ptp(np.vstack(points), axis=0))
        return float(diagonal) / 4 or 1.0


def _farthest(points: Array) -> Array:
    """Points that lie farthest out in the directions of a spiral from pole to pole of a sphere."""
    z = 1 - (2 * np.arange(_DIRECTIONS) + 1) / _DIRECTIONS
    turn = np.pi * (1 + np.sqrt(5)) * np.arange(_DIRECTIONS)
    r = np.sqrt(1 - z**2)
    directions = np.stack([r * np.cos(turn), r * np.sin(turn), z])
    return points[np.unique((points @ directions).argmax(axis=0))]

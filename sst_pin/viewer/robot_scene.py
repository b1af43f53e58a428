# SPDX-License-Identifier: BSD-2-Clause
"""The scene of a robot: shapes, arrows, labels, layers, and where they are in a motion."""

import itertools

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..description.colours import HUES
from ..errors import InputError
from ..loops.start import start_of
from ..model.appearance import drawn_frame
from .arrows import (
    contact_arrows,
    contact_places,
    contact_spheres,
    reaction_arrows,
    torque_arrows,
)
from .axis_labels import axes_with_labels
from .body_meshes import body_shapes
from .rate_axes import RateAxis, axes_of
from .scene_parts import EffortLayout, ForceArrow, ForceMark, Shape, TorqueArrow, transform
from .skeleton import joined_points, masses, skeleton
from .struts import struts
from .triangles import tube

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
#: The trail is a tube; its cross-section has this number of sides.
TRAIL_SIDES = 8
#: The largest arrow, as a share of the robot's length.
_ARROW = 0.45
#: Number of directions in which the outermost points are found, and of samples of a motion.
_DIRECTIONS = 150
_SAMPLES = 60
#: Two unit vectors are parallel if the length of their cross product is smaller, and orthogonal if
#: the size of their dot product is smaller.
_PARALLEL = 1e-3


class Scene:
    """What is drawn of a robot, and where it is in a configuration.

    The arguments are as in `Viewer`. `scene_parts` explains shapes, arrows, movers and efforts.

    Attributes:
        start: The first configuration, shape (nq,).
        size: A length of the robot, [m], to which lines, axes and arrows are scaled.
        point: The frame whose path is drawn, or None.
        shapes: All shapes that do not change with the effort; the shapes of bodies come first.
        struts: Shapes that run from one body to another.
        contacts: Places of the contacts. They are movers of their own, because the point of a
            sphere that touches the ground is not fixed to the body.
        layout: The order of the entries of an effort.
        arrows: Torques of the motors, then forces of reactions, then forces of contacts.
        labels: Words in the scene.
        layers: The layers of this scene, and whether each is shown at first.
        face: Direction from a planar robot to a camera that sees it face-on; None for other robots.
        ground: Height of the ground, [m], if all contacts with the world are on one level plane;
            else None.
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
        self._data = model.createData()  # for `_joints` only
        self.start = start_of(robot.engine, chosen=True)  # without a warning that home is missing
        self.point = robot.appearance.point if frame is None else drawn_frame(model, frame)

        # Shapes of the bodies, and the size of the robot.
        bodies = robot.visual_model if visual_model is None else visual_model
        shapes_of_bodies = list[Shape]()
        for body in bodies.geometryObjects:
            shapes_of_bodies += body_shapes(body)
        self.size = self._size(robot, shapes_of_bodies)
        size = self.size

        # Other shapes. Colours of joints, by number: a joint has the colour of its first motor.
        rate_axes = axes_of(model, self.start)
        colours = dict[int, str]()
        for rate, motor in np.argwhere(robot.actuation):
            colours.setdefault(rate_axes[rate].joint, HUES[motor % len(HUES)])
        self.struts = list(struts(robot, rate_axes, size))
        self.contacts = contact_places(robot)
        axes_and_frames, self.labels = axes_with_labels(robot, rate_axes, self.point, size)
        self.shapes = [
            *shapes_of_bodies,
            *skeleton(robot, rate_axes, colours, size),
            *masses(model),
            *(strut.shape for strut in self.struts),
            *contact_spheres(self.contacts),
            *axes_and_frames,
        ]

        # Arrows, in the order of the effort.
        scale = _ARROW * size
        self.layout = EffortLayout(
            motors=len(robot.motor_names),
            reactions=(model.njoints - 1 + len(robot.closures)) if reactions else 0,
            contacts=len(self.contacts),
        )
        self.arrows: list[TorqueArrow | ForceArrow | ForceMark] = list(
            torque_arrows(model, self.start, rate_axes, robot.actuation, scale)
        )
        if reactions:
            self.arrows += reaction_arrows(robot, self.layout, scale)
        self.arrows += contact_arrows(self.contacts, self.layout, scale)

        # View and floor.
        self.face = self._face(rate_axes)
        self.ground = self._ground()

        # Layers. At first skeleton and masses are shown only if the bodies have no shapes.
        is_shown = dict.fromkeys(LAYERS, True)
        is_shown["skeleton"] = not shapes_of_bodies
        is_shown["inertia"] = not shapes_of_bodies and self.face is None
        is_shown["axes"] = axes
        is_shown["frames"] = frames
        present = {shape.layer for shape in self.shapes}
        present.update(arrow.shape.layer for arrow in self.arrows)
        if self.point:
            present.add("trail")
        self.layers = {name: is_shown[name] for name in LAYERS if name in present}

    @property
    def moving_shapes(self) -> list[Shape]:
        """Shapes of the bodies that move, or of their skeleton where there are none."""
        layer = "bodies" if "bodies" in self.layers else "skeleton"
        return [shape for shape in self.shapes if shape.layer == layer and shape.mover != "0"]

    def poses(self, q: Array) -> dict[str, Array]:
        """Placements of all movers in the world, by name, for one configuration q."""
        joints = self._joints(q)
        poses = {str(i): matrix for i, matrix in enumerate(joints)}
        poses |= {place.node: place.placement(joints) for place in self.contacts}
        poses |= {strut.shape.mover: strut.placement(joints) for strut in self.struts}
        return poses

    def outermost_points(self, q: Array, effort: Array, wanted: Array | None = None) -> Array:
        """The outermost points in many directions, of everything that is shown in a motion.

        First the outermost points of each mover are found in its own frame. From these points, the
        outermost points in the world are found at samples of the motion.

        Args:
            q: Configurations, shape (n, nq).
            effort: Efforts, shape (n, size).
            wanted: Configurations of the reference path; q by default.

        Returns:
            Points in the world, shape (k, 3), [m].
        """
        # Points on each mover.
        points_of_movers: dict[str, list[Array]] = {}

        def add(shape: Shape, at: Array) -> None:
            points = _farthest(transform(shape.mesh.vertices, at))
            points_of_movers.setdefault(shape.mover, []).append(points)

        for shape in self.shapes:
            if self.layers[shape.layer]:
                add(shape, shape.at)
        # Each arrow is as long as it becomes in the motion. All signs are tried: two of a torque,
        # and, if forces are drawn, eight of the three components of a force.
        largest = np.abs(effort).max(axis=0)
        forces = self.layout.reactions + self.layout.contacts
        for signs in itertools.product((1.0, -1.0), repeat=3 if forces else 1):
            signs_of_torques = np.full(self.layout.motors, signs[0])
            signs_of_effort = np.concatenate([signs_of_torques, np.tile(signs, forces)])
            for arrow in self.arrows:
                add(arrow.shape, arrow.placement(largest * signs_of_effort))

        # Points in the world.
        outermost = np.zeros((0, 3))
        if self.layers.get("trail"):
            outermost = self._path(q if wanted is None else np.vstack([q, wanted]))
        for i in np.unique(np.linspace(0, len(q) - 1, _SAMPLES).round().astype(int)):
            poses = self.poses(q[i])
            for mover, points in points_of_movers.items():
                points_in_world = transform(np.vstack(points), poses[mover])
                outermost = np.vstack([outermost, points_in_world])
            outermost = _farthest(outermost)
        return outermost

    def trail(self, q: Array) -> Shape:
        """The path of the point as a thick line, which the page draws up to the current time."""
        line = tube(self._path(q), 0.009 * self.size, TRAIL_SIDES)
        return Shape("0", "trail", "passed", line, _TRAIL)

    def reference(self, q: Array) -> Shape:
        """The path of the point as a thin line."""
        return Shape("0", "trail", "path", tube(self._path(q), 0.004 * self.size), _PATH)

    def _face(self, axes: list[RateAxis]) -> list[float] | None:
        """The normal of the plane of motion of a planar robot, shape (3,); None for other robots.

        A robot is planar if all its rotations are about parallel axes and all its slides are normal
        to them.
        """
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
        # Of both sides of the plane, the camera takes the one that technical drawings show: from
        # above (z), from the front (-y), or from the right (x).
        sign = 1.0 if normal @ (1, -1, 1) > 0 else -1.0
        x, y, z = sign * normal
        if np.hypot(x, y) < _PARALLEL:
            y = -1e-4  # seen straight from above, no direction in the picture would be upwards
        return [float(x), float(y), float(z)]

    def _ground(self) -> float | None:
        """The height of the one level plane that contacts touch in the world."""
        heights = set[float]()
        for place in self.contacts:
            plane = place.ground.placement
            # The cosine of the angle between the normal and z, about 1 - angle^2 / 2.
            is_level = plane.rotation[2, 2] > 1 - _PARALLEL**2
            if place.ground.parentJoint == 0 and is_level:
                heights.add(float(plane.translation[2]))
        return heights.pop() if len(heights) == 1 else None

    def _joints(self, q: Array) -> Array:
        """Placements of the joints, homogeneous, shape (joints, 4, 4)."""
        pin.forwardKinematics(self._model, self._data, q)
        return np.array([at.homogeneous for at in self._data.oMi])

    def _path(self, q: Array) -> Array:
        """Positions of the point in the world, shape (n, 3), [m], for q of shape (n, nq)."""
        assert self.point is not None
        poses = np.array([self._joints(x)[self.point.joint] for x in q])
        return poses[:, :3, :3] @ self.point.placement.translation + poses[:, :3, 3]

    def _size(self, robot: ClosedChain, shapes_of_bodies: list[Shape]) -> float:
        """A length of the robot, [m]: the size in its `appearance`, or a length from its shapes.

        From shapes it is a quarter of the diagonal of their bounding box at the start; without
        shapes, of the bounding box of the skeleton.
        """
        if robot.appearance.size is not None:
            return robot.appearance.size
        poses = self._joints(self.start)
        points = []
        for shape in shapes_of_bodies:
            on_body = transform(shape.mesh.vertices, shape.at)
            points.append(transform(on_body, poses[int(shape.mover)]))
        if not points:
            for points_of_body, pose in zip(joined_points(robot), poses, strict=True):
                if points_of_body:
                    points.append(transform(np.array(points_of_body), pose))
        diagonal = np.linalg.norm(np.ptp(np.vstack(points), axis=0))
        return float(diagonal) / 4 or 1.0  # 1 m for a robot whose points are all the same


def _farthest(points: Array) -> Array:
    """Those of the points, shape (n, 3), that lie farthest out in one of many directions.

    The directions are evenly spread over the sphere, as a Fibonacci lattice: z decreases in equal
    steps from pole to pole, and the angle about z grows by 2 pi times the golden ratio.
    """
    z = 1 - (2 * np.arange(_DIRECTIONS) + 1) / _DIRECTIONS
    # The golden ratio is (1 + sqrt(5)) / 2.
    angle = np.pi * (1 + np.sqrt(5)) * np.arange(_DIRECTIONS)
    r = np.sqrt(1 - z**2)
    directions = np.stack([r * np.cos(angle), r * np.sin(angle), z])  # shape (3, directions)
    farthest = (points @ directions).argmax(axis=0)
    return points[np.unique(farthest)]

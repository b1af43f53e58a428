# SPDX-License-Identifier: BSD-2-Clause
"""The scene of a robot for the viewers: shapes, arrows, labels, layers."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..chain.appearance import drawn_frame
from ..chain.closed_chain import ClosedChain
from ..chain.starts import start_of
from ..description.colours import HUES
from ..errors import InputError
from .bodies import body_shapes
from .joints import arrows_of, axes_of, pulls_of
from .names import names_of
from .scene_parts import Arrow, Pull, Shape
from .skeleton import masses, points_of, skeleton, struts
from .triangles import tube

#: Layers that can be shown and hidden, in the order of their boxes; reactions only on demand.
LAYERS = ("bodies", "skeleton", "inertia", "torques", "trail", "axes", "frames")
_TRAIL, _PATH = "#8E24AA", "#A9B0B6"
TRAIL_SIDES = 8
#: The largest arrow, as a share of the robot's length.
_LARGEST = 0.45
#: Directions in which the robot's reach is known, and samples of a motion that it is taken from.
_DIRECTIONS, _SAMPLES = 150, 60


class Scene:
    """A robot as shapes: its bodies, or where it has none a skeleton and its masses.

    The arguments are those of `Viewer`.

    Attributes:
        shapes: All shapes that do not change with the torques.
        arrows: Torques of the motors, and the forces of reactions.
        labels: Labels.
        layers: Existing ones of `LAYERS`, and whether each is shown at first.
        start: Configuration before one is asked for, shape (nq,).
        struts: Those of the shapes that run from one body to another.
        size: A length of the robot, [m].
        point: The frame whose path is drawn, or None.
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
        self._model, self._data = robot.mechanism.model, robot.mechanism.model.createData()
        model = self._model
        bodies = robot.visual_model if visual_model is None else visual_model
        self.shapes = [shape for body in bodies.geometryObjects for shape in body_shapes(body)]
        bare = not self.shapes
        self.start = start_of(robot)
        self.point = robot.appearance.point if frame is None else drawn_frame(model, frame)
        lines = axes_of(model, self._data, self.start)
        self.size = size = self._size(robot)
        B = robot.actuation
        colours = {lines[i].joint: HUES[motor % len(HUES)] for i, motor in np.argwhere(B)[::-1]}
        self.shapes += skeleton(robot, lines, colours, size)
        self.shapes += masses(model)
        self.struts = list(struts(robot, lines, size))
        self.shapes += [strut.shape for strut in self.struts]
        self.arrows: list[Arrow | Pull] = list(
            arrows_of(model, self._data, lines, B, _LARGEST * size)
        )
        if reactions:
            self.arrows += pulls_of(robot, _LARGEST * size)
        named, self.labels = names_of(robot, lines, self.point, size)
        self.shapes += named
        self._width = 0.009 * size
        there = {shape.layer for shape in (*self.shapes, *(a.shape for a in self.arrows))}
        if self.point:
            there.add("trail")
        shown = {"skeleton": bare, "inertia": bare, "axes": axes, "frames": frames}
        self.layers = {
            name: shown.get(name, True) for name in (*LAYERS, "reactions") if name in there
        }

    @property
    def moving(self) -> list[Shape]:
        """Shapes of the bodies that move, or of their skeleton where there are none."""
        layer = "bodies" if "bodies" in self.layers else "skeleton"
        return [shape for shape in self.shapes if shape.layer == layer and shape.mover != "0"]

    def poses(self, q: Array) -> dict[str, Array]:
        """Placements of the movers of the shapes: homogeneous matrices, with a scale for struts."""
        joints = self._joints(q)
        placed = {str(i): matrix for i, matrix in enumerate(joints)}
        return placed | {strut.shape.mover: strut.at(joints) for strut in self.struts}

    def reach(self, q: Array, tau: Array, wanted: Array | None = None) -> Array:
        """The outermost points in many directions, of everything that is shown in a motion.

        Args:
            q: Configurations, shape (n, nq).
            tau: Motor torques, then forces of reactions, as shares of the largest, shape (n, ...).
            wanted: Configurations of the reference path, shape (m, nq); q by default.
        """
        directions = _directions()
        kept = np.unique(np.linspace(0, len(q) - 1, _SAMPLES).round().astype(int))
        largest = np.abs(tau).max(axis=0)
        solids = [(s.mover, s.at, s.mesh.vertices) for s in self.shapes if self.layers[s.layer]]
        solids += [
            (a.shape.mover, a.at(sign * largest), a.shape.mesh.vertices)
            for a in self.arrows
            for sign in (1, -1)
        ]
        clouds: dict[str, list[Array]] = {}
        for mover, at, vertices in solids:
            placed = vertices @ at[:3, :3].T + at[:3, 3]
            clouds.setdefault(mover, []).append(_farthest(placed, directions))
        found = np.zeros((0, 3))
        if self.layers.get("trail"):
            found = _farthest(
                np.vstack([self._path(x) for x in (q, q if wanted is None else wanted)]), directions
            )
        for i in kept:
            poses = self.poses(q[i])
            moved = [
                np.vstack(cloud) @ poses[mover][:3, :3].T + poses[mover][:3, 3]
                for mover, cloud in clouds.items()
            ]
            found = _farthest(np.vstack([found, *moved]), directions)
        return found

    def trail(self, q: Array) -> Shape:
        """The path of the point as a thick line, of which a page shows what has been passed."""
        line = tube(self._path(q), self._width, TRAIL_SIDES)
        return Shape("0", "trail", "passed", line, _TRAIL)

    def reference(self, q: Array) -> Shape:
        """The path of the point as a thin line."""
        return Shape("0", "trail", "path", tube(self._path(q), 0.45 * self._width), _PATH)

    # --- inside -----------------------------------------------------------------------------

    def _joints(self, q: Array) -> Array:
        pin.forwardKinematics(self._model, self._data, q)
        return np.array([at.homogeneous for at in self._data.oMi])

    def _path(self, q: Array) -> Array:
        assert self.point is not None
        joint, origin = self.point.joint, self.point.placement.translation
        return np.array([self._data.oMi[joint].act(origin) for _ in map(self._joints, q)])

    def _size(self, robot: ClosedChain) -> float:
        """A length of the robot, [m]: its own, or a quarter of the diagonal of its shapes."""
        if (size := robot.appearance.size) is not None:
            return size
        poses = self._joints(self.start)
        points = [
            (shape.mesh.vertices @ shape.at[:3, :3].T + shape.at[:3, 3], int(shape.mover))
            for shape in self.shapes
        ] or [(np.array(own), joint) for joint, own in enumerate(points_of(robot)) if own]
        placed = [p @ poses[joint][:3, :3].T + poses[joint][:3, 3] for p, joint in points]
        return float(np.linalg.norm(np.ptp(np.vstack(placed), axis=0))) / 4 or 1.0


def _farthest(points: Array, directions: Array) -> Array:
    return points[np.unique((points @ directions.T).argmax(axis=0))]


def _directions() -> Array:
    """Directions spread evenly over a sphere, on a spiral from pole to pole, shape (n, 3)."""
    z = 1 - (2 * np.arange(_DIRECTIONS) + 1) / _DIRECTIONS
    turn = np.pi * (1 + np.sqrt(5)) * np.arange(_DIRECTIONS)
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)

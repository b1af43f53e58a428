# SPDX-License-Identifier: BSD-2-Clause
"""Struts: straight parts between two points that move, such as rods, ropes, springs and cylinders.

The mesh of a strut goes from z = 0 to z = 1; it is stretched to the distance of the points.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ..closed_chain import ClosedChain
from ..description.colours import HUES
from ..model.closures import Distance
from ..model.contacts import Rope
from ..model.lines import LineForce
from ..model.tree import frame_named
from .rate_axes import RateAxis
from .scene_parts import GREY, Mesh, Shape, Strut
from .skeleton import BONE_RADIUS
from .triangles import circle, tube

#: Turns of the coil of a spring.
_TURNS = 8


def struts(robot: ClosedChain, axes: Sequence[RateAxis], size: float) -> Iterator[Strut]:
    """Forces along lines, rods of `Distance` closures, ropes, and rails of sliding joints.

    `axes` has the axis of each rate; `size` is a length of the robot, [m].
    """
    line = tube([(0, 0, 0), (0, 0, 1)], BONE_RADIUS * size)

    # Struts between two frames. Each pair is a part of the robot, which has the names `frame_a` and
    # `frame_b`, and the shape of its strut.
    pairs: list[tuple[Distance | LineForce | Rope, Shape]] = list(_line_forces(robot, size))
    rods = [closure for closure in robot.closures if isinstance(closure, Distance)]
    for k, rod in enumerate(rods):
        pairs.append((rod, Shape(f"rod_{k}", "bodies", "rod", line, GREY)))
    cord = Mesh(line.vertices * (0.3, 0.3, 1), line.faces)
    for k, rope in enumerate(robot.mechanism.contacts.ropes):
        pairs.append((rope, Shape(f"rope_{k}", "bodies", f"rope {rope}", cord, GREY)))
    for part, shape in pairs:
        a = frame_named(robot.mechanism.model, part.frame_a)
        b = frame_named(robot.mechanism.model, part.frame_b)
        points = np.stack([a.placement.translation, b.placement.translation])
        yield Strut(shape, (int(a.parentJoint), int(b.parentJoint)), points)

    # Rails of joints that slide along one axis: from the joint's origin at position 0, on the body
    # before, to the origin of the body that slides.
    thin = Mesh(line.vertices * (0.6, 0.6, 1), line.faces)
    for axis in axes:
        if not axis.turns and axis.mover != axis.joint:
            shape = Shape(f"rail_{axis.joint}", "skeleton", "rail", thin, GREY)
            yield Strut(shape, (axis.mover, axis.joint), np.stack([axis.origin, np.zeros(3)]))


def _line_forces(robot: ClosedChain, size: float) -> Iterator[tuple[LineForce, Shape]]:
    """The shapes of forces along lines.

    A line with a motor is a cylinder with its piston rod, a line with a spring is a coil, and other
    lines are thin.
    """
    r = BONE_RADIUS * size
    z = np.linspace(0, 1, 12 * _TURNS + 1)
    coil = 2 * r * circle(2 * np.pi * _TURNS * z) + np.outer(z, (0, 0, 1))
    for k, line in enumerate(robot.lines):
        motors = np.flatnonzero(robot.mechanism.lines.actuation[k])
        colour = GREY
        if len(motors):
            barrel = 1.8 * r
            piston = 0.8 * r
            ends = [(0, 0, 0), (0, 0, 0.6), (0, 0, 0.6), (0, 0, 1)]
            mesh = tube(ends, [barrel, barrel, piston, piston])
            colour = HUES[motors[0] % len(HUES)]
        elif line.stiffness:
            mesh = tube(coil, 0.4 * r, 6)
        else:
            mesh = tube([(0, 0, 0), (0, 0, 1)], 0.4 * r)
        yield line, Shape(f"line_{k}", "bodies", f"line {line}", mesh, colour)

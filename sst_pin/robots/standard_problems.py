# SPDX-License-Identifier: BSD-2-Clause
"""Benchmark mechanisms of the literature on multibody dynamics that belong to the gallery.

Axes, masses and initial states are published ones; docs/standard_problems.md has the results.
"""

from functools import partial

import numpy as np
import pinocchio as pin
from pinocchio.rpy import rpyToMatrix

from ..arrays import Array
from ..model.closures import Closure
from .building_blocks import Tree, body, box
from .gallery_robot import GalleryRobot, Joints, of_dimensions
from .placements import HERE, rotation_x_then_y, shift

_RX = pin.JointModelRX
_RY = pin.JointModelRY
_RZ = pin.JointModelRZ
_ALONG_Y = np.array([0.0, -9.81, 0.0])


@of_dimensions
def bricard(*, length: float = 1.0, mass: float = 1.0, thickness: float = 0.1) -> GalleryRobot:
    """Bricard's linkage of six hinges along the edges of a cube; overconstrained but movable.

    Problem A04 of the IFToMM library: five equal rods, gravity along -y. At home the rods are edges
    of the cube. The counting formula gives no degree of freedom, but the linkage has one. The
    platform is the third rod, its frame at the third hinge. The motor is at the first hinge.

    Args:
        length: Length of the rods, [m].
        mass: Mass of each rod, [kg].
        thickness: Side of their square section, [m].
    """
    tree = Tree("bricard")
    tree.model.gravity.linear = _ALONG_Y
    edges = length * np.array([(1, 0, 0), (0, -1, 0), (0, 0, 1), (-1, 0, 0), (0, 1, 0)])
    parent = "universe"
    at = HERE
    for k, (kind, edge) in enumerate(zip((_RY, _RZ, _RX, _RY, _RZ), edges, strict=True), 1):
        size = np.maximum(np.abs(edge), thickness)
        tree.add_joint(f"hinge_{k}", kind(), box(mass, size, edge / 2), parent, at)
        parent = f"hinge_{k}"
        at = shift(edge)
    # The last hinge turns about x; hinge closures turn about z of their frames.
    z_to_x = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    tree.add_frame("ground_pin", "universe", pin.SE3(z_to_x, np.array([0, 0, length])))
    tree.add_frame("end_pin", parent, pin.SE3(z_to_x, edges[-1]))
    tree.make_platform("hinge_3")
    closures = [Closure("ground_pin", "end_pin", "hinge")]
    joints = partial(_bricard_joints, length)
    return GalleryRobot(tree, closures, ["hinge_1"], joints, shift(edges[0] + edges[1]))


def _bricard_joints(length: float, pose: pin.SE3) -> Joints:
    """Inverse kinematics, from both ends of the open chain to the platform's hinge.

    The frame of the platform is at hinge 3. With lengths in units of the rods, two chains of two
    rods lead to a point p = (x, y, z). From the base, rods 1 and 2 lead to hinge 3. They turn by a
    about y and then by b about z:

        p = Rot_y(a) [(1, 0, 0) + Rot_z(b) (0, -1, 0)]
          = ((1 + sin b) cos a, -cos b, -(1 + sin b) sin a),

    so that a = atan2(-z, x) and 1 + sin b = sqrt(x^2 + z^2). From the platform, rods 4 and 5 lead
    in the same way from hinge 4, at (0, 0, 1), to the last pin, which is at (0, 0, 1) in the base:

        p = Rot_y(a) [(-1, 0, 0) + Rot_z(b) (0, 1, 0)]
          = (-(1 + sin b) cos a, cos b, (1 + sin b) sin a).
    """
    x, y, z = pose.translation / length
    hinge_1 = np.arctan2(-z, x)
    hinge_2 = np.arctan2(np.hypot(x, z) - 1, -y)

    # Hinge 3 turns the platform about x on the second rod.
    second_rod = rpyToMatrix(0.0, hinge_1, 0.0) @ rpyToMatrix(0.0, 0.0, hinge_2)
    R = second_rod.T @ pose.rotation
    hinge_3 = np.arctan2(R[2, 1], R[1, 1])

    last_pin = np.array([0, 0, length])
    hinge_4_to_pin = pose.actInv(last_pin) / length - (0, 0, 1)
    x, y, z = hinge_4_to_pin
    hinge_4 = np.arctan2(z, -x)
    hinge_5 = np.arctan2(np.hypot(x, z) - 1, y)
    return {
        "hinge_1": hinge_1,
        "hinge_2": hinge_2,
        "hinge_3": hinge_3,
        "hinge_4": hinge_4,
        "hinge_5": hinge_5,
    }


# The slider-crank: the centre of the crank's circle, shape (3,), and the length of the rod, [m].
_CRANK = np.array([0.0, 0.1, 0.12])
_ROD = 0.3


def slider_crank() -> GalleryRobot:
    """A spatial slider-crank: a ball joint at the crank, a universal joint at the slider.

    The benchmark of the IFToMM library (E. J. Haug, Computer Aided Kinematics and Dynamics of
    Mechanical Systems, 1989): the crank turns about x, the slider moves along x, weight along -z.
    At home the crank is upright. The platform is the rod, its frame at the ball, x towards the
    slider. The motor drives the crank.
    """
    tree = Tree("slider_crank")
    tip = np.array([0.0, 0.0, 0.08])
    end = np.array([-_ROD, 0.0, 0.0])
    crank = body(0.12, tip / 2, (1e-4, 1e-4, 1e-5), [np.zeros(3), tip], 0.006)
    bar = body(0.5, end / 2, (4e-4, 4e-3, 4e-3), [np.zeros(3), end], 0.006)
    tree.add_joint("crank", _RX(), crank, at=shift(_CRANK))
    tree.add_joint("slider", pin.JointModelPX(), box(2.0, (0.05, 0.03, 0.03)))
    x, y, _ = np.eye(3)
    tree.add_joint("rod", pin.JointModelUniversal(x, y), bar, "slider")
    tree.add_frame("tip", "crank", tip)
    tree.make_platform("rod", end)
    # At home the ball is above the centre of the crank. The rod has its length with the slider at
    # x = 0.2: 0.3^2 = 0.2^2 + 0.1^2 + 0.2^2.
    ball = _CRANK + tip
    about_x, about_y = _rod_turns(ball, 0.2)
    home = pin.SE3(rotation_x_then_y(about_x, about_y), ball)
    closures = [Closure("tip", "platform", "3d")]
    return GalleryRobot(tree, closures, ["crank"], _slider_crank_joints, home)


def _rod_turns(ball: Array, slider: float) -> tuple[float, float]:
    """Turns about x and then y of the rod from the slider, [m], to the ball, shape (3,).

    The rod is along -x of its frame: Rot_x(a) Rot_y(b) (-1, 0, 0) = (-cos b, -sin a sin b, cos a
    sin b) has the direction (x, y, z), where sin b > 0.
    """
    x, y, z = ball - (slider, 0, 0)
    return float(np.arctan2(-y, z)), float(np.arctan2(np.hypot(y, z), -x))


def _slider_crank_joints(pose: pin.SE3) -> Joints:
    """Inverse kinematics: the rod's pose gives the slider at one end, the ball at the other."""
    ball = pose.translation
    slider = float(pose.act(np.array([_ROD, 0, 0]))[0])
    _, y, z = ball - _CRANK  # Rot_x(crank) (0, 0, length of the crank)
    return {"crank": np.arctan2(-y, z), "slider": slider, "rod": _rod_turns(ball, slider)}

# SPDX-License-Identifier: BSD-2-Clause
"""Platforms on legs with universal and ball joints: Stewart, 3-UPS-PU, hexaglide, delta."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from pinocchio.rpy import rpyToMatrix

from ..arrays import Array, single_array
from ..model.closures import Closure
from .building_blocks import Tree, bar, box, disc, rod, rods
from .gallery_robot import GalleryRobot, Joints, of_dimensions
from .placements import circle, planar, rotation_x_then_y, shift, two_link, universal_angles

_X, _Y, _ = np.eye(3)


@of_dimensions
def stewart(
    *,
    base_radius: float = 0.5,
    platform_radius: float = 0.3,
    base_spread: float = 0.35,
    platform_spread: float = 0.7,
    retracted: float = 0.5,
    platform_mass: float = 12.0,
    barrel_mass: float = 2.0,
    rod_mass: float = 1.0,
) -> GalleryRobot:
    """The Gough-Stewart platform 6-UPS: six driven struts move a platform.

    In the tree, the platform is a free-flyer; ball closures connect it with the struts. A strut
    turns about a universal joint at the base and does not spin. The layout is that of V. E. Gough's
    machine and of D. Stewart, A platform with six degrees of freedom, Proc. Inst. Mech. Eng. 180
    (1965).

    Args:
        base_radius: Radius of the circle of the base's joints, [m].
        platform_radius: Radius of the circle of the platform's joints, [m].
        base_spread: Half the angle between the two neighbours of a pair on the base, [rad].
        platform_spread: Half the angle between the same two struts on the platform, [rad].
        retracted: Length of a strut at no stroke, [m].
        platform_mass: [kg].
        barrel_mass: Mass of the part of each strut at the base, [kg].
        rod_mass: Mass of the part of each strut at the platform, [kg].
    """
    tree = Tree("stewart")
    base = circle(base_radius, _pairs(base_spread))
    vertices = circle(platform_radius, _pairs(platform_spread))
    tree.add_joint(
        "platform", pin.JointModelFreeFlyer(), disc(platform_mass, platform_radius, 0.03)
    )
    tree.make_platform("platform")
    closures, motors = _add_struts(
        tree, base, vertices, retracted, barrel_mass=barrel_mass, rod_mass=rod_mass
    )
    joints = partial(_stewart_joints, base, vertices, retracted)
    home = shift((0, 0, _height(base[0], vertices[0], 1.3 * retracted)))
    return GalleryRobot(tree, closures, motors, joints, home)


def _stewart_joints(base: Array, vertices: Array, retracted: float, pose: pin.SE3) -> Joints:
    """Inverse kinematics: the platform is a free-flyer in the tree."""
    return {"platform": pin.SE3ToXYZQUAT(pose)} | _strut_joints(base, vertices, retracted, pose)


@of_dimensions
def ups_pu(
    *,
    base_radius: float = 0.4,
    platform_radius: float = 0.25,
    post: float = 0.3,
    retracted: float = 0.4,
    platform_mass: float = 6.0,
    post_mass: float = 4.0,
    barrel_mass: float = 1.5,
    rod_mass: float = 0.8,
) -> GalleryRobot:
    """The platform 3-UPS-PU: three driven struts and a central post.

    The post slides along z and carries the platform on a universal joint. So the platform has three
    degrees of freedom: it moves along z, and turns about x and then y. Its dynamics has been
    published with the NOC.

    Args:
        base_radius: Radius of the circle of the base's joints, [m].
        platform_radius: Radius of the circle of the platform's joints, [m].
        post: Length of the post, [m]. At the stroke 0, its lower end is in the plane of the base.
        retracted: Length of a strut at no stroke, [m].
        platform_mass: [kg].
        post_mass: [kg].
        barrel_mass: Mass of the part of each strut at the base, [kg].
        rod_mass: Mass of the part of each strut at the platform, [kg].
    """
    tree = Tree("ups_pu")
    angles = 2 * np.pi / 3 * np.arange(3)
    base = circle(base_radius, angles)
    vertices = circle(platform_radius, angles)
    tree.add_joint("post", pin.JointModelPZ(), rod(post_mass, (0, 0, post), 0.03))
    plate = disc(platform_mass, platform_radius, 0.03)
    tree.add_joint("platform", pin.JointModelUniversal(_X, _Y), plate, "post", shift((0, 0, post)))
    tree.make_platform("platform")
    closures, motors = _add_struts(
        tree, base, vertices, retracted, barrel_mass=barrel_mass, rod_mass=rod_mass
    )
    joints = partial(_ups_pu_joints, post, base, vertices, retracted)
    home = shift((0, 0, _height(base[0], vertices[0], 1.4 * retracted)))
    return GalleryRobot(tree, closures, motors, joints, home)


def _ups_pu_joints(
    post: float, base: Array, vertices: Array, retracted: float, pose: pin.SE3
) -> Joints:
    """Inverse kinematics: the universal joint turns about x and then y."""
    post_joints = {
        "post": pose.translation[2] - post,
        "platform": universal_angles(pose.rotation[:, 2]),
    }
    return post_joints | _strut_joints(base, vertices, retracted, pose)


@of_dimensions
def hexaglide(
    *,
    rails: ArrayLike = (-0.3, -0.25, -0.025, 0.025, 0.25, 0.3),
    platform_radius: float = 0.12,
    platform_spread: float = 0.5,
    strut: float = 0.6,
    platform_mass: float = 4.0,
    carriage_mass: float = 2.0,
    strut_mass: float = 0.8,
) -> GalleryRobot:
    """The hexaglide 6-PUS: six carriages on parallel rails carry a platform on rods.

    Rails run along x in the plane z = 0. In the tree, the platform above them is a free-flyer; six
    ball closures connect it with the rods. The layout is that of the Hexaglide of ETH Zurich (M.
    Honegger, A. Codourey, E. Burdet, Adaptive control of the Hexaglide, a 6 dof parallel
    manipulator, ICRA 1997).

    Args:
        rails: y of the six rails, shape (6,), [m].
        platform_radius: Radius of the circle of the platform's joints, [m].
        platform_spread: Half the angle between two neighbours of the platform, [rad].
        strut: Length of the rods, [m].
        platform_mass: [kg].
        carriage_mass: Mass of each carriage, [kg].
        strut_mass: Mass of each strut, [kg].
    """
    rails = single_array("rails", rails, (6,))
    tree = Tree("hexaglide")
    vertices = circle(platform_radius, _pairs(platform_spread) - np.pi / 2)
    tree.add_joint(
        "platform", pin.JointModelFreeFlyer(), disc(platform_mass, platform_radius, 0.02)
    )
    tree.make_platform("platform")
    for k, (y, vertex) in enumerate(zip(rails, vertices, strict=True), 1):
        carriage = box(carriage_mass, (0.08, 0.04, 0.04))
        tree.add_joint(f"carriage_{k}", pin.JointModelPX(), carriage, at=shift((0, y)))
        strut_rod = rod(strut_mass, (0, 0, strut), 0.01)
        tree.add_joint(f"strut_{k}", pin.JointModelUniversal(_X, _Y), strut_rod, f"carriage_{k}")
        tree.add_frame(f"end_of_strut_{k}", f"strut_{k}", (0, 0, strut))
        tree.add_frame(f"ball_{k}", "platform", vertex)
    closures = [Closure(f"ball_{k}", f"end_of_strut_{k}", "3d") for k in range(1, 7)]
    joints = partial(_hexaglide_joints, rails, vertices, strut)
    motors = [f"carriage_{k}" for k in range(1, 7)]
    return GalleryRobot(tree, closures, motors, joints, shift((0, 0, 2 / 3 * strut)))


#: The side of its ball on which each carriage of the hexaglide is: -1 at smaller x, 1 at larger x.
_SIDES = (-1, 1, -1, 1, -1, 1)


def _hexaglide_joints(rails: Array, vertices: Array, strut: float, pose: pin.SE3) -> Joints:
    """Inverse kinematics: a strut of known length ends at its ball, and begins on its rail."""
    joints = {"platform": pin.SE3ToXYZQUAT(pose)}
    for k, (y, vertex, side) in enumerate(zip(rails, vertices, _SIDES, strict=True), 1):
        # (dx, dy, dz) is the ball, seen from the rail's point at x = 0. If the carriage is at
        # x = dx + along_rail, the strut to the ball is (-along_rail, dy, dz).
        dx, dy, dz = pose.act(vertex) - (0, y, 0)
        along_rail = side * np.sqrt(strut**2 - dy**2 - dz**2)
        joints[f"carriage_{k}"] = dx + along_rail
        joints[f"strut_{k}"] = universal_angles((-along_rail, dy, dz))
    return joints


def _height(foot: Array, vertex: Array, length: float) -> float:
    """Height of a level platform on struts of one length, [m]; NaN where they are too short."""
    with np.errstate(invalid="ignore"):
        return float(np.sqrt(length**2 - ((foot - vertex) ** 2).sum()))


def _pairs(spread: float) -> Array:
    """Angles of three pairs of neighbours on a circle, shape (6,), [rad].

    `spread` is half the angle between the two neighbours of a pair.
    """
    middles = 2 * np.pi / 3 * np.arange(3)
    angles = [(middle - spread, middle + spread) for middle in middles]
    return np.ravel(angles)


def _add_struts(
    tree: Tree,
    base: Array,
    vertices: Array,
    retracted: float,
    *,
    barrel_mass: float,
    rod_mass: float,
) -> tuple[list[Closure], list[str]]:
    """Add struts: a universal joint on the base, a slide, and a ball closure with the platform.

    `base` and `vertices` are the places of the joints on base and platform, in their frames, shape
    (struts, 3), [m]. Returns the closures and the names of the motors, which are at the slides.
    """
    closures = []
    motors = []
    for k, (foot, vertex) in enumerate(zip(base, vertices, strict=True), 1):
        barrel = rod(barrel_mass, (0, 0, 0.8 * retracted), 0.025)
        piston = rods(rod_mass, [(0, 0, -0.6 * retracted), (0, 0, 0)], 0.015)
        tree.add_joint(f"universal_{k}", pin.JointModelUniversal(_X, _Y), barrel, at=shift(foot))
        at = shift((0, 0, retracted))
        tree.add_joint(f"stroke_{k}", pin.JointModelPZ(), piston, f"universal_{k}", at)
        # The piston stays in its barrel.
        tree.set_limits(f"stroke_{k}", -0.2 * retracted, 0.4 * retracted)
        tree.add_frame(f"end_of_rod_{k}", f"stroke_{k}", (0, 0))
        tree.add_frame(f"ball_{k}", "platform", vertex)
        closures.append(Closure(f"ball_{k}", f"end_of_rod_{k}", "3d"))
        motors.append(f"stroke_{k}")
    return closures, motors


def _strut_joints(base: Array, vertices: Array, retracted: float, pose: pin.SE3) -> Joints:
    """Inverse kinematics: the platform's pose gives both ends of each strut."""
    joints: Joints = {}
    for k, (foot, vertex) in enumerate(zip(base, vertices, strict=True), 1):
        reach = pose.act(vertex) - foot
        joints[f"universal_{k}"] = universal_angles(reach)
        joints[f"stroke_{k}"] = np.linalg.norm(reach) - retracted
    return joints


@of_dimensions
def delta(
    *,
    base_radius: float = 0.12,
    platform_radius: float = 0.05,
    arm: float = 0.15,
    forearm: float = 0.32,
    spacing: float = 0.08,
    arm_mass: float = 0.08,
    rod_mass: float = 0.02,
    platform_mass: float = 0.15,
) -> GalleryRobot:
    """The delta robot: three arms and six rods move a platform without rotation.

    Universal joints connect the rods to the arms, so that rods do not spin. Ball joints connect
    them to the platform. One of these balls is in the tree: the platform is the child of rod_1a.
    The robot is that of R. Clavel, Delta, a fast robot with parallel geometry, ISIR 1988, in the
    size of a machine for a table.

    Args:
        base_radius: Radius of the circle of the motors, [m].
        platform_radius: Radius of the circle of the platform's joints, [m].
        arm: Length of the driven arms, [m].
        forearm: Length of the rods, [m].
        spacing: Between the two rods of a pair, [m].
        arm_mass: Mass of each arm, [kg].
        rod_mass: Mass of each of the six rods, [kg].
        platform_mass: [kg].
    """
    tree = Tree("delta")
    closures = []
    # In the tree, the body of the platform has its origin at the ball of rod_1a. `first` is the
    # position of this ball, seen from the centre of the platform.
    first = np.array([platform_radius, spacing / 2, 0])
    end = (0, 0, -forearm)
    for k in (1, 2, 3):
        leg = planar(0, 0, 2 * np.pi / 3 * (k - 1))
        motor = leg * shift((base_radius, 0))
        tree.add_joint(f"motor_{k}", pin.JointModelRY(), bar(arm_mass, arm, 0.008), at=motor)
        for name, offset in ((f"{k}a", spacing / 2), (f"{k}b", -spacing / 2)):
            bars = rod(rod_mass, end, 0.004)
            at = shift((arm, offset))
            kind = pin.JointModelUniversal(_X, _Y)
            tree.add_joint(f"rod_{name}", kind, bars, f"motor_{k}", at)
            if name == "1a":
                plate = disc(platform_mass, platform_radius, 0.01)
                plate = [solid._replace(at=shift(-first)) for solid in plate]
                tree.add_joint("ball", pin.JointModelSpherical(), plate, "rod_1a", shift(end))
                tree.make_platform("ball", -first)
            else:
                vertex = leg.act(np.array([platform_radius, offset, 0]))
                tree.add_frame(f"end_{name}", f"rod_{name}", end)
                tree.add_frame(f"ball_{name}", "ball", vertex - first)
                closures.append(Closure(f"ball_{name}", f"end_{name}", "3d"))
    joints = partial(_delta_joints, (base_radius, platform_radius), arm, forearm)
    motors = [f"motor_{k}" for k in (1, 2, 3)]
    # At home the arms are level. `horizontal` is the horizontal part of a rod, whose length is
    # `forearm`, so the vertical part is the depth of the platform.
    horizontal = base_radius + arm - platform_radius
    with np.errstate(invalid="ignore"):
        home = shift((0, 0, -np.sqrt(forearm**2 - horizontal**2)))
    return GalleryRobot(tree, closures, motors, joints, home)


def _delta_joints(radii: tuple[float, float], arm: float, forearm: float, pose: pin.SE3) -> Joints:
    """Inverse kinematics; `radii` are those of base and platform.

    In the frame of a leg, with x radial and z up, the arm turns about y, in the plane of x and z. A
    rod leaves this plane by y, so its projection has the length sqrt(forearm^2 - y^2). Arm and
    projected rod are a two-link arm.
    """
    base_radius, platform_radius = radii
    joints: Joints = {}
    for k in (1, 2, 3):
        leg = planar(0, 0, 2 * np.pi / 3 * (k - 1))
        x, y, z = leg.actInv(pose.translation) - (base_radius - platform_radius, 0, 0)
        motor, _ = two_link((x, -z), arm, np.sqrt(forearm**2 - y**2), elbow=1)
        R_arm = rpyToMatrix(0.0, motor, 0.0)
        # The rod in the frame of the arm; turns about x and then y bring -z to it.
        dx, dy, dz = R_arm.T @ (x, y, z) - (arm, 0, 0)
        about_x = np.arctan2(dy, -dz)
        about_y = np.arctan2(-dx, np.hypot(dy, dz))
        joints[f"motor_{k}"] = motor
        joints[f"rod_{k}a"] = (about_x, about_y)
        joints[f"rod_{k}b"] = (about_x, about_y)
        if k == 1:  # the ball at the end of rod_1a turns the platform back
            R_rod = R_arm @ rotation_x_then_y(about_x, about_y)
            joints["ball"] = pin.Quaternion(R_rod.T).coeffs()
    return joints

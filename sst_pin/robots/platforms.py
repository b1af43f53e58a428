# SPDX-License-Identifier: BSD-2-Clause
"""Platforms on legs of universal joint, slide and ball: Stewart, hexaglide, 3-UPS-PU."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, single_array
from ..chain.closures import Closure
from .angles import universal
from .building_blocks import Tree, box, circle, disc, rod, rods, shift
from .gallery_robot import GalleryRobot, Joints, of_dimensions

_X, _Y, _ = np.eye(3)
#: Where the carriages of the hexaglide run, before the platform's joints or behind them.
_SIDES = (-1, 1, -1, 1, -1, 1)


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

    The platform is a free-flyer with six ball joints. A strut turns about a universal joint at the
    base and does not spin. The layout of V. E. Gough's machine and of D. Stewart, A platform with
    six degrees of freedom, Proc. Inst. Mech. Eng. 180 (1965); dimensions and masses are chosen
    here.

    Args:
        base_radius: Radius of the circle of the base's joints, [m].
        platform_radius: Radius of the circle of the platform's joints, [m].
        base_spread: Half the angle between two neighbours of the base, [rad].
        platform_spread: Half the angle between the same legs on the platform, [rad].
        retracted: Length of a strut at no stroke, [m].
        platform_mass: [kg].
        barrel_mass: Mass of the part of each strut at the base, [kg].
        rod_mass: Mass of the part of each strut at the platform, [kg].

    Example:
        >>> chain = sst_pin.robots.stewart()
        >>> zero = np.zeros(chain.degrees_of_freedom)
        >>> chain.compute_torques(chain.home, zero, zero).round(2)
        array([32.25, 32.25, 32.25, 32.25, 32.25, 32.25])
    """
    tree = Tree("stewart")
    base = circle(base_radius, _pairs(base_spread))
    vertices = circle(platform_radius, _pairs(platform_spread))
    tree.joint("platform", pin.JointModelFreeFlyer(), disc(platform_mass, platform_radius, 0.03))
    tree.platform("platform")
    _add_struts(tree, base, vertices, retracted, barrel_mass, rod_mass)
    joints = partial(_stewart_joints, base=base, vertices=vertices, retracted=retracted)
    closures = [Closure(f"ball_{k}", f"end_of_rod_{k}", "3d") for k in range(1, 7)]
    home = shift((0, 0, _height(base[0], vertices[0], 1.3 * retracted)))
    return GalleryRobot(tree, closures, [f"stroke_{k}" for k in range(1, 7)], joints, home)


def _stewart_joints(pose: pin.SE3, base: Array, vertices: Array, retracted: float) -> Joints:
    return {"platform": pin.SE3ToXYZQUAT(pose)} | _strut_joints(pose, base, vertices, retracted)


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
    published with the NOC before; dimensions and masses are chosen here.

    Args:
        base_radius: Radius of the circle of the base's joints, [m].
        platform_radius: Radius of the circle of the platform's joints, [m].
        post: Length of the post, whose foot is at the base's height at no heave, [m].
        retracted: Length of a strut at no stroke, [m].
        platform_mass: [kg].
        post_mass: [kg].
        barrel_mass: Mass of the part of each strut at the base, [kg].
        rod_mass: Mass of the part of each strut at the platform, [kg].

    Example:
        >>> chain = sst_pin.robots.ups_pu()
        >>> zero = np.zeros(chain.degrees_of_freedom)
        >>> chain.compute_torques(chain.home, zero, zero).round(2)
        array([42.27, 42.27, 42.27])
    """
    tree = Tree("ups_pu")
    angles = 2 * np.pi / 3 * np.arange(3)
    base, vertices = circle(base_radius, angles), circle(platform_radius, angles)
    tree.joint("post", pin.JointModelPZ(), rod(post_mass, (0, 0, post), 0.03))
    plate = disc(platform_mass, platform_radius, 0.03)
    tree.joint("platform", pin.JointModelUniversal(_X, _Y), plate, "post", shift((0, 0, post)))
    tree.platform("platform")
    _add_struts(tree, base, vertices, retracted, barrel_mass, rod_mass)
    joints = partial(_ups_pu_joints, base=base, vertices=vertices, post=post, retracted=retracted)
    closures = [Closure(f"ball_{k}", f"end_of_rod_{k}", "3d") for k in range(1, 4)]
    home = shift((0, 0, _height(base[0], vertices[0], 1.4 * retracted)))
    return GalleryRobot(tree, closures, [f"stroke_{k}" for k in range(1, 4)], joints, home)


def _ups_pu_joints(
    pose: pin.SE3, base: Array, vertices: Array, post: float, retracted: float
) -> Joints:
    own = {"post": pose.translation[2] - post, "platform": universal(pose.rotation[:, 2])}
    return own | _strut_joints(pose, base, vertices, retracted)


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

    Rails run along x in the plane z = 0; the platform is a free-flyer above them that six balls
    hold. The layout of the Hexaglide of ETH Zurich (M. Honegger, A. Codourey, E. Burdet, Adaptive
    control of the Hexaglide, a 6 dof parallel manipulator, ICRA 1997); dimensions and masses are
    chosen here.

    Args:
        rails: y of the six rails, shape (6,), [m].
        platform_radius: Radius of the circle of the platform's joints, [m].
        platform_spread: Half the angle between two neighbours of the platform, [rad].
        strut: Length of the rods, [m].
        platform_mass: [kg].
        carriage_mass: Mass of each carriage, [kg].
        strut_mass: Mass of each strut, [kg].

    Example:
        >>> chain = sst_pin.robots.hexaglide()
        >>> zero = np.zeros(chain.degrees_of_freedom)
        >>> chain.compute_torques(chain.home, zero, zero).round(2)
        array([  8.22, -15.65,   9.14,  -9.71,  15.11,  -7.11])
    """
    rails = single_array("rails", rails, (6,))
    tree = Tree("hexaglide")
    vertices = circle(platform_radius, _pairs(platform_spread) - np.pi / 2)
    plate = disc(platform_mass, platform_radius, 0.02)
    tree.joint("platform", pin.JointModelFreeFlyer(), plate)
    tree.platform("platform")
    for k, (y, vertex) in enumerate(zip(rails, vertices, strict=True), 1):
        carriage = box(carriage_mass, (0.08, 0.04, 0.04))
        tree.joint(f"carriage_{k}", pin.JointModelPX(), carriage, at=shift((0, y)))
        bar = rod(strut_mass, (0, 0, strut), 0.01)
        tree.joint(f"strut_{k}", pin.JointModelUniversal(_X, _Y), bar, f"carriage_{k}")
        tree.frame(f"end_of_strut_{k}", f"strut_{k}", (0, 0, strut))
        tree.frame(f"ball_{k}", "platform", vertex)
    closures = [Closure(f"ball_{k}", f"end_of_strut_{k}", "3d") for k in range(1, 7)]
    joints = partial(_hexaglide_joints, rails=rails, vertices=vertices, strut=strut)
    motors = [f"carriage_{k}" for k in range(1, 7)]
    return GalleryRobot(tree, closures, motors, joints, shift((0, 0, 2 / 3 * strut)))


def _hexaglide_joints(pose: pin.SE3, rails: Array, vertices: Array, strut: float) -> Joints:
    joints = {"platform": pin.SE3ToXYZQUAT(pose)}
    for k, (y, vertex, side) in enumerate(zip(rails, vertices, _SIDES, strict=True), 1):
        x, *rest = pose.act(vertex) - (0, y, 0)
        reach = np.sqrt(strut**2 - np.dot(rest, rest))
        joints |= {f"carriage_{k}": x + side * reach}
        joints |= {f"strut_{k}": universal((-side * reach, *rest))}
    return joints


def _height(foot: Array, vertex: Array, length: float) -> float:
    """Height of a level platform on struts of one length, [m]; NaN where they are too short."""
    with np.errstate(invalid="ignore"):
        return float(np.sqrt(length**2 - ((foot - vertex) ** 2).sum()))


def _pairs(spread: float) -> Array:
    """Angles of three pairs of neighbours, half the angle between them given, shape (6,), [rad]."""
    middles = 2 * np.pi / 3 * np.arange(3)
    return (middles[:, None] + spread * np.array([-1, 1])).ravel()


def _add_struts(
    tree: Tree,
    base: Array,
    vertices: Array,
    retracted: float,
    barrel_mass: float,
    rod_mass: float,
) -> None:
    """Struts that turn about a universal joint on the base, slide, and end at the platform."""
    for k, (foot, vertex) in enumerate(zip(base, vertices, strict=True), 1):
        barrel = rod(barrel_mass, (0, 0, 0.8 * retracted), 0.025)
        piston = rods(rod_mass, [(0, 0, -0.6 * retracted), (0, 0, 0)], 0.015)
        tree.joint(f"universal_{k}", pin.JointModelUniversal(_X, _Y), barrel, at=shift(foot))
        at = shift((0, 0, retracted))
        tree.joint(f"stroke_{k}", pin.JointModelPZ(), piston, f"universal_{k}", at)
        tree.frame(f"end_of_rod_{k}", f"stroke_{k}", (0, 0, 0))
        tree.frame(f"ball_{k}", "platform", vertex)


def _strut_joints(pose: pin.SE3, base: Array, vertices: Array, retracted: float) -> Joints:
    joints: Joints = {}
    for k, (foot, vertex) in enumerate(zip(base, vertices, strict=True), 1):
        reach = pose.act(vertex) - foot
        joints[f"universal_{k}"] = universal(reach)
        joints[f"stroke_{k}"] = np.linalg.norm(reach) - retracted
    return joints

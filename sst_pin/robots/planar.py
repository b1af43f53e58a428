# SPDX-License-Identifier: BSD-2-Clause
"""Robots whose bodies move in one plane: four-bar, five-bar, 3-RRR, 4-RRR."""

from functools import partial

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, in_one_turn
from ..model.closures import Closure
from .building_blocks import Tree, bar, star
from .gallery_robot import GalleryRobot, Joints, of_dimensions
from .placements import UPRIGHT, angle_about_z, angle_of, circle, planar, shift, two_link

#: Lengths of the proximal and the distal link, [m].
_Lengths = tuple[float, float]


@of_dimensions
def four_bar(
    *,
    crank: float = 0.1,
    coupler: float = 0.25,
    rocker: float = 0.25,
    ground: float = 0.2,
    point: float = 0.5,
    linear_density: float = 2.0,
    radius: float = 0.008,
) -> GalleryRobot:
    """A four-bar linkage that stands upright, driven at its crank; x to the right, z up.

    The platform is the point of the coupler, its x axis along the coupler, its z axis normal to the
    plane. Lengths are in the proportions of Hoecken's linkage, 1 : 2.5 : 2.5 : 2 : 5, which draws a
    line that is nearly straight (R. L. Norton, Design of Machinery).

    Args:
        crank: From the origin to its pin, [m].
        coupler: From pin to pin, [m].
        rocker: From pin to pin, [m].
        ground: From the crank's axis to the rocker's, along x, [m].
        point: From the crank's pin to the point of the coupler, [m].
        linear_density: Mass of a bar per length, [kg/m].
        radius: Radius of the bars, [m].

    Example:
        >>> chain = sst_pin.robots.four_bar()
        >>> chain.compute_torques(chain.home, [0], [0]).round(2)
        array([0.16])
    """
    tree = Tree("four_bar")
    for name, parent, at, length in (
        ("crank", "universe", UPRIGHT, crank),
        ("coupler", "crank", shift((crank, 0)), max(point, coupler)),  # its point may be beyond
        ("rocker", "universe", UPRIGHT * shift((ground, 0)), rocker),
    ):
        tree.add_hinge(name, bar(linear_density * length, length, radius), parent, at)
    tree.add_frame("coupler_pin", "coupler", (coupler, 0))
    tree.add_frame("rocker_pin", "rocker", (rocker, 0))
    tree.make_platform("coupler", (point, 0))
    # At home the crank stands at 60 degrees, and its pin at (x, y).
    x = crank * np.cos(np.pi / 3)
    y = crank * np.sin(np.pi / 3)
    angle, _ = two_link((ground - x, -y), coupler, rocker, elbow=-1)
    home = UPRIGHT * planar(x, y, angle) * shift((point, 0))
    joints = partial(_four_bar_joints, coupler, ground, point)
    return GalleryRobot(tree, [Closure("coupler_pin", "rocker_pin", "3d")], ["crank"], joints, home)


def _four_bar_joints(coupler: float, ground: float, point: float, pose: pin.SE3) -> Joints:
    """Inverse kinematics: the coupler's pose gives both of its pins, and these the other bars."""
    pose = UPRIGHT.actInv(pose)
    crank_pin = pose.act(np.array([-point, 0, 0]))
    rocker_pin = pose.act(np.array([coupler - point, 0, 0]))
    crank = angle_of(crank_pin)
    rocker = angle_of(rocker_pin - (ground, 0, 0))
    turn = float(in_one_turn(angle_about_z(pose.rotation) - crank))
    return {"crank": crank, "coupler": turn, "rocker": rocker}


@of_dimensions
def five_bar(
    *,
    span: float = 0.118,
    proximal: float = 0.09,
    distal: float = 0.09,
    linear_density: float = 0.8,
    radius: float = 0.006,
) -> GalleryRobot:
    """A five-bar robot of two motors that carries a point in the horizontal plane.

    The platform is the point where the arms meet, without orientation. Elbows point outwards.
    Lengths are like those of small five-bars for the laboratory (DexTAR; L. Campos, F. Bourbonnais,
    I. Bonev, P. Bigras, Development of a five-bar parallel robot with large workspace, ASME DETC
    2010).

    Args:
        span: Between the motors, along x, [m].
        proximal: Length of the driven links, [m].
        distal: Length of the others, [m].
        linear_density: Mass of a link per length, [kg/m].
        radius: Radius of the links, [m].
    """
    tree = Tree("five_bar")
    lengths = (proximal, distal)
    for k, x in enumerate((-span / 2, span / 2), 1):
        _add_arm(tree, k, (x, 0), lengths, linear_density, radius)
        tree.add_frame(f"tip_{k}", f"elbow_{k}", (distal, 0))
    tree.make_platform("elbow_1", (distal, 0))
    joints = partial(_five_bar_joints, span, lengths)
    reach = 0.85 * (proximal + distal)
    home = shift((0, np.sqrt(np.maximum(reach**2 - span**2 / 4, 0))))
    closures = [Closure("tip_1", "tip_2", "3d")]
    return GalleryRobot(tree, closures, ["shoulder_1", "shoulder_2"], joints, home, point=True)


def _five_bar_joints(span: float, lengths: _Lengths, pose: pin.SE3) -> Joints:
    """Inverse kinematics: each arm is a two-link arm to the platform; elbows point outwards."""
    joints: Joints = {}
    for k, side in ((1, -1), (2, 1)):
        target = pose.translation - (side * span / 2, 0, 0)
        shoulder, elbow = two_link(target, lengths[0], lengths[1], elbow=side)
        joints[f"shoulder_{k}"] = shoulder
        joints[f"elbow_{k}"] = elbow
    return joints


@of_dimensions
def planar_3rrr(
    *,
    base_radius: float = 0.35,
    platform_radius: float = 0.1,
    proximal: float = 0.2,
    distal: float = 0.2,
    platform_mass: float = 0.8,
    linear_density: float = 1.5,
    radius: float = 0.01,
) -> GalleryRobot:
    """A planar platform on three legs of three revolutes, the first of each leg driven.

    It moves in the horizontal plane; the platform's frame is in its middle. The robot of C.
    Gosselin and J. Angeles, The optimum kinematic design of a planar three-degree-of-freedom
    parallel manipulator, J. Mechanisms 110 (1988). Elbows bend to the left.

    Args:
        base_radius: Radius of the circle of the motors, [m].
        platform_radius: Radius of the circle of the platform's joints, [m].
        proximal: Length of the driven links, [m].
        distal: Length of the others, [m].
        platform_mass: [kg].
        linear_density: Mass of a link per length, [kg/m].
        radius: Radius of the links, [m].
    """
    return _planar_platform(
        "planar_3rrr",
        angles=np.pi / 2 + 2 * np.pi / 3 * np.arange(3),
        base_radius=base_radius,
        platform_radius=platform_radius,
        proximal=proximal,
        distal=distal,
        platform_mass=platform_mass,
        linear_density=linear_density,
        radius=radius,
    )


@of_dimensions
def planar_4rrr(
    *,
    base_radius: float = 0.35,
    platform_radius: float = 0.1,
    proximal: float = 0.2,
    distal: float = 0.2,
    platform_mass: float = 0.8,
    linear_density: float = 1.5,
    radius: float = 0.01,
) -> GalleryRobot:
    """A planar platform on four legs: four motors for three degrees of freedom.

    Redundant actuation removes singularities and allows preload against backlash (A. Müller,
    Internal preload control of redundantly actuated parallel manipulators, IEEE Trans. Robotics 21
    (2005)). Arguments as `planar_3rrr`.
    """
    return _planar_platform(
        "planar_4rrr",
        angles=np.pi / 4 + np.pi / 2 * np.arange(4),
        base_radius=base_radius,
        platform_radius=platform_radius,
        proximal=proximal,
        distal=distal,
        platform_mass=platform_mass,
        linear_density=linear_density,
        radius=radius,
    )


def _planar_platform(
    name: str,
    *,
    angles: ArrayLike,
    base_radius: float,
    platform_radius: float,
    proximal: float,
    distal: float,
    platform_mass: float,
    linear_density: float,
    radius: float,
) -> GalleryRobot:
    """A platform in the horizontal plane on legs at some angles about z, shape (legs,), [rad].

    In the tree, leg 1 carries the platform; the other legs are pinned to it.
    """
    base = circle(base_radius, angles)  # the motors
    vertices = circle(platform_radius, angles)  # the joints of the platform
    lengths = (proximal, distal)
    plate = star(platform_mass, vertices - vertices[0], radius)
    tree = Tree(name)
    legs = range(1, len(base) + 1)
    for k in legs:
        _add_arm(tree, k, base[k - 1], lengths, linear_density, radius)
        if k == 1:
            tree.add_hinge("wrist_1", plate, "elbow_1", shift((distal, 0)))
            tree.make_platform("wrist_1", -vertices[0])
        else:
            tree.add_frame(f"tip_{k}", f"elbow_{k}", (distal, 0))
            tree.add_frame(f"vertex_{k}", "wrist_1", vertices[k - 1] - vertices[0])
    closures = [Closure(f"vertex_{k}", f"tip_{k}", "3d") for k in legs[1:]]
    joints = partial(_planar_joints, base, vertices, lengths)
    motors = [f"shoulder_{k}" for k in legs]
    return GalleryRobot(tree, closures, motors, joints, planar(0, 0, 0))


def _planar_joints(base: Array, vertices: Array, lengths: _Lengths, pose: pin.SE3) -> Joints:
    """Inverse kinematics: each leg is a two-link arm to its vertex.

    `base` are the motors, `vertices` the joints of the platform in its frame, shape (legs, 3), [m].
    """
    joints: Joints = {}
    for k, (foot, vertex) in enumerate(zip(base, vertices, strict=True), 1):
        shoulder, elbow = two_link(pose.act(vertex) - foot, lengths[0], lengths[1], elbow=1)
        joints[f"shoulder_{k}"] = shoulder
        joints[f"elbow_{k}"] = elbow
    turn = angle_about_z(pose.rotation) - joints["shoulder_1"] - joints["elbow_1"]
    joints["wrist_1"] = float(in_one_turn(turn))
    return joints


def _add_arm(
    tree: Tree, k: int, foot: ArrayLike, lengths: _Lengths, linear_density: float, radius: float
) -> None:
    """Add two links in series: hinge shoulder_k at a foot on the base, then hinge elbow_k."""
    proximal, distal = lengths
    upper = bar(linear_density * proximal, proximal, radius)
    lower = bar(linear_density * distal, distal, radius)
    tree.add_hinge(f"shoulder_{k}", upper, at=shift(foot))
    tree.add_hinge(f"elbow_{k}", lower, f"shoulder_{k}", shift((proximal, 0)))

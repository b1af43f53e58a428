# SPDX-License-Identifier: BSD-2-Clause
"""Overconstrained robots closed by hinges: the spherical 3-RRR, Bennett's linkage."""

from functools import partial

import numpy as np
import pinocchio as pin
from pinocchio.rpy import rpyToMatrix

from ..model.closures import Closure
from .building_blocks import Solids, Tree, arc, bar, box, rod
from .gallery_robot import GalleryRobot, Joints, of_dimensions
from .placements import HERE, angle_about_z, direction, planar, shift, turned_x

_LEGS = (1, 2, 3)
#: Angle between the diagonal of a cube and its edges, [rad].
_CUBE = float(np.arccos(1 / np.sqrt(3)))


@of_dimensions
def agile_eye(
    *,
    radius: float = 0.09,
    proximal_mass: float = 0.12,
    distal_mass: float = 0.08,
    platform_mass: float = 0.1,
    camera_mass: float = 0.2,
) -> GalleryRobot:
    """The Agile Eye: a spherical 3-RRR with right angles between neighbouring axes.

    It turns a camera about the origin; z is the axis of symmetry. The two hinge closures have ten
    equations, six of which are redundant. The robot of C. Gosselin and J.-F. Hamel, The agile eye:
    a high-performance three-degree-of-freedom camera-orienting device, ICRA 1994.

    Args:
        radius: Radius of the driven links, [m].
        proximal_mass: Mass of each driven link, [kg].
        distal_mass: Mass of each of the other links, [kg].
        platform_mass: Without the camera, [kg].
        camera_mass: [kg].
    """
    masses = proximal_mass, distal_mass, platform_mass
    return _spherical_3rrr("agile_eye", radius, masses, box(camera_mass, (0.03, 0.03, 0.05)))


@of_dimensions
def agile_wrist(
    *,
    radius: float = 0.16,
    proximal_mass: float = 0.9,
    distal_mass: float = 0.6,
    platform_mass: float = 1.4,
    tool_mass: float = 0.8,
    tool: float = 0.15,
) -> GalleryRobot:
    """The Agile Wrist: the axes of the Agile Eye in the size of a robot's wrist, with a tool.

    The robot of F. Bidault, C.-P. Teng and J. Angeles, Structural optimization of a spherical
    parallel manipulator using a two-level approach, ASME DETC 2001.

    Args:
        radius: Radius of the driven links, [m].
        proximal_mass: Mass of each driven link, [kg].
        distal_mass: Mass of each of the other links, [kg].
        platform_mass: Without the tool, [kg].
        tool_mass: [kg].
        tool: Length of the tool, along the platform's z axis, [m].
    """
    masses = proximal_mass, distal_mass, platform_mass
    return _spherical_3rrr("agile_wrist", radius, masses, rod(tool_mass, (0, 0, tool), 0.015))


def _spherical_3rrr(
    name: str, radius: float, masses: tuple[float, float, float], payload: Solids
) -> GalleryRobot:
    """Legs of two quarter-circle links; leg 1 carries the platform, hinges close legs 2 and 3."""
    tree = Tree(name)
    quarter = turned_x(np.pi / 2)
    thickness = 0.06 * radius
    for k in _LEGS:
        upper = arc(masses[0], np.pi / 2, radius, thickness)
        lower = arc(masses[1], np.pi / 2, 0.85 * radius, thickness)
        tree.hinge(f"motor_{k}", upper, at=_motor_frame(k))
        tree.hinge(f"elbow_{k}", lower, f"motor_{k}", quarter)
        if k == 1:
            platform = _platform_frame(1).inverse()
            plate = []
            for j in _LEGS:
                spoke = 0.7 * radius * (platform * _platform_frame(j)).rotation[:, 2]
                plate += rod(masses[2] / 3, spoke, thickness)
            plate += [solid._replace(at=platform * solid.at) for solid in payload]
            tree.hinge("wrist_1", plate, "elbow_1", quarter)
            tree.platform("wrist_1", platform)
        else:
            tree.frame(f"end_{k}", f"elbow_{k}", quarter)
            tree.frame(f"axis_{k}", "wrist_1", platform * _platform_frame(k))
    closures = [Closure(f"axis_{k}", f"end_{k}", "hinge") for k in _LEGS[1:]]
    motors = [f"motor_{k}" for k in _LEGS]
    return GalleryRobot(tree, closures, motors, _spherical_joints, HERE)


def _spherical_joints(pose: pin.SE3) -> Joints:
    joints: Joints = {}
    quarter = turned_x(np.pi / 2).rotation
    for k in _LEGS:
        R = _motor_frame(k).rotation
        axis = pose.rotation @ _platform_frame(k).rotation
        x, y, _ = R.T @ axis[:, 2]
        motor = np.arctan2(y, x)
        R = R @ rpyToMatrix(0.0, 0.0, motor) @ quarter
        x, y, _ = R.T @ axis[:, 2]
        elbow = np.arctan2(x, -y)
        joints |= {f"motor_{k}": motor, f"elbow_{k}": elbow}
        if k == 1:
            R = R @ rpyToMatrix(0.0, 0.0, elbow) @ quarter
            joints["wrist_1"] = angle_about_z(R.T @ axis)
    return joints


def _motor_frame(k: int) -> pin.SE3:
    """A frame in the base whose z axis is that of motor k: three at right angles, below."""
    return _along_cube(2 * np.pi / 3 * k, np.pi - _CUBE)


def _platform_frame(k: int) -> pin.SE3:
    """A frame on the platform whose z axis is that of leg k: three at right angles, above."""
    return _along_cube(2 * np.pi / 3 * (k + 1) + np.pi, _CUBE)


def _along_cube(azimuth: float, tilt: float) -> pin.SE3:
    return pin.SE3(rpyToMatrix(0.0, 0.0, azimuth) @ rpyToMatrix(0.0, tilt, 0.0), np.zeros(3))


@of_dimensions
def bennett(
    *,
    crank: float = 0.3,
    twist: float = np.pi / 6,
    coupler_twist: float = np.pi / 2,
    linear_density: float = 2.0,
    radius: float = 0.01,
) -> GalleryRobot:
    """Bennett's linkage: four revolute joints, no two parallel; overconstrained but movable.

    Opposite bars are equal; lengths are proportional to the sines of their twists (G. T. Bennett, A
    new mechanism, Engineering 76 (1903)). The counting formula gives minus two degrees of freedom,
    but it has one: three of its five closure equations are redundant. The platform is the middle of
    the coupler.

    Args:
        crank: Length of the crank and of the bar across, [m].
        twist: Angle from the first axis of these bars to the second, [rad].
        coupler_twist: The same angle of the coupler and of the base, [rad].
        linear_density: Mass of a bar per length, [kg/m].
        radius: Radius of the bars, [m].
    """
    coupler = crank * np.sin(coupler_twist) / np.sin(twist)
    over_crank = shift((crank, 0)) * turned_x(twist)
    over_coupler = shift((coupler, 0)) * turned_x(coupler_twist)
    crank_bar = bar(linear_density * crank, crank, radius)
    coupler_bar = bar(linear_density * coupler, coupler, radius)
    tree = Tree("bennett")
    tree.hinge("crank", crank_bar)
    tree.hinge("coupler", coupler_bar, "crank", over_crank)
    tree.hinge("follower", crank_bar, "coupler", over_coupler)
    tree.frame("ground_pin", "universe", over_coupler.inverse())
    tree.frame("follower_pin", "follower", over_crank)
    tree.platform("coupler", (coupler / 2, 0))
    ratio = np.sin((coupler_twist + twist) / 2) / np.sin((coupler_twist - twist) / 2)
    joints = partial(_bennett_joints, coupler / 2, ratio)
    home = planar(0, 0, 1.2) * over_crank * planar(0, 0, _partner(1.2, ratio))
    closures = [Closure("ground_pin", "follower_pin", "hinge")]
    return GalleryRobot(tree, closures, ["crank"], joints, home * shift((coupler / 2, 0)))


def _bennett_joints(half_coupler: float, ratio: float, pose: pin.SE3) -> Joints:
    crank = direction(pose.act(np.array([-half_coupler, 0, 0])))
    return {"crank": crank, "coupler": _partner(crank, ratio), "follower": -crank}


def _partner(angle: float, ratio: float) -> float:
    """The second angle of the linkage: tan(first / 2) tan(second / 2) is constant."""
    return float(2 * np.arctan2(ratio * np.cos(angle / 2), np.sin(angle / 2)))

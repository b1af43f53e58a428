# SPDX-License-Identifier: BSD-2-Clause
"""Spherical robots 3-RRR: every axis passes through the origin."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..chain.closures import Closure
from .angles import angle_about_z
from .building_blocks import Solid, Tree, arc, box, rods, turned_x
from .gallery_robot import GalleryRobot, Joints, of_dimensions

_RZ = pin.JointModelRZ
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

    It turns a camera about the origin; z is the axis of symmetry. Each of its two hinge closures
    has five equations, of the ten six are redundant. The robot of C. Gosselin and J.-F. Hamel,
    The agile eye: a high-performance three-degree-of-freedom camera-orienting device, ICRA 1994;
    radius and masses are chosen here.

    Args:
        radius: Radius of the driven links, [m].
        proximal_mass: Mass of each driven link, [kg].
        distal_mass: Mass of each of the other links, [kg].
        platform_mass: Without the camera, [kg].
        camera_mass: [kg].

    Example:
        >>> chain = sst_pin.robots.agile_eye()
        >>> zero = np.zeros(chain.degrees_of_freedom)
        >>> chain.compute_torques(chain.home, zero, zero).round(2)
        array([0.06, 0.06, 0.06])
    """
    camera = box(camera_mass, (0.03, 0.03, 0.05))
    masses = proximal_mass, distal_mass, platform_mass
    return _spherical_3rrr("agile_eye", radius, masses, camera)


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
    parallel manipulator using a two-level approach, ASME DETC 2001; radius and masses are chosen
    here.

    Args:
        radius: Radius of the driven links, [m].
        proximal_mass: Mass of each driven link, [kg].
        distal_mass: Mass of each of the other links, [kg].
        platform_mass: Without the tool, [kg].
        tool_mass: [kg].
        tool: Length of the tool, along the platform's z axis, [m].

    Example:
        >>> chain = sst_pin.robots.agile_wrist()
        >>> zero = np.zeros(chain.degrees_of_freedom)
        >>> chain.compute_torques(chain.home, zero, zero).round(2)
        array([0.8, 0.8, 0.8])
    """
    bit = rods(tool_mass, [(0, 0, 0), (0, 0, tool)], 0.015)
    masses = proximal_mass, distal_mass, platform_mass
    return _spherical_3rrr("agile_wrist", radius, masses, bit)


def _spherical_3rrr(
    name: str, radius: float, masses: tuple[float, float, float], payload: list[Solid]
) -> GalleryRobot:
    """Two links of a quarter circle in each leg; leg 1 bears the platform, hinges the others."""
    tree = Tree(name)
    quarter, thickness = turned_x(np.pi / 2), 0.06 * radius
    for k in _LEGS:
        upper = arc(masses[0], np.pi / 2, radius, thickness)
        lower = arc(masses[1], np.pi / 2, 0.85 * radius, thickness)
        tree.joint(f"motor_{k}", _RZ(), upper, at=_motor_frame(k))
        tree.joint(f"elbow_{k}", _RZ(), lower, f"motor_{k}", quarter)
        if k == 1:
            platform = _platform_frame(1).inverse()
            spokes = [(platform * _platform_frame(j)).rotation[:, 2] for j in _LEGS]
            plate = [
                solid
                for spoke in spokes
                for solid in rods(masses[2] / 3, [(0, 0, 0), 0.7 * radius * spoke], thickness)
            ]
            plate += [solid._replace(at=platform * solid.at) for solid in payload]
            tree.joint("wrist_1", _RZ(), plate, "elbow_1", quarter)
            tree.platform("wrist_1", platform)
        else:
            tree.frame(f"end_{k}", f"elbow_{k}", quarter)
            tree.frame(f"axis_{k}", "wrist_1", platform * _platform_frame(k))
    closures = [Closure(f"axis_{k}", f"end_{k}", "hinge") for k in _LEGS[1:]]
    motors = [f"motor_{k}" for k in _LEGS]
    return GalleryRobot(tree, closures, motors, _spherical_joints, pin.SE3.Identity())


def _spherical_joints(pose: pin.SE3) -> Joints:
    joints: Joints = {}
    quarter = turned_x(np.pi / 2).rotation
    for k in _LEGS:
        R, axis = _motor_frame(k).rotation, pose.rotation @ _platform_frame(k).rotation
        x, y, _ = R.T @ axis[:, 2]
        R = R @ _about_z(np.arctan2(y, x)) @ quarter
        joints[f"motor_{k}"] = np.arctan2(y, x)
        x, y, _ = R.T @ axis[:, 2]
        R = R @ _about_z(np.arctan2(x, -y)) @ quarter
        joints[f"elbow_{k}"] = np.arctan2(x, -y)
        if k == 1:
            joints["wrist_1"] = angle_about_z(R.T @ axis)
    return joints


def _motor_frame(k: int) -> pin.SE3:
    """Its z axis is that of motor k: three at right angles, below."""
    return _along_cube(2 * np.pi / 3 * k, np.pi - _CUBE)


def _platform_frame(k: int) -> pin.SE3:
    """Its z axis is that of leg k on the platform, in the platform's frame: above."""
    return _along_cube(2 * np.pi / 3 * (k + 1) + np.pi, _CUBE)


def _along_cube(azimuth: float, tilt: float) -> pin.SE3:
    return pin.SE3(_about_z(azimuth) @ pin.rpy.rpyToMatrix(0.0, tilt, 0.0), np.zeros(3))


def _about_z(angle: float) -> Array:
    R: Array = pin.rpy.rpyToMatrix(0.0, 0.0, float(angle))
    return R

# SPDX-License-Identifier: BSD-2-Clause
"""Clavel's delta robot."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin

from ..chain.closures import Closure
from .angles import of_two_turns, two_link
from .building_blocks import Tree, disc, planar, rod, shift
from .gallery_robot import GalleryRobot, Joints, of_dimensions

_SIDES = {"a": 1, "b": -1}


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

    The rods are connected to the arms by universal joints and do not spin. Ball joints connect them
    to the platform, which is the child of rod_1a in the tree. The robot of R. Clavel, Delta, a fast
    robot with parallel geometry, ISIR 1988; dimensions and masses are chosen here, those of a
    machine for a table.

    Args:
        base_radius: Radius of the circle of the motors, [m].
        platform_radius: Radius of the circle of the platform's joints, [m].
        arm: Length of the driven arms, [m].
        forearm: Length of the rods, [m].
        spacing: Between the two rods of a pair, [m].
        arm_mass: Mass of each arm, [kg].
        rod_mass: Mass of each of the six rods, [kg].
        platform_mass: [kg].

    Example:
        >>> chain = sst_pin.robots.delta()
        >>> zero = np.zeros(chain.degrees_of_freedom)
        >>> chain.compute_torques(chain.home, zero, zero).round(2)
        array([-0.19, -0.19, -0.19])
    """
    tree = Tree("delta")
    x, y, _ = np.eye(3)
    vertices = {}
    for k in (1, 2, 3):
        leg = planar(0, 0, 2 * np.pi / 3 * (k - 1))
        motor = leg * shift((base_radius, 0))
        tree.joint(f"motor_{k}", pin.JointModelRY(), rod(arm_mass, (arm, 0, 0), 0.008), at=motor)
        for side, sign in _SIDES.items():
            offset = sign * spacing / 2
            vertices[f"{k}{side}"] = leg.act(np.array([platform_radius, offset, 0]))
            tree.joint(
                f"rod_{k}{side}",
                pin.JointModelUniversal(x, y),
                rod(rod_mass, (0, 0, -forearm), 0.004),
                f"motor_{k}",
                shift((arm, offset)),
            )
            end = 0, 0, -forearm
            if not tree.model.existFrame("platform"):
                plate = [
                    solid._replace(at=shift(-vertices["1a"]))
                    for solid in disc(platform_mass, platform_radius, 0.01)
                ]
                tree.joint("ball", pin.JointModelSpherical(), plate, "rod_1a", shift(end))
                tree.platform("ball", -vertices["1a"])
            else:
                tree.frame(f"end_{k}{side}", f"rod_{k}{side}", end)
                tree.frame(f"ball_{k}{side}", "ball", vertices[f"{k}{side}"] - vertices["1a"])
    closures = [Closure(f"ball_{name}", f"end_{name}", "3d") for name in vertices if name != "1a"]
    joints = partial(_delta_joints, radii=(base_radius, platform_radius), arm=arm, forearm=forearm)
    motors = [f"motor_{k}" for k in (1, 2, 3)]
    level = base_radius + arm - platform_radius  # of the arms, at home
    with np.errstate(invalid="ignore"):
        home = shift((0, 0, -np.sqrt(forearm**2 - level**2)))
    return GalleryRobot(tree, closures, motors, joints, home)


def _delta_joints(pose: pin.SE3, radii: tuple[float, float], arm: float, forearm: float) -> Joints:
    base_radius, platform_radius = radii
    joints: Joints = {}
    for k in (1, 2, 3):
        leg = planar(0, 0, 2 * np.pi / 3 * (k - 1))
        x, y, z = leg.actInv(pose.translation) - (base_radius - platform_radius, 0, 0)
        motor, _ = two_link((x, -z), arm, np.sqrt(forearm**2 - y**2), 1)
        turn = pin.rpy.rpyToMatrix(0.0, motor, 0.0)
        dx, dy, dz = turn.T @ (x, y, z) - (arm, 0, 0)
        rods = np.arctan2(dy, -dz), np.arctan2(-dx, np.hypot(dy, dz))
        joints |= {f"motor_{k}": motor, f"rod_{k}a": rods, f"rod_{k}b": rods}
        if k == 1:
            borne = (turn @ of_two_turns(*rods)).T
            joints["ball"] = pin.Quaternion(borne).coeffs()
    return joints

# SPDX-License-Identifier: BSD-2-Clause
"""Bennett's linkage."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin

from ..chain.closures import Closure
from .angles import direction
from .building_blocks import Tree, planar, rod, shift, turned_x
from .gallery_robot import GalleryRobot, Joints, of_dimensions


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

    Opposite bars are equal; lengths are proportional to the sines of their twists (G. T.
    Bennett, A new mechanism, Engineering 76 (1903)). The counting formula gives minus two
    degrees of freedom, but the linkage has one: three of its five closure equations are redundant.
    The platform is the middle of the coupler. Dimensions and masses are chosen here.

    Args:
        crank: Length of the crank and of the bar across, [m].
        twist: From the first axis of these bars to the second, [rad].
        coupler_twist: That of the coupler and of the base, [rad].
        linear_density: Mass of a bar per length, [kg/m].
        radius: Radius of the bars, [m].

    Example:
        >>> chain = sst_pin.robots.bennett()
        >>> zero = np.zeros(chain.degrees_of_freedom)
        >>> chain.compute_torques(chain.home, zero, zero).round(2)
        array([1.42])
    """
    coupler = crank * np.sin(coupler_twist) / np.sin(twist)
    over_crank = shift((crank, 0)) * turned_x(twist)
    over_coupler = shift((coupler, 0)) * turned_x(coupler_twist)
    bars = [rod(linear_density * length, (length, 0, 0), radius) for length in (crank, coupler)]
    tree = Tree("bennett")
    tree.joint("crank", pin.JointModelRZ(), bars[0])
    tree.joint("coupler", pin.JointModelRZ(), bars[1], "crank", over_crank)
    tree.joint("follower", pin.JointModelRZ(), bars[0], "coupler", over_coupler)
    tree.frame("ground_pin", "universe", over_coupler.inverse())
    tree.frame("follower_pin", "follower", over_crank)
    tree.platform("coupler", (coupler / 2, 0, 0))
    ratio = np.sin((coupler_twist + twist) / 2) / np.sin((coupler_twist - twist) / 2)
    joints = partial(_bennett_joints, half_coupler=coupler / 2, ratio=ratio)
    home = planar(0, 0, 1.2) * over_crank * planar(0, 0, _partner(1.2, ratio))
    closures = [Closure("ground_pin", "follower_pin", "hinge")]
    return GalleryRobot(tree, closures, ["crank"], joints, home * shift((coupler / 2, 0)))


def _bennett_joints(pose: pin.SE3, half_coupler: float, ratio: float) -> Joints:
    crank = direction(pose.act(np.array([-half_coupler, 0, 0])))
    return {"crank": crank, "coupler": _partner(crank, ratio), "follower": -crank}


def _partner(angle: float, ratio: float) -> float:
    """The second angle of the linkage: tan(first / 2) tan(second / 2) is constant."""
    return float(2 * np.arctan2(ratio * np.cos(angle / 2), np.sin(angle / 2)))

# SPDX-License-Identifier: BSD-2-Clause
"""Chains with any number of loops: scissor lift and ladder."""

from functools import partial

import numpy as np
import pinocchio as pin

from ..arrays import in_one_turn, whole_number
from ..chain.closures import Closure
from .building_blocks import Tree, bar, box
from .gallery_robot import GalleryRobot, Joints, of_dimensions
from .placements import HERE, UPRIGHT, planar, shift, two_link


@of_dimensions
def scissor_lift(
    cells: int = 3,
    *,
    arm: float = 1.0,
    arm_mass: float = 6.0,
    slider_mass: float = 2.0,
    platform_mass: float = 20.0,
    radius: float = 0.02,
) -> GalleryRobot:
    """A scissor lift of crossed arms, driven by the slider at its foot; x to the right, z up.

    The left foot is hinged to the base, the right one slides along x; so do the corners of the
    platform. The platform's frame is in its left corner. Each crossing closes a loop, whose plane
    makes one of its three equations redundant.

    Args:
        cells: Pairs of arms, one or more.
        arm: Length of an arm, [m].
        arm_mass: Mass of each arm, [kg].
        slider_mass: Mass of each of the two sliders, [kg].
        platform_mass: [kg].
        radius: Radius of the arms, [m].

    Raises:
        InputError: For no cells.

    Example:
        >>> chain = sst_pin.robots.scissor_lift()
        >>> chain.compute_torques(chain.home, [0], [0]).round(2)
        array([-2154.85])
    """
    cells = whole_number("cells", cells, 1)
    tree = Tree("scissor_lift")
    foot = box(slider_mass, (6 * radius, 4 * radius, 4 * radius))
    tip = shift((arm, 0))
    for order in ("ab", "ba"):  # the arms that begin at the hinge, and those at the slider
        parent, at = "universe", UPRIGHT
        if order == "ba":
            tree.joint("slider", pin.JointModelPX(), foot, at=UPRIGHT)
            parent, at = "slider", HERE
        for k in range(1, cells + 1):
            name = f"{order[(k - 1) % 2]}_{k}"
            tree.hinge(name, bar(arm_mass, arm, radius), parent, at)
            tree.frame(f"middle_of_{name}", name, (arm / 2, 0))
            parent, at = name, tip
        if parent.startswith("b"):
            plate = box(platform_mass, (arm, 2 * radius, arm / 2), (arm / 2, radius, 0))
            tree.hinge("platform_hinge", plate, parent, tip)
            tree.platform("platform_hinge")
            tree.joint("platform_slider", pin.JointModelPX(), foot, "platform_hinge")
            tree.frame("corner", "platform_slider", (0, 0))
        else:
            tree.frame("tip", parent, tip)
    closures = [Closure(f"middle_of_a_{k}", f"middle_of_b_{k}", "3d") for k in range(1, cells + 1)]
    closures += [Closure("corner", "tip", "3d")]
    home = UPRIGHT * shift((0, cells * arm * np.sin(0.5)))
    return GalleryRobot(tree, closures, ["slider"], partial(_lift_joints, cells, arm), home)


def _lift_joints(cells: int, arm: float, pose: pin.SE3) -> Joints:
    rise = np.arcsin(UPRIGHT.actInv(pose).translation[1] / (cells * arm))
    fold = np.pi - 2 * rise
    joints = {"slider": arm * np.cos(rise), "platform_slider": arm * np.cos(rise)}
    joints |= {"a_1": rise, "b_1": np.pi - rise, "platform_hinge": rise - np.pi}
    for k in range(2, cells + 1):
        joints |= {f"a_{k}": -fold, f"b_{k}": fold}
    return joints


@of_dimensions
def ladder(
    cells: int = 4,
    *,
    rail: float = 0.3,
    rung: float = 0.2,
    linear_density: float = 1.0,
    radius: float = 0.01,
) -> GalleryRobot:
    """A ladder of parallelograms, one upon the other, each driven; x to the right, z up.

    The loops share no joints, and there can be any number of them. The platform is the top rung,
    which does not turn; its frame lies at the left. For a place of the platform, the cells of the
    lower half lean alike, and those of the upper half.

    Args:
        cells: Parallelograms, two or more, each with a motor at its left rail.
        rail: Length of the rails, [m].
        rung: Length of the rungs, [m].
        linear_density: Mass of a bar per length, [kg/m].
        radius: Radius of the bars, [m].

    Raises:
        InputError: For fewer than two cells.

    Example:
        >>> chain = sst_pin.robots.ladder()
        >>> chain.compute_torques(chain.home, [0] * 4, [0] * 4).round(2)
        array([-2.92, -2.11,  1.91,  0.74])
    """
    cells = whole_number("cells", cells, 2)
    tree = Tree("ladder")
    rails, rungs = (bar(linear_density * length, length, radius) for length in (rail, rung))
    parent, at = "universe", UPRIGHT
    for k in range(1, cells + 1):
        tree.hinge(f"right_{k}", rails, parent, at * shift((rung, 0)))
        tree.hinge(f"left_{k}", rails, parent, at)
        tree.hinge(f"rung_{k}", rungs, f"left_{k}", shift((rail, 0)))
        tree.frame(f"end_of_right_{k}", f"right_{k}", (rail, 0))
        tree.frame(f"end_of_rung_{k}", f"rung_{k}", (rung, 0))
        parent, at = f"rung_{k}", HERE
    tree.platform(parent)
    steps = range(1, cells + 1)
    closures = [Closure(f"end_of_rung_{k}", f"end_of_right_{k}", "3d") for k in steps]
    lengths = (cells - cells // 2) * rail, cells // 2 * rail
    tip = planar(0, 0, np.radians(110)) * shift((lengths[0], 0))
    tip = tip * planar(0, 0, np.radians(-50)) * shift((lengths[1], 0))
    joints = partial(_ladder_joints, cells, lengths)
    home = UPRIGHT * shift(tip.translation)
    return GalleryRobot(tree, closures, [f"left_{k}" for k in steps], joints, home)


def _ladder_joints(cells: int, lengths: tuple[float, float], pose: pin.SE3) -> Joints:
    lower, bend = two_link(UPRIGHT.actInv(pose).translation, *lengths, -1)
    joints: Joints = {}
    for k in range(1, cells + 1):
        lean = lower if k <= cells - cells // 2 else float(in_one_turn(lower + bend))
        joints |= {f"left_{k}": lean, f"right_{k}": lean, f"rung_{k}": -lean}
    return joints

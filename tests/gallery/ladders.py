# SPDX-License-Identifier: BSD-2-Clause
"""A ladder: as many loops as one likes, which share no joints."""

from functools import partial

import numpy as np
import pinocchio as pin

from sst_pin.arrays import in_one_turn, whole_number
from sst_pin.model.closures import Closure
from sst_pin.robots.building_blocks import Tree, bar
from sst_pin.robots.gallery_robot import GalleryRobot, Joints, of_dimensions
from sst_pin.robots.placements import HERE, UPRIGHT, planar, shift, two_link


@of_dimensions
def ladder(cells: int = 4, *, rail: float = 0.3, rung: float = 0.2) -> GalleryRobot:
    """A ladder of parallelograms, one upon the other, each driven; x to the right, z up.

    The platform is the top rung, which does not turn; its frame lies at the left. For a place of
    the platform, the cells of the lower half lean alike, and those of the upper half.
    """
    cells = whole_number("cells", cells, 2)
    tree = Tree("ladder")
    rails, rungs = (bar(length, length, 0.01) for length in (rail, rung))  # 1 kg per metre
    parent, at = "universe", UPRIGHT
    for k in range(1, cells + 1):
        tree.add_hinge(f"right_{k}", rails, parent, at * shift((rung, 0)))
        tree.add_hinge(f"left_{k}", rails, parent, at)
        tree.add_hinge(f"rung_{k}", rungs, f"left_{k}", shift((rail, 0)))
        tree.add_frame(f"end_of_right_{k}", f"right_{k}", (rail, 0))
        tree.add_frame(f"end_of_rung_{k}", f"rung_{k}", (rung, 0))
        parent, at = f"rung_{k}", HERE
    tree.make_platform(parent)
    steps = range(1, cells + 1)
    closures = [Closure(f"end_of_rung_{k}", f"end_of_right_{k}", "3d") for k in steps]
    lengths = (cells - cells // 2) * rail, cells // 2 * rail
    tip = planar(0, 0, np.radians(110)) * shift((lengths[0], 0))
    tip = tip * planar(0, 0, np.radians(-50)) * shift((lengths[1], 0))
    joints = partial(_ladder_joints, cells, lengths)
    home = UPRIGHT * shift(tip.translation)
    return GalleryRobot(tree, closures, [f"left_{k}" for k in steps], joints, home)


def _ladder_joints(cells: int, lengths: tuple[float, float], pose: pin.SE3) -> Joints:
    lower, bend = two_link(UPRIGHT.actInv(pose).translation, *lengths, elbow=-1)
    joints: Joints = {}
    for k in range(1, cells + 1):
        lean = lower if k <= cells - cells // 2 else float(in_one_turn(lower + bend))
        joints |= {f"left_{k}": lean, f"right_{k}": lean, f"rung_{k}": -lean}
    return joints

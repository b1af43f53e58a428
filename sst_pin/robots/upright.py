# SPDX-License-Identifier: BSD-2-Clause
"""Upright mechanisms of several loops: scissor lift and an excavator's arm."""

from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import in_one_turn, whole_number
from ..model.closures import Closure
from .building_blocks import Tree, bar, box, rods
from .gallery_robot import GalleryRobot, Joints, of_dimensions
from .placements import HERE, UPRIGHT, angle_about_z, direction, planar, shift, two_link


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

    The left foot is hinged to the base, the right one slides along x. The platform has a hinge at
    its left corner, where its frame is, and a slider at the right one. Each crossing and this
    slider close a loop; one of the three equations of each planar loop is redundant.

    Args:
        cells: Pairs of arms, one or more.
        arm: Length of an arm, [m].
        arm_mass: Mass of each arm, [kg].
        slider_mass: Mass of each of the two sliders, [kg].
        platform_mass: [kg].
        radius: Radius of the arms, [m].

    Raises:
        InputError: For no cells.
    """
    cells = whole_number("cells", cells, 1)
    # Arms a rise to the right, arms b to the left. The chain from the hinge is a_1, b_2, a_3, ...,
    # that from the slider b_1, a_2, b_3, ... The last arm b ends at the upper left and carries the
    # platform.
    tree = Tree("scissor_lift")
    foot = box(slider_mass, (6 * radius, 4 * radius, 4 * radius))
    tip = shift((arm, 0))
    for order in ("ab", "ba"):  # the arms that begin at the hinge, and those at the slider
        parent = "universe"
        at = UPRIGHT
        if order == "ba":
            tree.joint("slider", pin.JointModelPX(), foot, at=UPRIGHT)
            parent = "slider"
            at = HERE
        for k in range(1, cells + 1):
            name = f"{order[(k - 1) % 2]}_{k}"
            tree.hinge(name, bar(arm_mass, arm, radius), parent, at)
            tree.frame(f"middle_of_{name}", name, (arm / 2, 0))
            parent = name
            at = tip
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
    """Positions of the joints: `rise` is the angle of an arm, `fold` that between two arms."""
    rise = np.arcsin(UPRIGHT.actInv(pose).translation[1] / (cells * arm))
    fold = np.pi - 2 * rise
    joints = {"slider": arm * np.cos(rise), "platform_slider": arm * np.cos(rise)}
    joints |= {"a_1": rise, "b_1": np.pi - rise, "platform_hinge": rise - np.pi}
    for k in range(2, cells + 1):
        joints |= {f"a_{k}": -fold, f"b_{k}": fold}
    return joints


#: In a plane, [m].
_Point = tuple[float, float]


class _Cylinder(NamedTuple):
    """A hydraulic cylinder between two bodies, named after the body that it moves in the end."""

    name: str
    #: Body that carries the barrel, and its foot there.
    carrier: str
    foot: _Point
    #: Body with the lug to which the eye of the rod is pinned, and the place of the lug.
    driven: str
    lug: _Point
    #: Length from foot to lug at no stroke, [m].
    retracted: float

    def add(self, tree: Tree, mass: float) -> None:
        """The barrel on its carrier, and the rod in it."""
        upright = UPRIGHT if self.carrier == "swing" else HERE
        barrel = bar(mass, 0.9 * self.retracted, 0.045)
        piston = rods(mass / 2, [(-0.9 * self.retracted, 0, 0), (0, 0, 0)], 0.025)
        barrel_joint = f"{self.name}_barrel"
        stroke = f"{self.name}_stroke"
        at = shift((self.retracted, 0))
        tree.hinge(barrel_joint, barrel, self.carrier, upright * shift(self.foot))
        tree.joint(stroke, pin.JointModelPX(), piston, barrel_joint, at)
        tree.frame(f"{self.name}_eye", stroke, (0, 0))


@of_dimensions
def excavator(
    *,
    boom: float = 2.4,
    arm: float = 1.3,
    bucket: float = 0.7,
    rocker: float = 0.3,
    link: float = 0.3,
    swing_mass: float = 900.0,
    boom_mass: float = 160.0,
    arm_mass: float = 80.0,
    bucket_mass: float = 60.0,
    link_mass: float = 6.0,
    cylinder_mass: float = 18.0,
) -> GalleryRobot:
    """The arm of a small excavator: a swing and three cylinders move boom, arm and bucket.

    The cylinders of boom and arm each form a triangle, the cylinder of the bucket a triangle and a
    four-bar: four loops in the arm's plane. The platform is the tip of the bucket, x along the
    bucket, z normal to the arm's plane. The attachments of the cylinders on swing, boom and arm do
    not depend on the lengths. The layout is that of every backhoe; dimensions and masses are those
    of a machine of three tonnes.

    Args:
        boom: Distance between its pins, [m].
        arm: From the boom's pin to the bucket's, [m].
        bucket: From its pin to its tip, [m].
        rocker: Length of the rocker on the arm that the bucket's cylinder moves, [m].
        link: Length of the link from the rocker to the bucket, [m].
        swing_mass: Mass of the house that turns, [kg].
        boom_mass: [kg].
        arm_mass: [kg].
        bucket_mass: [kg].
        link_mass: Mass of link and rocker each, [kg].
        cylinder_mass: Mass of each barrel; a rod weighs half as much, [kg].
    """
    foot = (0.3, 0.5)
    pivot = (arm - 0.3, 0.0)
    bucket_pin = (0.08, 0.25)
    cylinders = (
        _Cylinder("boom", "swing", (0.6, 0.3), "boom", (1.1, 0.2), 0.8),
        _Cylinder("arm", "boom", (1.2, 0.45), "arm", (-0.3, 0.2), 1.0),
        _Cylinder("bucket", "arm", (0.05, 0.3), "rocker", (rocker, 0), 0.85),
    )
    tree = Tree("excavator")
    tree.hinge("swing", box(swing_mass, (1.2, 1.0, 0.6), (-0.2, 0, 0.3)))
    carrier = "universe"
    for name, parent, at, mass, length, radius in (
        ("boom", "swing", UPRIGHT * shift(foot), boom_mass, boom, 0.1),
        ("arm", "boom", shift((boom, 0)), arm_mass, arm, 0.08),
        ("bucket", "arm", shift((arm, 0)), bucket_mass, bucket, 0.08),
        ("rocker", "arm", shift(pivot), link_mass, rocker, 0.03),
        ("link", "rocker", shift((rocker, 0)), link_mass, link, 0.03),
    ):
        # Pinocchio numbers joints depth first: the cylinders of a body, then the bodies it carries.
        # Bodies of one parent stand together.
        if parent != carrier:
            carrier = parent
            for cylinder in cylinders:
                if cylinder.carrier == carrier:
                    cylinder.add(tree, cylinder_mass)
        tree.hinge(name, bar(mass, length, radius), parent, at)
    for c in cylinders:
        tree.frame(f"{c.name}_lug", c.driven, c.lug)
    tree.platform("bucket", (bucket, 0))
    tree.frame("end_of_link", "link", (link, 0))
    tree.frame("pin_of_bucket", "bucket", bucket_pin)
    closures = [Closure(f"{c.name}_lug", f"{c.name}_eye", "3d") for c in cylinders]
    closures += [Closure("pin_of_bucket", "end_of_link", "3d")]
    home = UPRIGHT * shift(foot)
    for angle, length in zip((0.5, -1.7, -1.0), (boom, arm, bucket), strict=True):
        home = home * planar(0, 0, angle) * shift((length, 0))
    lengths = (boom, arm, bucket)
    bars = (rocker, link)
    joints = partial(_excavator_joints, foot, lengths, pivot, bucket_pin, bars, cylinders)
    motors = ["swing", *(f"{c.name}_stroke" for c in cylinders)]
    return GalleryRobot(tree, closures, motors, joints, home)


def _excavator_joints(
    foot: _Point,
    lengths: tuple[float, float, float],
    pivot: _Point,
    bucket_pin: _Point,
    bars: tuple[float, float],
    cylinders: tuple[_Cylinder, ...],
    pose: pin.SE3,
) -> Joints:
    swing = direction(pose.translation)
    local = (planar(0, 0, swing) * UPRIGHT * shift(foot)).actInv(pose)
    boom, arm, bucket = lengths
    wrist = local.act(np.array([-bucket, 0, 0]))
    raised, bent = two_link(wrist, boom, arm, -1)
    curled = float(in_one_turn(angle_about_z(local.rotation) - raised - bent))
    on_arm = planar(arm, 0, curled).act(np.array([*bucket_pin, 0]))
    rocker, link = two_link(on_arm - (*pivot, 0), bars[0], bars[1], -1)
    joints: Joints = {"swing": swing, "boom": raised, "arm": bent, "bucket": curled}
    joints |= {"rocker": rocker, "link": link}
    # Placements of the driven bodies on the bodies that carry their cylinders.
    placements = {
        "boom": planar(foot[0], foot[1], raised),
        "arm": planar(boom, 0, bent),
        "rocker": planar(pivot[0], pivot[1], rocker),
    }
    for c in cylinders:
        reach = placements[c.driven].act(np.array([*c.lug, 0])) - (*c.foot, 0)
        joints[f"{c.name}_barrel"] = direction(reach)
        joints[f"{c.name}_stroke"] = float(np.linalg.norm(reach)) - c.retracted
    return joints

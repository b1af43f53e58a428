# SPDX-License-Identifier: BSD-2-Clause
"""An excavator's arm, driven by cylinders."""

from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import in_one_turn
from ..chain.closures import Closure
from .building_blocks import Tree, bar, box, rods
from .gallery_robot import GalleryRobot, Joints, of_dimensions
from .placements import HERE, UPRIGHT, angle_about_z, direction, planar, shift, two_link

#: In a plane, [m].
_Point = tuple[float, float]


class _Cylinder(NamedTuple):
    """A hydraulic cylinder between two bodies, named after what it moves."""

    name: str
    #: Body that carries the barrel, and its foot there.
    carrier: str
    foot: _Point
    #: Body that the rod is pinned to, and its eye there.
    moved: str
    eye: _Point
    #: Length from foot to eye at no stroke, [m].
    retracted: float


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

    The boom's and the arm's cylinder make triangles, the bucket's a triangle and a four-bar: four
    loops in the arm's plane. The platform is the tip of the bucket, x along the bucket, z normal to
    the arm's plane. Where cylinders attach does not change with the lengths. The layout is that of
    every backhoe; dimensions and masses are those of a machine of three tonnes.

    Args:
        boom: Between its pins, [m].
        arm: From the boom's pin to the bucket's, [m].
        bucket: From its pin to its tip, [m].
        rocker: On the arm, moved by the bucket's cylinder, [m].
        link: From the rocker to the bucket, [m].
        swing_mass: Mass of the house that turns, [kg].
        boom_mass: [kg].
        arm_mass: [kg].
        bucket_mass: [kg].
        link_mass: Mass of link and rocker each, [kg].
        cylinder_mass: Mass of each barrel; a rod weighs half as much, [kg].

    Example:
        >>> chain = sst_pin.robots.excavator()
        >>> chain.compute_torques(chain.home, [0] * 4, [0] * 4).round(2)
        array([    0.  , 17590.55, -1772.63,   849.25])
    """
    foot, pivot, bucket_pin = (0.3, 0.5), (arm - 0.3, 0.0), (0.08, 0.25)
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
        if parent != carrier:  # depth first: the cylinders of a body before the bodies it carries
            carrier = parent
            _add_cylinders(tree, [c for c in cylinders if c.carrier == carrier], cylinder_mass)
        tree.hinge(name, bar(mass, length, radius), parent, at)
    for c in cylinders:
        tree.frame(f"{c.name}_lug", c.moved, c.eye)
    tree.platform("bucket", (bucket, 0))
    tree.frame("end_of_link", "link", (link, 0))
    tree.frame("pin_of_bucket", "bucket", bucket_pin)
    closures = [Closure(f"{c.name}_lug", f"{c.name}_eye", "3d") for c in cylinders]
    closures += [Closure("pin_of_bucket", "end_of_link", "3d")]
    home = UPRIGHT * shift(foot)
    for angle, length in zip((0.5, -1.7, -1.0), (boom, arm, bucket), strict=True):
        home = home * planar(0, 0, angle) * shift((length, 0))
    lengths, bars = (boom, arm, bucket), (rocker, link)
    joints = partial(_excavator_joints, foot, lengths, pivot, bucket_pin, bars, cylinders)
    motors = ["swing", *(f"{c.name}_stroke" for c in cylinders)]
    return GalleryRobot(tree, closures, motors, joints, home)


def _add_cylinders(tree: Tree, cylinders: list[_Cylinder], mass: float) -> None:
    for c in cylinders:
        upright = UPRIGHT if c.carrier == "swing" else HERE
        barrel = bar(mass, 0.9 * c.retracted, 0.045)
        piston = rods(mass / 2, [(-0.9 * c.retracted, 0, 0), (0, 0, 0)], 0.025)
        tree.hinge(f"{c.name}_barrel", barrel, c.carrier, upright * shift(c.foot))
        at = shift((c.retracted, 0))
        tree.joint(f"{c.name}_stroke", pin.JointModelPX(), piston, f"{c.name}_barrel", at)
        tree.frame(f"{c.name}_eye", f"{c.name}_stroke", (0, 0))


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
    rocker, link = two_link(on_arm - (*pivot, 0), *bars, -1)
    joints: Joints = {"swing": swing, "boom": raised, "arm": bent, "bucket": curled}
    joints |= {"rocker": rocker, "link": link}
    moved = {
        "boom": planar(*foot, raised),
        "arm": planar(boom, 0, bent),
        "rocker": planar(*pivot, rocker),
    }
    for c in cylinders:
        reach = moved[c.moved].act(np.array([*c.eye, 0])) - (*c.foot, 0)
        joints[f"{c.name}_barrel"] = direction(reach)
        joints[f"{c.name}_stroke"] = float(np.linalg.norm(reach)) - c.retracted
    return joints

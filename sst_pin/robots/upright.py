# SPDX-License-Identifier: BSD-2-Clause
"""Upright mechanisms of several loops: scissor lift and an excavator's arm."""

from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin

from ..arrays import in_one_turn, whole_number
from ..model.closures import Closure
from .building_blocks import Tree, bar, box, rods
from .gallery_robot import GalleryRobot, Joints, of_dimensions
from .placements import HERE, UPRIGHT, angle_about_z, angle_of, planar, shift, two_link


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
    # Cell k has two arms that cross in their middles: a_k rises to the right, b_k to the left. The
    # arms are hinged end to end in two zigzags. One stands on the fixed hinge: a_1, b_2, a_3, ...
    # The other one stands on the slider: b_1, a_2, b_3, ...
    on_hinge = []
    on_slider = []
    for k in range(1, cells + 1):
        if k % 2 == 1:
            on_hinge.append(f"a_{k}")
            on_slider.append(f"b_{k}")
        else:
            on_hinge.append(f"b_{k}")
            on_slider.append(f"a_{k}")
    tree = Tree("scissor_lift")
    foot = box(slider_mass, (6 * radius, 4 * radius, 4 * radius))
    tip = shift((arm, 0))

    def add_zigzag(names: list[str], parent: str, at: pin.SE3) -> None:
        """Add arms end to end, the first one at a placement on a parent; then what is on top."""
        for name in names:
            tree.add_hinge(name, bar(arm_mass, arm, radius), parent, at)
            tree.add_frame(f"middle_of_{name}", name, (arm / 2, 0))
            parent = name
            at = tip
        # One zigzag ends with the last arm b, at the upper left, and carries the platform. The
        # other one ends with the last arm a, below the platform's slider at the upper right.
        last_arm = names[-1]
        if last_arm == f"b_{cells}":
            plate = box(platform_mass, (arm, 2 * radius, arm / 2), (arm / 2, radius, 0))
            tree.add_hinge("platform_hinge", plate, last_arm, tip)
            tree.make_platform("platform_hinge")
            tree.add_joint("platform_slider", pin.JointModelPX(), foot, "platform_hinge")
            tree.add_frame("corner", "platform_slider", (0, 0))
        else:
            tree.add_frame("tip", last_arm, tip)

    add_zigzag(on_hinge, "universe", UPRIGHT)
    tree.add_joint("slider", pin.JointModelPX(), foot, at=UPRIGHT)
    add_zigzag(on_slider, "slider", HERE)
    closures = [Closure(f"middle_of_a_{k}", f"middle_of_b_{k}", "3d") for k in range(1, cells + 1)]
    closures += [Closure("corner", "tip", "3d")]
    # At home the arms rise by 0.5 rad.
    home = UPRIGHT * shift((0, cells * arm * np.sin(0.5)))
    return GalleryRobot(tree, closures, ["slider"], partial(_lift_joints, cells, arm), home)


def _lift_joints(cells: int, arm: float, pose: pin.SE3) -> Joints:
    """Inverse kinematics: the platform is at the height cells * arm * sin(rise).

    Arms a have the direction `rise` in the plane, arms b the direction pi - rise. Joints turn by
    the differences of the directions along a zigzag; the platform has the direction 0.
    """
    rise = np.arcsin(UPRIGHT.actInv(pose).translation[1] / (cells * arm))
    fold = np.pi - 2 * rise  # from the direction of arms a to that of arms b
    joints: Joints = {
        "slider": arm * np.cos(rise),
        "platform_slider": arm * np.cos(rise),
        "a_1": rise,
        "b_1": np.pi - rise,
        "platform_hinge": rise - np.pi,
    }
    for k in range(2, cells + 1):
        joints[f"a_{k}"] = -fold
        joints[f"b_{k}"] = fold
    return joints


#: A point in the plane of the arm, in the frame of a body, [m].
_Point = tuple[float, float]


@dataclass(frozen=True)
class _Cylinder:
    """A hydraulic cylinder between two bodies; its rod slides in its barrel.

    Attributes:
        name: First part of the names of its joints and frames.
        carrier: The body on which the barrel turns.
        foot: The pin of the barrel on the carrier.
        driven: The body that the rod drives.
        lug: The pin of the rod on the driven body.
        retracted: Distance of both pins at no stroke, [m].
    """

    name: str
    carrier: str
    foot: _Point
    driven: str
    lug: _Point
    retracted: float

    def add(self, tree: Tree, mass: float) -> None:
        """Add the barrel on its carrier, and in it the rod, which weighs half as much."""
        barrel = bar(mass, 0.9 * self.retracted, 0.045)
        piston = rods(mass / 2, [(-0.9 * self.retracted, 0, 0), (0, 0, 0)], 0.025)
        barrel_joint = f"{self.name}_barrel"
        stroke = f"{self.name}_stroke"
        # The z axis of the swing points up; those of the other bodies are normal to the plane.
        if self.carrier == "swing":
            at = UPRIGHT * shift(self.foot)
        else:
            at = shift(self.foot)
        tree.add_hinge(barrel_joint, barrel, self.carrier, at)
        tree.add_joint(stroke, pin.JointModelPX(), piston, barrel_joint, shift((self.retracted, 0)))
        tree.add_frame(f"{self.name}_eye", stroke, (0, 0))

    def add_closure(self, tree: Tree) -> Closure:
        """Add the lug on the driven body, and pin the end of the rod to it."""
        tree.add_frame(f"{self.name}_lug", self.driven, self.lug)
        return Closure(f"{self.name}_lug", f"{self.name}_eye", "3d")

    def joints(self, driven_in_carrier: pin.SE3) -> Joints:
        """Angle of the barrel and stroke, for a placement of the driven body in the carrier."""
        from_foot_to_lug = driven_in_carrier.act(np.array([*self.lug, 0])) - (*self.foot, 0)
        return {
            f"{self.name}_barrel": angle_of(from_foot_to_lug),
            f"{self.name}_stroke": float(np.linalg.norm(from_foot_to_lug)) - self.retracted,
        }


@dataclass(frozen=True)
class _ExcavatorArm:
    """The geometry of an excavator's arm, and its inverse kinematics.

    A swing turns about the vertical and carries boom, arm and bucket in series. The rocker turns on
    the arm, and the link connects the end of the rocker with the bucket. Each of these bodies has
    its origin at its first pin, and x along its length.

    Attributes:
        boom, arm, bucket, rocker, link: Lengths, [m].
        boom_pin: The pin of the boom on the swing.
        rocker_pin: The pin of the rocker on the arm.
        link_pin: The pin of the link on the bucket.
        boom_cylinder: It drives the boom, from the swing.
        arm_cylinder: It drives the arm, from the boom.
        bucket_cylinder: It drives the rocker, and so the bucket, from the arm.
    """

    boom: float
    arm: float
    bucket: float
    rocker: float
    link: float
    boom_pin: _Point
    rocker_pin: _Point
    link_pin: _Point
    boom_cylinder: _Cylinder
    arm_cylinder: _Cylinder
    bucket_cylinder: _Cylinder

    def joints(self, pose: pin.SE3) -> Joints:
        """Inverse kinematics in closed form: all joints for a pose of the bucket's tip."""
        # The swing turns the plane of the arm to the tip. From here on all is in this plane, with
        # the origin at the boom's pin.
        swing = angle_of(pose.translation)
        tip = (planar(0, 0, swing) * UPRIGHT * shift(self.boom_pin)).actInv(pose)
        # Boom and arm are a two-link arm to the pin of the bucket. The bucket turns by the rest of
        # the tip's angle.
        bucket_pin = tip.act(np.array([-self.bucket, 0, 0]))
        boom, arm = two_link(bucket_pin, self.boom, self.arm, elbow=-1)
        bucket = float(in_one_turn(angle_about_z(tip.rotation) - boom - arm))
        # Rocker and link are a two-link arm on the arm, to the link's pin on the bucket.
        bucket_in_arm = planar(self.arm, 0, bucket)
        link_pin = bucket_in_arm.act(np.array([*self.link_pin, 0]))
        from_rocker_pin = link_pin - (*self.rocker_pin, 0)
        rocker, link = two_link(from_rocker_pin, self.rocker, self.link, elbow=-1)
        joints: Joints = {
            "swing": swing,
            "boom": boom,
            "arm": arm,
            "bucket": bucket,
            "rocker": rocker,
            "link": link,
        }
        # Each cylinder closes a triangle with its carrier and its driven body.
        joints |= self.boom_cylinder.joints(planar(*self.boom_pin, boom))
        joints |= self.arm_cylinder.joints(planar(self.boom, 0, arm))
        joints |= self.bucket_cylinder.joints(planar(*self.rocker_pin, rocker))
        return joints


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
    geometry = _ExcavatorArm(
        boom=boom,
        arm=arm,
        bucket=bucket,
        rocker=rocker,
        link=link,
        boom_pin=(0.3, 0.5),
        rocker_pin=(arm - 0.3, 0.0),
        link_pin=(0.08, 0.25),
        boom_cylinder=_Cylinder(
            name="boom",
            carrier="swing",
            foot=(0.6, 0.3),
            driven="boom",
            lug=(1.1, 0.2),
            retracted=0.8,
        ),
        arm_cylinder=_Cylinder(
            name="arm",
            carrier="boom",
            foot=(1.2, 0.45),
            driven="arm",
            lug=(-0.3, 0.2),
            retracted=1.0,
        ),
        bucket_cylinder=_Cylinder(
            name="bucket",
            carrier="arm",
            foot=(0.05, 0.3),
            driven="rocker",
            lug=(rocker, 0),
            retracted=0.85,
        ),
    )
    cylinders = (geometry.boom_cylinder, geometry.arm_cylinder, geometry.bucket_cylinder)

    # Joints in the order in which Pinocchio numbers them: depth first.
    boom_placement = UPRIGHT * shift(geometry.boom_pin)
    tree = Tree("excavator")
    tree.add_hinge("swing", box(swing_mass, (1.2, 1.0, 0.6), (-0.2, 0, 0.3)))
    geometry.boom_cylinder.add(tree, cylinder_mass)
    tree.add_hinge("boom", bar(boom_mass, boom, 0.1), "swing", boom_placement)
    geometry.arm_cylinder.add(tree, cylinder_mass)
    tree.add_hinge("arm", bar(arm_mass, arm, 0.08), "boom", shift((boom, 0)))
    geometry.bucket_cylinder.add(tree, cylinder_mass)
    tree.add_hinge("bucket", bar(bucket_mass, bucket, 0.08), "arm", shift((arm, 0)))
    tree.add_hinge("rocker", bar(link_mass, rocker, 0.03), "arm", shift(geometry.rocker_pin))
    tree.add_hinge("link", bar(link_mass, link, 0.03), "rocker", shift((rocker, 0)))
    closures = [cylinder.add_closure(tree) for cylinder in cylinders]
    tree.make_platform("bucket", (bucket, 0))
    tree.add_frame("end_of_link", "link", (link, 0))
    tree.add_frame("pin_of_bucket", "bucket", geometry.link_pin)
    closures.append(Closure("pin_of_bucket", "end_of_link", "3d"))

    home = boom_placement
    for angle, length in ((0.5, boom), (-1.7, arm), (-1.0, bucket)):
        home = home * planar(0, 0, angle) * shift((length, 0))
    motors = ["swing", *(f"{cylinder.name}_stroke" for cylinder in cylinders)]
    return GalleryRobot(tree, closures, motors, geometry.joints, home)

# SPDX-License-Identifier: BSD-2-Clause
"""Joints of legged robots that motors drive by rods: ankle, knee, and a leg with both."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..chain.closures import Closure
from .angles import two_link, universal
from .building_blocks import Tree, box, disc, rod, shift
from .gallery_robot import GalleryRobot, Joints, of_dimensions

_RY = pin.JointModelRY


class _Rod(NamedTuple):
    """A motor with a crank that moves a link by a rod; x forward, y to the left, z up.

    The crank points backward at 0, and so does the link's lever where the joint is at 0.

    Attributes:
        name: Name in those of motor and rod: `motor_name`, `rod_name`.
        motor: The motor's axis in the frame of the joint, its link not turned, shape (3,), [m].
        crank: Length of the crank, [m].
        eye: Where the rod meets the link, in the frame of the link, shape (3,), [m].
        length: Length of the rod, [m].
    """

    name: str
    motor: Array
    crank: float
    eye: Array
    length: float

    def angles(self, turn: Array) -> tuple[float, Array]:
        """Angle of the motor, and the rod in the crank's axes, for the orientation of the link.

        Shapes (), (3,) and (3, 3); NaN out of reach.
        """
        x, y, z = turn @ self.eye - self.motor
        square = x * x + y * y + z * z
        middle = (square + self.crank**2 - self.length**2) / (2 * self.crank)
        motor = np.arctan2(z, -x) + np.arccos(middle / np.hypot(x, z))
        R = pin.rpy.rpyToMatrix(0.0, motor, 0.0)
        return float(motor), R.T @ (x, y, z) + (self.crank, 0.0, 0.0)


@of_dimensions
def ankle(
    *,
    width: float = 0.05,
    lever: float = 0.05,
    upper: float = 0.26,
    lower: float = 0.18,
    rod_mass: float = 0.06,
    crank_mass: float = 0.08,
    foot_mass: float = 0.9,
) -> GalleryRobot:
    """The ankle of a humanoid: two motors on the shank turn the foot in pitch and roll by two rods.

    The shank is fixed; the ankle is at the origin, x forward, z up. Equal turns of the motors make
    pitch, opposite ones roll. Balls connect the rods to the foot, universal joints to the cranks.
    The platform is the foot. The layout is common to present humanoids; dimensions and masses are
    chosen here.

    Args:
        width: From the middle to each rod, along y, [m].
        lever: Length of the cranks and of the foot's levers, [m].
        upper: Height of the left motor above the ankle, [m].
        lower: Height of the right motor above the ankle, [m].
        rod_mass: Mass of each rod, [kg].
        crank_mass: Mass of each crank, [kg].
        foot_mass: [kg].

    Example:
        >>> chain = sst_pin.robots.ankle()
        >>> zero = np.zeros(chain.degrees_of_freedom)
        >>> chain.compute_torques(chain.home, zero, zero).round(2)
        array([-0.09, -0.11])
    """
    tree = Tree("ankle")
    rods = _ankle_rods(width, lever, (upper, lower))
    masses = rod_mass, crank_mass, foot_mass
    closures = _add_ankle(tree, "universe", pin.SE3.Identity(), rods, masses)
    tree.platform("ankle_roll")
    return GalleryRobot(
        tree,
        closures,
        [f"motor_{r.name}" for r in rods],
        partial(_ankle_joints, rods=rods),
        pin.SE3(_pitch_roll(0.1, 0.05), np.zeros(3)),
    )


@of_dimensions
def knee(
    *,
    thigh: float = 0.4,
    shank: float = 0.4,
    height: float = 0.25,
    crank: float = 0.05,
    lever: float = 0.04,
    link_mass: float = 2.0,
    rod_mass: float = 0.15,
) -> GalleryRobot:
    """A knee of four bars: a motor on the thigh bends the knee by a crank, a rod and a lever.

    The thigh is fixed; the hip is at the origin, x forward, z up. The knee bends backward by 2 rad.
    The lever is shorter than the crank, so the gear ratio changes on the way. The platform is the
    shank. Dimensions and masses are chosen here.

    Args:
        thigh: From hip to knee, [m].
        shank: From knee to ankle, [m].
        height: Height of the motor above the knee, [m].
        crank: Length of the crank, [m].
        lever: Length of the shank's lever, [m].
        link_mass: Mass of the shank, [kg].
        rod_mass: Mass of rod and crank each, [kg].

    Example:
        >>> chain = sst_pin.robots.knee()
        >>> zero = np.zeros(chain.degrees_of_freedom)
        >>> chain.compute_torques(chain.home, zero, zero).round(2)
        array([3.65])
    """
    tree = Tree("knee")
    bar = _knee_rod(height, crank, lever)
    at = shift((0, 0, -thigh))
    closures = _add_knee(tree, "universe", at, bar, (rod_mass, link_mass), shank)
    tree.platform("knee")
    home = at * pin.SE3(_pitch_roll(0.8, 0.0), np.zeros(3))
    return GalleryRobot(
        tree,
        closures,
        ["motor_knee"],
        partial(_knee_pose_joints, bar=bar),
        home,
    )


@of_dimensions
def leg(
    *,
    thigh: float = 0.4,
    shank: float = 0.4,
    width: float = 0.05,
    lever: float = 0.05,
    thigh_mass: float = 4.0,
    shank_mass: float = 2.5,
    foot_mass: float = 0.9,
    rod_mass: float = 0.07,
) -> GalleryRobot:
    """A leg under a fixed hip: a hip motor, the knee of four bars, the ankle of two rods.

    The hip turns about y and is at the origin, x forward, z up. The platform is the foot, at the
    ankle. Motors sit at two thirds of the links or lower. Dimensions and masses are chosen here.

    Args:
        thigh: From hip to knee, [m].
        shank: From knee to ankle, [m].
        width: From the middle to each rod of the ankle, along y, [m].
        lever: Length of all cranks and of the ankle's levers; the knee's is 0.8 of it, [m].
        thigh_mass: [kg].
        shank_mass: [kg].
        foot_mass: [kg].
        rod_mass: Mass of each rod and crank of the ankle, [kg]; those of the knee weigh twice that.

    Example:
        >>> chain = sst_pin.robots.leg()
        >>> zero = np.zeros(chain.degrees_of_freedom)
        >>> chain.compute_torques(chain.home, zero, zero).round(2)
        array([-6.92,  4.51, -0.09, -0.1 ])
    """
    tree = Tree("leg")
    bar, rods = (
        _knee_rod(0.6 * thigh, lever, 0.8 * lever),
        _ankle_rods(width, lever, (0.65 * shank, 0.45 * shank)),
    )
    tree.joint("hip", _RY(), rod(thigh_mass, (0, 0, -thigh), 0.04))
    below = shift((0, 0, -thigh))
    closures = _add_knee(tree, "hip", below, bar, (2 * rod_mass, shank_mass), shank)
    masses = rod_mass, rod_mass, foot_mass
    at = shift((0, 0, -shank))
    closures += _add_ankle(tree, "knee", at, rods, masses)
    tree.platform("ankle_roll")
    joints = partial(_leg_joints, lengths=(thigh, shank), bar=bar, rods=rods)
    down = -0.9 * (thigh + shank)
    home = pin.SE3(_pitch_roll(0.1, 0.05), np.array([0.025 * (thigh + shank), 0.0, down]))
    return GalleryRobot(
        tree, closures, ["hip", "motor_knee", *(f"motor_{r.name}" for r in rods)], joints, home
    )


def _ankle_rods(width: float, lever: float, heights: tuple[float, float]) -> list[_Rod]:
    """The ankle's two, their rods vertical where the joint is at 0."""
    return [
        _Rod(
            side,
            np.array([0, sign * width, height]),
            lever,
            np.array([-lever, sign * width, 0]),
            height,
        )
        for side, sign, height in zip(("left", "right"), (1, -1), heights, strict=True)
    ]


def _knee_rod(height: float, crank: float, lever: float) -> _Rod:
    """The knee's, its lever level where the knee is bent by 1 rad, and its crank level too."""
    eye = pin.rpy.rpyToMatrix(0.0, -1.0, 0.0) @ (-lever, 0.0, 0.0)
    length = float(np.hypot(height, crank - lever))
    return _Rod("knee", np.array([0.0, 0.0, height]), crank, eye, length)


def _add_motor(tree: Tree, parent: str, at: pin.SE3, bar: _Rod, mass: float) -> None:
    """The crank of a motor whose joint is placed at `at` on its parent."""
    crank = rod(mass, (-bar.crank, 0, 0), 0.008)
    tree.joint(f"motor_{bar.name}", _RY(), crank, parent, at * shift(bar.motor))


def _add_knee(
    tree: Tree,
    parent: str,
    at: pin.SE3,
    bar: _Rod,
    masses: tuple[float, float],
    shank: float,
) -> list[Closure]:
    rod_mass, link_mass = masses
    _add_motor(tree, parent, at, bar, rod_mass)
    coupler = rod(rod_mass, (0, 0, -bar.length), 0.006)
    tree.joint("rod_knee", _RY(), coupler, "motor_knee", shift((-bar.crank, 0)))
    tree.frame("end_knee", "rod_knee", (0, 0, -bar.length))
    tree.joint("knee", _RY(), rod(link_mass, (0, 0, -shank), 0.03), parent, at)
    tree.frame("lever_knee", "knee", bar.eye)
    return [Closure("lever_knee", "end_knee", "3d")]


def _add_ankle(
    tree: Tree,
    parent: str,
    at: pin.SE3,
    rods: list[_Rod],
    masses: tuple[float, float, float],
) -> list[Closure]:
    rod_mass, crank_mass, foot_mass = masses
    x, y, _ = np.eye(3)
    for bar in rods:
        _add_motor(tree, parent, at, bar, crank_mass)
        tree.joint(
            f"rod_{bar.name}",
            pin.JointModelUniversal(x, y),
            rod(rod_mass, (0, 0, -bar.length), 0.005),
            f"motor_{bar.name}",
            shift((-bar.crank, 0)),
        )
        tree.frame(f"end_{bar.name}", f"rod_{bar.name}", (0, 0, -bar.length))
    size = abs(rods[0].eye[0])  # of levers: the foot is drawn by it
    tree.joint("ankle_pitch", _RY(), disc(0.05 * foot_mass, 0.4 * size, 0.4 * size), parent, at)
    foot = box(
        0.95 * foot_mass, np.multiply(size, (4.8, 1.8, 0.6)), np.multiply(size, (0.8, 0, -1))
    )
    tree.joint("ankle_roll", pin.JointModelRX(), foot, "ankle_pitch")
    for bar in rods:
        tree.frame(f"lever_{bar.name}", "ankle_roll", bar.eye)
    return [Closure(f"lever_{bar.name}", f"end_{bar.name}", "3d") for bar in rods]


def _pitch_roll(pitch: float, roll: float) -> Array:
    """Orientation by turns about y and then the moved x, shape (3, 3)."""
    R: Array = pin.rpy.rpyToMatrix(0.0, pitch, 0.0) @ pin.rpy.rpyToMatrix(roll, 0.0, 0.0)
    return R


def _pitch_and_roll(R: Array) -> tuple[float, float]:
    """Angles of an orientation by turns about y and then the moved x."""
    return float(np.arctan2(-R[2, 0], R[0, 0])), float(np.arctan2(-R[1, 2], R[1, 1]))


def _knee_pose_joints(pose: pin.SE3, bar: _Rod) -> Joints:
    return _knee_joints(_pitch_and_roll(pose.rotation)[0], bar)


def _knee_joints(bend: float, bar: _Rod) -> Joints:
    motor, along = bar.angles(pin.rpy.rpyToMatrix(0.0, bend, 0.0))
    return {"motor_knee": motor, "rod_knee": float(np.arctan2(-along[0], -along[2])), "knee": bend}


def _ankle_joints(pose: pin.SE3, rods: list[_Rod]) -> Joints:
    pitch, roll = _pitch_and_roll(pose.rotation)
    joints: Joints = {"ankle_pitch": pitch, "ankle_roll": roll}
    for bar in rods:
        motor, along = bar.angles(_pitch_roll(pitch, roll))
        joints |= {f"motor_{bar.name}": motor, f"rod_{bar.name}": universal(-along)}
    return joints


def _leg_joints(pose: pin.SE3, lengths: tuple[float, float], bar: _Rod, rods: list[_Rod]) -> Joints:
    x, _, z = pose.translation
    hip, bend = two_link((-z, -x), *lengths, 1)
    turned = pin.SE3(pin.rpy.rpyToMatrix(0.0, -hip - bend, 0.0) @ pose.rotation, np.zeros(3))
    return {"hip": hip} | _knee_joints(bend, bar) | _ankle_joints(turned, rods)

# SPDX-License-Identifier: BSD-2-Clause
"""Ankle, knee and leg of a humanoid, whose motors move the joints by rods.

Each drive is a four-bar: a motor turns a crank, and a rod connects the crank with a lever of the
link. In all frames x points forward, y to the left, z up. Pitch is a turn about y, roll about x.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin
from pinocchio.rpy import rpyToMatrix

from ..arrays import Array
from ..model.closures import Closure
from .building_blocks import Tree, box, disc, rod
from .gallery_robot import GalleryRobot, Joints, of_dimensions
from .placements import HERE, shift, two_link, universal_angles

_RY = pin.JointModelRY


@dataclass(frozen=True)
class _Drive:
    """A motor with a crank that moves a link by a rod.

    Where the motor is at 0, the crank points backward. The rod ends at the eye, a ball on the link.

    Attributes:
        name: Suffix of the names of motor, rod and frames.
        link: The joint of the link.
        motor: Position of the motor in the frame of the joint at 0, shape (3,), [m].
        crank: Length of the crank, [m].
        eye: Position of the eye in the frame of the link, shape (3,), [m].
        length: Length of the rod, [m].
        is_planar: Whether the rod stays in the plane of the crank. It then has a hinge at the
            crank, otherwise a universal joint.
    """

    name: str
    link: str
    motor: Array
    crank: float
    eye: Array
    length: float
    is_planar: bool

    def add(
        self, tree: Tree, parent: str, at: pin.SE3, *, rod_mass: float, crank_mass: float
    ) -> None:
        """Add crank and rod; `at` is the placement of the link's joint on the parent."""
        motor = f"motor_{self.name}"
        crank = rod(crank_mass, (-self.crank, 0, 0), 0.008)
        tree.add_joint(motor, _RY(), crank, parent, at * shift(self.motor))
        if self.is_planar:
            kind = _RY()
            radius = 0.006
        else:
            x, y, _ = np.eye(3)
            kind = pin.JointModelUniversal(x, y)
            radius = 0.005
        bars = rod(rod_mass, (0, 0, -self.length), radius)
        tree.add_joint(f"rod_{self.name}", kind, bars, motor, shift((-self.crank, 0)))
        tree.add_frame(f"end_{self.name}", f"rod_{self.name}", (0, 0, -self.length))

    def add_closure(self, tree: Tree) -> Closure:
        """Add the ball between the rod and the eye of the link."""
        tree.add_frame(f"lever_{self.name}", self.link, self.eye)
        return Closure(f"lever_{self.name}", f"end_{self.name}", "3d")

    def joints(self, R: Array) -> Joints:
        """Angles of motor and rod for an orientation R of the link; NaN out of reach.

        The motor turns by phi about y. Seen from the motor, the tip of the crank is at
        c(phi) = crank (-cos(phi), 0, sin(phi)), and the eye at r = (x, y, z). The rod connects
        both, so |r - c(phi)| = length. Squared, this is

            -x cos(phi) + z sin(phi) = (r . r + crank^2 - length^2) / (2 crank).

        The left side is h cos(phi - phi_0) with h = |(x, z)| and phi_0 = atan2(z, -x). There are
        two solutions, phi_0 +- acos(right side / h). The crank has the one with plus.
        """
        r = R @ self.eye - self.motor
        x, y, z = r
        square = x * x + y * y + z * z
        right_side = (square + self.crank**2 - self.length**2) / (2 * self.crank)
        motor = np.arctan2(z, -x) + np.arccos(right_side / np.hypot(x, z))
        # In the frame of the crank: the z axis of the rod points from the eye to the tip of the
        # crank, which is at (-crank, 0, 0).
        eye_in_crank = _pitch_roll(motor).T @ r
        z_axis = (-self.crank, 0.0, 0.0) - eye_in_crank
        if self.is_planar:
            rod_angles = np.arctan2(z_axis[0], z_axis[2])
        else:
            rod_angles = universal_angles(z_axis)
        return {f"motor_{self.name}": motor, f"rod_{self.name}": rod_angles}


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
    The platform is the foot. The layout is common to present humanoids.

    Args:
        width: From the middle to each rod, along y, [m].
        lever: Length of the cranks and of the foot's levers, [m].
        upper: Height of the left motor above the ankle, [m].
        lower: Height of the right motor above the ankle, [m].
        rod_mass: Mass of each rod, [kg].
        crank_mass: Mass of each crank, [kg].
        foot_mass: [kg].
    """
    tree = Tree("ankle")
    drives = _ankle_drives(width, lever, (upper, lower))
    closures = _add_ankle(
        tree,
        "universe",
        HERE,
        drives,
        rod_mass=rod_mass,
        crank_mass=crank_mass,
        foot_mass=foot_mass,
    )
    joints = partial(_ankle_joints, drives)
    home = pin.SE3(_pitch_roll(0.1, 0.05), np.zeros(3))
    return GalleryRobot(tree, closures, ["motor_left", "motor_right"], joints, home)


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

    The thigh is fixed; the hip is at the origin, x forward, z up. The knee can bend backward by 2
    rad. Lever and crank differ in length, so the gear ratio changes. The platform is the shank.

    Args:
        thigh: From hip to knee, [m].
        shank: From knee to ankle, [m].
        height: Height of the motor above the knee, [m].
        crank: Length of the crank, [m].
        lever: Length of the shank's lever, [m].
        link_mass: Mass of the shank, [kg].
        rod_mass: Mass of rod and crank each, [kg].
    """
    tree = Tree("knee")
    drive = _knee_drive(height, crank, lever)
    at = shift((0, 0, -thigh))
    closures = _add_knee(
        tree, "universe", at, drive, rod_mass=rod_mass, shank_mass=link_mass, shank=shank
    )
    tree.make_platform("knee")
    home = at * pin.SE3(_pitch_roll(0.8), np.zeros(3))
    return GalleryRobot(tree, closures, ["motor_knee"], partial(_knee_joints, drive), home)


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
    ankle. The knee's motor is on the thigh, the ankle's two are on the shank.

    Args:
        thigh: From hip to knee, [m].
        shank: From knee to ankle, [m].
        width: From the middle to each rod of the ankle, along y, [m].
        lever: Length of all cranks and of the ankle's levers; the knee's is 0.8 of it, [m].
        thigh_mass: [kg].
        shank_mass: [kg].
        foot_mass: [kg].
        rod_mass: Mass of each rod and crank of the ankle, [kg]; rod and crank of the knee are twice
            as heavy.
    """
    tree = Tree("leg")
    knee_drive = _knee_drive(0.6 * thigh, lever, 0.8 * lever)
    ankle_drives = _ankle_drives(width, lever, (0.65 * shank, 0.45 * shank))
    tree.add_joint("hip", _RY(), rod(thigh_mass, (0, 0, -thigh), 0.04))
    closures = _add_knee(
        tree,
        "hip",
        shift((0, 0, -thigh)),
        knee_drive,
        rod_mass=2 * rod_mass,
        shank_mass=shank_mass,
        shank=shank,
    )
    closures += _add_ankle(
        tree,
        "knee",
        shift((0, 0, -shank)),
        ankle_drives,
        rod_mass=rod_mass,
        crank_mass=rod_mass,
        foot_mass=foot_mass,
    )
    joints = partial(_leg_joints, (thigh, shank), knee_drive, ankle_drives)
    # At home the knee is bent: the ankle is almost below the hip, at 0.9 of the length of the leg.
    place = np.array([0.025 * (thigh + shank), 0.0, -0.9 * (thigh + shank)])
    motors = ["hip", "motor_knee", "motor_left", "motor_right"]
    return GalleryRobot(tree, closures, motors, joints, pin.SE3(_pitch_roll(0.1, 0.05), place))


def _ankle_drives(width: float, lever: float, heights: tuple[float, float]) -> list[_Drive]:
    """The two drives of the ankle; their rods are vertical where the ankle is at 0."""
    drives = []
    for name, y, height in zip(("left", "right"), (width, -width), heights, strict=True):
        motor = np.array([0, y, height])
        eye = np.array([-lever, y, 0])
        drive = _Drive(
            name=name,
            link="ankle_roll",
            motor=motor,
            crank=lever,
            eye=eye,
            length=height,
            is_planar=False,
        )
        drives.append(drive)
    return drives


def _knee_drive(height: float, crank: float, lever: float) -> _Drive:
    """The drive of the knee; where the knee is bent by 1 rad, lever and crank are horizontal.

    Both then point backward. The eye is crank - lever in front of the tip of the crank, and
    `height` below it, which gives the length of the rod.
    """
    eye = _pitch_roll(-1.0) @ (-lever, 0.0, 0.0)
    length = float(np.hypot(height, crank - lever))
    return _Drive(
        name="knee",
        link="knee",
        motor=np.array([0.0, 0.0, height]),
        crank=crank,
        eye=eye,
        length=length,
        is_planar=True,
    )


def _add_knee(
    tree: Tree,
    parent: str,
    at: pin.SE3,
    drive: _Drive,
    *,
    rod_mass: float,
    shank_mass: float,
    shank: float,
) -> list[Closure]:
    """Add crank, rod and shank, and return the closure, in a list.

    `at` is the placement of the knee on its parent. The crank has the mass of the rod. `shank` is
    the length from knee to ankle.
    """
    drive.add(tree, parent, at, rod_mass=rod_mass, crank_mass=rod_mass)
    tree.add_joint("knee", _RY(), rod(shank_mass, (0, 0, -shank), 0.03), parent, at)
    return [drive.add_closure(tree)]


def _add_ankle(
    tree: Tree,
    parent: str,
    at: pin.SE3,
    drives: list[_Drive],
    *,
    rod_mass: float,
    crank_mass: float,
    foot_mass: float,
) -> list[Closure]:
    """Add cranks, rods and the foot, which is the platform, and return the closures.

    `at` is the placement of the ankle on its parent. The ankle has two joints, pitch and then roll,
    with a small disc between them.
    """
    for drive in drives:
        drive.add(tree, parent, at, rod_mass=rod_mass, crank_mass=crank_mass)
    size = drives[0].crank  # the length of cranks and levers; disc and foot are multiples of it
    tree.add_joint("ankle_pitch", _RY(), disc(0.05 * foot_mass, 0.4 * size, 0.4 * size), parent, at)
    edges = np.multiply(size, (4.8, 1.8, 0.6))
    centre = np.multiply(size, (0.8, 0, -1))
    foot = box(0.95 * foot_mass, edges, centre)
    tree.add_joint("ankle_roll", pin.JointModelRX(), foot, "ankle_pitch")
    tree.make_platform("ankle_roll")
    return [drive.add_closure(tree) for drive in drives]


def _pitch_roll(pitch: float, roll: float = 0.0) -> Array:
    """Orientation by turns about y and then the moved x, shape (3, 3)."""
    return np.asarray(rpyToMatrix(0.0, pitch, 0.0) @ rpyToMatrix(roll, 0.0, 0.0))


def _knee_joints(drive: _Drive, pose: pin.SE3) -> Joints:
    """Inverse kinematics of the knee: the shank's pose is a turn about y."""
    bend = float(np.arctan2(-pose.rotation[2, 0], pose.rotation[0, 0]))
    return {"knee": bend} | drive.joints(_pitch_roll(bend))


def _ankle_joints(drives: list[_Drive], pose: pin.SE3) -> Joints:
    """Inverse kinematics of the ankle: the foot's pose is a turn about y, then about x."""
    R = pose.rotation
    pitch = float(np.arctan2(-R[2, 0], R[0, 0]))
    roll = float(np.arctan2(-R[1, 2], R[1, 1]))
    joints: Joints = {"ankle_pitch": pitch, "ankle_roll": roll}
    for drive in drives:
        joints |= drive.joints(_pitch_roll(pitch, roll))
    return joints


def _leg_joints(
    lengths: tuple[float, float], knee_drive: _Drive, ankle_drives: list[_Drive], pose: pin.SE3
) -> Joints:
    """Inverse kinematics of the leg; `lengths` are those of thigh and shank.

    Thigh and shank are a two-link arm from the hip to the ankle. The plane of this arm has the axes
    -z, along the straight leg, and -x: a positive turn about y brings -z to -x. The ankle then
    turns the foot to its orientation.
    """
    thigh, shank = lengths
    x, _, z = pose.translation
    hip, bend = two_link((-z, -x), thigh, shank, elbow=1)
    joints: Joints = {"hip": hip, "knee": bend}
    joints |= knee_drive.joints(_pitch_roll(bend))
    foot_on_shank = pin.SE3(_pitch_roll(-hip - bend) @ pose.rotation, np.zeros(3))
    return joints | _ankle_joints(ankle_drives, foot_on_shank)

# SPDX-License-Identifier: BSD-2-Clause
"""Overconstrained robots closed by hinges: the spherical 3-RRR, Bennett's linkage."""

from functools import partial

import numpy as np
import pinocchio as pin
from pinocchio.rpy import rpyToMatrix

from ..model.closures import Closure
from .building_blocks import Solids, Tree, arc, bar, box, rod
from .gallery_robot import GalleryRobot, Joints, of_dimensions
from .placements import HERE, angle_about_z, angle_of, planar, rotated_about_x, shift

_LEGS = (1, 2, 3)
#: Angle between the diagonal of a cube and its edges, [rad]. Three axes with this angle to z, with
#: azimuths that differ by 120 degrees, are at right angles to each other, as edges of a cube.
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

    It turns a camera about the origin; z is the axis of symmetry. The two hinge closures have ten
    equations, six of which are redundant. The robot of C. Gosselin and J.-F. Hamel, The agile eye:
    a high-performance three-degree-of-freedom camera-orienting device, ICRA 1994.

    Args:
        radius: Radius of the driven links, [m].
        proximal_mass: Mass of each driven link, [kg].
        distal_mass: Mass of each of the other links, [kg].
        platform_mass: Without the camera, [kg].
        camera_mass: [kg].
    """
    return _spherical_3rrr(
        "agile_eye",
        radius=radius,
        proximal_mass=proximal_mass,
        distal_mass=distal_mass,
        platform_mass=platform_mass,
        payload=box(camera_mass, (0.03, 0.03, 0.05)),
    )


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
    parallel manipulator using a two-level approach, ASME DETC 2001.

    Args:
        radius: Radius of the driven links, [m].
        proximal_mass: Mass of each driven link, [kg].
        distal_mass: Mass of each of the other links, [kg].
        platform_mass: Without the tool, [kg].
        tool_mass: [kg].
        tool: Length of the tool, along the platform's z axis, [m].
    """
    return _spherical_3rrr(
        "agile_wrist",
        radius=radius,
        proximal_mass=proximal_mass,
        distal_mass=distal_mass,
        platform_mass=platform_mass,
        payload=rod(tool_mass, (0, 0, tool), 0.015),
    )


def _spherical_3rrr(
    name: str,
    *,
    radius: float,
    proximal_mass: float,
    distal_mass: float,
    platform_mass: float,
    payload: Solids,
) -> GalleryRobot:
    """A spherical 3-RRR whose links are quarter circles; all axes pass through the origin.

    Each leg has the hinges motor, elbow and wrist. In the tree, leg 1 carries the platform; hinge
    closures connect it with the wrists of legs 2 and 3. The payload is fixed to the platform.
    """
    tree = Tree(name)
    quarter = rotated_about_x(np.pi / 2)  # from one hinge of a leg to the next
    thickness = 0.06 * radius
    # Placement of the platform's own frame in wrist 1. The body of the platform in the tree has the
    # frame of wrist 1.
    platform = _wrist_on_platform(1).inverse()
    for k in _LEGS:
        # Arcs from the z axis of a hinge, about its x axis, to the axis of the next hinge, which
        # `quarter` turns to -y.
        upper = arc(proximal_mass, np.pi / 2, radius, thickness)
        lower = arc(distal_mass, np.pi / 2, 0.85 * radius, thickness)
        tree.add_hinge(f"motor_{k}", upper, at=_motor_on_base(k))
        tree.add_hinge(f"elbow_{k}", lower, f"motor_{k}", quarter)
        if k == 1:
            plate = []
            for j in _LEGS:
                spoke = 0.7 * radius * (platform * _wrist_on_platform(j)).rotation[:, 2]
                plate += rod(platform_mass / 3, spoke, thickness)
            plate += [solid._replace(at=platform * solid.at) for solid in payload]
            tree.add_hinge("wrist_1", plate, "elbow_1", quarter)
            tree.make_platform("wrist_1", platform)
        else:
            tree.add_frame(f"end_{k}", f"elbow_{k}", quarter)
            tree.add_frame(f"axis_{k}", "wrist_1", platform * _wrist_on_platform(k))
    closures = [Closure(f"axis_{k}", f"end_{k}", "hinge") for k in _LEGS[1:]]
    motors = [f"motor_{k}" for k in _LEGS]
    return GalleryRobot(tree, closures, motors, _spherical_joints, HERE)


def _spherical_joints(pose: pin.SE3) -> Joints:
    """Inverse kinematics in closed form, one leg after the other.

    The pose of the platform gives the axis w of the wrist. In the frame of the motor, the axis of
    the elbow is Rot_z(motor) Rot_x(pi/2) z = (sin motor, -cos motor, 0). It must be normal to
    w = (x, y, z), so tan motor = y / x. In the frame of the elbow, w itself is the axis of the next
    hinge: w = Rot_z(elbow) Rot_x(pi/2) z = (sin elbow, -cos elbow, 0).
    """
    joints: Joints = {}
    quarter = rotated_about_x(np.pi / 2).rotation
    for k in _LEGS:
        wrist = pose.rotation @ _wrist_on_platform(k).rotation
        w = wrist[:, 2]

        # The motor's frame, where the motor is at 0.
        motor_frame = _motor_on_base(k).rotation
        w_in_motor = motor_frame.T @ w
        motor = np.arctan2(w_in_motor[1], w_in_motor[0])
        joints[f"motor_{k}"] = motor

        # The elbow's frame, where the elbow is at 0.
        elbow_frame = motor_frame @ rpyToMatrix(0.0, 0.0, motor) @ quarter
        w_in_elbow = elbow_frame.T @ w
        elbow = np.arctan2(w_in_elbow[0], -w_in_elbow[1])
        joints[f"elbow_{k}"] = elbow

        if k == 1:  # the other wrists are closures
            wrist_frame = elbow_frame @ rpyToMatrix(0.0, 0.0, elbow) @ quarter
            joints["wrist_1"] = angle_about_z(wrist_frame.T @ wrist)
    return joints


def _motor_on_base(k: int) -> pin.SE3:
    """The frame of motor k in the base. Its z axis is the motor's; the three axes point down."""
    return _tilted_frame(2 * np.pi / 3 * k, np.pi - _CUBE)


def _wrist_on_platform(k: int) -> pin.SE3:
    """The frame of wrist k on the platform. Its z axis is the wrist's; the three axes point up.

    The axes of the motors, reversed, point up: they are three edges of a cube. At home, the axes of
    the wrists are the same three edges. Wrist k is along the reversed axis of motor k + 1, so that
    the axes of motor k and wrist k are at right angles. The axis of elbow k is the third edge.
    """
    return _tilted_frame(2 * np.pi / 3 * (k + 1) + np.pi, _CUBE)


def _tilted_frame(azimuth: float, tilt: float) -> pin.SE3:
    """A frame at the origin whose z axis is tilted from z, towards an azimuth, [rad]."""
    return pin.SE3(rpyToMatrix(0.0, 0.0, azimuth) @ rpyToMatrix(0.0, tilt, 0.0), np.zeros(3))


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

    Opposite bars are equal; lengths are proportional to the sines of their twists (G. T. Bennett, A
    new mechanism, Engineering 76 (1903)). The twist of a bar is the angle between its two axes. The
    counting formula gives minus two degrees of freedom, but the linkage has one: three of its five
    closure equations are redundant. The platform is the middle of the coupler.

    Args:
        crank: Length of the crank and of the follower, the bar across, [m].
        twist: Twist of crank and follower, [rad].
        coupler_twist: Twist of the coupler and of the base, [rad].
        linear_density: Mass of a bar per length, [kg/m].
        radius: Radius of the bars, [m].
    """
    coupler = crank * np.sin(coupler_twist) / np.sin(twist)
    # Placements of the second pin of a bar in the frame of its first pin.
    crank_end = shift((crank, 0)) * rotated_about_x(twist)
    coupler_end = shift((coupler, 0)) * rotated_about_x(coupler_twist)
    crank_bar = bar(linear_density * crank, crank, radius)
    coupler_bar = bar(linear_density * coupler, coupler, radius)
    tree = Tree("bennett")
    tree.add_hinge("crank", crank_bar)
    tree.add_hinge("coupler", coupler_bar, "crank", crank_end)
    tree.add_hinge("follower", crank_bar, "coupler", coupler_end)
    # The base is a bar like the coupler, from the pin of the follower to the pin of the crank. The
    # crank turns about the origin, so the first pin of this bar is at `coupler_end.inverse()`.
    tree.add_frame("ground_pin", "universe", coupler_end.inverse())
    tree.add_frame("follower_pin", "follower", crank_end)
    tree.make_platform("coupler", (coupler / 2, 0))
    closures = [Closure("ground_pin", "follower_pin", "hinge")]

    # With equal twists the ratio is infinite: the coupler stays folded back, at pi.
    with np.errstate(divide="ignore"):
        ratio = np.sin((coupler_twist + twist) / 2) / np.sin((coupler_twist - twist) / 2)
    joints = partial(_bennett_joints, coupler / 2, ratio)
    crank_angle = 1.2
    coupler_pin = planar(0, 0, crank_angle) * crank_end
    home = coupler_pin * planar(0, 0, _coupler_angle(crank_angle, ratio)) * shift((coupler / 2, 0))
    return GalleryRobot(tree, closures, ["crank"], joints, home)


def _bennett_joints(half_coupler: float, ratio: float, pose: pin.SE3) -> Joints:
    """Inverse kinematics: the pin of the crank is half a coupler behind the platform.

    In Bennett's linkage the angles of opposite hinges add up to a full turn. The hinge of the
    follower is opposite to that of the crank, so its angle is -crank.
    """
    crank = angle_of(pose.act(np.array([-half_coupler, 0, 0])))
    return {"crank": crank, "coupler": _coupler_angle(crank, ratio), "follower": -crank}


def _coupler_angle(crank: float, ratio: float) -> float:
    """The angle of the coupler: Bennett's tan(crank / 2) tan(coupler / 2) = ratio."""
    return float(2 * np.arctan2(ratio * np.cos(crank / 2), np.sin(crank / 2)))

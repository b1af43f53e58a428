# SPDX-License-Identifier: BSD-2-Clause
"""Mechanisms on which the literature of multibody dynamics compares its programs.

Axes, masses and starts are those of the publications; docs/standard_problems.md has the results.
"""

from functools import partial

import coal
import numpy as np
import pinocchio as pin

from sst_pin.arrays import in_one_turn, whole_number
from sst_pin.model.closures import Closure
from sst_pin.model.lines import LineForce
from sst_pin.robots.building_blocks import Solid, Tree, body, box
from sst_pin.robots.gallery_robot import GalleryRobot, Joints
from sst_pin.robots.placements import angle_about_z, angle_of, planar, shift, two_link

_ALONG_Y = np.array([0.0, -9.81, 0.0])


def n_four_bar(loops: int = 2) -> GalleryRobot:
    """A row of four-bars that share their vertical bars; all bars of 1 m and 1 kg, slender.

    Problem A02 of the IFToMM library. At home the vertical bars are upright; the weight is along
    -y. Where all bars lie on one line, the mechanism is singular and has loops + 1 degrees of
    freedom. The platform is the first horizontal bar, which does not turn; its frame is at its
    left end. The motor is at the foot of the first vertical bar.
    """
    loops = whole_number("loops", loops, 1)
    tree = Tree("n_four_bar")
    tree.model.gravity.linear = _ALONG_Y
    moments, points = np.array([0.02**2 / 2, 1 / 12, 1 / 12]), np.array([(0, 0, 0), (1.0, 0, 0)])
    bar = body(1.0, points[1] / 2, moments, points, 0.02)
    for k in range(loops + 1):
        tree.add_hinge(f"bar_{k}", bar, at=shift((k, 0)))
        tree.add_frame(f"end_of_bar_{k}", f"bar_{k}", points[1])
        if k < loops:
            tree.add_hinge(f"link_{k + 1}", bar, f"bar_{k}", shift(points[1]))
            tree.add_frame(f"end_of_link_{k + 1}", f"link_{k + 1}", points[1])
    tree.make_platform("link_1")
    steps = range(1, loops + 1)
    closures = [Closure(f"end_of_link_{k}", f"end_of_bar_{k}", "3d") for k in steps]
    joints = partial(_n_four_bar_joints, loops)
    return GalleryRobot(tree, closures, ["bar_0"], joints, shift((0, 1)))


def _n_four_bar_joints(loops: int, pose: pin.SE3) -> Joints:
    lean = angle_of(pose.translation)
    links: Joints = {f"link_{k}": -lean for k in range(1, loops + 1)}
    return links | {f"bar_{k}": lean for k in range(loops + 1)}


#: Points of Andrews' mechanism in the base and on its bodies, [m]; names of the IVP test set.
_A, _B = (-0.06934, -0.00227), (-0.03635, 0.03273)
_D, _RR, _E, _SS, _U, _ZF, _ZT = 0.028, 0.007, 0.02, 0.035, 0.04, 0.02, 0.04


def andrews() -> GalleryRobot:
    """Andrews' squeezing mechanism: seven bodies in a plane, three loops through one point.

    Problem A03 of the IFToMM library (E. Hairer and G. Wanner, Solving Ordinary Differential
    Equations II, VII.7; the joints have the names of its angles). There is no weight. Dimensions,
    masses and moments of inertia about z are the published ones; those about x and y do not count.
    A spring pulls gamma towards the base, the motor drives beta. At home, the published start,
    theta is at a dead point: gamma does not describe the motion there. The platform is the body of
    theta, its frame where all loops meet.
    """
    tree = Tree("andrews")
    tree.model.gravity.linear = np.zeros(3)
    fixed = "universe"
    for name, parent, at, mass, inertia, centre, ends in (
        ("beta", fixed, (0, 0), 0.04325, 2.194e-6, (0.00092, 0), [(_RR, 0)]),
        ("theta", "beta", (_RR, 0), 0.00365, 4.410e-7, (-0.0115, 0), [(-_D, 0)]),
        ("gamma", fixed, _B, 0.02373, 5.255e-6, (0.01874, 0.01043), [(0.02, -0.018), (0, -_SS)]),
        ("delta", fixed, _A, 0.07050, 1.169e-5, (0.02308, 0.00916), [(_ZT, 0)]),
        ("phi", "delta", (_ZT, 0), 0.00706, 5.667e-7, (0, 0.01421 - _E), [(0, -_E)]),
        ("epsilon", fixed, _A, 0.05498, 1.912e-5, (0.01228, 0.00449), [(0, -_U)]),
        ("omega", "epsilon", (0, -_U), 0.00706, 5.667e-7, (_ZF - 0.01421, 0), [(_ZF, 0)]),
    ):
        line = np.array([(0, 0, 0), *((*end, 0) for end in ends)], dtype=float)
        solids = body(mass, centre, inertia * np.array([0.6, 0.6, 1]), line, 0.0012)
        tree.add_hinge(name, solids, parent, shift(at))
        tree.add_frame(f"tip_of_{name}", name, line[-1])
    tree.make_platform("theta", (-_D, 0))
    tree.add_frame("spring_foot", fixed, (0.014, 0.072))
    tree.add_frame("spring_eye", "gamma", (0.02, -0.018))
    spring = LineForce("spring_foot", "spring_eye", stiffness=4530.0, rest_length=0.07785)
    tips = [Closure(f"tip_of_{name}", "tip_of_theta", "3d") for name in ("gamma", "phi", "omega")]
    home = planar(0, 0, -0.0617138900142764496358948458001) * shift((_RR - _D, 0))
    return GalleryRobot(tree, tips, ["beta"], _andrews_joints, home, lines=[spring])


def _andrews_joints(pose: pin.SE3) -> Joints:
    tip = pose.translation
    beta, gamma = angle_of(pose.act(np.array([_D, 0, 0]))), angle_of(tip[:2] - _B) + np.pi / 2
    delta, bend = two_link(tip[:2] - _A, _ZT, _E, elbow=-1)
    epsilon, knee = two_link(tip[:2] - _A, _U, _ZF, elbow=1)
    return {
        "beta": beta,
        "theta": float(in_one_turn(angle_about_z(pose.rotation) - beta)),
        "gamma": gamma,
        "delta": delta,
        "phi": bend + np.pi / 2,
        "epsilon": epsilon + np.pi / 2,
        "omega": knee - np.pi / 2,
    }


def governor() -> GalleryRobot:
    """A flyball governor whose springs and dampers are stiff; an open tree.

    Problem A05 of the IFToMM library: a shaft that turns about z, two arms with balls hinged to it,
    a slider on it, and a spring with a damper from the middle of each arm to the slider. All four
    joints have a motor. The platform is the slider; for a pose of it the springs are at rest.
    """
    tree, lines = Tree("governor"), []
    tree.add_hinge("shaft", box(0.3, (0.01, 0.01, 1), (0, 0, 0.5)))
    point = pin.Inertia(5, np.zeros(3), np.zeros((3, 3)))
    ball = Solid(point, coal.Box(0.07, 0.07, 0.07), shift((1, 0)))
    for k, turn in ((1, 0.0), (2, np.pi)):
        arm = [*box(0.3, (1, 0.01, 0.01), (0.5, 0, 0)), ball]
        hinge = planar(0, 0, turn) * shift((0.05, 0, 1))
        tree.add_joint(f"arm_{k}", pin.JointModelRY(), arm, "shaft", hinge)
        tree.add_frame(f"middle_{k}", f"arm_{k}", (0.5, 0, 0))
        lines.append((f"middle_{k}", f"foot_{k}"))
    tree.add_joint("slider", pin.JointModelPZ(), box(3.0, (0.1, 0.1, 0.1)), "shaft")
    for k, x in ((1, 0.05), (2, -0.05)):
        tree.add_frame(f"foot_{k}", "slider", (x, 0, 0))
    tree.make_platform("slider")
    home = shift((0, 0, 0.5))
    spring = partial(LineForce, stiffness=8e5, rest_length=0.5, damping=4e4)
    springs = [spring(*line) for line in lines]
    motors = ["shaft", "arm_1", "arm_2", "slider"]
    return GalleryRobot(tree, [], motors, _governor_joints, home, lines=springs)


def _governor_joints(pose: pin.SE3) -> Joints:
    height = pose.translation[2]
    alpha = np.arcsin(1 - height)  # below the horizontal; half an arm and its spring are equal
    return {"shaft": angle_about_z(pose.rotation), "arm_1": alpha, "arm_2": alpha, "slider": height}

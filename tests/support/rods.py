# SPDX-License-Identifier: BSD-2-Clause
"""Parallel robots whose legs are rods of constant length, and their positions in closed form."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

import sst_pin

#: Radii of the motors of a delta and of the balls on its platform, and length of its arms, [m].
BASE, PLATFORM, ARM = 0.2, 0.05, 0.1
#: Points on the ground and on the platform of a hexaglide, [m]: pairs, and no regular hexagon.
GUIDES = 0.3 * np.array([[np.cos(a), np.sin(a), 0] for a in (0, 0.5, 2.1, 2.5, 4.2, 4.8)])
BALLS = 0.12 * np.array([[np.cos(a), np.sin(a), 0] for a in (-0.5, 1.0, 1.6, 3.1, 3.7, 5.2)])


def rod_delta(lengths: Sequence[float]) -> sst_pin.ClosedChain:
    """A delta whose platform slides in space, with a rod from each of three arms."""
    model = pin.Model()
    platform = model.addJoint(0, pin.JointModelTranslation(), _at(0, 0, -0.3), "slides")
    model.appendBodyToJoint(platform, pin.Inertia.FromBox(0.2, 0.1, 0.1, 0.01), _at(0, 0, 0))
    _frame(model, "platform", platform, _at(0, 0, 0))
    closures = []
    for k, length in enumerate(lengths, 1):
        leg = pin.SE3(pin.rpy.rpyToMatrix(0, 0, 2 * np.pi * k / 3), np.zeros(3))
        motor = model.addJoint(0, pin.JointModelRY(), leg * _at(BASE, 0, 0), f"motor_{k}")
        arm = pin.Inertia.FromBox(0.1, ARM, 0.01, 0.01)
        model.appendBodyToJoint(motor, arm, _at(ARM / 2, 0, 0))
        _frame(model, f"elbow_{k}", motor, _at(ARM, 0, 0))
        _frame(model, f"ball_{k}", platform, leg * _at(PLATFORM, 0, 0))
        closures.append(sst_pin.Distance(f"elbow_{k}", f"ball_{k}", length))
    home = np.array([0.0, 0.0, 0.0, 0.3, 0.3, 0.3])
    model.referenceConfigurations["home"] = home
    return sst_pin.ClosedChain(model, closures, ["motor_1", "motor_2", "motor_3"])


def hexaglide(lengths: Sequence[float]) -> sst_pin.ClosedChain:
    """Six carriages on vertical guides, a rod from each to a platform that floats."""
    model = pin.Model()
    platform = model.addJoint(0, pin.JointModelFreeFlyer(), _at(0, 0, 0), "floats")
    model.appendBodyToJoint(platform, pin.Inertia.FromBox(1.0, 0.2, 0.2, 0.02), _at(0, 0, 0))
    _frame(model, "platform", platform, _at(0, 0, 0))
    closures = []
    for k, length in enumerate(lengths, 1):
        carriage = model.addJoint(0, pin.JointModelPZ(), _at(*GUIDES[k - 1]), f"motor_{k}")
        model.appendBodyToJoint(carriage, pin.Inertia.FromBox(0.2, 0.05, 0.05, 0.05), _at(0, 0, 0))
        _frame(model, f"carriage_{k}", carriage, _at(0, 0, 0))
        _frame(model, f"ball_{k}", platform, _at(*BALLS[k - 1]))
        closures.append(sst_pin.Distance(f"carriage_{k}", f"ball_{k}", length))
    model.referenceConfigurations["home"] = hexaglide_configuration(lengths, _at(0, 0, 0))
    return sst_pin.ClosedChain(model, closures, [f"motor_{k}" for k in range(1, 7)])


def hexaglide_configuration(lengths: Sequence[float], pose: pin.SE3) -> np.ndarray:
    """All joints for a pose of the platform: each rod hangs from its carriage."""
    balls = BALLS @ pose.rotation.T + pose.translation
    sideways = np.linalg.norm((balls - GUIDES)[:, :2], axis=1)
    return np.concatenate(
        [pin.SE3ToXYZQUAT(pose), balls[:, 2] + np.sqrt(np.square(lengths) - sideways**2)]
    )


def delta_points(lengths: Sequence[float], x: np.ndarray) -> np.ndarray:
    """Positions of the platform for angles of the motors, shape (N, 3): lower of two points.

    The centre is at the distance of the rods from the elbows, moved inwards by the platform's
    radius: three spheres meet in it (trilateration).
    """
    leg = 2 * np.pi * np.arange(1, 4) / 3
    reach = BASE - PLATFORM + ARM * np.cos(x)
    elbows = np.stack([reach * np.cos(leg), reach * np.sin(leg), -ARM * np.sin(x)], axis=-1)
    L = np.asarray(lengths)
    points = []
    for P, (a, b, c) in zip(elbows, [L**2] * len(x), strict=True):
        # Differences of the equations of the spheres are planes; their line meets a sphere twice.
        A = 2 * (P[1:] - P[0])
        right = np.square(P[1:]).sum(1) - np.square(P[0]).sum() - np.array([b - a, c - a])
        point = np.linalg.lstsq(A, right)[0]
        along = np.cross(A[0], A[1])
        along *= np.sign(along[2]) / np.linalg.norm(along)
        d = point - P[0]
        down = -along @ d - np.sqrt((along @ d) ** 2 - d @ d + a)
        points.append(point + down * along)
    return np.array(points)


def _at(x: float, y: float, z: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z], dtype=float))


def _frame(model: pin.Model, name: str, joint: int, place: pin.SE3) -> None:
    model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))

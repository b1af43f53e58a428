# SPDX-License-Identifier: BSD-2-Clause
"""The same measurements of every tool, against our own robot."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import sst_pin

from . import STAR_FRAMES, Array, Tool

#: Random configurations, all joints all the way round.
CONFIGURATIONS = 100
#: Of the fall from home under gravity, [s]; later the carriage of leg 1 meets the star.
FALL = 0.2


class Facts(NamedTuple):
    """What was measured of one tool; None where it has no answer.

    Attributes:
        warnings: What it wrote while it loaded.
        joints: Number of joints that move.
        mass: Of all bodies, [kg].
        visuals: Number of visual shapes.
        frames: Number of frames that were compared.
        pose_error: Largest deviation of an entry of their homogeneous matrices, [1], [m].
        torque_error: Of the tree's inverse dynamics, relative to the largest torque.
        gap: Angle between the arcs of the star at the end of the fall, [rad].
        fall_error: Angle between its star and ours at the end of the fall, [rad].
    """

    warnings: list[str]
    joints: int | None
    mass: float | None
    visuals: int | None
    frames: int | None
    pose_error: float | None
    torque_error: float | None
    gap: float | None
    fall_error: float | None


def measure(kind: type[Tool]) -> Facts:
    """Load the description in one tool and ask it everything."""
    robot = sst_pin.SST()
    if kind.module:
        import_module(kind.module)  # what it says of itself is no warning
    with written() as warnings:
        tool = kind(Path(sst_pin.PACKAGE_PATH))
    joints = None if tool.joints is None else len(tool.joints)
    frames, pose_error = _poses(robot, tool) or (None, None)
    gap, fall_error = _fall(robot, tool) or (None, None)
    return Facts(
        warnings,
        joints,
        tool.mass,
        tool.visuals,
        frames,
        pose_error,
        _torques(robot, tool),
        gap,
        fall_error,
    )


@contextmanager
def written() -> Iterator[list[str]]:
    """Lines on standard output and error meanwhile, those of C and C++ included."""
    lines: list[str] = []
    with tempfile.TemporaryFile("w+") as file:
        sys.stdout.flush()
        sys.stderr.flush()
        kept = [os.dup(1), os.dup(2)]
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        try:
            yield lines
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            for number, descriptor in enumerate(kept, start=1):
                os.dup2(descriptor, number)
                os.close(descriptor)
            file.seek(0)
            lines += [line.strip() for line in file if line.strip()]


def _in_order_of(robot: sst_pin.SST, tool: Tool) -> list[int]:
    """Where each joint of the tool stands in `q` of the robot."""
    assert tool.joints is not None
    return [robot.joint_names.index(name) for name in tool.joints]


def _poses(robot: sst_pin.SST, tool: Tool) -> tuple[int, float] | None:
    names, worst = set(), 0.0
    rng = np.random.default_rng(0)
    data = robot.model.createData()
    for q in rng.uniform(-np.pi, np.pi, (CONFIGURATIONS, 9)):
        if tool.joints is None or (poses := tool.frame_poses(q[_in_order_of(robot, tool)])) is None:
            return None
        pin.framesForwardKinematics(robot.model, data, q)
        for frame, placement in zip(robot.model.frames, data.oMf, strict=True):
            if frame.name in poses and frame.type == pin.FrameType.BODY:
                names.add(frame.name)
                error = np.abs(poses[frame.name] - placement.homogeneous).max()
                worst = max(worst, float(error))
    return len(names), worst


def _torques(robot: sst_pin.SST, tool: Tool) -> float | None:
    worst = 0.0
    rng = np.random.default_rng(1)
    for _ in range(CONFIGURATIONS):
        q, v, a = rng.uniform(-np.pi, np.pi, 9), rng.normal(size=9), rng.normal(size=9)
        if tool.joints is None:
            return None
        order = _in_order_of(robot, tool)
        tau = tool.inverse_dynamics(q[order], v[order], a[order])
        if tau is None:
            return None
        expected = pin.rnea(robot.model, robot.model.createData(), q, v, a)[order]
        worst = max(worst, float(np.abs(tau - expected).max() / np.abs(expected).max()))
    return worst


def _fall(robot: sst_pin.SST, tool: Tool) -> tuple[float, float] | None:
    if tool.closing is None:
        return None
    order = _in_order_of(robot, tool)
    end = np.empty(9)
    end[order] = tool.fall(robot.home[order], FALL)
    ours = robot.simulate(np.zeros(3), robot.home, np.zeros(3), np.linspace(0, FALL, 3)).q[-1]
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, end)
    arcs = [data.oMf[robot.model.getFrameId(name)].rotation for name in STAR_FRAMES]
    gap = max(_angle(arcs[0], arc) for arc in arcs[1:])
    R = robot.platform_orientation(ours)
    return gap, max(_angle(R, arc) for arc in arcs)


def _angle(R: Array, other: Array) -> float:
    return float(Rotation.from_matrix(R.T @ other).magnitude())

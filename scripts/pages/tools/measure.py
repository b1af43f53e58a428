# SPDX-License-Identifier: BSD-2-Clause
"""Measure every tool in the same way, against our own robot."""

import ctypes
import logging
import os
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import sst_pin

from . import STAR_FRAMES, Array, Tool
from .drake_tool import Drake
from .mujoco_tool import MujocoMjcf, MujocoUrdf
from .pinocchio_tool import Pinocchio
from .pybullet_tool import Pybullet
from .python_tools import Urchin, UrdfParserPy, Yourdfpy
from .ros_tools import CheckUrdf, Kdl
from .three_tool import ThreeUrdfLoader

#: In the order of the table.
TOOLS: tuple[type[Tool], ...] = (
    *(Pinocchio, MujocoUrdf, MujocoMjcf, Drake, Pybullet),
    *(Kdl, CheckUrdf, UrdfParserPy, Yourdfpy, Urchin, ThreeUrdfLoader),
)
#: Random configurations, all joints all the way round.
CONFIGURATIONS = 100
#: Duration of the fall from home under gravity, [s]; later the carriage of leg 1 meets the star.
FALL = 0.2


class Facts(NamedTuple):
    """What was measured of one tool; None where it has no answer."""

    warnings: list[str]  # what it wrote while it loaded
    joints: int | None  # number of those that move
    mass: float | None  # of all bodies, [kg]
    visuals: int | None  # number of shapes
    frames: int | None  # number of those that were compared
    pose_error: float | None  # largest deviation of an entry of their matrices, [1], [m]
    torque_error: float | None  # of the tree's inverse dynamics, relative to the largest torque
    gap: float | None  # angle between the arcs of the star at the end of the fall, [rad]
    fall_error: float | None  # angle between its star and ours at the end of the fall, [rad]


def measure(kind: type[Tool], folder: Path = Path(sst_pin.PACKAGE_PATH)) -> Facts:
    """Load a description in one tool and ask it everything; our robot is the shipped one."""
    if kind.module:
        import_module(kind.module)  # what it says of itself is no warning
    with written() as lines:
        tool = kind(folder)
    robot = sst_pin.SST()
    try:
        frames, pose_error = _poses(robot, tool) or (None, None)
        torque_error = _torques(robot, tool)
        gap, fall_error = _fall(robot, tool) or (None, None)
    finally:
        tool.close()
    joints = None if tool.joints is None else len(tool.joints)
    seen = (joints, tool.mass, tool.visuals, frames)
    return Facts(lines, *seen, pose_error, torque_error, gap, fall_error)


@contextmanager
def written() -> Iterator[list[str]]:
    """Lines on standard output and error meanwhile, those of C++ and of Python's warnings too."""
    lines: list[str] = []
    c = ctypes.CDLL(None)
    with tempfile.TemporaryFile("w+") as file, warnings.catch_warnings(record=True) as caught:
        for category in (UserWarning, RuntimeWarning):
            warnings.simplefilter("always", category)
        handler = logging.StreamHandler(file)
        handler.setLevel(logging.WARNING)
        logging.getLogger().addHandler(handler)
        kept = [os.dup(number) for number in (1, 2)]
        sys.stdout.flush()
        sys.stderr.flush()
        c.fflush(None)  # C keeps what goes to a file until it has enough of it
        for number in (1, 2):
            os.dup2(file.fileno(), number)
        try:
            with redirect_stdout(file), redirect_stderr(file):
                yield lines
        finally:
            file.flush()
            c.fflush(None)
            for number, descriptor in enumerate(kept, start=1):
                os.dup2(descriptor, number)
                os.close(descriptor)
            logging.getLogger().removeHandler(handler)
        file.seek(0)
        lines += [line.strip() for line in file if line.strip()]
        lines += [f"{warning.category.__name__}: {warning.message}" for warning in caught]


def _order(robot: sst_pin.SST, tool: Tool) -> list[int]:
    """Where each joint of the tool stands in `q` of the robot."""
    return [robot.joint_names.index(name) for name in tool.joints or ()]


def _poses(robot: sst_pin.SST, tool: Tool) -> tuple[int, float] | None:
    order, worst, names = _order(robot, tool), 0.0, set()
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (CONFIGURATIONS, 9)):
        found = tool.frame_poses(q[order])
        if found is None:
            return None
        ours = _frames(robot, q)
        names = found.keys() & ours.keys()
        worst = max(worst, *(float(np.abs(found[x] - ours[x]).max()) for x in names))
    return len(names), worst


def _frames(robot: sst_pin.SST, q: Array) -> dict[str, Array]:
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    links = [f.name for f in robot.model.frames if f.type == pin.FrameType.BODY]
    return {name: data.oMf[robot.model.getFrameId(name)].homogeneous for name in links}


def _torques(robot: sst_pin.SST, tool: Tool) -> float | None:
    order, worst = _order(robot, tool), 0.0
    rng = np.random.default_rng(1)
    for _ in range(CONFIGURATIONS):
        q, (v, a) = rng.uniform(-np.pi, np.pi, 9), rng.normal(size=(2, 9))
        tau = tool.inverse_dynamics(q[order], v[order], a[order])
        if tau is None:
            return None
        ours = pin.rnea(robot.model, robot.model.createData(), q, v, a)[order]
        worst = max(worst, float(np.abs(tau - ours).max() / np.abs(ours).max()))
    return worst


def _fall(robot: sst_pin.SST, tool: Tool) -> tuple[float, float] | None:
    if not tool.closing:
        return None
    order, q = _order(robot, tool), np.empty(9)
    q[order] = tool.fall(robot.home[order], FALL)
    frames = _frames(robot, q)
    arcs = [frames[name][:3, :3] for name in STAR_FRAMES]
    ours = robot.simulate(np.zeros(3), robot.home, np.zeros(3), np.array([0, FALL]))
    R = robot.platform_orientation(ours.q[-1])
    gap = max(_angle(arcs[0], arc) for arc in arcs[1:])
    return gap, max(_angle(R, arc) for arc in arcs)


def _angle(R: Array, other: Array) -> float:
    return float(Rotation.from_matrix(R.T @ other).magnitude())

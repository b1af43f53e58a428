# SPDX-License-Identifier: BSD-2-Clause
"""Named configurations of an MJCF: its keyframes, and the home."""

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import SSTError
from ..loops.loops import Loops
from .mjcf_compiled import BALL, FREE, HINGE, SLIDE, Compiled, pose_of
from .mjcf_tree import MjcfTree
from .robot_file import RobotFile

#: Number of entries of `qpos` for each type of joint.
_SIZES = {FREE: 7, BALL: 4, HINGE: 1, SLIDE: 1}


def put_keyframes(compiled: Compiled, tree: MjcfTree) -> None:
    """Write the keyframes that have a name into the model, as its `referenceConfigurations`.

    A problem names each body that a keyframe moves and that is fixed here. A note names each locked
    joint to which a keyframe gives another position.
    """
    mj = compiled.mj
    model = tree.model
    for key in range(mj.nkey):
        name = mj.key(key).name
        if not name:
            continue
        _refuse_moved_bodies(compiled, key)
        _note_locked_joints(compiled, key)
        q = tree.configuration(mj.key_qpos[key])
        model.referenceConfigurations[name] = pin.normalize(model, q)


def _refuse_moved_bodies(compiled: Compiled, key: int) -> None:
    """Add a problem for each body that a keyframe moves by `mocap`; here they are fixed."""
    mj = compiled.mj
    positions = mj.key_mpos[key].reshape(-1, 3)
    quaternions = mj.key_mquat[key].reshape(-1, 4)
    for body in map(int, np.flatnonzero(mj.body_mocapid >= 0)):
        mocap = mj.body_mocapid[body]
        pose = pose_of(positions[mocap], quaternions[mocap])
        fixed_pose = pose_of(mj.body_pos[body], mj.body_quat[body])
        if not np.allclose(pose.homogeneous, fixed_pose.homogeneous):
            text = f"it moves the mocap body {compiled.name('body', body)}, which is fixed here"
            compiled.problems.append(f"key {mj.key(key).name}: {text}")


def _note_locked_joints(compiled: Compiled, key: int) -> None:
    """Add a note for each locked joint to which a keyframe gives another position than `qpos0`.

    Only joints that are locked as a whole get one. A ball with a locked rate gets none: mostly it
    is the end of a rod, and the spin of a rod about its axis has no effect.
    """
    mj = compiled.mj
    for joint in range(mj.njnt):
        if not compiled.is_locked(joint):
            continue
        kind = int(mj.jnt_type[joint])
        first = mj.jnt_qposadr[joint]
        entries = slice(first, first + _SIZES[kind])
        position = _without_quaternion(kind, mj.key_qpos[key][entries])
        if not np.allclose(position, _without_quaternion(kind, mj.qpos0[entries])):
            text = f"{compiled.joint_name(joint)} is locked elsewhere; its value is left out"
            compiled.notes.append(f"key {mj.key(key).name}: {text}")


def _without_quaternion(kind: int, qpos: Array) -> Array:
    """The position of a joint in numbers that are equal for equal positions.

    The quaternions q and -q are the same rotation, so balls and free joints have a matrix here.
    """
    if kind == FREE:
        return np.asarray(pose_of(qpos[:3], qpos[3:]).homogeneous)
    if kind == BALL:
        return np.asarray(pose_of(np.zeros(3), qpos).rotation)
    return qpos


def put_home(robot: RobotFile, q: Array) -> None:
    """Make the configuration q the home if it closes the loops and the file names no home."""
    model = robot.model
    if not model.nv or "home" in model.referenceConfigurations:
        return
    q = pin.normalize(model, q)
    loops = Loops(model, robot.closures)
    try:
        loops.evaluate_closed(q, robot.uncorrected_mechanism().row_scale)
    except SSTError:
        # The loops are open at q, or no robot can be made from this file. In the second case, the
        # caller makes the robot after it has issued all notes, and gets this error then.
        return
    model.referenceConfigurations["home"] = q

# SPDX-License-Identifier: BSD-2-Clause
"""Named configurations of an MJCF: its keyframes, and the home."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from ..loops.loops import Loops
from ..model.closures import Constraint
from ..model.loop_groups import longest_offset
from ..model.thresholds import CLOSURE_TOLERANCE
from .mjcf_compiled import BALL, FREE, HINGE, SLIDE, Compiled
from .mjcf_tree import MjcfTree

#: Number of entries of `qpos` for each type of joint.
_SIZES = {FREE: 7, BALL: 4, HINGE: 1, SLIDE: 1}


def put_keyframes(compiled: Compiled, tree: MjcfTree) -> None:
    """Write the keyframes that have a name into the model, as its `referenceConfigurations`.

    A problem names each body that a keyframe moves and that is fixed here, a note each locked joint
    to which it gives another position.
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
        pose = [*positions[mocap], *quaternions[mocap]]
        if not np.allclose(pose, [*mj.body_pos[body], *mj.body_quat[body]]):
            text = f"it moves the mocap body {compiled.name('body', body)}, which is fixed here"
            compiled.problems.append(f"key {mj.key(key).name}: {text}")


def _note_locked_joints(compiled: Compiled, key: int) -> None:
    """Add a note for each locked joint to which a keyframe gives another position."""
    mj = compiled.mj
    for joint in range(mj.njnt):
        if not compiled.is_locked(joint):
            continue
        first = mj.jnt_qposadr[joint]
        entries = slice(first, first + _SIZES[int(mj.jnt_type[joint])])
        if not np.allclose(mj.key_qpos[key][entries], mj.qpos0[entries]):
            text = f"{compiled.joint_name(joint)} is locked elsewhere; its value is left out"
            compiled.notes.append(f"key {mj.key(key).name}: {text}")


def put_home(compiled: Compiled, tree: MjcfTree, closures: Sequence[Constraint]) -> None:
    """Make `qpos0` the home if it closes the loops and no keyframe is named home."""
    model = tree.model
    if not model.nv or "home" in model.referenceConfigurations:
        return
    q = pin.normalize(model, tree.configuration(compiled.mj.qpos0))
    loops = Loops(model, closures)
    loops.evaluate(q)
    length = longest_offset(model, range(1, model.njoints), closures, ground=False) or 1.0
    gap = np.abs(loops.f).max(initial=0.0)  # at q
    if gap <= CLOSURE_TOLERANCE * length:
        model.referenceConfigurations["home"] = q

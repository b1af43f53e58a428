# SPDX-License-Identifier: BSD-2-Clause
"""An MJCF as MuJoCo compiles it: names of its elements, disabled flags, locked joints, tendons.

MuJoCo has two kinds of tendons. A spatial tendon is a line in space through sites, perhaps around
geoms. A fixed tendon is a sum: its length is the sum of a coefficient times the position of a joint
over some hinges and slides. What a tendon consists of, sites or joints, are its wraps.
"""

from collections.abc import Collection
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from ..arrays import Array
from .mjcf_loading import load_mjcf

#: Types of joints, as `mjtJoint` has them.
FREE, BALL, SLIDE, HINGE = range(4)
#: Flags that the flag "constraint" disables too.
_CONSTRAINTS = ("equality", "frictionloss", "limit")


class Compiled:
    """A compiled model, and what its readers find out about it.

    Elements of MuJoCo, such as joints and tendons, are arguments by their indices.

    Attributes:
        source: The path of the file, for messages.
        mujoco: The module.
        mj: The `mujoco.MjModel`.
        locked: Names of the joints and single rates that the caller locks.
        problems: What cannot be read. The readers of the model add to them.
        notes: What is read otherwise than in MuJoCo. The readers add to them too.
    """

    def __init__(self, path: Path, locked: Collection[str]) -> None:
        loaded = load_mjcf(path)
        self.source = str(path)
        self.mujoco = loaded.mujoco
        self.mj = loaded.mj
        self.locked = set(locked)
        self.problems = list[str]()
        self.notes = loaded.notes
        self._bodies = {self.mj.body(body).name: body for body in range(1, self.mj.nbody)}

    def disabled(self, flag: str) -> bool:
        """Whether a flag of the options is "disable"; not every MuJoCo has every flag."""
        if flag in _CONSTRAINTS and self.disabled("constraint"):
            return True
        bit = getattr(self.mujoco.mjtDisableBit, f"mjDSBL_{flag.upper()}", 0)
        return bool(self.mj.opt.disableflags & int(bit))

    @property
    def motors_carry_weights(self) -> bool:
        """Whether motors, and not MuJoCo, compensate weights."""
        return bool(getattr(self.mj, "jnt_actgravcomp", np.zeros(0)).any())

    @cached_property
    def body_gravcomp(self) -> Array:
        """The share of its weight that is compensated for each body, shape (bodies,).

        MuJoCo computes no passive forces if neither springs nor dampers act. It ignores negative
        numbers unless another body has a positive one.
        """
        gravcomp = np.array(self.mj.body_gravcomp)
        without_passive = self.disabled("spring") and self.disabled("damper")
        if without_passive or self.disabled("passive") or not (gravcomp > 0).any():
            return np.zeros(self.mj.nbody)
        return gravcomp

    @cached_property
    def gravcomp(self) -> float | None:
        """The compensated share of the weights, if all moving bodies have the same; else None."""
        mj = self.mj
        if self.motors_carry_weights:  # `mjcf_unread` refuses it
            return None
        moving = mj.body_weldid > 0  # 0 for bodies that are fixed to the world
        shares = set(self.body_gravcomp[moving & (mj.body_mass > 0)].tolist())
        return shares.pop() if len(shares) == 1 else None

    # --- names --------------------------------------------------------------------------------

    def name(self, kind: str, i: int) -> str:
        """Name of an element; one without a name is called after its kind and number.

        If a site has the name of a body and is not at the body's frame, it is called `NAME_site`,
        because the frame of the body is called `NAME`.
        """
        name = getattr(self.mj, kind)(i).name or f"{kind}_{i}"
        if kind == "site" and self._is_beside_body(i, name):
            return f"{name}_site"
        return name

    def _is_beside_body(self, site: int, name: str) -> bool:
        """Whether a site has the name of a body whose frame is elsewhere."""
        body = self._bodies.get(name)
        if body is None:
            return False
        on_body = pose_of(self.mj.site_pos[site], self.mj.site_quat[site])
        return body != self.mj.site_bodyid[site] or on_body != pin.SE3.Identity()

    def joint_name(self, joint: int) -> str:
        """Name of a joint; one without a name is called after its body."""
        body = self.mj.jnt_bodyid[joint]
        number = joint - self.mj.body_jntadr[body]
        suffix = f"_{number}" if number else ""
        return self.mj.joint(joint).name or f"{self.name('body', body)}{suffix}"

    def rate_names(self, joint: int) -> list[str]:
        """Names of the rates of a ball or a free joint, by which they are locked."""
        rates = list[str]()
        if self.mj.jnt_type[joint] == FREE:
            rates += ["vx", "vy", "vz"]
        if self.mj.jnt_type[joint] in (BALL, FREE):
            rates += ["wx", "wy", "wz"]
        return [f"{self.joint_name(joint)}_{rate}" for rate in rates]

    # --- joints -------------------------------------------------------------------------------

    def is_locked(self, joint: int) -> bool:
        """Whether a joint is locked as a whole."""
        return self.joint_name(joint) in self.locked

    def locked_rates(self, joint: int) -> list[int]:
        """Indices of the rates of a ball or a free joint that are locked."""
        return [k for k, name in enumerate(self.rate_names(joint)) if name in self.locked]

    def forces_of_free_joint(self, joint: int) -> list[str]:
        """What a free joint has that depends on the axes of its rates, in words.

        Damping is the same for all six rates, and so the same in all axes.
        """
        mj = self.mj
        dof = mj.jnt_dofadr[joint]
        words = list[str]()
        if mj.dof_armature[dof]:
            words.append("armature")
        if mj.dof_frictionloss[dof] and not self.disabled("frictionloss"):
            words.append("frictionloss")
        if mj.jnt_stiffness[joint] and not self.disabled("spring"):
            words.append("a spring")
        return words

    # --- tendons ------------------------------------------------------------------------------

    def wraps(self, tendon: int) -> range:
        """Indices of the wraps of a tendon, its sites or joints, in MuJoCo's fields `wrap_*`."""
        first = self.mj.tendon_adr[tendon]
        return range(first, first + self.mj.tendon_num[tendon])

    def is_spatial(self, tendon: int) -> bool:
        """Whether a tendon is a line in space, not a sum of joints."""
        kinds = self.mj.wrap_type[self.wraps(tendon)]
        return bool((kinds != int(self.mujoco.mjtWrap.mjWRAP_JOINT)).any())

    @cached_property
    def tendon_armature(self) -> Array:
        """Inertias of the tendons, shape (tendons,); not every MuJoCo has them."""
        return np.asarray(getattr(self.mj, "tendon_armature", np.zeros(self.mj.ntendon)))

    def coefficients(self, tendon: int) -> dict[int, float]:
        """Coefficients of a fixed tendon by joint, without zeros and without locked joints."""
        coefficients = dict[int, float]()
        for k in self.wraps(tendon):
            joint = int(self.mj.wrap_objid[k])
            coefficient = float(self.mj.wrap_prm[k])
            if coefficient and not self.is_locked(joint):
                coefficients[joint] = coefficient
        return coefficients

    def tendon_length(self, tendon: int, qpos: Array) -> float:
        """Length of a fixed tendon: the sum of coefficients times positions.

        Locked joints have their positions at `qpos0`.
        """
        wraps = self.wraps(tendon)
        joints = self.mj.wrap_objid[wraps]
        moving = np.array([not self.is_locked(joint) for joint in joints], dtype=bool)
        addresses = self.mj.jnt_qposadr[joints]
        positions = np.where(moving, qpos[addresses], self.mj.qpos0[addresses])
        return float(self.mj.wrap_prm[wraps] @ positions)

    def needs_joint(self, tendon: int) -> bool:
        """Whether a fixed tendon is read as a joint of its own; see `mjcf_tree`.

        It needs one if it has forces, or an inertia that couples several joints.
        """
        if self.is_spatial(tendon):
            return False
        coefficients = self.coefficients(tendon)
        if not coefficients:  # all its joints are locked
            return False
        mj = self.mj
        has_spring = mj.tendon_stiffness[tendon] and not self.disabled("spring")
        has_damper = mj.tendon_damping[tendon] and not self.disabled("damper")
        has_friction = mj.tendon_frictionloss[tendon] and not self.disabled("frictionloss")
        if has_spring or has_damper or has_friction:
            return True
        return bool(self.tendon_armature[tendon]) and len(coefficients) > 1


def pose_of(position: Array, quaternion: Array) -> pin.SE3:
    """A placement from MuJoCo's position and quaternion w, x, y, z."""
    return pin.SE3(pin.Quaternion(*quaternion).normalized().matrix(), position)

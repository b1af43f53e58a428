# SPDX-License-Identifier: BSD-2-Clause
"""MuJoCo: the tree from the URDF, the closed robot from the MJCF."""

from pathlib import Path

import numpy as np

from . import Array, Tool, pose


class MujocoUrdf(Tool):
    name = "MuJoCo, URDF"
    module = "mujoco"
    distribution = "mujoco"

    def __init__(self, folder: Path) -> None:
        import mujoco

        self._mujoco = mujoco
        self._model = model = mujoco.MjModel.from_xml_path(str(folder / self.file))
        self._data = mujoco.MjData(model)
        self.joints = [model.joint(i).name for i in range(model.njnt)]
        self.mass = float(model.body_mass.sum())
        self.visuals = int(((model.geom_contype == 0) & (model.geom_conaffinity == 0)).sum())

    def frame_poses(self, q: Array) -> dict[str, Array]:
        model, data = self._model, self._data
        data.qpos[:] = q
        self._mujoco.mj_kinematics(model, data)
        bodies = [data.body(i) for i in range(1, model.nbody)]
        sites = [data.site(i) for i in range(model.nsite)]
        return {x.name: pose(x.xmat.reshape(3, 3), x.xpos) for x in [*bodies, *sites]}

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        model, data, disable = self._model, self._data, self._mujoco.mjtDisableBit
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        enabled = model.opt.disableflags
        model.opt.disableflags = enabled | disable.mjDSBL_CONSTRAINT  # the tree alone
        self._mujoco.mj_inverse(model, data)
        model.opt.disableflags = enabled
        return data.qfrc_inverse.copy()


class MujocoMjcf(MujocoUrdf):
    name = "MuJoCo, MJCF"
    file = "sst.xml"
    closing = "the file's welds"

    def fall(self, q0: Array, duration: float) -> Array:
        model, data = self._model, self._data
        self._mujoco.mj_resetData(model, data)
        data.qpos[:] = q0
        self._mujoco.mj_step(model, data, nstep=round(duration / model.opt.timestep))
        return np.array(data.qpos)

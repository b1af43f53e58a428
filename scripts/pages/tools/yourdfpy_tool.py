# SPDX-License-Identifier: BSD-2-Clause
"""yourdfpy: URDF in Python with trimesh."""

from pathlib import Path

import numpy as np

from . import Array, Tool


class Yourdfpy(Tool):
    name = "yourdfpy"
    module = "yourdfpy"
    distribution = "yourdfpy"

    def __init__(self, folder: Path) -> None:
        import yourdfpy

        self._urdf = yourdfpy.URDF.load(str(folder / self.file))
        self._urdf.validate()
        self.joints = list(self._urdf.actuated_joint_names)
        inertials = (link.inertial for link in self._urdf.robot.links)
        self.mass = sum(inertial.mass for inertial in inertials if inertial)
        self.visuals = len(self._urdf.scene.geometry)

    def frame_poses(self, q: Array) -> dict[str, Array]:
        self._urdf.update_cfg(q)
        return {name: np.array(self._urdf.get_transform(name)) for name in self._urdf.link_map}

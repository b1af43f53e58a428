# SPDX-License-Identifier: BSD-2-Clause
"""urchin, the maintained successor of urdfpy."""

from pathlib import Path

from . import Array, Tool


class Urchin(Tool):
    name = "urchin"
    module = "urchin"
    distribution = "urchin"

    def __init__(self, folder: Path) -> None:
        from urchin import URDF

        self._urdf = URDF.load(str(folder / self.file))
        self.joints = [joint.name for joint in self._urdf.actuated_joints]
        self.mass = sum(link.inertial.mass for link in self._urdf.links)
        visuals = (visual for link in self._urdf.links for visual in link.visuals)
        self.visuals = sum(len(visual.geometry.meshes) > 0 for visual in visuals)

    def frame_poses(self, q: Array) -> dict[str, Array]:
        return self._urdf.link_fk(dict(zip(self.joints, q, strict=True)), use_names=True)

# SPDX-License-Identifier: BSD-2-Clause
"""Readers of URDF in Python: ROS's, one with trimesh, and the maintained successor of urdfpy."""

from pathlib import Path

import numpy as np

from . import Array, Tool


class UrdfParserPy(Tool):
    """ROS's parser in Python."""

    name = "urdf_parser_py"
    module = "urdf_parser_py"
    distribution = "urdf_parser_py"

    def __init__(self, folder: Path) -> None:
        from urdf_parser_py.urdf import URDF

        robot = URDF.from_xml_file(str(folder / self.file))
        self.joints = [joint.name for joint in robot.joints if joint.type != "fixed"]
        self.mass = sum(link.inertial.mass for link in robot.links if link.inertial)
        self.visuals = sum(len(link.visuals) for link in robot.links)


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

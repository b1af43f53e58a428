# SPDX-License-Identifier: BSD-2-Clause
"""The parsers under ROS, as far as they come without ROS: C++ urdfdom and urdf_parser_py."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

from . import Tool


class CheckUrdf(Tool):
    """Debian's `check_urdf`: what RViz and robot_state_publisher parse with, no numbers."""

    name = "`check_urdf` (urdfdom)"

    def __init__(self, folder: Path) -> None:
        command = ["check_urdf", str(folder / self.file)]
        result = subprocess.run(command, capture_output=True, text=True, check=True)
        sys.stderr.write(result.stderr)
        if "Successfully Parsed XML" not in result.stdout:
            raise ValueError(result.stdout)

    @classmethod
    def missing(cls) -> str:
        return "" if shutil.which("check_urdf") else "check_urdf (liburdfdom-tools) is not there"

    @classmethod
    def version(cls) -> str:
        query = ["dpkg-query", "-W", "-f=${Version}", "liburdfdom-tools"]
        found = subprocess.run(query, capture_output=True, text=True, check=False).stdout
        return re.sub(r"-.*", "", found)


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

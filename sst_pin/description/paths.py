# SPDX-License-Identifier: BSD-2-Clause
"""Paths of the shipped description, as strings for the loaders of other tools."""

from importlib.resources import files
from pathlib import Path


def _package_path() -> Path:
    installed = Path(str(files("sst_pin"))) / "urdf"
    return installed if installed.is_dir() else installed.parents[1] / "urdf"


#: Folder of the shipped description; relative names of meshes start here.
PACKAGE_PATH = str(_package_path())
#: The folder that holds it.
REPOSITORY_PATH = str(_package_path().parent)
#: The paper's robot.
URDF_PATH = str(_package_path() / "sst.urdf")
#: Its loop closures, motors and gravity.
YAML_PATH = str(_package_path() / "sst.yaml")
#: Its named poses and collision pairs.
SRDF_PATH = str(_package_path() / "sst.srdf")
#: The robot with closed loops, for MuJoCo.
MJCF_PATH = str(_package_path() / "sst.xml")

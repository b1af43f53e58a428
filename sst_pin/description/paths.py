# SPDX-License-Identifier: BSD-2-Clause
"""Where the shipped description lies."""

from importlib.resources import files
from pathlib import Path


def _package_path() -> Path:
    installed = Path(str(files("sst_pin"))) / "urdf"
    return installed if installed.is_dir() else installed.parents[1] / "urdf"


#: Folder of the shipped description.
PACKAGE_PATH = _package_path()
#: The paper's robot.
URDF_PATH = PACKAGE_PATH / "sst.urdf"
#: Its loop closures, motors and gravity.
YAML_PATH = PACKAGE_PATH / "sst.yaml"
#: The robot with closed loops, for MuJoCo.
MJCF_PATH = PACKAGE_PATH / "sst.xml"

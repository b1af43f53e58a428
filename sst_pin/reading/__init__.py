# SPDX-License-Identifier: BSD-2-Clause
"""Reads description files: a tree, closures and motors of a robot."""

from .closed_urdf import closed_robot, cuts_beside, read_cuts, read_urdf
from .cuts import parse_cuts
from .robot_file import RobotFile
from .text import is_mjcf
from .urdf import Urdf

__all__ = ["RobotFile", "Urdf", "closed_robot", "cuts_beside", "is_mjcf", "parse_cuts"]
__all__ += ["read_cuts", "read_urdf"]

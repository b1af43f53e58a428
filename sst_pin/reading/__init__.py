# SPDX-License-Identifier: BSD-2-Clause
"""From description files to Pinocchio: URDF and MJCF to models, YAML to cuts."""

from .cuts import Cuts, Extended, closed, load_poses, parse_cuts, read_urdf
from .text import is_mjcf, read_text
from .urdf import parse_mimics, parse_urdf, parse_xml

__all__ = [
    "Cuts",
    "Extended",
    "closed",
    "is_mjcf",
    "load_poses",
    "parse_cuts",
    "parse_mimics",
    "parse_urdf",
    "parse_xml",
    "read_text",
    "read_urdf",
]

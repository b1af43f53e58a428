# SPDX-License-Identifier: BSD-2-Clause
"""From description files to Pinocchio: URDF and MJCF to models, YAML to cuts."""

from .cuts import Cuts, parse_cuts
from .text import read_text
from .urdf import parse_urdf, parse_xml

__all__ = ["Cuts", "parse_cuts", "parse_urdf", "parse_xml", "read_text"]

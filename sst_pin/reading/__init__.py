# SPDX-License-Identifier: BSD-2-Clause
"""Description files to what robots are made of: a tree, closures and motors."""

from .cuts import Cuts, closed, is_marked, load_poses, parse_cuts, read_cuts, read_urdf
from .described import Described
from .text import is_mjcf
from .urdf import Urdf

__all__ = [
    "Cuts",
    "Described",
    "Urdf",
    "closed",
    "is_marked",
    "is_mjcf",
    "load_poses",
    "parse_cuts",
    "read_cuts",
    "read_urdf",
]

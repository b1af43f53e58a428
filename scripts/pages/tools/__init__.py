# SPDX-License-Identifier: BSD-2-Clause
"""Other people's programs that read our description, each behind the same few questions.

An adapter loads a file of the folder as its users would and answers in its own order of joints.
What a program cannot tell stays None.
"""

import subprocess
from importlib import metadata, util
from pathlib import Path
from typing import ClassVar

import numpy as np

from sst_pin.arrays import Array

#: Pairs of frames that coincide in the closed robot; the first is that of arc 1 of the star.
CLOSURES = (("closedloop1_A", "closedloop1_B"), ("closedloop2_A", "closedloop2_B"))
#: {E} as each of the three arcs of the star sees it.
STAR_FRAMES = ("closedloop1_A", "closedloop1_B", "closedloop2_B")


class Tool:
    """One program with the robot of a folder loaded."""

    name: ClassVar[str]  # in the table
    module: ClassVar[str] = ""  # what Python imports; empty for a program of its own
    distribution: ClassVar[str] = ""  # what pip installs
    package: ClassVar[str] = ""  # of Debian, for a program of its own
    file: ClassVar[str] = "sst.urdf"  # what it reads of the folder
    closing: ClassVar[str] = ""  # what closes the loops in its simulation, if it has one
    step: ClassVar[float | None] = None  # of that simulation when it is of first order, [s]
    joints: list[str] | None = None  # those that move, in the order of `q`
    mass: float | None = None  # of all bodies, [kg]
    visuals: int | None = None  # number of visual shapes

    def __init__(self, folder: Path) -> None:
        raise NotImplementedError

    def close(self) -> None:
        """End what was started for it."""

    @classmethod
    def missing(cls) -> str:
        """The reason why the program cannot be used here; empty when it can."""
        return "" if util.find_spec(cls.module) else f"{cls.distribution} is not installed"

    @classmethod
    def version(cls) -> str:
        """The version of the program."""
        if not cls.package:
            return metadata.version(cls.distribution)
        query = ["dpkg-query", "-W", "-f=${Version}", cls.package]
        found = subprocess.run(query, capture_output=True, text=True, check=False).stdout
        return found.partition("-")[0]

    def frame_poses(self, q: Array) -> dict[str, Array] | None:
        """Links in the base at one configuration of the tree, homogeneous (4, 4), by name."""
        return None

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array | None:
        """Torques in all joints of the tree, shape (9,), [N m]."""
        return None

    def fall(self, q0: Array, duration: float) -> Array:
        """`q` after the closed robot has fallen from rest at q0, motors free, for some seconds."""
        raise NotImplementedError


def pose(rotation: Array, position: Array) -> Array:
    """Homogeneous matrix (4, 4)."""
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = rotation, position
    return placed

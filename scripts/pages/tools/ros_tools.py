# SPDX-License-Identifier: BSD-2-Clause
"""What ROS reads a URDF with, as far as Debian and PyPI have it without ROS."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from . import Array, Tool


class CheckUrdf(Tool):
    """The C++ parser of RViz and robot_state_publisher; it tells no numbers."""

    name = "`check_urdf` (urdfdom)"
    package = "liburdfdom-tools"

    def __init__(self, folder: Path) -> None:
        command = ["check_urdf", str(folder / self.file)]
        result = subprocess.run(command, capture_output=True, text=True, check=True)
        sys.stderr.write(result.stderr)
        if "Successfully Parsed XML" not in result.stdout:
            raise ValueError(result.stdout)

    @classmethod
    def missing(cls) -> str:
        return "" if shutil.which("check_urdf") else "check_urdf (liburdfdom-tools) is not there"


class Kdl(Tool):
    """kdl_parser, with which robot_state_publisher makes its tree, and KDL behind it."""

    name = "KDL (kdl_parser)"
    package = "libkdl-parser-dev"

    def __init__(self, folder: Path) -> None:
        self._build = tempfile.TemporaryDirectory()
        program = str(Path(self._build.name) / "kdl_facts")
        source = str(Path(__file__).with_name("kdl_facts.cpp"))
        compiler = ["g++", "-std=c++17", "-w", "-isystem/usr/include/eigen3"]
        libraries = ["-lkdl_parser", "-lorocos-kdl"]
        subprocess.run([*compiler, source, *libraries, "-o", program], check=True)
        self._program = subprocess.Popen(
            [program, str(folder / self.file)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.joints = self._answer()
        self.mass = float(self._answer()[0])
        self._segments = self._answer()

    def close(self) -> None:
        self._program.communicate()
        self._build.cleanup()

    @classmethod
    def missing(cls) -> str:
        there = Path("/usr/include/kdl_parser/kdl_parser.hpp").is_file() and shutil.which("g++")
        return "" if there else "g++ or libkdl-parser-dev is not there"

    def frame_poses(self, q: Array) -> dict[str, Array]:
        poses, _ = self._ask(q, 0 * q, 0 * q)
        return dict(zip(self._segments, poses, strict=True))

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        return self._ask(q, v, a)[1]

    def _ask(self, *motion: Array) -> tuple[Array, Array]:
        print(*(repr(float(x)) for x in np.concatenate(motion)), file=self._program.stdin)
        self._program.stdin.flush()
        numbers = np.array(self._answer(), dtype=float)
        poses = np.tile(np.eye(4), (len(self._segments), 1, 1))
        poses[:, :3] = numbers[:-9].reshape(-1, 3, 4)
        return poses, numbers[-9:]

    def _answer(self) -> list[str]:
        return self._program.stdout.readline().split()

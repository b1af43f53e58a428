# SPDX-License-Identifier: BSD-2-Clause
"""Exported C99 of a robot, compiled strictly and called from this process."""

import ctypes
import subprocess

import numpy as np

from sst_pin.compiled.export import c_files
from sst_pin.files import write_files

STRICT = [
    *("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion"),
    *("-Wfloat-conversion", "-Werror", "-O1"),
]
TYPES = {"double": np.float64, "single": np.float32}


class Exported:
    """The functions of an exported robot, compiled, in this process."""

    def __init__(self, chain, folder, precision="double", compiler=("cc",)):
        self.type = TYPES[precision]
        write_files(c_files(chain, folder, precision))
        source, library = folder / "robot.c", folder / "robot.so"
        command = [*compiler, *STRICT, "-shared", "-fPIC", source, "-o", library]
        subprocess.run(list(map(str, command)), check=True)
        self.library = ctypes.CDLL(str(library))

    def __call__(self, name, size, *inputs):
        """The code that the function returns, and its result."""
        result = np.full(size, np.nan, dtype=self.type)
        arrays = [np.ascontiguousarray(x, dtype=self.type) for x in inputs] + [result]
        addresses = [a.ctypes.data_as(ctypes.c_void_p) for a in arrays if a.size]
        return getattr(self.library, f"robot_{name}")(*addresses), result

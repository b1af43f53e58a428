# SPDX-License-Identifier: BSD-2-Clause
"""Kernels as a loaded library offers them."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np

from ..arrays import Array

#: The list of sizes in a library ends with -1; there are no more than this.
_MOST_SIZES = 8


@dataclass(frozen=True)
class Code:
    """A kernel in a loaded library; the names of its functions end in `entry`."""

    library: ctypes.CDLL
    entry: str

    def sizes(self, word: str) -> list[int]:
        """Numbers in the output of one of its functions, then in each input."""
        return self._sizes(word)[1:]

    def address(self, word: str) -> int:
        """Address of one of its functions: "run", of rollouts "rate" too."""
        function = getattr(self.library, f"{word}_{self.entry}")
        address = ctypes.cast(function, ctypes.c_void_p).value
        assert address is not None
        return address

    def prepared(self, numbers: Array) -> Array:
        """Parameters with the constants behind them that the kernel makes of them."""
        p = np.concatenate([numbers, np.zeros(self._sizes("run")[0] - len(numbers))])
        getattr(self.library, f"prepare_{self.entry}")(ctypes.c_void_p(p.ctypes.data))
        return p

    def _sizes(self, word: str) -> list[int]:
        name = f"sizes_{word}_{self.entry}"
        numbers = list((ctypes.c_int * _MOST_SIZES).in_dll(self.library, name))
        return numbers[: numbers.index(-1)]

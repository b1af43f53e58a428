# SPDX-License-Identifier: BSD-2-Clause
"""Kernels as a loaded library offers them."""

from __future__ import annotations

import ctypes
import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import CompilationError

Array = NDArray[np.float64]
#: The list of sizes in a library ends with -1; there are no more than this.
_MOST_SIZES = 8


def require_current(made_of: str, *sources: Path) -> None:
    """Refuse an extension that was compiled from other sources than those beside it.

    So it is after an update of a clone that is installed with `pip install -e`.

    Args:
        made_of: The hash of its sources that the extension tells.
        sources: These; where one is not there, the extension came with the package.

    Raises:
        CompilationError: When they are others.
    """
    if not all(source.is_file() for source in sources):
        return
    content = b"".join(source.read_bytes() for source in sources)
    if hashlib.sha256(content).hexdigest() != made_of:
        raise CompilationError(
            f"the extension was compiled from another {sources[0].name}; install sst-pin again "
            "(in a clone: pip install -e .)"
        )


@dataclass(frozen=True)
class Code:
    """A kernel in a library.

    Attributes:
        library: Loaded.
        entry: What the names of its functions end in.
    """

    library: ctypes.CDLL
    entry: str

    def sizes(self, word: str) -> list[int]:
        """Numbers in the output of one of its functions, then in each input."""
        return self._sizes(word)[1:]

    def address(self, word: str) -> int:
        """Of one of its functions: "run", of rollouts "rate" too."""
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

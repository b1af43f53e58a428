# SPDX-License-Identifier: BSD-2-Clause
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

INSTRUCTIONS: str
SOURCES: str

class Kernel:
    def __init__(
        self,
        single: int,
        batch: int,
        sizes: tuple[int, ...],
        output: int,
        parameters: Array,
        library: Any,
        loaded: Callable[[], Kernel | None] | None = None,
        batch_parameters: Array | None = None,
        moment: int = -1,
    ) -> None: ...
    def answer(self, a: Any, b: Any, c: Any, load: Any, out: Any, threads: Any) -> Array | None: ...
    def derivatives(
        self, kind: Callable[..., Any], a: Any, b: Any, c: Any, threads: Any
    ) -> Any: ...
    def many(self, arrays: tuple[Array | None, ...], out: Array, threads: int = 1) -> Indices: ...

class RolloutKernel:
    def __init__(
        self, code: int, sizes: tuple[int, int, int, int], parameters: Array, library: Any
    ) -> None: ...
    def run(
        self,
        step: float,
        q0: Array,
        va0: Array,
        tau: Array,
        load: Array | None,
        q: Array,
        va: Array,
        verdicts: Array,
        threads: int = 1,
    ) -> Indices: ...

# SPDX-License-Identifier: BSD-2-Clause
"""Settings of a simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import positive_number, require_flags, require_word
from ..errors import InputError

#: Implicit integrators of SciPy, for stiff motions.
IMPLICIT = ("Radau", "BDF")
#: Integrators of SciPy that can be chosen.
METHODS = ("RK23", "RK45", "DOP853", *IMPLICIT)


@dataclass(frozen=True)
class Settings:
    """How a motion is integrated; `ClosedChain.simulate` describes the fields."""

    method: str
    rtol: float
    atol: float
    max_condition_number: float
    through_singularities: bool
    progress: Callable[[float], None] | None
    max_step: float | None

    def __post_init__(self) -> None:
        require_word("method", self.method, METHODS)
        require_flags(through_singularities=self.through_singularities)
        positive_number("rtol", self.rtol)
        positive_number("atol", self.atol)
        positive_number("max_condition_number", self.max_condition_number)
        unlimited = isinstance(self.max_step, float) and self.max_step == np.inf
        if self.max_step is not None and not unlimited:
            positive_number("max_step", self.max_step)
        if self.progress is not None and not callable(self.progress):
            raise InputError("progress", f"{self.progress!r} cannot be called")

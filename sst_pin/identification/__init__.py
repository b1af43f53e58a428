# SPDX-License-Identifier: BSD-2-Clause
"""Identification: which dynamic parameters motions show, and their values from measurements."""

from .base_parameters import BaseParameters, base_parameters, random_states
from .estimation import Estimate, estimate

__all__ = [
    "BaseParameters",
    "Estimate",
    "base_parameters",
    "estimate",
    "random_states",
]


def __dir__() -> list[str]:
    return __all__

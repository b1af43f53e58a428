# SPDX-License-Identifier: BSD-2-Clause
"""Identification: which dynamic parameters motions show, and their values from measurements."""

from .base_parameters import BaseParameters, base_parameters, random_states

__all__ = ["BaseParameters", "base_parameters", "random_states"]


def __dir__() -> list[str]:
    return __all__

# SPDX-License-Identifier: BSD-2-Clause
"""For those who design a robot: what its tolerances do."""

from .tolerances import Tolerances, clearance, tolerances

__all__ = ["Tolerances", "clearance", "tolerances"]


def __dir__() -> list[str]:
    return __all__

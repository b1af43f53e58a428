# SPDX-License-Identifier: BSD-2-Clause
"""Design: the effect of manufacturing tolerances."""

from .tolerances import Tolerances, clearance, tolerances

__all__ = ["Tolerances", "clearance", "tolerances"]


def __dir__() -> list[str]:
    return __all__

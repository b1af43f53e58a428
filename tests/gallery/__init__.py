# SPDX-License-Identifier: BSD-2-Clause
"""Robots of the tests and pages beside those of `sst_pin.robots`."""

from collections.abc import Callable

from sst_pin import robots
from sst_pin.robots import GalleryRobot

from .ladders import ladder
from .standard_mechanisms import andrews, governor, n_four_bar

#: The functions of all robots, these and those of the package, by name.
EVERY_ROBOT: dict[str, Callable[..., GalleryRobot]] = {
    name: getattr(robots, name) for name in robots.__all__ if name.islower()
} | {f.__name__: f for f in (andrews, governor, ladder, n_four_bar)}

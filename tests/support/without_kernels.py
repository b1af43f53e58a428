# SPDX-License-Identifier: BSD-2-Clause
"""A robot computed by its other path."""

import copy
from functools import partial

from sst_pin.engine import Engine
from sst_pin.sst import kernels


def on_reference_path(robot):
    """An SST without its kernels."""
    slow = copy.copy(robot)
    off = partial(kernels.backend, off="for comparison")
    slow._engine = Engine(robot.engine.mechanism, off)
    assert slow.path == "the reference path: for comparison"
    return slow

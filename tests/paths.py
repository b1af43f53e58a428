# SPDX-License-Identifier: BSD-2-Clause
"""A robot computed by its other path."""

import copy
from functools import partial

from sst_pin.sst import kernel_path


def on_reference_path(robot):
    """An SST without its kernels."""
    slow = copy.copy(robot)
    slow._current.kernels = partial(kernel_path.backend, off="for comparison")
    slow.refresh()
    assert slow.path == "the reference path: for comparison"
    return slow

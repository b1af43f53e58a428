# SPDX-License-Identifier: BSD-2-Clause
"""The same robot on its other path."""

import copy


def on_reference_path(robot):
    """An SST without its kernels."""
    slow = copy.copy(robot)
    slow._off = "for comparison"
    slow.refresh()
    assert slow.path == "the reference path: for comparison"
    return slow

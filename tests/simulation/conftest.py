# SPDX-License-Identifier: BSD-2-Clause
"""Motions need few of the kernels that `compile` makes."""

import pytest


@pytest.fixture(autouse=True)
def few_kernels(kernels_at_their_first_use):
    """Only what a motion uses is compiled."""

# SPDX-License-Identifier: BSD-2-Clause
"""The sign of a rate in Coulomb friction, of joints and of lines."""

import numpy as np

from ..arrays import Array
from .thresholds import AT_REST


def sign_of(rates: Array, width: float) -> Array:
    """The sign of each rate, zero at rest; tanh(rate / width) with a width above 0."""
    if width:
        return np.tanh(rates / width)
    return np.asarray(np.sign(rates) * (np.abs(rates) > AT_REST))


def sign_slope(rates: Array, width: float) -> Array:
    """Derivative of the sign by each rate; `width` must be above 0."""
    return np.asarray((1 - np.tanh(rates / width) ** 2) / width)

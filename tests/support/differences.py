# SPDX-License-Identifier: BSD-2-Clause
"""Random configurations, and derivatives by differences."""

import pinocchio as pin


def random_q(model, random, size=1.0):
    """A configuration around the neutral one."""
    return pin.integrate(model, pin.neutral(model), size * random.normal(size=model.nv))


def derivative(function, h=0.01):
    """Derivative at 0 by central differences of eighth order: h^8 and rounding / h."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    return sum(w * (function(k * h) - function(-k * h)) for k, w in weights.items()) / h

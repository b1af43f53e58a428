# SPDX-License-Identifier: BSD-2-Clause
"""Lengths of lines and their rates.

Lines are treated as `Distance` closures that nothing holds: f of `Loops` has their lengths, and Phi
gives the rates of the lengths. This module calls Phi of lines J.
"""

import sys
from collections.abc import Iterable
from functools import cached_property

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import SingularConfigurationError
from ..model.closures import Distance
from ..model.contacts import Rope
from ..model.lines import LineForce
from ..model.mechanism import Mechanism
from ..model.thresholds import LEAST_LENGTH
from .loops import Loops

#: The distance of these closures, [m], in place of 0, which `Distance` refuses. It is so small that
#: f = length - distance is exactly the length.
_NO_DISTANCE = sys.float_info.min


def line_loops(model: pin.Model, lines: Iterable[LineForce | Rope]) -> Loops:
    """`Loops` of the lines: f are their lengths, [m]."""
    return Loops(model, [Distance(x.frame_a, x.frame_b, _NO_DISTANCE) for x in lines])


class LineKinematics:
    """Lengths of the lines of a mechanism, and their rates; one object per thread.

    Most robots have no lines. For these no `Loops` are made, and results are empty arrays.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self._lines = mechanism.lines.forces

    @cached_property
    def loops(self) -> Loops:
        """The lines; `lengths` and `evaluate` evaluate them at q."""
        return line_loops(self._mechanism.model, self._lines)

    def lengths(self, q: Array) -> Array:
        """Lengths of the lines, shape (lines,), [m]."""
        if not self._lines:
            return np.zeros(0)
        self.loops.evaluate(q)
        return self.loops.f.copy()

    def evaluate(self, q: Array) -> tuple[Array, Array]:
        """Lengths, shape (lines,), and J, shape (lines, nv): the rates of the lengths are J v.

        Raises:
            SingularConfigurationError: If the ends of a line coincide, so that it has no direction.
        """
        if not self._lines:
            return np.zeros(0), np.zeros((0, self._mechanism.model.nv))
        lengths = self.lengths(q)
        for line, length in zip(self._lines, lengths, strict=True):
            if length <= LEAST_LENGTH * self._mechanism.length:
                raise SingularConfigurationError(
                    f"the direction of the force on line {line} is not determined: its ends "
                    f"{line.frame_a} and {line.frame_b} coincide; move away, or choose other "
                    "frames",
                    float("inf"),
                )
        return lengths, self.loops.Phi

    def inertia(self, q: Array) -> Array:
        """J^T m J of the masses m that move with the lengths, shape (nv, nv)."""
        _, J = self.evaluate(q)
        return np.asarray((J.T * self._mechanism.lines.masses).dot(J))

    def inertial_tensions(self, q: Array, v: Array, v_dot: Array) -> Array:
        """Masses times the second derivatives of the lengths, shape (lines,), [N]."""
        masses = self._mechanism.lines.masses
        if not masses.any():
            return np.zeros(len(masses))
        return masses * self.accelerations(q, v, v_dot)

    def accelerations(self, q: Array, v: Array, v_dot: Array) -> Array:
        """Second derivatives of the lengths, J v_dot + J_dot v, shape (lines,), [m/s^2]."""
        if not self._lines:
            return np.zeros(0)
        _, J = self.evaluate(q)
        return np.asarray(J.dot(v_dot) + self.loops.drift(v))

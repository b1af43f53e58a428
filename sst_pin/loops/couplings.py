# SPDX-License-Identifier: BSD-2-Clause
"""Couplings as rows on the rates of one-coordinate joints."""

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from ..arrays import Array, Flags
from ..errors import DescriptionError
from ..model.closures import Coupling
from ..model.tree import joint_id


class Coupled:
    """The row of a coupling of joints that have one coordinate each."""

    def __init__(self, model: pin.Model, coupling: Coupling) -> None:
        self._nv = model.nv
        terms = [(coupling.joint, Polynomial([0.0, 1.0]), 1.0)]
        terms += [(name, Polynomial(p), -1.0) for name, p in coupling.polynomials.items()]
        self._offset = coupling.offset
        #: For each joint its index in q and in v, the polynomial P of its coordinate with
        #: sum P = offset, and the first and second derivative of P.
        self.terms: list[tuple[int, int, Polynomial, Polynomial, Polynomial]] = []
        for name, polynomial, sign in terms:
            joint = model.joints[joint_id(model, name)]
            if (joint.nq, joint.nv) != (1, 1):
                problem = f"joint {name} has {joint.nq} coordinates; couplings take one"
                raise DescriptionError(str(coupling), [problem])
            P = sign * polynomial
            self.terms.append((joint.idx_q, joint.idx_v, P, P.deriv(), P.deriv(2)))

    @property
    def touched(self) -> Flags:
        """Which rates it depends on, shape (nv,)."""
        return np.isin(np.arange(self._nv), [k for _, k, *_ in self.terms])

    @property
    def curved(self) -> Flags:
        """Which rates it depends on otherwise than linearly, shape (nv,)."""
        return np.isin(np.arange(self._nv), [k for _, k, *_, P_2 in self.terms if P_2.coef.any()])

    def residual(self, q: Array) -> float:
        """How far it is off, in the unit of its first joint."""
        return sum(float(P(q[i])) for i, _, P, *_ in self.terms) - self._offset

    def row(self, q: Array) -> Array:
        """Row of Phi, shape (nv,)."""
        row = np.zeros(self._nv)
        for i, k, _, P_1, _ in self.terms:
            row[k] = P_1(q[i])
        return row

    def row_rate(self, q: Array, v: Array) -> Array:
        """Rate of `row`, shape (nv,)."""
        row = np.zeros(self._nv)
        for i, k, _, _, P_2 in self.terms:
            row[k] = P_2(q[i]) * v[k]
        return row

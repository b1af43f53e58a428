# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives of every order along the motions that keep the loops closed, as numbers.

On the closures q has n directions, those of `tangent`, T. What is differentiated by q and then
along T is the derivative along a closed motion; it is itself a function of a closed q, which can be
differentiated in the same way. CasADi does all of this.
"""

from __future__ import annotations

from functools import cache
from math import prod

import casadi as ca
import numpy as np
from casadi import SX, Function

from ..arrays import Array
from .casadi_functions import CasadiFunctions


class AlongMotions:
    """Values and derivatives of functions of closed configurations, one thread at a time."""

    def __init__(self, functions: CasadiFunctions) -> None:
        self._functions = functions
        self._made: dict[tuple[str, int], Function] = {}
        self._sound = cache(lambda motors: functions.checked(np.inf, motors=motors))

    def values(self, name: str, order: int, *arguments: Array) -> Array:
        """One of the `CasadiFunctions` by name, or its derivatives of an order, of samples in rows.

        The arguments are q, shape (..., nq), and others, shape (..., size). The result has the
        shape (..., size, N, .., N), an axis of N for each order: the n directions of q, then the
        entries of the others. Samples where a pivot is small are NaN; that the loops are closed is
        for the caller to check. A frame's name follows "frame_placement ".
        """
        lead = arguments[0].shape[:-1]
        columns = [x.reshape(prod(lead), x.shape[-1]).T for x in arguments]
        function = self._function(name, order)
        values = np.empty((prod(lead), function.numel_out(0)))
        if len(values):
            values[:] = function(*columns).full().T
            checks = self._sound(name == "torques")(columns[0]).full().ravel()
            values[~(checks <= 1)] = np.nan
        axes = (self._functions.n + sum(x.shape[-1] for x in arguments[1:]),) * order
        return values.reshape(*lead, values.shape[1] // prod(axes), *axes)

    def _function(self, name: str, order: int) -> Function:
        """All numbers of one order in a column, the last axis first."""
        if (name, order) not in self._made:
            self._made[name, order] = self._derived(name, order) if order else self._given(name)
        return self._made[name, order]

    def _given(self, name: str) -> Function:
        first, _, rest = name.partition(" ")
        function = getattr(self._functions, first)
        if rest:
            function = function(rest)
        symbols = function.sx_in()
        results = ca.vertcat(*(ca.vec(x.T) for x in function.call(symbols)))
        return Function("values", symbols, [results])

    def _derived(self, name: str, order: int) -> Function:
        before = self._function(name, order - 1)
        symbols = before.sx_in()
        (values,), x = before.call(symbols), ca.vertcat(*symbols)
        T = self._functions.tangent(symbols[0])
        step = ca.diagcat(T, SX.eye(x.numel() - self._functions.nq))
        return Function("derivatives", symbols, [ca.vec(ca.jtimes(values, x, step).T)])

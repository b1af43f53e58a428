# SPDX-License-Identifier: BSD-2-Clause
"""Motions with stops, dry friction, ropes, cables and contacts, by compiled code."""

from __future__ import annotations

import ctypes
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array, Indices
from ..dynamics.nonsmooth_rows import NonsmoothRows
from ..dynamics.nonsmooth_step import NonsmoothArrays
from ..model.mechanism import Mechanism
from .libraries import Code
from .symbolic_parameters import SymbolicParameters

#: Largest change of det Phi_u in a step, a factor, and smallest det Phi_u, as a part of the largest
#: at the sample configurations; other steps are left to the reference path.
DETERMINANT_CHANGE, LEAST_DETERMINANT = 1.5, 0.2


class NonsmoothCode:
    """Compiled steps of one mechanism, for single motions and for several at once."""

    def __init__(
        self,
        mechanism: Mechanism,
        parameters: SymbolicParameters,
        single: Code,
        batch: Code,
        lanes: int,
    ) -> None:
        self._lanes = lanes
        numbers = parameters.pack(mechanism, mechanism.friction)
        self._codes = [(code, code.prepared(numbers)) for code in (single, batch)]
        self._parameters = parameters

    def run(self, rows: NonsmoothRows, motions: NonsmoothArrays, threads: int) -> Indices:
        """Fill motions as far as their steps are sound; the numbers of steps, shape (N,)."""
        mechanism = rows.mechanism
        p = self._parameters.pack(mechanism, mechanism.friction)
        numbers = parameter_values(rows, self._parameters, p[None])
        count = len(motions.q)
        reached = np.zeros(count, dtype=np.intp)
        workers = min(threads, -(-count // self._lanes), 64)
        if workers < 2:
            self._run(numbers, motions, reached)
            return reached
        size = -(-count // (workers * self._lanes)) * self._lanes
        parts = [slice(k, k + size) for k in range(0, count, size)]
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(lambda k: self._run(numbers, motions.part(k), reached[k]), parts))
        return reached

    def _run(self, numbers: Array, motions: NonsmoothArrays, reached: Indices) -> None:
        code, p = self._codes[len(motions.q) > 1]
        function = ctypes.CFUNCTYPE(
            None,
            *[ctypes.c_void_p] * 2,
            ctypes.c_double,
            *[ctypes.c_ssize_t] * 2,
            *[ctypes.c_void_p] * 9,
        )(code.address("run"))
        arrays = *motions[1:], reached
        count, steps = motions.residual.shape
        function(
            p.ctypes.data,
            numbers.ctypes.data,
            motions.dt,
            steps,
            count,
            *(None if array is None else array.ctypes.data for array in arrays),
        )


def implicit_rates(parameters: SymbolicParameters) -> list[int]:
    """Rates with viscous friction or a spring."""
    return sorted({*parameters.joints["viscous"], *parameters.joints["stiffness"]})


def other_lines(rows: NonsmoothRows) -> list[int]:
    """Indices of the lines that also push."""
    cables = set(rows.cables.tolist())
    return [k for k in range(len(rows.mechanism.lines.forces)) if k not in cables]


def parameter_values(rows: NonsmoothRows, parameters: SymbolicParameters, p: Array) -> Array:
    """The numbers of a step in the order of `c/nonsmooth_solver.h`, shape (robots, count).

    Args:
        rows: The rows and gains, the same for all robots.
        parameters: Order of the symbolic parameters.
        p: Symbolic parameters of each robot, shape (robots, size).
    """
    mechanism = rows.mechanism
    gains = rows.gains
    contacts = mechanism.contacts
    robots = len(p)
    coulomb = parameters.of_joints("coulomb", p.T)
    viscous = parameters.of_joints("viscous", p.T)
    stiffness = parameters.of_joints("stiffness", p.T)
    lines = [_Line(*numbers) for numbers in parameters.of_lines(p.T)]
    cables = [lines[k] for k in rows.cables]
    others = [lines[k] for k in other_lines(rows)]
    rates = implicit_rates(parameters)
    columns = [  # each a number for all robots, or one for each
        *(x.friction for x in contacts.points),
        *rows.restitution,
        *(x.radius for x in contacts.points),
        *(-x.length for x in contacts.ropes),
        *(x.stiffness for x in cables),
        *(x.rest_length for x in cables),
        *(x.damping for x in cables),
        *(x.preload for x in cables),
        *mechanism.lines.actuation[rows.cables].ravel(),
        *(x.limit for x in rows.stops),
        *(coulomb[rate] for rate in rows.dry),
        *(viscous.get(rate, 0.0) for rate in rates),
        *(x.damping for x in others),
        *gains.damping,
        *(stiffness.get(rate, 0.0) for rate in rates),
        *(x.stiffness for x in others),
        *gains.stiffness,
        *rows.least_gaps,
    ]
    values = np.zeros((robots, len(columns)))
    for k, column in enumerate(columns):
        values[:, k] = column
    return values


class _Line(NamedTuple):
    """Numbers of a line, in the order of `SymbolicParameters`; each for all robots."""

    stiffness: Any
    rest_length: Any
    damping: Any
    preload: Any

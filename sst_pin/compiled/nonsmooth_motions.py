# SPDX-License-Identifier: BSD-2-Clause
"""Motions with stops, dry friction, ropes, cables and contacts, by compiled code."""

from __future__ import annotations

import ctypes
from concurrent.futures import ThreadPoolExecutor

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
        numbers = parameter_values(rows, self._parameters)
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


def parameter_values(rows: NonsmoothRows, parameters: SymbolicParameters) -> Array:
    """The numbers of a step in the order of `c/nonsmooth.h`."""
    mechanism = rows.mechanism
    gains = rows.gains
    lines = mechanism.lines
    rates = implicit_rates(parameters)
    others = other_lines(rows)
    cables = rows.cables
    parts = [
        [x.friction for x in mechanism.contacts.points],
        rows.restitution,
        [x.radius for x in mechanism.contacts.points],
        [-x.length for x in mechanism.contacts.ropes],
        lines.stiffness[cables],
        lines.rest_lengths[cables],
        lines.damping[cables],
        lines.preload[cables],
        lines.actuation[cables].ravel(),
        [x.limit for x in rows.stops],
        mechanism.friction.coulomb[rows.dry],
        mechanism.friction.viscous[rates],
        lines.damping[others],
        gains.damping,
        mechanism.springs.stiffness[rates],
        lines.stiffness[others],
        gains.stiffness,
        rows.least_gaps,
    ]
    return np.concatenate([np.asarray(part, dtype=float) for part in parts])

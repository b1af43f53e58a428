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

# Phi_u are the columns of Phi for the dependent rates. Steps beyond these limits are left to the
# reference path.
#: Largest factor by which det Phi_u changes in a step.
DETERMINANT_CHANGE = 1.5
#: Smallest det Phi_u, as a part of the largest at the sample configurations.
LEAST_DETERMINANT = 0.2
#: The most threads of a call.
_MOST_THREADS = 64


class NonsmoothCode:
    """Compiled steps of one mechanism, for `lanes` motions at once."""

    def __init__(
        self, mechanism: Mechanism, parameters: SymbolicParameters, code: Code, lanes: int
    ) -> None:
        self._code = code
        self._lanes = lanes
        self._parameters = parameters
        self._p = parameters.pack(mechanism, mechanism.friction)  # in the order of `parameters`
        self._prepared = code.prepared(self._p)

    def run(self, rows: NonsmoothRows, motions: NonsmoothArrays, threads: int) -> Indices:
        """Fill motions as far as their steps are sound; the numbers of steps, shape (N,)."""
        numbers = parameter_values(rows, self._parameters, self._p[None])
        count = len(motions.q)
        reached = np.zeros(count, dtype=np.intp)
        vectors = -(-count // self._lanes)  # rounded up, as below
        workers = min(threads, vectors, _MOST_THREADS)
        if workers < 2:
            self._run(numbers, motions, reached)
            return reached
        # Each thread gets whole vectors of motions.
        size = -(-count // (workers * self._lanes)) * self._lanes
        parts = [slice(k, k + size) for k in range(0, count, size)]
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(lambda k: self._run(numbers, motions.part(k), reached[k]), parts))
        return reached

    def _run(self, numbers: Array, motions: NonsmoothArrays, reached: Indices) -> None:
        """Call `run` of entries/nonsmooth.c; `reached` gets the numbers of steps."""
        count, steps = motions.residual.shape
        pointers: list[Array | Indices | None] = [
            motions.tau,
            motions.positions,
            motions.load,
            motions.q,
            motions.va,
            motions.forces,
            motions.residual,
            motions.impulses,
            reached,
        ]
        function = ctypes.CFUNCTYPE(
            None,  # it returns nothing
            ctypes.c_void_p,  # p
            ctypes.c_void_p,  # numbers
            ctypes.c_double,  # dt
            ctypes.c_ssize_t,  # steps
            ctypes.c_ssize_t,  # count
            *[ctypes.c_void_p for _ in pointers],
        )(self._code.address("run"))
        function(
            self._prepared.ctypes.data,
            numbers.ctypes.data,
            motions.dt,
            steps,
            count,
            *(None if array is None else array.ctypes.data for array in pointers),
        )


def implicit_rates(parameters: SymbolicParameters) -> list[int]:
    """Rates with viscous friction or a spring, whose forces are implicit in a step."""
    return sorted({*parameters.joints["viscous"], *parameters.joints["stiffness"]})


def other_lines(rows: NonsmoothRows) -> list[int]:
    """Indices of the lines that also push."""
    cables = set(rows.cables.tolist())
    return [k for k in range(len(rows.mechanism.lines.forces)) if k not in cables]


def parameter_values(rows: NonsmoothRows, parameters: SymbolicParameters, p: Array) -> Array:
    """The numbers of a step in the order of `c/nonsmooth_step.h`, shape (robots, count).

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
    line_coulomb = parameters.line_coulomb(p.T)
    viscous = parameters.of_joints("viscous", p.T)
    stiffness = parameters.of_joints("stiffness", p.T)
    lines = [_Line(*numbers) for numbers in parameters.of_lines(p.T)]
    cables = [lines[k] for k in rows.cables]
    others = [lines[k] for k in other_lines(rows)]
    rates = implicit_rates(parameters)
    # By the names and in the order of the members of `robot_numbers` in the C. Each entry is a
    # number for all robots, or an array with one for each.
    parts: dict[str, list[Any]] = {
        # contacts
        "friction": [x.friction for x in contacts.points],
        "restitution": list(rows.restitution),
        # what the gaps of contacts and ropes are measured from
        "offsets": [x.radius for x in contacts.points] + [-x.length for x in contacts.ropes],
        # cables
        "line_stiffness": [x.stiffness for x in cables],
        "rest_lengths": [x.rest_length for x in cables],
        "line_damping": [x.damping for x in cables],
        "preload": [x.preload for x in cables],
        "on_cables": list(mechanism.lines.actuation[rows.cables].ravel()),
        # stops, dry friction of joints and of lines
        "limits": [x.limit for x in rows.stops],
        "coulomb": [coulomb[rate] for rate in rows.dry_rates]
        + [line_coulomb[k] for k in rows.dry_lines],
        # implicit rows: joints, lines that also push, motors
        "damping": [viscous.get(rate, 0.0) for rate in rates]
        + [x.damping for x in others]
        + list(gains.damping),
        "stiffness": [stiffness.get(rate, 0.0) for rate in rates]
        + [x.stiffness for x in others]
        + list(gains.stiffness),
        # the least gaps with which a motion may start
        "least_gaps": list(rows.least_gaps),
    }
    columns = [column for part in parts.values() for column in part]
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

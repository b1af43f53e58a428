# SPDX-License-Identifier: BSD-2-Clause
"""Motions with stops, dry friction, ropes, cables and contacts, by compiled code.

`NonsmoothCode.run` computes motions step by step, several in the lanes of one vector and vectors in
several threads. `parameter_values` collects the numbers of a robot that the code reads.
"""

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

# Phi_u are the columns of Phi for the dependent rates. Near a singular configuration det Phi_u is
# small and changes fast. Steps beyond these limits are left to the reference path.
#: Largest factor by which det Phi_u changes in a step.
DETERMINANT_CHANGE = 1.5
#: Smallest |det Phi_u|, relative to the largest one at the sample configurations.
LEAST_DETERMINANT = 0.2
#: The most threads of a call.
_MOST_THREADS = 64


class NonsmoothCode:
    """Compiled steps of one mechanism.

    Args:
        mechanism: The mechanism.
        parameters: The order of its symbolic parameters.
        code: The compiled code.
        lanes: Number of motions that the code computes at once.
    """

    def __init__(
        self, mechanism: Mechanism, parameters: SymbolicParameters, code: Code, lanes: int
    ) -> None:
        self._code = code
        self._lanes = lanes
        self._parameters = parameters
        self._p = parameters.pack(mechanism, mechanism.friction)  # in the order of `parameters`
        self._prepared = code.prepared(self._p)

    def run(self, rows: NonsmoothRows, motions: NonsmoothArrays, threads: int) -> Indices:
        """Compute motions until their first step that the code leaves to the reference path.

        Args:
            rows: The rows and gains of the robot.
            motions: Inputs and results of N motions; the results are written.
            threads: The most threads.

        Returns:
            Number of computed steps of each motion, shape (N,).
        """
        numbers = parameter_values(rows, self._parameters, self._p[None])
        count = len(motions.q)
        reached = np.zeros(count, dtype=np.intp)
        vectors = -(-count // self._lanes)  # rounded up
        workers = min(threads, vectors, _MOST_THREADS)
        if workers < 2:
            self._run(numbers, motions, reached)
            return reached
        # Each thread gets whole vectors of motions.
        vectors_of_thread = -(-count // (workers * self._lanes))  # rounded up
        size = vectors_of_thread * self._lanes
        parts = [slice(first, first + size) for first in range(0, count, size)]

        def run_part(part: slice) -> None:
            self._run(numbers, motions.part(part), reached[part])

        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(run_part, parts))  # `list` waits and raises errors of the threads
        return reached

    def _run(self, numbers: Array, motions: NonsmoothArrays, reached: Indices) -> None:
        """Call `run` of entries/nonsmooth.c, which writes the numbers of steps to `reached`."""
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
    """Rates with viscous friction or a spring, whose forces act with the rates after a step."""
    return sorted({*parameters.joints["viscous"], *parameters.joints["stiffness"]})


def other_lines(rows: NonsmoothRows) -> list[int]:
    """Indices of the lines that also push: those that are no cables."""
    cables = set(rows.cables.tolist())
    return [k for k in range(len(rows.mechanism.lines.forces)) if k not in cables]


def parameter_values(rows: NonsmoothRows, parameters: SymbolicParameters, p: Array) -> Array:
    """The numbers that the C of a step reads, shape (robots, count).

    Their order is that of the members of `robot_numbers` in `c/nonsmooth_step.h`.

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
    # By the members of `robot_numbers`. An entry of a list is a number for all robots, or an array
    # with a number for each robot.
    parts: dict[str, list[Any]] = {
        # contacts
        "friction": [x.friction for x in contacts.points],
        "restitution": list(rows.restitution),
        # the gap of a contact is its height less its radius; that of a rope is its length less the
        # distance of its ends
        "offsets": [x.radius for x in contacts.points] + [-x.length for x in contacts.ropes],
        # cables
        "line_stiffness": [x.stiffness for x in cables],
        "rest_lengths": [x.rest_length for x in cables],
        "line_damping": [x.damping for x in cables],
        "preload": [x.preload for x in cables],
        "on_cables": list(mechanism.lines.actuation[rows.cables].ravel()),
        # stops, dry friction of joints and of lines
        "limits": [x.limit for x in rows.stops],
        "coulomb": [
            *(coulomb[rate] for rate in rows.dry_rates),
            *(line_coulomb[k] for k in rows.dry_lines),
        ],
        # implicit rows: joints, lines that also push, motors
        "damping": [
            *(viscous.get(rate, 0.0) for rate in rates),
            *(x.damping for x in others),
            *gains.damping,
        ],
        "stiffness": [
            *(stiffness.get(rate, 0.0) for rate in rates),
            *(x.stiffness for x in others),
            *gains.stiffness,
        ],
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

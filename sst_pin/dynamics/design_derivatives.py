# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives by the design: by placements, lengths, masses and mass centres.

A change of the geometry is the position of a joint at rest. So its derivatives are those of a
larger mechanism along this joint: columns of L, of L_dot and of the derivatives of the forces.
Forces are linear in the dynamic parameters; their derivatives are columns of the regressor.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, for_each_sample, in_order
from ..errors import InputError, SingularConfigurationError, UnknownNameError
from ..model.closures import Coupling
from ..model.geometry import Error, displaced, displacements, enlarged, parameter_names
from ..model.mechanism import Friction, Mechanism, Springs
from ..model.tree import frame_id
from ..summaries import listed
from . import regressor
from .reference import Reference

#: A parameter, a pattern of names, several that change together, or their factors.
Parameter = str | Sequence[str] | Mapping[str, float]
#: Names that change together, and their factors.
Group = dict[str, float]
#: The slide and the turn of a displacement.
_HALVES = np.kron(np.eye(2), np.ones(3))


class DesignDerivatives(NamedTuple):
    """Derivatives by design parameters, the positions of the coordinates, va and aa held.

    Attributes:
        names: The parameters.
        q: Of the configuration, along the rates of the joints, shape (..., nv, names).
        torques: Of the motor torques, shape (..., motors, names).
        L: Of the joint complement, v = L va, shape (..., nv, n, names).
        pose: Of a frame's pose, [linear; angular] in base axes at its origin, shape
            (..., 6, names); without a frame (..., 0, names).
    """

    names: tuple[str, ...]
    q: Array
    torques: Array
    L: Array
    pose: Array


def names_of(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of all parameters: lengths, displacements, dynamic parameters without offsets."""
    dynamic = regressor.names_of(mechanism)
    return (*parameter_names(mechanism), *(x for x in dynamic if not x.endswith("offset")))


def groups_of(mechanism: Mechanism, parameters: Iterable[Parameter]) -> list[tuple[str, Group]]:
    """For each parameter its label, the names that change with it, and their factors."""
    known, groups = names_of(mechanism), list[tuple[str, Group]]()
    for parameter in parameters:
        words = (parameter,) if isinstance(parameter, str) else parameter
        factors = words if isinstance(words, Mapping) else dict.fromkeys(words, 1.0)
        group = Group()
        for pattern, factor in factors.items():
            fitting = [x for x in known if pattern == x or fnmatchcase(x, str(pattern))]
            if not fitting:
                raise UnknownNameError("design parameter", str(pattern), list(known))
            group |= {name: group.get(name, 0.0) + float(factor) for name in fitting}
        groups.append((" + ".join(map(str, factors)), group))
    return groups


def changed(
    mechanism: Mechanism, changes: Mapping[str, float]
) -> tuple[pin.Model, dict[str, float]]:
    """The tree with a changed geometry, and the values of changed dynamic parameters."""
    ((_, total),) = groups_of(mechanism, [changes])
    theta, geometry = regressor.parameters_of(mechanism), parameter_names(mechanism)
    moves = displacements(mechanism, {x: c for x, c in total.items() if x in geometry})
    values = {x: theta[x] + c for x, c in total.items() if x not in geometry}
    return displaced(mechanism.model, moves), values


class Design:
    """A mechanism with a joint at rest for each change of its geometry; one object per thread."""

    def __init__(self, reference: Reference, groups: Sequence[tuple[str, Group]]) -> None:
        self._small, self._groups = reference, groups
        self.names = tuple(name for name, _ in groups)
        mechanism = reference.mechanism
        theta, geometry = regressor.names_of(mechanism), parameter_names(mechanism)
        #: Changes of the dynamic parameters, shape (p, names).
        self._theta = np.array([[g.get(x, 0.0) for _, g in groups] for x in theta])
        errors: list[Error] = []
        couplings: list[Coupling] = []
        #: The parameters that change the geometry, and how far they move the first of their joints.
        self._moved, leaders, sizes = list[int](), list[str](), list[float]()
        for k, (_, group) in enumerate(groups):
            moves = displacements(mechanism, {x: f for x, f in group.items() if x in geometry})
            ways = [
                (f"{place} {kind}{k}", place, way, float(np.linalg.norm(way)))
                for place, displacement in moves.items()
                for kind, way in zip("xr", displacement * _HALVES, strict=True)
                if way.any()
            ]
            errors += [(joint, place, way / size) for joint, place, way, size in ways]
            for leader, _, _, first in ways[:1]:
                self._moved.append(k)
                leaders.append(leader)
                sizes.append(first)
                couplings += [
                    Coupling(x, {leader: (0.0, size / first)}) for x, *_, size in ways[1:]
                ]
        self._sizes = np.array(sizes)
        self._large = Reference(self._enlarged(errors, couplings, leaders))

    def _enlarged(
        self, errors: Sequence[Error], couplings: Sequence[Coupling], leaders: Sequence[str]
    ) -> Mechanism:
        """The mechanism with joints at rest, of which those that lead are coordinates too."""
        mechanism = self._small.mechanism
        old, model = mechanism.model, enlarged(mechanism.model, errors)
        ids = [model.getJointId(name) for name in list(old.names)[1:]]
        pairs = [(old.joints[i], model.joints[j]) for i, j in enumerate(ids, 1)]
        self._q = np.concatenate([j.idx_q + np.arange(i.nq) for i, j in pairs])
        self._v = np.concatenate([j.idx_v + np.arange(i.nv) for i, j in pairs])
        self._bodies, self._neutral = np.array(ids) - 1, pin.neutral(model)

        def of_rates(numbers: Array) -> Array:
            return _scattered(numbers, self._v, model.nv)

        friction, springs = mechanism.friction, mechanism.springs
        at_rest = [model.joints[model.getJointId(name)].idx_v for name in leaders]
        return replace(
            mechanism,
            model=model,
            closures=(*mechanism.closures, *couplings),
            coordinates=np.append(self._v[mechanism.coordinates], at_rest).astype(np.intp),
            motors=of_rates(mechanism.motors),
            friction=Friction(of_rates(friction.viscous), of_rates(friction.coulomb)),
            springs=Springs(of_rates(springs.stiffness), self._configuration(springs.reference)),
            example=None,
            row_sizes=None,
        )

    def _configuration(self, q: Array) -> Array:
        large = self._neutral.copy()
        large[self._q] = q
        return large

    def row(
        self,
        q: Array,
        va: Array,
        aa: Array,
        wrenches: Array | None,
        frame: str | None,
        sign_width: float,
    ) -> Array:
        """Derivatives of q, torques, L and the pose of one sample, side by side."""
        tau, n = self._small.torques(q, va, aa, wrenches), len(va)
        if wrenches is not None:
            bodies = self._large.mechanism.model.njoints - 1
            wrenches = _scattered(wrenches, self._bodies, bodies)
        x, rest = self._configuration(q), np.zeros(len(self._moved))
        motion = x, np.append(va, rest), np.append(aa, rest), wrenches
        try:
            slopes = self._large.torque_derivatives(*motion, sign_width)[:n, n : n + len(rest)]
        except SingularConfigurationError:
            self._require_closing(q)
            raise
        by_f = self._columns(slopes * self._sizes)
        if self._theta.any():
            by_f += self._small.torque_regressor(q, va, aa) @ self._theta
        by_q, by_L, A, by_A = self._kinematics(x, n)
        one_to_one = self._small.mechanism.driven_one_to_one
        parts = [by_q, by_f if one_to_one else _least(by_f, A, by_A, tau), by_L]
        if frame is not None:
            J = self._large.frame_jacobian(x, frame_id(self._large.mechanism.model, frame))
            parts.append(self._columns(J[:, n:] * self._sizes))
        return np.concatenate([part.ravel() for part in parts])

    def _kinematics(self, x: Array, n: int) -> tuple[Array, Array, Array, Array]:
        """Derivatives of q and L, A = L^T B and its derivatives, at x of the large mechanism."""
        memory = self._large.memory
        memory.complement.evaluate(x)
        B, lines = memory.actuation(x), memory.mechanism.lines
        L, ways = np.split(memory.complement.L, [n], axis=1)
        by_L = np.zeros((*L.shape, len(self._moved)))
        by_A = np.zeros((n, B.shape[1], len(self._moved)))
        ways = ways * self._sizes
        for k, way in enumerate(ways.T):
            by_L[..., k] = memory.complement.L_dot(memory.loops.Phi_dot(way))[:, :n]
            by_A[..., k] = by_L[..., k].T @ B
            if lines.motors.any():
                by_A[..., k] += L.T @ memory.lines.loops.Phi_dot(way).T @ lines.motors
        by_q, by_L = ways[self._v], by_L[self._v]
        return self._columns(by_q), self._columns(by_L), L.T @ B, self._columns(by_A)

    def _columns(self, array: Array) -> Array:
        """Derivatives by all parameters, from those by the ones that change the geometry."""
        result = np.zeros((*array.shape[:-1], len(self._groups)))
        result[..., self._moved] = array
        return result

    def _require_closing(self, q: Array) -> None:
        """Refuse parameters with which the loops do not close."""
        opening, n = [], len(self._small.mechanism.coordinates)
        for group in self._groups:
            alone = Design(self._small, [group])
            try:
                alone._kinematics(alone._configuration(q), n)
            except SingularConfigurationError:
                opening.append(group[0])
        names = listed(opening or list(self.names))
        cure = "leave them out, or change several together, as [{first: 1, second: -1}]"
        raise InputError("names", f"changes of {names} alone open the loops; {cure}")


def _scattered(rows: Array, at: Array, count: int) -> Array:
    """So many rows, zero but for some."""
    result = np.zeros((count, *rows.shape[1:]))
    result[at] = rows
    return result


def _least(by_f: Array, A: Array, by_A: Array, tau: Array) -> Array:
    """Derivatives of the least torques with A tau = f, shape (motors, names)."""
    inverse = np.linalg.pinv(A)
    result = inverse @ (by_f - np.einsum("imk,m->ik", by_A, tau))
    preload = np.einsum("imk,i->mk", by_A, inverse.T @ tau)
    return result + preload - inverse @ (A @ preload)


def design_derivatives(
    reference: Reference,
    parameters: Iterable[Parameter],
    arrays: Sequence[Array | None],
    frame: str | None,
    sign_width: float,
) -> DesignDerivatives:
    """Derivatives for samples of q, va, aa and wrenches."""
    mechanism, wanted = reference.mechanism, in_order("names", parameters)
    if frame is not None:
        frame_id(mechanism.model, frame)
    key = repr(wanted)
    if key not in reference.designs:
        design = Design(reference, groups_of(mechanism, wanted))
        reference.designs.clear()  # one is enough for a loop
        reference.designs[key] = design
    design = reference.designs[key]
    nv, motors = mechanism.motors.shape
    n = len(mechanism.coordinates)
    shapes = [(nv,), (motors,), (nv, n), (6 if frame is not None else 0,)]
    ends = np.cumsum([math.prod(shape) * len(wanted) for shape in shapes])

    def row(q: Array, va: Array, aa: Array, wrenches: Array | None) -> Array:
        return design.row(q, va, aa, wrenches, frame, sign_width)

    rows = for_each_sample(row, arrays, (1, 1, 1, 2), (int(ends[-1]),))
    shaped = [
        part.reshape(*rows.shape[:-1], *shape, len(wanted))
        for part, shape in zip(np.split(rows, ends[:-1], axis=-1), shapes, strict=True)
    ]
    return DesignDerivatives(design.names, *shaped)

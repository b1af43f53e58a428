# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives by design parameters: placements, lengths, masses and mass centres.

A change of the geometry is the position of an added joint at rest. Derivatives by it are columns of
L, of L_dot and of the derivatives of the forces of the larger mechanism. Forces are linear in the
dynamic parameters; their derivatives are columns of the regressor.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import filter as fitting
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, for_each_sample, in_order, single_array
from ..arrays import names as words
from ..errors import InputError, SingularConfigurationError, UnknownNameError
from ..model.closures import Coupling
from ..model.geometry import (
    RestingJoint,
    displaced,
    displacements,
    enlarged,
    extended,
    extensions,
    parameter_names,
)
from ..model.mechanism import Friction, Mechanism, Springs
from ..model.tree import frame_id
from ..summaries import listed
from . import regressor
from .dynamics import Context
from .noc import body_jacobians
from .reference import Reference

#: A parameter, a pattern of names, several that change together, or their factors.
Parameter = str | Sequence[str] | Mapping[str, float]
#: A label, the names that change together, and their factors.
Group = tuple[str, dict[str, float]]


class FrameWrenches(NamedTuple):
    """Wrenches that stay at frames; the wrenches at the mass centres contain them.

    Attributes:
        frames: Names of the frames.
        bodies: Their bodies, from 0.
        wrenches: [force; moment] at the origins, base axes, shape (..., frames, 6).
    """

    frames: list[str]
    bodies: list[int]
    wrenches: Array


class DesignDerivatives(NamedTuple):
    """Derivatives by design parameters, the positions of the coordinates, va and aa held.

    Attributes:
        names: The parameters.
        q: Derivatives of the configuration, along the rates of the joints, shape (..., nv, names).
        torques: Derivatives of the motor torques, shape (..., motors, names).
        L: Derivatives of the joint complement, v = L va, shape (..., nv, n, names).
        pose: Derivatives of a frame's pose, [linear; angular] in base axes at its origin, shape
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


def groups_of(mechanism: Mechanism, parameters: Iterable[Parameter]) -> list[Group]:
    """The names that change with each parameter."""
    known = names_of(mechanism)
    groups: list[Group] = []
    for parameter in parameters:
        if isinstance(parameter, str):
            patterns: Mapping[str, float] = {parameter: 1.0}
        elif isinstance(parameter, Mapping):
            patterns = parameter
        else:
            patterns = dict.fromkeys(words("names", parameter), 1.0)
        factors: dict[str, float] = {}
        for pattern, factor in patterns.items():
            number = float(single_array("factors", factor, ()))
            names = [pattern] if pattern in known else fitting(known, str(pattern))
            if not names:
                raise UnknownNameError("design parameter", str(pattern), list(known))
            for name in names:
                factors[name] = factors.get(name, 0.0) + number
        label = " + ".join(map(str, patterns))
        groups.append((label, factors))
    return groups


class ChangedDesign(NamedTuple):
    """What changes of design parameters give.

    Attributes:
        model: The tree with displaced joints and frames.
        extensions: Changes of the lengths of rods, by their names, [m].
        dynamic_parameters: The values of the dynamic parameters that change.
    """

    model: pin.Model
    extensions: dict[str, float]
    dynamic_parameters: dict[str, float]


def changed(mechanism: Mechanism, changes: Mapping[str, float] | object) -> ChangedDesign:
    """The tree, lengths of rods and dynamic parameters with changes of design parameters.

    Anything that is not a mapping of names to numbers is refused.
    """
    if not isinstance(changes, Mapping):
        problem = (
            f'{changes!r}: a mapping of names to changes is needed, such as {{"crank.x": 1e-3}}'
        )
        raise InputError("changes", problem)
    numbers = {name: float(single_array("changes", x, ())) for name, x in changes.items()}
    ((_, total),) = groups_of(mechanism, [numbers])
    theta = regressor.parameters_of(mechanism)
    geometry = parameter_names(mechanism)
    of_geometry = {x: c for x, c in total.items() if x in geometry}
    return ChangedDesign(
        model=displaced(mechanism.model, displacements(mechanism, of_geometry)),
        extensions=extensions(mechanism.closures, of_geometry),
        dynamic_parameters={x: theta[x] + c for x, c in total.items() if x not in geometry},
    )


class Design:
    """A mechanism with a joint at rest for each change of its geometry; one object per thread."""

    def __init__(self, reference: Reference, groups: Sequence[Group]) -> None:
        self._small = reference
        self._groups = groups
        self.names = tuple(label for label, _ in groups)
        mechanism = reference.mechanism
        geometry = parameter_names(mechanism)
        #: Changes of the dynamic parameters, a column for each group.
        self._theta = np.array(
            [
                [factors.get(name, 0.0) for _, factors in groups]
                for name in regressor.names_of(mechanism)
            ]
        )
        joints_at_rest: list[RestingJoint] = []
        rods_of_joints: dict[str, str] = {}
        couplings: list[Coupling] = []
        leaders: list[str] = []
        directions: list[Array] = []
        for k, (_, factors) in enumerate(groups):
            changes = {name: factor for name, factor in factors.items() if name in geometry}
            joints = _joints_of_group(displacements(mechanism, changes), k)
            joints_at_rest += joints
            #: The rate of each joint of the group at a unit rate of its parameter.
            rates = {name: float(np.linalg.norm(direction)) for name, _, direction in joints}
            for rod, change in extensions(mechanism.closures, changes).items():
                if change:
                    rods_of_joints[f"{rod} length{k}"] = rod
                    rates[f"{rod} length{k}"] = change
            if not rates:
                continue
            # The first joint of a group leads, the others follow it in fixed proportions.
            leader, *followers = rates
            leaders.append(leader)
            directions.append(rates[leader] * np.eye(len(groups))[k])
            for follower in followers:
                ratio = rates[follower] / rates[leader]
                couplings.append(Coupling(follower, {leader: (0.0, ratio)}))
        #: Rates of the leaders, in rows, by a change of each group, in columns.
        self._directions = np.array(directions).reshape(len(directions), len(groups))
        self._large = Reference(self._enlarged(joints_at_rest, rods_of_joints, couplings, leaders))

    def _enlarged(
        self,
        joints_at_rest: list[RestingJoint],
        rods_of_joints: dict[str, str],
        couplings: list[Coupling],
        leaders: list[str],
    ) -> Mechanism:
        """The mechanism with joints at rest, of which those that lead are coordinates too."""
        mechanism = self._small.mechanism
        small = mechanism.model
        large = enlarged(small, joints_at_rest, slides=rods_of_joints)
        # Where the joints of the mechanism are in q, v and the bodies of the larger one.
        ids = [large.getJointId(name) for name in list(small.names)[1:]]
        pairs = [(small.joints[i], large.joints[j]) for i, j in enumerate(ids, 1)]
        self._q = np.concatenate([j.idx_q + np.arange(i.nq) for i, j in pairs])
        self._v = np.concatenate([j.idx_v + np.arange(i.nv) for i, j in pairs])
        self._bodies = np.array(ids) - 1
        self._neutral = pin.neutral(large)

        friction = mechanism.friction
        springs = mechanism.springs
        zero_rates = np.zeros(large.nv)
        no_motors = np.zeros((large.nv, mechanism.motor_count))
        leading = [large.joints[large.getJointId(name)].idx_v for name in leaders]
        return replace(
            mechanism,
            model=large,
            closures=(*extended(mechanism.closures, rods_of_joints), *couplings),
            coordinates=np.array([*self._v[mechanism.coordinates], *leading], dtype=np.intp),
            actuation=_put(no_motors, self._v, mechanism.actuation),
            friction=Friction(
                _put(zero_rates, self._v, friction.viscous),
                _put(zero_rates, self._v, friction.coulomb),
            ),
            springs=Springs(
                _put(zero_rates, self._v, springs.stiffness),
                _put(self._neutral, self._q, springs.reference),
            ),
            example=None,
            row_sizes=None,
        )

    def at(self, q: Array) -> tuple[Array, Context]:
        """The configuration of the large mechanism, and its loops and L there."""
        x = _put(self._neutral, self._q, q)
        context = self._large.context
        context.complement.evaluate(x)
        return x, context

    def row(
        self,
        q: Array,
        va: Array,
        aa: Array,
        wrenches: Array | None,
        at_frames: FrameWrenches | None,
        frame: str | None,
        sign_width: float,
    ) -> Array:
        """Derivatives of q, torques, L and the pose of one sample, side by side."""
        tau = self._small.torques(q, va, aa, wrenches)
        n = len(va)
        directions = self._directions
        try:
            x, context = self.at(q)
        except SingularConfigurationError:
            names = listed([group[0] for group in self._groups if self._opens(group, q)])
            cure = "leave them out, or change several together, as [{first: 1, second: -1}]"
            raise InputError("names", f"changes of {names} alone open the loops; {cure}") from None
        # Columns of the large L: along the coordinates, then along each leader.
        L, leader_motions = np.split(context.complement.L, [n], axis=1)

        # Derivatives of L and of A = L^T B along each leader.
        B = context.actuation(x)
        lines = context.mechanism.lines
        by_L = np.zeros((len(directions), *L.shape))
        by_A = np.zeros((len(directions), n, len(tau)))
        for k, motion in enumerate(leader_motions.T):
            by_L[k] = context.complement.L_dot(context.loops.Phi_dot(motion))[:, :n]
            by_A[k] = by_L[k].T @ B
            if lines.actuation.any():
                by_A[k] += L.T @ context.lines.loops.Phi_dot(motion).T @ lines.actuation

        # Derivatives of the forces along the leaders, and by the dynamic parameters.
        if wrenches is not None:
            no_wrenches = np.zeros((context.mechanism.model.njoints - 1, 6))
            wrenches = _put(no_wrenches, self._bodies, wrenches)
        rest = np.zeros(len(directions))
        by_q_va_aa = self._large.torque_derivatives(
            x, np.append(va, rest), np.append(aa, rest), wrenches, sign_width
        )
        by_f = by_q_va_aa[:n, n : n + len(directions)] @ directions
        if at_frames is not None:
            by_f -= self._force_by_arms(x, at_frames) @ directions
        if self._theta.any():
            by_f += self._small.torque_regressor(q, va, aa) @ self._theta
        if not self._small.mechanism.driven_one_to_one:
            by_f = _least(by_f, L.T @ B, np.tensordot(by_A, directions, (0, 0)), tau)

        parts = [
            leader_motions[self._v] @ directions,
            by_f,
            np.tensordot(by_L[:, self._v], directions, (0, 0)),
        ]
        if frame is not None:
            index = frame_id(context.mechanism.model, frame)
            parts.append(self._large.frame_jacobian(x, index)[:, n:] @ directions)
        return np.concatenate([part.ravel() for part in parts])

    def _force_by_arms(self, x: Array, at_frames: FrameWrenches) -> Array:
        """Derivative of J^T w along each leader, as the arms of wrenches at frames change.

        It is what derivatives for constant wrenches at the mass centres lack, shape (n, leaders).
        """
        context = self._large.context
        L = context.complement.L
        n = L.shape[1] - len(self._directions)
        J_of_bodies = body_jacobians(context.loops) @ L
        force = np.zeros((n, len(self._directions)))
        for name, body, wrench in zip(*at_frames, strict=True):
            row = 6 * self._bodies[body]
            J_of_centre = J_of_bodies[row : row + 3]
            J_of_turns = J_of_bodies[row + 3 : row + 6]
            index = frame_id(context.mechanism.model, name)
            J_of_frame = self._large.frame_jacobian(x, index)[:3]
            arm_rates = (J_of_frame - J_of_centre)[:, n:]
            moments = np.cross(arm_rates.T, wrench[:3]).T
            force += J_of_turns[:, :n].T @ moments
        return force

    def _opens(self, group: Group, q: Array) -> bool:
        """Whether a change of this group alone opens the loops."""
        try:
            Design(self._small, [group]).at(q)
        except SingularConfigurationError:
            return True
        return len(self._groups) == 1


def _joints_of_group(moves: Mapping[str, Array], group: int) -> list[RestingJoint]:
    """Joints at rest for the displacements of a group: a slide and a turn at each place."""
    joints: list[RestingJoint] = []
    for place, displacement in moves.items():
        slide = np.concatenate([displacement[:3], np.zeros(3)])
        turn = np.concatenate([np.zeros(3), displacement[3:]])
        for kind, direction in (("x", slide), ("r", turn)):
            if direction.any():
                joints.append((f"{place} {kind}{group}", place, direction))
    return joints


def _put(array: Array, at: Array, values: Array) -> Array:
    """A copy of an array with some values."""
    array = array.copy()
    array[at] = values
    return array


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
    at_frames: FrameWrenches | None,
    frame: str | None,
    sign_width: float,
) -> DesignDerivatives:
    """Derivatives for samples of q, va, aa and wrenches, which contain those at frames."""
    mechanism = reference.mechanism
    wanted = in_order("names", parameters)
    key = repr(wanted)
    if key not in reference.designs:
        reference.designs.clear()  # one is enough for a loop
        reference.designs[key] = Design(reference, groups_of(mechanism, wanted))
    design = reference.designs[key]
    nv, motors = mechanism.actuation.shape
    pose_size = 0
    if frame is not None:
        frame_id(mechanism.model, frame)  # refuses an unknown name
        pose_size = 6
    shapes = [(nv,), (motors,), (nv, len(mechanism.coordinates)), (pose_size,)]
    ends = np.cumsum([math.prod(shape) * len(wanted) for shape in shapes])

    def row(q: Array, va: Array, aa: Array, wrenches: Array, of_frames: Array | None) -> Array:
        of_sample = None
        if at_frames is not None and of_frames is not None:
            of_sample = at_frames._replace(wrenches=of_frames)
        return design.row(q, va, aa, wrenches, of_sample, frame, sign_width)

    samples = [*arrays, None if at_frames is None else at_frames.wrenches]
    rows = for_each_sample(row, samples, (1, 1, 1, 2, 2), (int(ends[-1]),))
    batch = rows.shape[:-1]
    parts = np.split(rows, ends[:-1], axis=-1)
    q, torques, L, pose = (
        part.reshape(*batch, *shape, len(wanted)) for part, shape in zip(parts, shapes, strict=True)
    )
    return DesignDerivatives(design.names, q, torques, L, pose)

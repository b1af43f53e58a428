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
from ..model.weight_shares import WeightShares
from ..summaries import listed
from . import regressor
from .dynamics import Context
from .noc import body_jacobians
from .reference import Reference
from .torque_sharing import inverse_for_torques

#: A parameter, a pattern of names, several that change together, or their factors.
Parameter = str | Sequence[str] | Mapping[str, float]


class Group(NamedTuple):
    """Design parameters that change together.

    Attributes:
        label: Their name, or names, as the caller has given them.
        factors: For each of them, its change for a unit change of the group.
    """

    label: str
    factors: dict[str, float]


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
        groups.append(Group(label, factors))
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
    (group,) = groups_of(mechanism, [numbers])
    total = group.factors
    theta = regressor.parameters_of(mechanism)
    geometry = parameter_names(mechanism)
    of_geometry = {x: c for x, c in total.items() if x in geometry}
    return ChangedDesign(
        model=displaced(mechanism.model, displacements(mechanism, of_geometry)),
        extensions=extensions(mechanism.closures, of_geometry),
        dynamic_parameters={x: theta[x] + c for x, c in total.items() if x not in geometry},
    )


class _AddedJoints(NamedTuple):
    """The joints that a mechanism gets for changes of its geometry; they are at rest.

    A group of changes has a joint for each displacement and for each rod that changes its length.
    The first one leads, and the others follow it in fixed proportions.

    Attributes:
        at_rest: The joints at places that are displaced.
        rods: Names of the rods, by the names of the slides that change their lengths.
        couplings: Of the joints that follow.
        leaders: Names of the joints that lead, at most one for each group.
        directions: Rates of the leaders, in rows, for a unit rate of each group, in columns.
    """

    at_rest: list[RestingJoint]
    rods: dict[str, str]
    couplings: list[Coupling]
    leaders: list[str]
    directions: Array


def _added_joints(mechanism: Mechanism, groups: Sequence[Group]) -> _AddedJoints:
    """The joints for all groups that change the geometry."""
    geometry = parameter_names(mechanism)
    at_rest: list[RestingJoint] = []
    rods: dict[str, str] = {}
    couplings: list[Coupling] = []
    leaders: list[str] = []
    directions: list[Array] = []
    for k, group in enumerate(groups):
        changes = {name: factor for name, factor in group.factors.items() if name in geometry}
        # The rate of each joint at a unit rate of the group.
        rates: dict[str, float] = {}
        for joint in _joints_at_places(displacements(mechanism, changes), k):
            at_rest.append(joint)
            rates[joint.name] = float(np.linalg.norm(joint.direction))
        for rod, change in extensions(mechanism.closures, changes).items():
            if change:
                rods[f"{rod} length{k}"] = rod
                rates[f"{rod} length{k}"] = change
        if not rates:
            continue
        leader, *followers = rates
        leaders.append(leader)
        directions.append(rates[leader] * np.eye(len(groups))[k])
        for follower in followers:
            ratio = rates[follower] / rates[leader]
            couplings.append(Coupling(follower, {leader: (0.0, ratio)}))
    matrix = np.array(directions).reshape(len(directions), len(groups))
    return _AddedJoints(at_rest, rods, couplings, leaders, matrix)


def _joints_at_places(moves: Mapping[str, Array], group: int) -> list[RestingJoint]:
    """Joints at rest for the displacements of a group: a slide and a turn at each place."""
    joints: list[RestingJoint] = []
    for place, displacement in moves.items():
        slide = np.concatenate([displacement[:3], np.zeros(3)])
        turn = np.concatenate([np.zeros(3), displacement[3:]])
        if slide.any():
            joints.append(RestingJoint(f"{place} x{group}", place, slide))
        if turn.any():
            joints.append(RestingJoint(f"{place} r{group}", place, turn))
    return joints


class Design:
    """A mechanism with joints at rest for changes of its geometry; one object per thread.

    `small` is the robot, `large` the mechanism with the added joints. Its coordinates are those of
    the robot, then the leaders of `_AddedJoints`.
    """

    def __init__(self, reference: Reference, groups: Sequence[Group]) -> None:
        self._small = reference
        self._groups = groups
        self.names = tuple(group.label for group in groups)
        mechanism = reference.mechanism
        #: Changes of the dynamic parameters, a column for each group.
        self._theta = np.array(
            [
                [group.factors.get(name, 0.0) for group in groups]
                for name in regressor.names_of(mechanism)
            ]
        )
        added = _added_joints(mechanism, groups)
        #: See `_AddedJoints`.
        self._directions = added.directions

        # Where the robot's joints are in q, v and the bodies of the large mechanism.
        small = mechanism.model
        large = enlarged(small, added.at_rest, slides=added.rods)
        ids = [large.getJointId(name) for name in list(small.names)[1:]]
        pairs = [(small.joints[i], large.joints[j]) for i, j in enumerate(ids, 1)]
        self._q = np.concatenate([j.idx_q + np.arange(i.nq) for i, j in pairs])
        self._v = np.concatenate([j.idx_v + np.arange(i.nv) for i, j in pairs])
        self._bodies = np.array(ids) - 1
        self._neutral = pin.neutral(large)
        self._large = Reference(self._enlarged(large, added))

    def _enlarged(self, large: pin.Model, added: _AddedJoints) -> Mechanism:
        """The mechanism with the added joints; `large` is its tree."""
        mechanism = self._small.mechanism
        friction = mechanism.friction
        springs = mechanism.springs
        zero_rates = np.zeros(large.nv)
        no_motors = np.zeros((large.nv, mechanism.motor_count))
        leading = [large.joints[large.getJointId(name)].idx_v for name in added.leaders]
        return replace(
            mechanism,
            model=large,
            closures=(*extended(mechanism.closures, added.rods), *added.couplings),
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
            weight_shares=self._enlarged_shares(large),
            example=None,
            row_sizes=None,
        )

    def _enlarged_shares(self, large: pin.Model) -> WeightShares | None:
        """The shares of the weights for the bodies of the large tree."""
        small = self._small.mechanism.weight_shares
        if small is None:
            return None
        bodies = large.njoints - 1
        return WeightShares(
            _put(np.ones(bodies), self._bodies, small.shares),
            _put(np.zeros((bodies, 3)), self._bodies, small.offsets),
        )

    def _at(self, q: Array) -> tuple[Array, Context]:
        """The configuration x of the large mechanism, and its loops and L at x."""
        x = _put(self._neutral, self._q, q)
        context = self._large.context
        context.complement.evaluate(x)
        return x, context

    def of_sample(
        self,
        q: Array,
        va: Array,
        aa: Array,
        wrenches: Array | None,
        at_frames: FrameWrenches | None,
        frame: str | None,
        sign_width: float,
    ) -> DesignDerivatives:
        """The derivatives of one sample.

        A derivative by a parameter is that along the leader of its group times `directions`.
        """
        tau = self._small.torques(q, va, aa, wrenches)
        n = len(va)
        directions = self._directions
        try:
            x, context = self._at(q)
        except SingularConfigurationError:
            names = listed([group.label for group in self._groups if self._opens(group, q)])
            cure = "leave them out, or change several together, as [{first: 1, second: -1}]"
            raise InputError("names", f"changes of {names} alone open the loops; {cure}") from None
        # Columns of the large L: along the coordinates, then along each leader.
        L, leader_motions = np.split(context.complement.L, [n], axis=1)

        by_L = self._complement_derivatives(context, leader_motions, n)
        by_torques = self._force_derivatives(q, x, va, aa, wrenches, at_frames, sign_width)
        if not self._small.mechanism.driven_one_to_one:
            A = L.T @ context.actuation(x)
            by_A = self._actuation_derivatives(context, x, L, leader_motions, by_L)
            inverse = inverse_for_torques(self._small.mechanism, A)
            by_A = np.tensordot(by_A, directions, (0, 0))
            by_torques = _least(by_torques, A, inverse, by_A, tau)
        by_pose = np.zeros((0, len(self.names)))
        if frame is not None:
            index = frame_id(context.mechanism.model, frame)
            by_pose = self._large.frame_jacobian(x, index)[:, n:] @ directions
        return DesignDerivatives(
            names=self.names,
            q=leader_motions[self._v] @ directions,
            torques=by_torques,
            L=np.tensordot(by_L[:, self._v], directions, (0, 0)),
            pose=by_pose,
        )

    def _complement_derivatives(self, context: Context, leader_motions: Array, n: int) -> Array:
        """Derivatives of L along each leader, shape (leaders, large nv, n).

        They are the rates of L in the motions of the leaders, shape (large nv, leaders).
        """
        by_L = np.zeros((leader_motions.shape[1], len(leader_motions), n))
        for k, motion in enumerate(leader_motions.T):
            by_L[k] = context.complement.L_dot(context.loops.Phi_dot(motion))[:, :n]
        return by_L

    def _actuation_derivatives(
        self, context: Context, x: Array, L: Array, leader_motions: Array, by_L: Array
    ) -> Array:
        """Derivatives of A = L^T B along each leader, shape (leaders, n, motors).

        B changes where motors act on lines, whose directions change.
        """
        by_A = by_L.swapaxes(1, 2) @ context.actuation(x)
        on_lines = context.mechanism.lines.actuation
        if on_lines.any():
            for k, motion in enumerate(leader_motions.T):
                by_A[k] += L.T @ context.lines.loops.Phi_dot(motion).T @ on_lines
        return by_A

    def _force_derivatives(
        self,
        q: Array,
        x: Array,
        va: Array,
        aa: Array,
        wrenches: Array | None,
        at_frames: FrameWrenches | None,
        sign_width: float,
    ) -> Array:
        """Derivatives of the generalized forces, shape (n, names); x is the large configuration."""
        n = len(va)
        directions = self._directions
        if wrenches is not None:
            no_wrenches = np.zeros((self._large.mechanism.model.njoints - 1, 6))
            wrenches = _put(no_wrenches, self._bodies, wrenches)
        rest = np.zeros(len(directions))
        by_q_va_aa = self._large.torque_derivatives(
            x, np.append(va, rest), np.append(aa, rest), wrenches, sign_width
        )
        by_f = by_q_va_aa[:n, n : n + len(directions)] @ directions  # by q, of the leaders
        if at_frames is not None:
            by_f -= self._force_by_arms(x, at_frames) @ directions
        if self._theta.any():
            by_f += self._small.torque_regressor(q, va, aa) @ self._theta
        return np.asarray(by_f)

    def _force_by_arms(self, x: Array, at_frames: FrameWrenches) -> Array:
        """Derivative of J^T w along each leader, as the arms of wrenches at frames change.

        It is what derivatives for constant wrenches at the mass centres lack, shape (n, leaders).
        """
        context = self._large.context
        L = context.complement.L
        n = L.shape[1] - len(self._directions)
        J_of_bodies = body_jacobians(context.loops) @ L
        force = np.zeros((n, len(self._directions)))
        frames = zip(at_frames.frames, at_frames.bodies, at_frames.wrenches, strict=True)
        for name, body, wrench in frames:
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
            Design(self._small, [group])._at(q)
        except SingularConfigurationError:
            return True
        return len(self._groups) == 1


def _put(array: Array, at: Array, values: Array) -> Array:
    """A copy of an array with some values."""
    array = array.copy()
    array[at] = values
    return array


def _least(by_f: Array, A: Array, inverse: Array, by_A: Array, tau: Array) -> Array:
    """Derivatives of the least torques with A tau = f, shape (motors, names).

    With tau = A^+ f and A of full row rank (Golub and Pereyra 1973),

        dtau = A^+ (df - dA tau) + (I - A^+ A) dA^T (A^+)^T tau.

    The second part makes no motion: it keeps the preload at zero. It vanishes if A has no null
    space.
    """
    for_motion = inverse @ (by_f - np.einsum("imk,m->ik", by_A, tau))
    preload = np.einsum("imk,i->mk", by_A, inverse.T @ tau)
    return for_motion + preload - inverse @ (A @ preload)


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
    pose_size = 0
    if frame is not None:
        frame_id(mechanism.model, frame)  # refuses an unknown name
        pose_size = 6

    # A function of one sample has one array as its result: all derivatives in a row.
    nv, motors = mechanism.actuation.shape
    shapes = [(nv,), (motors,), (nv, len(mechanism.coordinates)), (pose_size,)]
    ends = np.cumsum([math.prod(shape) * len(wanted) for shape in shapes])

    def row(q: Array, va: Array, aa: Array, wrenches: Array, of_frames: Array | None) -> Array:
        of_sample = None
        if at_frames is not None and of_frames is not None:
            of_sample = at_frames._replace(wrenches=of_frames)
        d = design.of_sample(q, va, aa, wrenches, of_sample, frame, sign_width)
        return np.concatenate([d.q.ravel(), d.torques.ravel(), d.L.ravel(), d.pose.ravel()])

    samples = [*arrays, None if at_frames is None else at_frames.wrenches]
    rows = for_each_sample(row, samples, (1, 1, 1, 2, 2), (int(ends[-1]),))
    parts = np.split(rows, ends[:-1], axis=-1)
    q, torques, L, pose = (
        part.reshape(*rows.shape[:-1], *shape, len(wanted))
        for part, shape in zip(parts, shapes, strict=True)
    )
    return DesignDerivatives(names=design.names, q=q, torques=torques, L=L, pose=pose)

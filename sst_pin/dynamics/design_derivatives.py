# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives by design parameters: placements, lengths, masses and mass centres.

Some parameters change the geometry. For these, the robot gets an additional joint, a slide or a
turn, at each place that the change displaces. The position of this joint is the amount of the
change. The added joints stay at zero, where the larger mechanism moves as the robot does.
Derivatives by the amount of the change are therefore derivatives along a coordinate of the larger
mechanism. Its L, L_dot and derivatives of forces contain them.

Other parameters are dynamic, such as masses. The forces are linear in them, so the derivatives are
columns of the regressor.

The module first reads the names of parameters (`groups_of`, `changed`). `Design` then makes the
larger mechanism and computes the derivatives at one sample. `design_derivatives`, at the end, does
so for a batch.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, for_each_sample, in_order, matching_names, single_array
from ..arrays import names as checked_names
from ..errors import InputError, SingularConfigurationError
from ..model.closures import Coupling
from ..model.enlarged_tree import RestingJoint, enlarged, with_extended_rods
from ..model.geometry import displaced, displacements, extensions, parameter_names
from ..model.mechanism import Friction, Mechanism, Springs
from ..model.tree import frame_id
from ..model.weight_shares import WeightShares
from ..summaries import listed
from . import regressor
from .dynamics import Context
from .noc import body_jacobians
from .reference import Reference
from .torque_sharing import inverse_for_torques

#: A name or a pattern of names, several of them that change together, or these with factors.
Parameter = str | Sequence[str] | Mapping[str, float]


class Group(NamedTuple):
    """Design parameters that change together.

    Attributes:
        label: The name or names that the caller has given.
        factors: The change of each parameter, by its name, for a unit change of the group.
    """

    label: str
    factors: dict[str, float]


class FrameWrenches(NamedTuple):
    """Wrenches that act at frames and stay there if the design changes.

    They are given in addition to the external wrenches at the mass centres, which contain them too:
    their moments about the mass centres change with the design.

    Attributes:
        frames: Names of the frames.
        bodies: Indices of the bodies on which the frames are, from 0.
        wrenches: [force; moment] at the origins of the frames, base axes, shape (..., frames, 6).
    """

    frames: list[str]
    bodies: list[int]
    wrenches: Array


class DesignDerivatives(NamedTuple):
    """Derivatives by design parameters, with constant positions, va and aa of the coordinates.

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
    """Names of all parameters: lengths, displacements, dynamic parameters.

    The offsets among the dynamic parameters are left out: they belong to measurements.
    """
    dynamic = regressor.names_of(mechanism)
    return (*parameter_names(mechanism), *(x for x in dynamic if not x.endswith("offset")))


def groups_of(mechanism: Mechanism, parameters: Iterable[Parameter]) -> list[Group]:
    """A group for each parameter of the caller: the names that it stands for, and their factors."""
    known = names_of(mechanism)
    groups: list[Group] = []
    for parameter in parameters:
        if isinstance(parameter, str):
            patterns: Mapping[str, float] = {parameter: 1.0}
        elif isinstance(parameter, Mapping):
            patterns = parameter
        else:
            patterns = dict.fromkeys(checked_names("names", parameter), 1.0)
        factors: dict[str, float] = {}
        for pattern, factor in patterns.items():
            number = float(single_array("factors", factor, ()))
            for name in matching_names("design parameter", str(pattern), known):
                factors[name] = factors.get(name, 0.0) + number
        label = " + ".join(map(str, patterns))
        groups.append(Group(label, factors))
    return groups


class ChangedDesign(NamedTuple):
    """A mechanism's tree and numbers after changes of design parameters.

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
    theta = regressor.parameters_of(mechanism)
    names_of_geometry = parameter_names(mechanism)
    of_geometry: dict[str, float] = {}
    new_theta: dict[str, float] = {}
    for name, change in group.factors.items():
        if name in names_of_geometry:
            of_geometry[name] = change
        else:
            new_theta[name] = theta[name] + change
    return ChangedDesign(
        model=displaced(mechanism.model, displacements(mechanism, of_geometry)),
        extensions=extensions(mechanism.closures, of_geometry),
        dynamic_parameters=new_theta,
    )


class _AddedJoints(NamedTuple):
    """The joints that a mechanism gets for changes of its geometry; they are at rest.

    A group of parameters has a joint for each displacement and for each rod that changes its
    length. The first joint of the group is its leader. The others follow the leader in fixed
    proportions. A group of dynamic parameters has no joint and no leader.

    Attributes:
        at_rest: The joints at places that are displaced.
        rods: Names of the rods, by the names of the slides that change their lengths.
        couplings: The couplings of the joints that follow with their leaders.
        leaders: Names of the leaders.
        directions: Entry (i, k) is the rate of leader i at a unit rate of group k: not zero if i is
            the leader of group k. Shape (leaders, groups).
    """

    at_rest: list[RestingJoint]
    rods: dict[str, str]
    couplings: list[Coupling]
    leaders: list[str]
    directions: Array


def _added_joints(mechanism: Mechanism, groups: Sequence[Group]) -> _AddedJoints:
    """The joints for all groups that change the geometry."""
    names_of_geometry = parameter_names(mechanism)
    at_rest: list[RestingJoint] = []
    rods: dict[str, str] = {}
    couplings: list[Coupling] = []
    leaders: list[str] = []
    directions: list[Array] = []
    for k, group in enumerate(groups):
        changes = {
            name: factor for name, factor in group.factors.items() if name in names_of_geometry
        }
        # The rate of each joint at a unit rate of the group. The axes of the joints are unit
        # vectors, so a rate is the size of a displacement.
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
        direction = np.zeros(len(groups))
        direction[k] = rates[leader]
        directions.append(direction)
        for follower in followers:
            ratio = rates[follower] / rates[leader]
            couplings.append(Coupling(follower, {leader: (0.0, ratio)}))  # ratio times the leader
    matrix = np.array(directions).reshape(len(directions), len(groups))
    return _AddedJoints(at_rest, rods, couplings, leaders, matrix)


def _joints_at_places(by_place: Mapping[str, Array], group: int) -> list[RestingJoint]:
    """Joints at rest for the displacements of a group: a slide and a turn at each place.

    A displacement is [linear; angular], shape (6,). `group` is the number of the group.
    """
    joints: list[RestingJoint] = []
    for place, displacement in by_place.items():
        slide = np.concatenate([displacement[:3], np.zeros(3)])
        turn = np.concatenate([np.zeros(3), displacement[3:]])
        if slide.any():
            joints.append(RestingJoint(f"{place} x{group}", place, slide))
        if turn.any():
            joints.append(RestingJoint(f"{place} r{group}", place, turn))
    return joints


class Design:
    """Computes the derivatives of one robot by groups of parameters; one object per thread.

    `_robot` is the reference path of the robot, `_larger` that of the larger mechanism, which has
    the added joints. The coordinates of the larger mechanism are those of the robot, then the
    leaders of `_AddedJoints`.
    """

    def __init__(self, reference: Reference, groups: Sequence[Group]) -> None:
        self._robot = reference
        self._groups = groups
        self.names = tuple(group.label for group in groups)
        mechanism = reference.mechanism
        #: Changes of the dynamic parameters for unit changes of the groups, shape (p, groups).
        self._theta_directions = np.array(
            [
                [group.factors.get(name, 0.0) for group in groups]
                for name in regressor.names_of(mechanism)
            ]
        )
        added = _added_joints(mechanism, groups)
        #: See `_AddedJoints`.
        self._directions = added.directions

        # Indices of the robot's q, v and bodies in those of the larger mechanism.
        larger_tree = enlarged(mechanism.model, added.at_rest, slides=added.rods)
        names = list(mechanism.model.names)[1:]
        joints = [larger_tree.joints[larger_tree.getJointId(name)] for name in names]
        self._q_indices = np.concatenate([j.idx_q + np.arange(j.nq) for j in joints])
        self._v_indices = np.concatenate([j.idx_v + np.arange(j.nv) for j in joints])
        self._body_indices = np.array([j.id for j in joints]) - 1
        self._neutral = pin.neutral(larger_tree)
        self._larger = Reference(self._larger_mechanism(larger_tree, added))

    def _larger_mechanism(self, tree: pin.Model, added: _AddedJoints) -> Mechanism:
        """The mechanism with the added joints; `tree` is the tree with them."""
        mechanism = self._robot.mechanism
        friction = mechanism.friction
        springs = mechanism.springs
        zero_rates = np.zeros(tree.nv)
        no_motors = np.zeros((tree.nv, mechanism.motor_count))
        leaders = [tree.joints[tree.getJointId(name)].idx_v for name in added.leaders]
        coordinates = [*self._v_indices[mechanism.coordinates], *leaders]
        return replace(
            mechanism,
            model=tree,
            closures=(*with_extended_rods(mechanism.closures, added.rods), *added.couplings),
            coordinates=np.array(coordinates, dtype=np.intp),
            actuation=_put(no_motors, self._v_indices, mechanism.actuation),
            friction=Friction(
                _put(zero_rates, self._v_indices, friction.viscous),
                _put(zero_rates, self._v_indices, friction.coulomb),
            ),
            springs=Springs(
                _put(zero_rates, self._v_indices, springs.stiffness),
                _put(self._neutral, self._q_indices, springs.reference),
            ),
            weight_shares=self._larger_weight_shares(tree),
            example=None,  # this array and the next one have the joints and rows of the robot
            row_sizes=None,
        )

    def _larger_weight_shares(self, tree: pin.Model) -> WeightShares | None:
        """Weight shares of the bodies of the larger tree; added bodies have no mass."""
        of_robot = self._robot.mechanism.weight_shares
        if of_robot is None:
            return None
        bodies = tree.njoints - 1
        return WeightShares(
            _put(np.ones(bodies), self._body_indices, of_robot.shares),
            _put(np.zeros((bodies, 3)), self._body_indices, of_robot.offsets),
        )

    def _evaluate_larger(self, q: Array) -> tuple[Array, Context]:
        """Compute L of the larger mechanism at q; returns its configuration x and its context."""
        x = _put(self._neutral, self._q_indices, q)
        context = self._larger.context
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

        Derivatives are computed along the leaders first. Times `_directions`, they are those by the
        groups.
        """
        tau = self._robot.torques(q, va, aa, wrenches)
        mechanism = self._robot.mechanism
        n = len(va)
        directions = self._directions
        try:
            x, context = self._evaluate_larger(q)
        except SingularConfigurationError:
            # The robot itself is regular here, since it has torques. So the leaders are not free to
            # move: their changes would open the loops.
            raise self._open_loops_error(q) from None
        # Columns of the larger mechanism's L: for the robot's coordinates, then for the leaders.
        L, leader_motions = np.split(context.complement.L, [n], axis=1)

        L_along = self._complement_derivatives(context, leader_motions, n)
        df = self._force_derivatives(q, x, va, aa, wrenches, at_frames, sign_width)
        torques = df  # if motor k drives coordinate k
        if not mechanism.driven_one_to_one:
            A = L.T @ context.actuation(x)
            A_along = self._actuation_derivatives(context, x, L, leader_motions, L_along)
            inverse = inverse_for_torques(mechanism, A)
            dA = _by_groups(A_along, directions)
            torques = _least_torque_derivatives(df, A, inverse, dA, tau)
        pose = np.zeros((0, len(self.names)))
        if frame is not None:
            index = frame_id(context.mechanism.model, frame)
            pose = self._larger.frame_jacobian(x, index)[:, n:] @ directions
        return DesignDerivatives(
            names=self.names,
            q=leader_motions[self._v_indices] @ directions,
            torques=torques,
            L=_by_groups(L_along[:, self._v_indices], directions),
            pose=pose,
        )

    def _open_loops_error(self, q: Array) -> InputError:
        """The error for changes with which the loops cannot close; it names the groups."""
        groups = [group for group in self._groups if _opens_loops(self._robot, group, q)]
        # If the loops open by little more than the tolerance, it can be that no group opens them
        # alone. Then all groups are named.
        names = listed([group.label for group in groups or self._groups])
        cure = "leave them out, or change several together, as [{first: 1, second: -1}]"
        return InputError("names", f"changes of {names} alone open the loops; {cure}")

    def _complement_derivatives(self, context: Context, leader_motions: Array, n: int) -> Array:
        """Derivatives of L along each leader, shape (leaders, larger nv, n).

        Column k of `leader_motions`, shape (larger nv, leaders), has the rates of all joints at a
        unit rate of leader k. The derivative along the leader is the rate of L at these rates.
        """
        derivatives = np.zeros((leader_motions.shape[1], len(leader_motions), n))
        for k, motion in enumerate(leader_motions.T):
            derivatives[k] = context.complement.L_dot(context.loops.Phi_dot(motion))[:, :n]
        return derivatives

    def _actuation_derivatives(
        self, context: Context, x: Array, L: Array, leader_motions: Array, L_along: Array
    ) -> Array:
        """Derivatives of A = L^T B along each leader, shape (leaders, n, motors).

        `L_along` are those of L. B changes too where motors act on lines: it has J^T of the lines.
        """
        derivatives = L_along.swapaxes(1, 2) @ context.actuation(x)  # evaluates the lines at x
        on_lines = context.mechanism.lines.actuation
        if on_lines.any():
            for k, motion in enumerate(leader_motions.T):
                J_along = context.lines.loops.Phi_dot(motion)
                derivatives[k] += L.T @ J_along.T @ on_lines
        return derivatives

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
        """Derivatives of the forces f, shape (n, names).

        x is the configuration of the larger mechanism at q.
        """
        n = len(va)
        directions = self._directions
        leaders = len(directions)
        if wrenches is not None:
            no_wrenches = np.zeros((self._larger.mechanism.model.njoints - 1, 6))
            wrenches = _put(no_wrenches, self._body_indices, wrenches)
        at_rest = np.zeros(leaders)
        by_q_va_aa = self._larger.torque_derivatives(
            x, np.append(va, at_rest), np.append(aa, at_rest), wrenches, sign_width
        )
        # The rows are forces on the robot's n coordinates, then on the leaders. The first columns
        # are derivatives by q: of the robot's n coordinates, then of the leaders.
        by_leaders = by_q_va_aa[:n, n : n + leaders]
        derivatives = by_leaders @ directions
        if at_frames is not None:
            # f are the forces that a motion needs besides external ones: these are subtracted.
            derivatives -= self._moment_derivatives(x, at_frames) @ directions
        if self._theta_directions.any():
            derivatives += self._robot.torque_regressor(q, va, aa) @ self._theta_directions
        return np.asarray(derivatives)

    def _moment_derivatives(self, x: Array, at_frames: FrameWrenches) -> Array:
        """Derivatives along each leader of the forces of wrenches at frames, shape (n, leaders).

        A wrench with the force F at the point p has the moment (p - c) x F about the mass centre c.
        Derivatives for constant wrenches at the mass centres do not have d(p - c) x F, the change
        of this moment. It acts on the coordinates by the body's angular Jacobian, transposed.
        """
        context = self._larger.context
        L = context.complement.L
        n = L.shape[1] - len(self._directions)
        J_of_bodies = body_jacobians(context.loops) @ L
        on_coordinates = np.zeros((n, len(self._directions)))
        frames = zip(at_frames.frames, at_frames.bodies, at_frames.wrenches, strict=True)
        for name, body, wrench in frames:
            row = 6 * self._body_indices[body]
            J_of_centre = J_of_bodies[row : row + 3]
            J_angular = J_of_bodies[row + 3 : row + 6]
            index = frame_id(context.mechanism.model, name)
            J_of_point = self._larger.frame_jacobian(x, index)[:3]
            arm_derivatives = (J_of_point - J_of_centre)[:, n:]  # of p - c along the leaders
            moments = np.cross(arm_derivatives.T, wrench[:3]).T
            on_coordinates += J_angular[:, :n].T @ moments
        return on_coordinates


def _opens_loops(robot: Reference, group: Group, q: Array) -> bool:
    """Whether a change of this group alone opens the loops at q."""
    try:
        Design(robot, [group])._evaluate_larger(q)
    except SingularConfigurationError:
        return True
    return False


def _put(array: Array, at: Array, values: Array) -> Array:
    """A copy of an array with some values."""
    array = array.copy()
    array[at] = values
    return array


def _by_groups(along_leaders: Array, directions: Array) -> Array:
    """Derivatives by the groups, shape (..., groups), from those of shape (leaders, ...)."""
    return np.tensordot(along_leaders, directions, axes=(0, 0))


def _least_torque_derivatives(df: Array, A: Array, inverse: Array, dA: Array, tau: Array) -> Array:
    """Derivatives of the least torques with A tau = f, shape (motors, names).

    With tau = A^+ f and A of constant rank (Golub and Pereyra 1973),

        dtau = A^+ (df - dA tau) + (I - A^+ A) dA^T (A^+)^T tau.

    The second part makes no motion: it keeps the preload at zero. It vanishes if A has no null
    space. The derivatives df have the shape (n, names), and dA (n, motors, names). `inverse` is
    A^+, by `inverse_for_torques`.
    """
    # Axes: i coordinates, m motors, k names.
    for_motion = inverse @ (df - np.einsum("imk,m->ik", dA, tau))
    preload = np.einsum("imk,i->mk", dA, inverse.T @ tau)
    return for_motion + preload - inverse @ (A @ preload)


def design_derivatives(
    reference: Reference,
    parameters: Iterable[Parameter],
    arrays: Sequence[Array | None],
    at_frames: FrameWrenches | None,
    frame: str | None,
    sign_width: float,
) -> DesignDerivatives:
    """Derivatives for a batch.

    Args:
        reference: The reference path of the robot.
        parameters: The design parameters.
        arrays: q, va, aa, and the external wrenches at the mass centres or None, with batch axes.
        at_frames: The part of these wrenches that acts at frames, or None.
        frame: Name of the frame whose pose is differentiated, or None.
        sign_width: Width of the smoothed sign of Coulomb friction, [rad/s] or [m/s].
    """
    mechanism = reference.mechanism
    wanted = in_order("names", parameters)
    # The last design is kept: a loop over samples asks for the same parameters again.
    key = repr(wanted)
    if key not in reference.designs:
        reference.designs.clear()
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
    sample_axes = (1, 1, 1, 2, 2)  # of q, va, aa, wrenches, wrenches at frames
    rows = for_each_sample(row, samples, sample_axes, (int(ends[-1]),))
    parts = np.split(rows, ends[:-1], axis=-1)
    q, torques, L, pose = (
        part.reshape(*rows.shape[:-1], *shape, len(wanted))
        for part, shape in zip(parts, shapes, strict=True)
    )
    return DesignDerivatives(names=design.names, q=q, torques=torques, L=L, pose=pose)

# SPDX-License-Identifier: BSD-2-Clause
"""Reactions: the wrenches in joints and closures, and which of them are unique.

The forces of the closures on the tree are Phi^T lambda, with multipliers lambda. They are the
forces that the motion needs, less those of motors, friction, springs and loads. If rows of Phi are
redundant, lambda is not unique: lambda + N x gives the same forces for any x, where the columns of
N span the null space of Phi^T. A column of N is a state of inner stress.

Without closures, the recursion of Newton and Euler gives the wrench in each joint. With closures,
the wrench is the result of the recursion minus X lambda. The matrix X of a joint sums the wrenches
that closures give to the bodies beyond the joint. A component of the wrench is unique exactly if
its row of X N is zero (Wojtyra 2005; Fraczek and Wojtyra 2011). The rows of Phi are made free of
units first, so that the verdict does not depend on the choice of units.

`reactions` computes all numbers of one sample, in one row as kernels do. `unpacked` makes
`Reactions` of the rows of all samples. `unique_forces` computes the part of each force that is
unique, in whatever axes the force is written.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Flags, as_array, require_fitting, single_array
from ..errors import IndeterminateError, InputError, UnknownNameError
from ..model.closures import Brake, Constraint, Coupling, frames_of
from ..model.mechanism import Mechanism
from ..model.thresholds import UNIQUE
from ..model.tree import frame_id
from ..summaries import Summary, listed
from .dynamics import Context, applied_forces, tensions_in_motion
from .noc import mass_centers

#: Stiffnesses do not determine an inner stress that acts in rigid parts only: it has no elastic
#: energy. A singular value s in `_relaxed` stands for the energy s^2 / 2 of a stress. A singular
#: value below this part of the largest one is rounding, so its stress counts as one without energy.
_RESISTED = 1e-9
#: Largest error of R^T R for the axes R of a user. Numbers that are written with six digits pass.
_RIGHT_ANGLES = 1e-5
_COMPONENTS = ("force x", "force y", "force z", "moment x", "moment y", "moment z")
#: The code of a joint or closure is the sum of the bits of its components that are not unique.
BITS = 2.0 ** np.arange(6)


class Verdict(NamedTuple):
    """A flag for each component of the wrenches."""

    #: Shape (..., r, 6).
    joints: Flags
    #: Shape (..., closures, 6).
    closures: Flags


@dataclass(frozen=True, eq=False, repr=False)
class Reactions(Summary):
    """Wrenches [force; moment] in the joints and closures of a robot, [N], [N m].

    A joint's wrench is all that its parent gives to its child there, at the origin and in the axes
    of the joint: by the bearing, the motor, friction, springs and gears. It does not include the
    force that rotors (`model.armature`) need along the joint's axis. A closure's wrench is what the
    link of frame A gives to the link of frame B, at the origin and in the axes of B. The wrench of
    a coupling is its force on the dependent joint, written about or along z, and that of a brake
    its force on the joint. A brake of a line pushes the ends apart if its force is positive.

    Components that are not unique are NaN, unless stiffnesses were given.

    Attributes:
        names: Names of the joints, then of the closures.
        joints: Shape (..., r, 6), joints in the order of the tree.
        closures: Shape (..., closures, 6).
        motors: Motor torques that act, shape (..., motors).
        ground: What the ground gives to the robot in all, at the origin of the base in base axes,
            shape (..., 6).
        determined: Which components are unique in the rigid robot.
        elastic: Which components are not unique in the rigid robot, but follow from the given
            stiffnesses.
        brakes: Torques or forces of the brakes, by the names of joints and lines, shapes (...);
            NaN where they are not unique.

    Example:
        >>> delta = sst_pin.robots.delta()
        >>> w = delta.reactions(delta.home, np.zeros(3), np.zeros(3))
        >>> w.ground[2].round(3), w.of("motor_1")[[0, 2]].round(3)
        (np.float64(5.003), array([0.65 , 1.668]))
    """

    names: tuple[str, ...]
    joints: Array
    closures: Array
    motors: Array
    ground: Array
    determined: Verdict
    elastic: Verdict
    brakes: dict[str, Array]

    def of(self, name: str, *, complete: bool = False) -> Array:
        """The wrench in one joint or closure, shape (..., 6); NaN where it is not unique.

        Args:
            name: As in `names`; a closure is called by its frames, "a - b", or "a - b (1)" where
                there are several.
            complete: Whether components that are not unique raise an error.

        Raises:
            UnknownNameError: If no joint or closure has this name.
            IndeterminateError: With `complete`, if components of the wrench are not unique.

        Example:
            >>> crank = sst_pin.robots.slider_crank()
            >>> crank.reactions(crank.home, [0], [0]).of("rod").shape
            (6,)
        """
        if name not in self.names:
            raise UnknownNameError("joint or closure", name, self.names)
        k = self.names.index(name)
        joints = self.joints.shape[-2]
        if k < joints:
            wrench = self.joints[..., k, :]
        else:
            wrench = self.closures[..., k - joints, :]
        missing = np.isnan(wrench).reshape(-1, 6).any(axis=0)
        if complete and missing.any():
            raise IndeterminateError(name, [_COMPONENTS[i] for i in np.flatnonzero(missing)])
        return wrench

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """The verdict for each joint and closure."""
        flags = np.concatenate(self.determined, axis=-2)
        unique = np.all(flags.reshape(-1, *flags.shape[-2:]), axis=0)
        rows = []
        for name, flags in zip(self.names, unique, strict=True):
            not_unique = [_COMPONENTS[i] for i in np.flatnonzero(~flags)]
            verdict = f"not unique: {listed(not_unique)}" if not_unique else "determined"
            rows.append((name, verdict))
        return "Reactions [force; moment]", rows


def names_of(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the joints of the tree, then of the closures; closures of one name get numbers."""
    closures = list(map(str, mechanism.closures))
    numbered = [
        f"{name} ({closures[: k + 1].count(name)})" if closures.count(name) > 1 else name
        for k, name in enumerate(closures)
    ]
    return (*list(mechanism.model.names)[1:], *numbered)


class RowParts(NamedTuple):
    """The parts of a row of `reactions`, in their order in the row."""

    wrenches: Array  #: Of joints and closures, six numbers each, shape (..., 6 (r + closures)).
    ground: Array  #: Wrench of the ground, shape (..., 6).
    tau: Array  #: Motor torques, shape (..., motors).
    codes: Array  #: One for each joint and closure, shape (..., r + closures); see `BITS`.


def parts_of(mechanism: Mechanism, rows: Array) -> RowParts:
    """The parts of rows of `reactions`, shape (..., `size_of`); they are views."""
    count = _wrench_count(mechanism)
    return RowParts(*np.split(rows, [6 * count, 6 * count + 6, -count], axis=-1))


def size_of(mechanism: Mechanism) -> int:
    """How many numbers `reactions` gives for a sample."""
    count = _wrench_count(mechanism)
    wrenches = 6 * count
    ground = 6
    codes = count
    return wrenches + ground + mechanism.motor_count + codes


def _wrench_count(mechanism: Mechanism) -> int:
    """Number of joints and closures, r + closures; each has a wrench."""
    return mechanism.model.njoints - 1 + len(mechanism.closures)


class _Wrenches(NamedTuple):
    """Wrenches [force; moment] in joints and closures, in their own axes, and what changes them.

    Attributes:
        values: One solution for the wrenches, shape (r + closures, 6). If there are compliances, it
            is the one with the least elastic energy.
        stresses: The wrenches of k inner stresses of the rigid robot, shape (r + closures, 6, k).
        free_stresses: The wrenches of the inner stresses that compliances do not determine, shape
            (r + closures, 6, l). Without compliances, these are all inner stresses.
        ground: Wrench of the ground on the robot, shape (6,).
        tau: Motor torques, shape (motors,).
    """

    values: Array
    stresses: Array
    free_stresses: Array
    ground: Array
    tau: Array


def reactions(
    context: Context,
    q: Array,
    va: Array,
    aa: Array,
    tau: Array | None,
    wrenches: Array | None,
    compliances: Array | None,
    axes: Array | None = None,
) -> Array:
    """Wrenches of joints and closures, the ground's wrench, torques and codes, in one row.

    There is a code for each joint and closure, see `BITS`. With compliances, components that they
    do not determine are NaN.

    Args:
        context: The context.
        q: Configuration, shape (nq,).
        va: Rates of the coordinates, shape (n,).
        aa: Accelerations of the coordinates, shape (n,).
        tau: Motor torques, shape (motors,); None if motor k drives coordinate k.
        wrenches: External wrenches at the mass centres, shape (r, 6), or None.
        compliances: Compliances of the components, shape (r + closures, 6); None for a rigid robot.
        axes: Axes in the base in which wrenches are written, in columns, shape (3, 3); None for
            those of each joint and closure.
    """
    w = _wrenches_in_motion(context, q, va, aa, tau, wrenches, compliances)
    values = w.values
    stresses = w.stresses
    free_stresses = w.free_stresses
    if axes is not None:
        turns = _turns(context, axes)
        values = (turns @ values[..., None])[..., 0]
        stresses = turns @ stresses
        free_stresses = turns @ free_stresses

    # A component is unique if no inner stress changes it. In a stress of unit size, moments are of
    # the order 1, and forces of the order 1 / length.
    sizes = np.repeat([context.mechanism.length, 1.0], 3)
    not_unique = np.linalg.norm(stresses, axis=-1) * sizes > UNIQUE
    if compliances is not None:
        undetermined = np.linalg.norm(free_stresses, axis=-1) * sizes > UNIQUE
        values[undetermined] = np.nan
    codes = not_unique @ BITS
    return np.concatenate([values.ravel(), w.ground, w.tau, codes])


def unique_forces(
    context: Context,
    q: Array,
    va: Array,
    aa: Array,
    tau: Array | None,
    wrenches: Array | None,
    compliances: Array | None,
) -> Array:
    """The unique parts of the forces in joints and closures, shape (r + closures, 4), flat.

    Inner stresses change the force in a joint along some directions. Its part normal to them is
    unique, whatever the axes are. The last column is the number of the directions.
    """
    w = _wrenches_in_motion(context, q, va, aa, tau, wrenches, compliances)
    rows = []
    for force, changes in zip(w.values[:, :3], w.free_stresses[:, :3], strict=True):
        U, s, _ = np.linalg.svd(changes * context.mechanism.length)  # free of units
        directions = U[:, : np.count_nonzero(s > UNIQUE)]
        unique = force - directions @ (directions.T @ force)
        rows.append([*unique, directions.shape[1]])
    return np.ravel(rows)


def _wrenches_in_motion(
    context: Context,
    q: Array,
    va: Array,
    aa: Array,
    tau: Array | None,
    wrenches: Array | None,
    compliances: Array | None,
) -> _Wrenches:
    """The wrenches for a motion; arguments as `reactions`."""
    mechanism = context.mechanism

    # The forces that closures must give to the tree: Phi^T lambda = needed.
    v, v_dot = context.complement.motion(q, va, aa)
    needed = context.tree_forces(v, v_dot)
    needed = needed - applied_forces(context, mechanism.friction, q, v, wrenches, tau)
    if tau is None:
        tau = needed.dot(context.complement.L)  # motor k drives coordinate k
        needed -= mechanism.actuation.dot(tau)
    multipliers, null_space = _multipliers(context, needed)

    # Joints have their wrenches without closures, plus those of lambda. Closures have those of
    # lambda only. A column of the null space N has the wrenches of an inner stress.
    loads = _loads(context, wrenches)
    if not mechanism.lines.none:
        loads += _loads_of_lines(context, q, v, v_dot, tau)
    without_closures, ground = _wrenches_without_closures(context, v, v_dot, loads)
    columns = _wrenches_of_multipliers(context, np.column_stack([multipliers, null_space]))
    values = columns[..., 0]
    values[: len(without_closures)] += without_closures  # joints are first
    stresses = columns[..., 1:]
    free_stresses = stresses
    if compliances is not None:
        values, free_stresses = _relaxed(values, stresses, compliances)
    return _Wrenches(values, stresses, free_stresses, ground, tau)


def _multipliers(context: Context, needed: Array) -> tuple[Array, Array]:
    """The smallest lambda with Phi^T lambda = needed, shape (rows,), and N, shape (rows, k).

    With the diagonal matrices R and D of the scales of rows and rates, (R Phi D)^T x = D needed is
    free of units, and lambda = R x. `needed` are the forces on the tree, shape (nv,).
    """
    mechanism = context.mechanism
    R = mechanism.row_scale
    D = mechanism.rate_scale
    U, s, Vt = np.linalg.svd(R[:, None] * context.loops.Phi * D)
    rank = mechanism.model.nv - len(mechanism.coordinates)
    smallest = U[:, :rank] @ ((Vt[:rank] @ (D * needed)) / s[:rank])
    return R * smallest, R[:, None] * U[:, rank:]


def _loads(context: Context, wrenches: Array | None) -> Array:
    """[force; moment] on the joints of the normal tree at the world's origin, shape (joints, 6)."""
    loads = np.zeros((context.tree.model.njoints, 6))
    if wrenches is not None:
        force = wrenches[:, :3]
        moment = wrenches[:, 3:]
        at_origin = moment + np.cross(mass_centers(context.loops), force)
        loads[context.tree.bodies[1:]] = np.hstack([force, at_origin])
    return loads


def _loads_of_lines(context: Context, q: Array, v: Array, v_dot: Array, tau: Array) -> Array:
    """The wrenches of lines on the joints of the normal tree, as `_loads`.

    A line acts as a closure of one row: the distance of its ends. A positive multiplier pushes the
    ends apart, a positive tension pulls them together. So the multipliers are minus the tensions.
    """
    tensions = tensions_in_motion(context, context.mechanism.friction, q, v, v_dot, tau)
    return context.lines.loops.forces_on_bodies(-tensions[:, None])[..., 0]


def _wrenches_without_closures(
    context: Context, v: Array, v_dot: Array, loads: Array
) -> tuple[Array, Array]:
    """Wrenches in the joints if there were no closures, and the wrench of the ground.

    The wrenches in joints are at the origins and in the axes of the joints, shape (r, 6). The
    wrench of the ground is at the origin of the base, shape (6,). Closures do not change the wrench
    of the ground on the whole robot: the motion and the loads determine it.
    """
    tree = context.tree
    data = context.data
    S = tree.S
    forces = map(pin.Force, loads)
    local = [place.actInv(load) for place, load in zip(data.oMi, forces, strict=True)]
    if context.mechanism.weight_shares is not None:
        local = [load + lift for load, lift in zip(local, context.lifts(), strict=True)]
    pin.rnea(tree.model, data, context.loops.q, S @ v, S @ v_dot, pin.StdVec_Force(local))
    # After `pin.rnea`, data.f has the wrenches that parents give to their children in the joints.
    in_joints = np.array([data.f[j].vector for j in tree.bodies[1:]])

    # The ground acts on the robot through the joints of the base, and through lines: loads[0] is
    # what lines give to the ground, so the ground gives the opposite.
    in_base_joints = [data.oMi[j].act(data.f[j]).vector for j in tree.model.children[0]]
    return in_joints, np.array(in_base_joints).sum(axis=0) - loads[0]


def _wrenches_of_multipliers(context: Context, Lambda: Array) -> Array:
    """[force; moment] of multipliers in all joints and closures, shape (r + closures, 6, columns).

    `Lambda` has multipliers lambda in columns, shape (rows, columns). The wrenches in joints are
    -X lambda: what the joint must give so that the bodies beyond it are in balance.
    """
    tree = context.tree
    data = context.data
    loops = context.loops
    wrenches = list[Array]()

    # The sum of what closures give to all bodies beyond a joint, first at the world's origin, then
    # in the axes and at the origin of the joint. The transposed action matrix of a frame takes
    # wrenches from the world into the frame.
    on_bodies = loops.forces_on_bodies(Lambda)
    for j in range(tree.model.njoints - 1, 0, -1):
        on_bodies[tree.model.parents[j]] += on_bodies[j]
    for j in tree.bodies[1:]:
        wrenches.append(-data.oMi[j].toActionMatrix().T @ on_bodies[j])

    for closure, rows in zip(context.mechanism.closures, loops.slices, strict=True):
        if isinstance(closure, Coupling | Brake):
            wrench = np.zeros((6, Lambda.shape[1]))
            wrench[acts_along(context.mechanism, closure)] = Lambda[rows][0]
        else:
            # A row of Phi is W [J_B; J_A], with the Jacobians of the frames at the world's origin.
            # Its force Phi^T lambda thus has the wrench W^T lambda: six numbers on B, six on A.
            W_B = loops.W[rows, :6]
            frame_b = data.oMf[frame_id(tree.model, frames_of(closure)[1])]
            wrench = frame_b.toActionMatrix().T @ W_B.T @ Lambda[rows]
        wrenches.append(wrench)
    return np.array(wrenches).reshape(-1, 6, Lambda.shape[1])


def _turns(context: Context, axes: Array) -> Array:
    """Matrices that rotate each wrench from its own axes to axes in the base.

    Shape (r + closures, 6, 6). The force of a coupling or a brake is written along z in any axes,
    so it stays as it is.
    """
    tree = context.tree
    data = context.data
    turns = [_turn_of_wrenches(axes.T @ data.oMi[j].rotation) for j in tree.bodies[1:]]
    for closure in context.mechanism.closures:
        if isinstance(closure, Coupling | Brake):
            turns.append(np.eye(6))
        else:
            frame_b = data.oMf[frame_id(tree.model, frames_of(closure)[1])]
            turns.append(_turn_of_wrenches(axes.T @ frame_b.rotation))
    return np.array(turns).reshape(-1, 6, 6)


def _turn_of_wrenches(R: Array) -> Array:
    """The matrix that rotates the force and the moment of a wrench by R, shape (6, 6)."""
    turn = np.zeros((6, 6))
    turn[:3, :3] = R
    turn[3:, 3:] = R
    return turn


def axes_of(axes: ArrayLike) -> Array:
    """The argument `axes` of reactions: three unit vectors in columns, at right angles."""
    R = single_array("axes", axes, (3, 3))
    error = np.abs(R.T @ R - np.eye(3)).max()
    if error > _RIGHT_ANGLES:
        raise InputError("axes", f"its columns are not orthonormal (|R^T R - 1| = {error:.2g})")
    return R


def acts_along(mechanism: Mechanism, closure: Constraint) -> int:
    """Where the force of a coupling or brake stands in [force; moment]: along or about z."""
    rate = mechanism.rate_of(closure)
    slides = rate is None or mechanism.space.rate_units[rate] == "m"
    return 2 if slides else 5


def _relaxed(values: Array, stresses: Array, compliances: Array) -> tuple[Array, Array]:
    """Wrenches with the least elastic energy, and inner stresses without elastic energy.

    With amounts x of the inner stresses, the wrenches are w = values + stresses x. Their energy is
    half the sum of compliance w^2 over all components, so x is a solution by least squares of
    root (values + stresses x) = 0, with the roots of the compliances.
    """
    root = np.sqrt(compliances).ravel()
    flat = stresses.reshape(values.size, -1)
    U, s, Vt = np.linalg.svd(root[:, None] * flat, full_matrices=False)
    rank = int(np.count_nonzero(s > _RESISTED * s.max(initial=0.0)))
    amounts = -Vt[:rank].T @ ((U[:, :rank].T @ (root * values.ravel())) / s[:rank])
    return values + stresses @ amounts, stresses @ Vt[rank:].T


def compliances_of(mechanism: Mechanism, stiffness: Mapping[str, ArrayLike]) -> Array:
    """Compliances of the components, shape (r + closures, 6); zero without a stiffness."""
    names = names_of(mechanism)
    if not isinstance(stiffness, Mapping):
        raise InputError("stiffness", f"{stiffness!r} is not a dict of six numbers by name")
    compliances = np.zeros((len(names), 6))
    for name, values in stiffness.items():
        if name not in names:
            raise UnknownNameError("joint or closure", name, names)
        numbers = as_array("stiffness", values, ())
        if numbers.shape != (6,) or not (numbers > 0).all():
            problem = f"of {name}: {numbers.tolist()}, expected six positive numbers"
            raise InputError("stiffness", problem)
        compliances[names.index(name)] = 1 / numbers
    return compliances


def unpacked(
    mechanism: Mechanism, rows: Array, relaxed: bool, out: Array | None = None
) -> Reactions:
    """Reactions from the rows of `reactions` for all samples; what is not unique becomes NaN.

    Args:
        mechanism: The mechanism.
        rows: The rows, shape (..., `size_of`).
        relaxed: Whether stiffnesses were given.
        out: Gets the wrenches of joints and closures, shape (..., r + closures, 6).
    """
    names = names_of(mechanism)
    r = mechanism.model.njoints - 1
    shape = (*rows.shape[:-1], len(names), 6)
    wrenches, ground, tau, codes = parts_of(mechanism, rows)
    values = wrenches.reshape(shape)

    # In most batches all samples have the same codes, so that one verdict is enough.
    samples = codes.reshape(-1, len(names))
    if len(samples) and (samples == samples[0]).all():
        codes = samples[0]
    # The codes of samples at fault are NaN: nothing is unique there.
    bits = np.nan_to_num(codes, nan=BITS.sum()).astype(np.uint8)
    not_unique = (bits[..., None] & BITS.astype(np.uint8)) > 0
    unique = np.broadcast_to(~not_unique, shape)
    if relaxed:
        elastic = not_unique & np.isfinite(values)
    else:
        elastic = np.broadcast_to(False, shape)
        np.copyto(values, np.nan, where=not_unique)

    if out is not None:
        require_fitting(out, shape)
        out[...] = values
        values = out
    of_closures = values[..., r:, :]
    brakes = {
        closure.name: of_closures[..., k, 2] + of_closures[..., k, 5]  # one of them is zero
        for k, closure in enumerate(mechanism.closures)
        if isinstance(closure, Brake)
    }
    return Reactions(
        names=names,
        joints=values[..., :r, :],
        closures=of_closures,
        motors=tau,
        ground=ground,
        determined=Verdict(joints=unique[..., :r, :], closures=unique[..., r:, :]),
        elastic=Verdict(joints=elastic[..., :r, :], closures=elastic[..., r:, :]),
        brakes=brakes,
    )

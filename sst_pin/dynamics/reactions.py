# SPDX-License-Identifier: BSD-2-Clause
"""Reactions: the wrenches in joints and closures, and which of them are unique.

The forces of the closures on the tree are Phi^T lambda: the forces of the motion minus those of
motors, friction, springs and loads. If rows of Phi are redundant, lambda is not unique: the null
space N of Phi^T has the states of inner stress. The wrench of a joint is that of the recursion of
Newton and Euler minus X lambda, what closures give to the bodies beyond the joint. A component is
unique exactly if its row of X N is zero (Wojtyra 2005; Fraczek and Wojtyra 2011). Rows are free of
units, so that the verdict does not depend on them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Flags, as_array, require_fitting
from ..errors import IndeterminateError, InputError, UnknownNameError
from ..model.closures import Brake, Constraint, Coupling, frames_of
from ..model.mechanism import Mechanism
from ..model.thresholds import UNIQUE
from ..model.tree import frame_id
from ..summaries import Summary, listed
from .dynamics import Context, applied_forces
from .noc import mass_centers

#: Inner stresses are not determined if the root of their elastic energy, relative to the largest,
#: is smaller: they act in rigid parts only.
_RESISTED = 1e-9
#: Bits of the components that are not unique, in the code of a joint or closure.
BITS = 2.0 ** np.arange(6)


class Verdict(NamedTuple):
    """One answer for each component of the wrenches."""

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
        elastic: Which components are not, but follow from the given stiffnesses.
        brakes: Torques or forces of the brakes, by the names of joints and lines, shapes (...);
            NaN where they are not unique.

    Example:
        >>> delta = sst_pin.robots.delta()
        >>> w = delta.reactions(delta.home, np.zeros(3), np.zeros(3))
        >>> w.ground[2].round(3), w.of("motor_1")[:3].round(3)
        (np.float64(5.003), array([ 0.65 , -0.   ,  1.668]))
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
            UnknownNameError: If there is none of that name.
            IndeterminateError: With `complete`, if components of it are not unique.

        Example:
            >>> crank = sst_pin.robots.slider_crank()
            >>> crank.reactions(crank.home, [0], [0]).of("rod").shape
            (6,)
        """
        if name not in self.names:
            raise UnknownNameError("joint or closure", name, self.names)
        k, joints = self.names.index(name), self.joints.shape[-2]
        wrench = self.joints[..., k, :] if k < joints else self.closures[..., k - joints, :]
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
            free = [_COMPONENTS[i] for i in np.flatnonzero(~flags)]
            rows.append((name, f"not unique: {listed(free)}" if free else "determined"))
        return "Reactions [force; moment]", rows


_COMPONENTS = ("force x", "force y", "force z", "moment x", "moment y", "moment z")


def names_of(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the joints of the tree, then of the closures; those of the same frames numbered."""
    closures = list(map(str, mechanism.closures))
    numbered = [
        f"{name} ({closures[: k + 1].count(name)})" if closures.count(name) > 1 else name
        for k, name in enumerate(closures)
    ]
    return (*list(mechanism.model.names)[1:], *numbered)


def size_of(mechanism: Mechanism) -> int:
    """How many numbers `reactions` gives for a sample."""
    wrenches = mechanism.model.njoints - 1 + len(mechanism.closures)
    return 7 * wrenches + 6 + mechanism.motors.shape[1]


def reactions(
    context: Context,
    q: Array,
    va: Array,
    aa: Array,
    tau: Array | None,
    wrenches: Array | None,
    compliances: Array | None,
) -> Array:
    """Wrenches of joints and closures, then the ground's, torques and codes, in a row.

    `tau` is None where there is one motor for each coordinate; `compliances` are those of the
    components, shape (r + closures, 6), or None. A code for each joint and closure has the bits of
    the components that are not unique. Those that compliances do not determine are NaN.
    """
    mechanism, tree, data = context.mechanism, context.tree, context.data
    v, v_dot = context.complement.motion(q, va, aa)
    needed = context.tree_forces(v, v_dot)
    needed = needed - applied_forces(context, mechanism.friction, q, v, wrenches, tau)
    if tau is None:
        tau = needed.dot(context.complement.L)
        needed -= mechanism.motors.dot(tau)
    Lambda = _multipliers(context, needed)

    loads = _loads(context, wrenches)
    if not mechanism.lines.none:
        lengths, J = context.lines.evaluate(q)
        tensions = mechanism.lines.tensions(lengths, J.dot(v), tau)
        tensions = tensions + context.lines.inertial_tensions(q, v, v_dot)
        loads += context.lines.loops.forces_on_bodies(-tensions[:, None])[..., 0]
    forces = map(pin.Force, loads)
    local = [place.actInv(load) for place, load in zip(data.oMi, forces, strict=True)]
    S = tree.S
    pin.rnea(tree.model, data, context.loops.q, S @ v, S @ v_dot, pin.StdVec_Force(local))
    carried = np.array([data.f[j].vector for j in tree.bodies[1:]])
    on_ground = [data.oMi[j].act(data.f[j]).vector for j in tree.model.children[0]]
    ground = sum(on_ground, -loads[0])  # less what lines take from it

    both = _wrenches(context, Lambda)
    both[: len(carried), :, 0] += carried
    values, stresses = both[..., 0], both[..., 1:]
    size = np.repeat([mechanism.length, 1.0], 3)  # in moments
    changes = np.linalg.norm(stresses, axis=-1) * size
    if compliances is not None:
        values, left = _relaxed(values, stresses, compliances)
        values[np.linalg.norm(left, axis=-1) * size > UNIQUE] = np.nan
    codes = (changes > UNIQUE) @ BITS
    return np.concatenate([values.ravel(), ground, tau, codes])


def _multipliers(context: Context, needed: Array) -> Array:
    """The smallest lambda with Phi^T lambda = needed, then N, in columns, shape (rows, 1 + k)."""
    mechanism = context.mechanism
    row, rate = mechanism.row_scale, mechanism.rate_scale
    U, s, Vt = np.linalg.svd(context.loops.Phi * row[:, None] * rate)
    rank = mechanism.model.nv - len(mechanism.coordinates)
    smallest = U[:, :rank] @ ((Vt[:rank] @ (rate * needed)) / s[:rank])
    return row[:, None] * np.column_stack([smallest, U[:, rank:]])


def _loads(context: Context, wrenches: Array | None) -> Array:
    """[force; moment] on the joints of the normal tree at the world's origin, shape (joints, 6)."""
    loads = np.zeros((context.tree.model.njoints, 6))
    if wrenches is not None:
        force, moment = wrenches[:, :3], wrenches[:, 3:]
        at_origin = moment + np.cross(mass_centers(context.loops), force)
        loads[context.tree.bodies[1:]] = np.hstack([force, at_origin])
    return loads


def _wrenches(context: Context, Lambda: Array) -> Array:
    """[force; moment] in joints and closures from lambda, shape (r + closures, 6, columns)."""
    tree, data, loops = context.tree, context.data, context.loops
    on_bodies = loops.forces_on_bodies(Lambda)
    for j in range(tree.model.njoints - 1, 0, -1):
        on_bodies[tree.model.parents[j]] += on_bodies[j]
    wrenches = [-data.oMi[j].toActionMatrix().T @ on_bodies[j] for j in tree.bodies[1:]]
    W = loops.W
    for closure, at in zip(context.mechanism.closures, loops.slices, strict=True):
        if isinstance(closure, Coupling | Brake):
            wrench = np.zeros((6, Lambda.shape[1]))
            wrench[acts_along(context.mechanism, closure)] = Lambda[at][0]
        else:
            frame_b = data.oMf[frame_id(tree.model, frames_of(closure)[1])]
            wrench = frame_b.toActionMatrix().T @ W[at, :6].T @ Lambda[at]
        wrenches.append(wrench)
    return np.array(wrenches).reshape(-1, 6, Lambda.shape[1])


def acts_along(mechanism: Mechanism, closure: Constraint) -> int:
    """Where the force of a coupling or brake stands in [force; moment]: along or about z."""
    rate = mechanism.rate_of(closure)
    slides = rate is None or mechanism.space.rate_units[rate] == "m"
    return 2 if slides else 5


def _relaxed(values: Array, stresses: Array, compliances: Array) -> tuple[Array, Array]:
    """Wrenches with the least elastic energy, and inner stresses without elastic energy."""
    root, flat = np.sqrt(compliances).ravel(), stresses.reshape(values.size, -1)
    U, s, Vt = np.linalg.svd(root[:, None] * flat, full_matrices=False)
    rank = int(np.count_nonzero(s > _RESISTED * s.max(initial=0.0)))
    amounts = -Vt[:rank].T @ ((U[:, :rank].T @ (root * values.ravel())) / s[:rank])
    return values + stresses @ amounts, stresses @ Vt[rank:].T


def compliances_of(mechanism: Mechanism, stiffness: Mapping[str, ArrayLike]) -> Array:
    """Compliance of each component of the wrenches, zero for those without a stiffness."""
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
    """Reactions from the numbers of each sample in a row; what is not unique becomes NaN.

    `out` gets the wrenches of joints and closures, shape (..., r + closures, 6).
    """
    names, r = names_of(mechanism), mechanism.model.njoints - 1
    count = 6 * len(names)
    values, ground, tau, codes = np.split(rows, [count, count + 6, -len(names)], axis=-1)
    flat = codes.reshape(-1, len(names))
    if len(flat) and (flat == flat[0]).all():
        codes = flat[0]  # as in most batches, which saves a verdict for each sample
    bits = np.nan_to_num(codes, nan=BITS.sum()).astype(np.uint8)  # NaN: of samples at fault
    free = ((bits[..., None] & BITS.astype(np.uint8)) > 0).reshape(*codes.shape[:-1], count)
    elastic = free & np.isfinite(values) if relaxed else np.zeros_like(free)
    if not relaxed:
        values[(..., free) if free.ndim == 1 else free] = np.nan
    shape = (*rows.shape[:-1], len(names), 6)
    unique, elastic = (np.broadcast_to(x, values.shape).reshape(shape) for x in (~free, elastic))
    values = values.reshape(shape)
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
        names,
        values[..., :r, :],
        of_closures,
        tau,
        ground,
        Verdict(unique[..., :r, :], unique[..., r:, :]),
        Verdict(elastic[..., :r, :], elastic[..., r:, :]),
        brakes,
    )

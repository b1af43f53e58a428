# SPDX-License-Identifier: BSD-2-Clause
"""Mobility of a closed chain: degrees of freedom, coordinates, and whether the motors suffice."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..former_names import FormerName
from ..model.mechanism import Mechanism
from ..model.thresholds import INDEPENDENT, RESTS
from ..model.tree import joint_id
from ..summaries import as_html, listed
from .coordinate_choice import choose_coordinates
from .line_kinematics import LineKinematics
from .loops import Loops
from .ranks import condition_number, free_motions, independent_rows, rank_of, scaled_Phi


@dataclass(frozen=True)
class Mobility:
    """Degrees of freedom of a closed chain at one configuration.

    Attributes:
        joints: Names of the rates: names of the joints, with a suffix if a joint has several.
        motor_names: Names of the motors.
        coordinates: Names of the n independent joints that describe the motion.
        rows: Name of each closure constraint.
        independent_rows: Indices of independent closure constraints, as many as the rank of Phi.
        degrees_of_freedom: Number of independent motions from this configuration. It is the number
            of rates minus the rank of Phi, unless joints are shaking.
        held: Number of degrees of freedom that the motors hold.
        loose_joints: Rates that can be nonzero while all motors are locked.
        idle_joints: Rates to lock, by name, so that no passive joint of a loop rotates freely.
            Example: a rod between two ball joints rotates about itself while all others are fixed.
        shaking_joints: Names of rates that the closures allow at this configuration although they
            belong to no motion, as in two bars in one line between fixed points.
        condition_number: Condition number of the columns of Phi for the dependent rates, without
            units; infinite if the coordinates do not suffice.
        where: Which configuration was used.
        q: This configuration, shape (nq,).
        brakes: Names of the joints and lines that brakes hold.
    """

    joints: tuple[str, ...]
    motor_names: tuple[str, ...]
    coordinates: tuple[str, ...]
    rows: tuple[str, ...]
    independent_rows: tuple[int, ...]
    degrees_of_freedom: int
    held: int
    loose_joints: tuple[str, ...]
    idle_joints: tuple[str, ...]
    shaking_joints: tuple[str, ...]
    condition_number: float
    where: str
    q: Array
    brakes: tuple[str, ...] = ()

    actuated = FormerName("motor_names")

    @property
    def rank(self) -> int:
        """Number of independent closure equations."""
        return len(self.independent_rows)

    @property
    def redundant_rows(self) -> int:
        """Number of closure equations that follow from the others."""
        return len(self.rows) - self.rank

    @property
    def sufficient(self) -> bool:
        """Whether the motors hold every degree of freedom."""
        return self.held == self.degrees_of_freedom

    @property
    def redundantly_actuated(self) -> bool:
        """Whether there are more motors than degrees of freedom."""
        return len(self.motor_names) > self.degrees_of_freedom

    @property
    def inner_stresses(self) -> int:
        """Number of independent motor torques that make no motion; see `preload_directions`."""
        return len(self.motor_names) - self.held

    def __repr__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        return "\n".join(f"{word:18}  {text}" for word, text in self._rows())

    def _repr_html_(self) -> str:
        return as_html("Mobility", self._rows())

    def _rows(self) -> list[tuple[str, str]]:
        n, dof = len(self.motor_names), self.degrees_of_freedom
        if not dof:
            verdict = "nothing moves, so no motor is needed; reactions(q) has the forces"
        elif not self.sufficient:
            left = dof - self.held
            move = "degree of freedom moves" if left == 1 else "degrees of freedom move"
            verdict = f"INSUFFICIENT: {left} {move} with the motors locked: "
            verdict += listed(self.loose_joints, 12)
        elif self.redundantly_actuated:
            verdict = f"REDUNDANT: {n - dof} more than degrees of freedom"
        else:
            verdict = "sufficient, one motor for each degree of freedom"
        if self.inner_stresses:
            verdict += f"; torques of the motors that make no motion: {self.inner_stresses}"
        ranks = f"{len(self.rows)}, rank {self.rank}, {self.redundant_rows} redundant"
        shaking = f"{', '.join(self.shaking_joints)} have rates, but no motion: locked=[...]"
        idle = rotating_freely(self.idle_joints)
        return [
            ("joints", f"{len(self.joints)}"),
            ("closure equations", ranks),
            ("degrees of freedom", f"{dof}"),
            ("motors", f"{n} ({listed(self.motor_names, 12)})"),
            ("actuation", verdict),
            ("coordinates", listed(self.coordinates, 12) or "none"),
            ("condition number", f"{self.condition_number:.4g} (dependent joints)"),
            ("judged at", self.where),
            *([("brakes", listed(self.brakes, 12))] if self.brakes else []),
            *([("idle joints", idle)] if self.idle_joints else []),
            *([("shaking joints", shaking)] if self.shaking_joints else []),
        ]


def judge(mechanism: Mechanism, loops: Loops, q: Array, where: str, motions: Array) -> Mobility:
    """Count motions from a closed q, in the mechanism's coordinates if these describe them."""
    Phi = scaled_Phi(mechanism, loops, q)
    space = mechanism.space
    groups = [space.rates_of([name]) for name in space.names_of(mechanism.coordinates.tolist())]
    coordinates = choose_coordinates(mechanism, Phi, groups, motions)
    rates = free_motions(Phi)
    shaking = np.abs(rates - motions @ (motions.T @ rates)).max(axis=1, initial=0.0) > INDEPENDENT
    _, sizes, Vt = np.linalg.svd(motor_rates(mechanism, q, motions))
    rank = int(np.count_nonzero(sizes > RESTS))
    moving = np.abs(motions @ Vt[rank:].T).max(axis=1, initial=0.0) > 1e-6
    return Mobility(
        joints=space.rate_names,
        motor_names=mechanism.motor_names,
        coordinates=space.names_of(coordinates.tolist()),
        rows=tuple(f"{c}: {row}" for c in mechanism.closures for row in c.rows),
        independent_rows=tuple(map(int, independent_rows(Phi))),
        degrees_of_freedom=len(coordinates),
        held=rank,
        loose_joints=tuple(np.array(space.rate_names)[moving].tolist()),
        idle_joints=idle_rates(mechanism, loops, Phi),
        shaking_joints=tuple(np.array(space.rate_names)[shaking].tolist()),
        condition_number=condition_number(mechanism, Phi, loops.parts(coordinates)),
        where=where,
        q=q.copy(),
        brakes=tuple(brake.name for brake in mechanism.brakes),
    )


def idle_rates(mechanism: Mechanism, loops: Loops, Phi: Array) -> tuple[str, ...]:
    """Rates to lock, so that no passive joint of a loop moves while all others are fixed.

    Each such motion gives the rate with the largest part in it. For a rod between two balls this is
    the turn about the axis that is nearest to the rod. Both balls may be joints of the tree; then
    the second one turns back what the first one turns. `loops` are evaluated.
    """
    idle, joints = list[int](), dict[int, list[int]]()
    model = mechanism.model
    for name, rates in mechanism.space.rates.items():
        if loops.touched[:, list(rates)].any() and not np.isin(rates, mechanism.driven).any():
            joints[joint_id(model, name)] = list(rates)
            idle += _free_rates(Phi, list(rates))
    for joint, turns in joints.items():
        before = joints.get(int(model.parents[joint]), [])
        if before and not np.isin([*before, *turns], idle).any():
            body = _twist(mechanism, loops, joint)
            idle += _free_rates(np.vstack([Phi, body]), [*before, *turns])
    return tuple(mechanism.space.rate_names[k] for k in idle)


def _free_rates(rows: Array, rates: list[int]) -> list[int]:
    """Some of the rates, as many as there are motions of them alone, with the largest parts."""
    from scipy.linalg import qr

    _, sizes, Vt = np.linalg.svd(rows[:, rates])
    motions = Vt[rank_of(sizes) :]
    if not len(motions):
        return []
    order = qr(motions, mode="r", pivoting=True)[1]
    return sorted(rates[k] for k in order[: len(motions)])


def _twist(mechanism: Mechanism, loops: Loops, joint: int) -> Array:
    """The velocity of a joint's body by the rates, free of units, shape (6, nv)."""
    tree = loops.tree
    where = tree.model, loops.data, tree.bodies[joint], pin.LOCAL
    J = pin.getJointJacobian(*where).reshape(6, -1).dot(tree.S) * mechanism.rate_scale
    J[:3] /= mechanism.length
    return J


def rotating_freely(idle: Sequence[str]) -> str:
    """That idle rates rotate freely, and the cure, in words."""
    names = ", ".join(idle)
    verb = "rotates" if len(idle) == 1 else "rotate"
    return (
        f"{names} {verb} freely; ClosedChain(..., locked={list(idle)}), or `locked: [{names}]` in "
        "the YAML, prevents it"
    )


def motor_rates(mechanism: Mechanism, q: Array, motions: Array) -> Array:
    """B^T times motions of the tree without units, shape (motors, motions), at a closed q.

    Each motor's row of B^T has length one; lines whose ends coincide have no direction, so zeros.
    """
    lines, B = mechanism.lines, mechanism.motors
    if lines.motors.any():
        kinematics = LineKinematics(mechanism)
        kinematics.lengths(q)
        B = B + np.nan_to_num(kinematics.loops.Phi).T @ lines.motors
    rows = B.T * mechanism.rate_scale
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > 0) @ motions

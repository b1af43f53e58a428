# SPDX-License-Identifier: BSD-2-Clause
"""Mobility of a closed chain: degrees of freedom, coordinates, and whether the motors suffice.

`judge` makes the report `Mobility` at one configuration. `idle_rates` finds passive joints that can
rotate freely. `motor_rates` is the rate of each motor in motions of the robot.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..former_names import FormerName
from ..model.closures import Distance
from ..model.mechanism import Mechanism
from ..model.thresholds import INDEPENDENT, RESTS
from ..model.tree import frame_id, joint_id
from ..summaries import as_html, listed
from .coordinate_choice import choose_coordinates
from .line_kinematics import LineKinematics
from .loops import Loops
from .ranks import condition_number, free_motions, independent_rows, scaled_Phi

#: A joint is loose if its part is larger than this in motions with the motors locked. Rounding
#: makes parts of up to 1e-9: the rounding of numbers divided by `RESTS`.
_LOOSE = 1e-6


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
        return "\n".join(f"{word:18}  {text}" for word, text in self._entries())

    def _repr_html_(self) -> str:
        return as_html("Mobility", self._entries())

    def _entries(self) -> list[tuple[str, str]]:
        """A word and a text for each line of the printed report."""
        ranks = f"{len(self.rows)}, rank {self.rank}, {self.redundant_rows} redundant"
        entries = [
            ("joints", f"{len(self.joints)}"),
            ("closure equations", ranks),
            ("degrees of freedom", f"{self.degrees_of_freedom}"),
            ("motors", f"{len(self.motor_names)} ({listed(self.motor_names, 12)})"),
            ("actuation", self._verdict()),
            ("coordinates", listed(self.coordinates, 12) or "none"),
            ("condition number", f"{self.condition_number:.4g} (dependent joints)"),
            ("judged at", self.where),
        ]
        if self.brakes:
            entries.append(("brakes", listed(self.brakes, 12)))
        if self.idle_joints:
            entries.append(("idle joints", rotating_freely(self.idle_joints)))
        if self.shaking_joints:
            names = ", ".join(self.shaking_joints)
            entries.append(("shaking joints", f"{names} have rates, but no motion: locked=[...]"))
        return entries

    def _verdict(self) -> str:
        """Whether the motors suffice, in words."""
        motors, freedoms = len(self.motor_names), self.degrees_of_freedom
        if not freedoms:
            verdict = "nothing moves, so no motor is needed; reactions(q) has the forces"
        elif not self.sufficient:
            loose = freedoms - self.held
            move = "degree of freedom moves" if loose == 1 else "degrees of freedom move"
            verdict = f"INSUFFICIENT: {loose} {move} with the motors locked: "
            verdict += listed(self.loose_joints, 12)
        elif self.redundantly_actuated:
            verdict = f"REDUNDANT: {motors - freedoms} more than degrees of freedom"
        else:
            verdict = "sufficient, one motor for each degree of freedom"
        if self.inner_stresses:
            verdict += f"; torques of the motors that make no motion: {self.inner_stresses}"
        return verdict


def judge(mechanism: Mechanism, loops: Loops, q: Array, where: str, motions: Array) -> Mobility:
    """The mobility at a closed q, in the mechanism's coordinates if these describe the motions.

    `motions` are those of `finite_motions`. Other rates that Phi allows are shaking: they belong to
    no motion. `where` says in words which configuration q is.
    """
    Phi = scaled_Phi(mechanism, loops, q)
    space = mechanism.space
    preferred = [space.rates_of([name]) for name in space.names_of(mechanism.coordinates.tolist())]
    coordinates = choose_coordinates(mechanism, Phi, preferred, motions)

    # Subtract from the rates that Phi allows their projections on the motions.
    allowed = free_motions(Phi)
    only_shaking = allowed - motions @ (motions.T @ allowed)
    is_shaking = np.abs(only_shaking).max(axis=1, initial=0.0) > INDEPENDENT

    # The motions that leave all motors at rest are the null space of the motors' rates.
    _, sizes, Vt = np.linalg.svd(motor_rates(mechanism, q, motions))
    held = int(np.count_nonzero(sizes > RESTS))
    with_motors_locked = motions @ Vt[held:].T
    is_loose = np.abs(with_motors_locked).max(axis=1, initial=0.0) > _LOOSE

    names_of_rates = np.array(space.rate_names)
    return Mobility(
        joints=space.rate_names,
        motor_names=mechanism.motor_names,
        coordinates=space.names_of(coordinates.tolist()),
        rows=tuple(f"{c}: {row}" for c in mechanism.closures for row in c.rows),
        independent_rows=tuple(map(int, independent_rows(Phi))),
        degrees_of_freedom=len(coordinates),
        held=held,
        loose_joints=tuple(names_of_rates[is_loose].tolist()),
        # Motions are orthogonal to shaking rates. So these rates, as rows, are zero in motions.
        idle_joints=idle_rates(mechanism, loops, np.vstack([Phi, only_shaking.T])),
        shaking_joints=tuple(names_of_rates[is_shaking].tolist()),
        condition_number=condition_number(mechanism, Phi, loops.parts(coordinates)),
        where=where,
        q=q.copy(),
        brakes=tuple(brake.name for brake in mechanism.brakes),
    )


def idle_rates(mechanism: Mechanism, loops: Loops, rows: Array) -> tuple[str, ...]:
    """Names of rates to lock, so that no passive joint of a loop rotates freely.

    For example, a rod between two balls can rotate about itself while all other joints and all
    motors are at rest. In each such motion the rate with the largest part is the one to lock: here
    the turn about the axis that is nearest to the rod.

    Args:
        mechanism: The mechanism.
        loops: Its loops, evaluated at a closed configuration.
        rows: Rows, free of units, that are zero in all motions, shape (k, nv): Phi of `scaled_Phi`,
            and perhaps more.
    """
    space = mechanism.space
    passive = _passive_joints(mechanism, loops)
    # In the motion of an idle joint, motors, lines and the rods of `Distance` closures, which have
    # no joints, are at rest too. Without their rows, a platform on such rods would count as idle:
    # it is a single joint of the tree, so that no other joint moves with it. But the rods do.
    rows_of_motors = motor_rates(mechanism, loops.q_of_model, np.eye(len(space.rate_names)))
    rows = np.vstack([rows, rows_of_motors, _rates_of_rods_and_lines(mechanism, loops)])
    idle = list[int]()

    # A rod with one ball in the tree and one in a closure: the rates of one joint turn it.
    for rates in passive.values():
        idle += _idle_among(rates, rows)

    # A rod with both balls in the tree: the rates of both joints turn it, in opposite senses, and
    # the body after the second ball is at rest.
    for joint, rates in passive.items():
        parent = int(mechanism.model.parents[joint])
        if parent not in passive:
            continue
        both = [*passive[parent], *rates]
        if not np.isin(both, idle).any():
            twist_of_body = _twist(mechanism, loops, joint)
            idle += _idle_among(both, np.vstack([rows, twist_of_body]))
    return tuple(space.rate_names[rate] for rate in idle)


def _passive_joints(mechanism: Mechanism, loops: Loops) -> dict[int, list[int]]:
    """The rates of each joint in a loop that no motor drives, by the index of the joint."""
    passive = dict[int, list[int]]()
    for name, indices in mechanism.space.rates.items():
        rates = list(indices)
        is_in_loop = loops.touched[:, rates].any()
        if is_in_loop and not np.isin(rates, mechanism.driven).any():
            passive[joint_id(mechanism.model, name)] = rates
    return passive


def _idle_among(rates: list[int], rows: Array) -> list[int]:
    """The rates to lock, so that the given rates have no motion while all other rates are zero.

    In such motions the rows, shape (k, nv), are zero. For each independent motion, one rate is
    locked: the one with the largest part that is independent of the rates chosen before.
    """
    from scipy.linalg import qr

    motions = free_motions(rows[:, rates])
    if not motions.shape[1]:
        return []
    # The pivots of QR are the largest independent columns of motions^T, a column for each rate.
    _, order = qr(motions.T, mode="r", pivoting=True)
    return sorted(rates[k] for k in order[: motions.shape[1]])


def _rates_of_rods_and_lines(mechanism: Mechanism, loops: Loops) -> Array:
    """Relative velocities of the ends of rods (`Distance`) and lines by v, free of units.

    Shape (k, nv), three rows for each. The configuration is that of the loops.
    """
    ends = [(line.frame_a, line.frame_b) for line in mechanism.lines.forces]
    for closure in mechanism.closures:
        if isinstance(closure, Distance):
            ends.append((closure.frame_a, closure.frame_b))
    rows = [np.zeros((0, mechanism.model.nv))]
    for names in ends:
        end_a, end_b = (frame_id(loops.tree.model, name) for name in names)
        J = loops.frame_jacobian(end_b)[:3] - loops.frame_jacobian(end_a)[:3]
        rows.append(J * mechanism.rate_scale / mechanism.length)
    return np.vstack(rows)


def _twist(mechanism: Mechanism, loops: Loops, joint: int) -> Array:
    """Jacobian of a joint's body in its own axes, free of units, shape (6, nv).

    The configuration is that of the loops.
    """
    tree = loops.tree
    J = pin.getJointJacobian(tree.model, loops.data, tree.bodies[joint], pin.LOCAL)
    J = J.reshape(6, -1).dot(tree.S) * mechanism.rate_scale
    J[:3] /= mechanism.length
    return J


def rotating_freely(idle: Sequence[str]) -> str:
    """A sentence that says which rates rotate freely, and the cure."""
    names = ", ".join(idle)
    verb = "rotates" if len(idle) == 1 else "rotate"
    return (
        f"{names} {verb} freely; ClosedChain(..., locked={list(idle)}), or `locked: [{names}]` in "
        "the YAML, prevents it"
    )


def motor_rates(mechanism: Mechanism, q: Array, motions: Array) -> Array:
    """Rates of the motors in motions, B^T motions, at a closed q, shape (motors, motions).

    The motions are rates of the tree without units, shape (nv, motions). The row of B^T of each
    motor is divided by its length, so that it counts for the motors which joints they move, not how
    fast. Lines whose ends coincide have no direction; their rows are zero.
    """
    lines = mechanism.lines
    B = mechanism.actuation  # the forces on the tree are B tau
    if lines.actuation.any():
        kinematics = LineKinematics(mechanism)
        kinematics.lengths(q)  # evaluates the loops of the lines at q
        J_of_lines = np.nan_to_num(kinematics.loops.Phi)  # rates of the lengths are J_of_lines v
        B = B + J_of_lines.T @ lines.actuation
    rows = B.T * mechanism.rate_scale
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    unit_rows = np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > 0)
    return unit_rows @ motions

# SPDX-License-Identifier: BSD-2-Clause
"""`Mechanism`: the data from which the dynamics of a closed chain is computed."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices, read_only
from ..errors import DescriptionError, SingularConfigurationError
from ..summaries import listed
from .closures import Brake, Constraint, Coupling
from .contacts import Contacts
from .dry_friction import sign_of, sign_slope
from .joint_space import JointSpace
from .lines import Lines
from .loop_groups import LoopGroup, longest_offset, loop_groups
from .tree import joint_id
from .weight_shares import WeightShares

_NOTHING_MOVES = (
    "no coordinates: nothing can move. reactions(q) computes the forces in a robot that stands "
    "still. If the robot should move, check its brakes, and the kinds and axes of its closures. If "
    'it moves in another assembly mode, store it as model.referenceConfigurations["home"]'
)
_NOT_ASSEMBLED = (
    "no configuration was assembled, so its degrees of freedom are not known; correct lengths and "
    'placements, or store a closed configuration as model.referenceConfigurations["home"]'
)
_NOTHING_FOUND = (
    "no coordinates: no configuration was assembled where they could be chosen; store a closed "
    'one as model.referenceConfigurations["home"], or give coordinates='
)


@dataclass(frozen=True)
class Friction:
    """Viscous and Coulomb friction of all joints.

    Attributes:
        viscous: D, shape (nv,), [N m s/rad] or [N s/m]; read-only.
        coulomb: F_c, shape (nv,), [N m] or [N]; read-only.
        sign_width: Rate at which the Coulomb term has risen to 76 %: sign(x) becomes
            tanh(x / sign_width); 0 keeps the sign.
    """

    viscous: Array
    coulomb: Array
    sign_width: float = 0.0

    def __post_init__(self) -> None:
        for name in ("viscous", "coulomb"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @cached_property
    def none(self) -> bool:
        """Whether no joint has friction."""
        return not (self.viscous.any() or self.coulomb.any())

    def forces(self, q_dot: Array) -> Array:
        """tau^f = -(D q_dot + F_c sign q_dot), Eqs. (87)-(89), with the sign that dissipates."""
        return -(self.viscous * q_dot + self.coulomb * sign_of(q_dot, self.sign_width))

    def slopes(self, q_dot: Array) -> Array:
        """Derivatives of the forces by the rates, shape (nv,); `sign_width` must be above 0."""
        return -(self.viscous + self.coulomb * sign_slope(q_dot, self.sign_width))


@dataclass(frozen=True)
class Springs:
    """Linear springs of joints."""

    #: Stiffness of each rate, shape (nv,), [N m/rad] or [N/m]; read-only.
    stiffness: Array
    #: Configuration without force, shape (nq,); read-only.
    reference: Array

    def __post_init__(self) -> None:
        for name in ("stiffness", "reference"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @cached_property
    def none(self) -> bool:
        """Whether no joint has a spring."""
        return not self.stiffness.any()

    def forces(self, model: pin.Model, q: Array) -> Array:
        """-k times the displacement from the reference, shape (nv,).

        This is minus the gradient of the energy, for balls too. The displacement d of a ball is the
        rotation vector, d_dot = J omega, and the gradient of k d^T d / 2 is k J^T d. It equals k d,
        because a rotation does not change its own axis: J^T d = d. `check` refuses the joints for
        which this does not hold.
        """
        return -self.stiffness * pin.difference(model, self.reference, q)

    def slopes(self, model: pin.Model, q: Array) -> Array:
        """Derivatives of the forces by q, shape (nv, nv)."""
        return -self.stiffness[:, None] * pin.dDifference(model, self.reference, q, pin.ARG1)

    def energy(self, model: pin.Model, q: Array) -> float:
        """Potential energy, [J]."""
        return float(self.stiffness @ pin.difference(model, self.reference, q) ** 2 / 2)

    def check(self, model: pin.Model) -> None:
        """Refuse springs whose force would not be the gradient of an energy."""
        problems = []
        for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
            k = self.stiffness[joint.idx_v : joint.idx_v + joint.nv]
            is_ball_with_one_stiffness = _is_ball(joint) and np.ptp(k) == 0
            has_energy = _rate_is_that_of_displacement(joint) or is_ball_with_one_stiffness
            if k.any() and not has_energy:
                problems.append(
                    f"joint {name}: a spring is not supported here; of joints with quaternions "
                    "only balls can have one, with the same stiffness in all directions"
                )
        if problems:
            raise DescriptionError(f"model {model.name}", problems)


def _rate_is_that_of_displacement(joint: Any) -> bool:
    """Whether v is the rate of the displacement that `pin.difference` computes.

    It is for joints of one rate, continuous ones included, and for joints with q_dot = v.
    """
    return joint.nv in (1, joint.nq)


def _is_ball(joint: Any) -> bool:
    return bool(joint.shortname() == "JointModelSpherical")


@dataclass(frozen=True)
class Mechanism:
    """A tree with closures, motors, friction and springs; it never changes."""

    #: The tree; a copy, which never changes.
    model: pin.Model
    closures: tuple[Constraint, ...]
    #: Indices in v of the independent rates, shape (n,).
    coordinates: Indices
    #: B: the forces on the tree are B tau, shape (nv, motors).
    actuation: Array
    motor_names: tuple[str, ...]
    friction: Friction
    springs: Springs
    #: Forces along lines, including motors on lines.
    lines: Lines
    #: What acts only in steps of `rollout(..., nonsmooth=True)`.
    contacts: Contacts = Contacts()  # noqa: RUF009
    #: Which part of the weight of each body acts, and where; None if the whole weight of each body
    #: acts at its mass centre.
    weight_shares: WeightShares | None = None
    #: A configuration with closed loops, shape (nq,), where the coordinates were judged; None if
    #: none was found.
    example: Array | None = None
    #: Norm of each row of Phi at the example, free of units, shape (rows,). A column of Phi that is
    #: much smaller shows a singularity, see `usual_size`. The norm is 0 for couplings with constant
    #: coefficients, which never come near a singularity.
    row_sizes: Array | None = None
    #: Names of the coordinates that move no mass, so that the mass matrix is singular. If the
    #: coordinates are singular at the example, names of other rates for the motions without mass.
    without_mass: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("coordinates", "actuation", "example", "row_sizes"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, read_only(getattr(self, name)))

    # --- the joints and the coordinates -----------------------------------------------------

    @cached_property
    def space(self) -> JointSpace:
        """Names and units of q and v."""
        return JointSpace(self.model)

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the coordinates: joints, or single rates of a joint."""
        return self.space.names_of(self.coordinates.tolist())

    @cached_property
    def coordinate_rate_names(self) -> tuple[str, ...]:
        """Name of each coordinate's rate, n of them."""
        return tuple(self.space.rate_names[k] for k in self.coordinates)

    @cached_property
    def coordinate_rate_units(self) -> tuple[str, ...]:
        """Unit of each coordinate: "rad" or "m", per second for its rate."""
        return tuple(self.space.rate_units[k] for k in self.coordinates)

    @cached_property
    def dependent(self) -> Indices:
        """Indices in v of the rates that the closures determine."""
        return read_only(np.setdiff1d(np.arange(self.model.nv), self.coordinates))

    @cached_property
    def selection(self) -> Array:
        """Rows that pick the coordinates, va = selection v, shape (n, nv)."""
        return read_only(np.eye(self.model.nv)[self.coordinates])

    @cached_property
    def held_in_part(self) -> bool:
        """Whether some rates of a joint with nq != nv are coordinates, others not.

        Such joints are balls, free-flyers and planar joints. No positions belong to single rates of
        them: integrals of the rates depend on the path to a configuration. So it is not unique what
        it means to hold such a coordinate fixed.
        """
        for joint in list(self.model.joints)[1:]:
            if joint.nv > 1 and joint.nq != joint.nv:
                rates = range(joint.idx_v, joint.idx_v + joint.nv)
                is_coordinate = np.isin(rates, self.coordinates)
                if is_coordinate.any() and not is_coordinate.all():
                    return True
        return False

    # --- the motors -------------------------------------------------------------------------

    @property
    def motor_count(self) -> int:
        """Number of motors."""
        return len(self.motor_names)

    @cached_property
    def driven(self) -> Indices:
        """Indices in v of the rates that motors act on, motor after motor."""
        rates: list[int] = []
        for column in self.actuation.T:
            for rate in np.flatnonzero(column).tolist():
                if rate not in rates:
                    rates.append(rate)
        return read_only(np.array(rates, dtype=np.intp))

    @cached_property
    def motor_lines(self) -> Indices:
        """Index of the line on which each motor acts alone; -1 for other motors."""
        factors = self.lines.actuation
        alone = (np.count_nonzero(factors, axis=0) == 1) & ~self.actuation.any(axis=0)
        lines = np.full(len(self.motor_names), -1)
        for k in np.flatnonzero(alone):
            lines[k] = np.flatnonzero(factors[:, k])[0]
        return read_only(lines)

    @cached_property
    def effort_factors(self) -> Array:
        """Forces of the motors on each rate, then on each line, for torques of 1.

        Shape (nv + lines, motors). For torques tau the forces are these factors times tau.
        """
        return read_only(np.vstack([self.actuation, self.lines.actuation]))

    @cached_property
    def effort_limits(self) -> Array:
        """Largest forces of the motors on each rate, then on each line, [N m] or [N].

        Shape (nv + lines,). The numbers are those of the file, in which zero is no limit.
        """
        of_lines = [line.effort for line in self.lines.forces]
        return read_only(np.concatenate([self.model.effortLimit, of_lines]))

    @cached_property
    def driven_one_to_one(self) -> bool:
        """Whether motor k gives the force of coordinate k, and nothing else."""
        return np.array_equal(self.actuation, self.selection.T) and not self.lines.actuation.any()

    @cached_property
    def motor_units(self) -> tuple[str, ...]:
        """Unit of each motor: "Nm" or "N", by its rate with the largest factor; on lines "N"."""
        units = []
        for column in self.actuation.T:
            largest = int(np.abs(column).argmax())
            is_torque = column[largest] != 0 and self.space.rate_units[largest] == "rad"
            units.append("Nm" if is_torque else "N")
        return tuple(units)

    # --- closures, springs and weights ------------------------------------------------------

    @property
    def brakes(self) -> tuple[Brake, ...]:
        """The closures that hold a joint or a line where it is."""
        return tuple(x for x in self.closures if isinstance(x, Brake))

    @cached_property
    def braked(self) -> Indices:
        """Indices in v of the rates that brakes of joints hold."""
        names = [brake.name for brake in self.brakes if brake.frames is None]
        return read_only(self.space.rates_of(names))

    def rate_of(self, closure: Constraint) -> int | None:
        """Index in v of the rate on which a coupling or a brake acts; None for other closures."""
        if isinstance(closure, Coupling):
            return int(self.model.joints[joint_id(self.model, closure.joint)].idx_v)
        if isinstance(closure, Brake) and closure.frames is None:
            return int(self.space.rates_of([closure.name])[0])
        return None

    @cached_property
    def possible_springs(self) -> Indices:
        """Indices in v of the rates that can have a spring, as `Springs.check` says."""
        rates: set[int] = set()
        for joint in list(self.model.joints)[1:]:
            if _rate_is_that_of_displacement(joint) or _is_ball(joint):
                rates.update(range(joint.idx_v, joint.idx_v + joint.nv))
        return read_only(np.array(sorted(rates), dtype=np.intp))

    @cached_property
    def weightless_parts(self) -> dict[int, Array]:
        """See `WeightShares.weightless_parts`; empty if all bodies have their whole weight."""
        return {} if self.weight_shares is None else self.weight_shares.weightless_parts(self.model)

    # --- what a computation needs -----------------------------------------------------------

    def require_assembly(self) -> None:
        """Raise an error if no configuration with closed loops is known."""
        if self.example is None:
            raise DescriptionError(f"model {self.model.name}", [_NOT_ASSEMBLED])

    def require_freedom(self) -> None:
        """Raise an error if nothing can move, or if it is not known what can."""
        if not len(self.coordinates):
            problem = _NOTHING_FOUND if self.example is None else _NOTHING_MOVES
            raise DescriptionError(f"model {self.model.name}", [problem])

    def require_mass(self) -> None:
        """Raise an error if a motion moves no mass: direct dynamics is not defined."""
        if self.without_mass:
            raise SingularConfigurationError(
                "the mass matrix is not positive definite: the rates "
                f"{listed(self.without_mass)} move no mass to speak of; give their bodies inertia "
                f"about these axes, or lock them: ClosedChain(..., locked={[*self.without_mass]})",
                float("inf"),
            )

    # --- lengths and scales -----------------------------------------------------------------

    @cached_property
    def length(self) -> float:
        """Length of the robot, [m]: its largest offset on one body or in a group of loops, or 1.

        It does not depend on where the robot stands in the world.
        """
        joints = range(1, self.model.njoints)
        lengths = [length for _, length in self._offsets_of_groups]
        offset = longest_offset(self.model, joints, self.closures, ground=False)
        return max([offset, *lengths]) or 1.0

    @cached_property
    def _offsets_of_groups(self) -> list[tuple[LoopGroup, float]]:
        """Each group of loops that share joints, and its largest offset, [m].

        The offset is 0 if all axes meet in one point, as in a spherical linkage.
        """
        groups = []
        for group in loop_groups(self.model, self.closures):
            groups.append((group, longest_offset(self.model, group.joints, group.closures)))
        return groups

    @cached_property
    def _lengths_of_groups(self) -> list[tuple[LoopGroup, float]]:
        """Each group of loops, and its length, [m]: its largest offset, or the robot's length."""
        return [(group, offset or self.length) for group, offset in self._offsets_of_groups]

    @cached_property
    def _length_of_closure(self) -> dict[Constraint, float]:
        """The length of the loops of each closure, [m]."""
        lengths: dict[Constraint, float] = {}
        for group, length in self._lengths_of_groups:
            for closure in group.closures:
                lengths[closure] = length
        return lengths

    @cached_property
    def rate_scale(self) -> Array:
        """Scale of the rates, shape (nv,): v / rate_scale is free of units.

        It is 1 rad/s for rotations. For translations it is the length of the joint's loops, or of
        the robot for a joint outside loops, per second.
        """
        lengths = np.full(self.model.nv, self.length)
        for group, length in self._lengths_of_groups:
            for number in group.joints:
                joint = self.model.joints[number]
                lengths[joint.idx_v : joint.idx_v + joint.nv] = length
        is_translation = np.array(self.space.rate_units) == "m"
        return read_only(np.where(is_translation, lengths, 1.0))

    @cached_property
    def motor_scale(self) -> Array:
        """Scale of the motor rates, shape (motors,): rates divided by it are free of units.

        A motor on several joints or lines has a factor for each. Its scale is the largest product
        of a factor and the scale of the joint or line.
        """
        on_rates = np.abs(self.actuation * self.rate_scale[:, None]).max(axis=0, initial=0.0)
        on_lines = np.abs(self.lines.actuation * self.length).max(axis=0, initial=0.0)
        return read_only(np.maximum(on_rates, on_lines))

    @cached_property
    def row_scale(self) -> Array:
        """Factors that make the rows of Phi free of units, shape (rows,).

        Phi without units is row_scale[:, None] * Phi * rate_scale.
        """
        units: list[float] = []
        for closure in self.closures:
            rate = self.rate_of(closure)
            if rate is not None:  # a coupling or a brake has one row, in the unit of its joint
                units.append(self.rate_scale[rate])
                continue
            for row in closure.rows:
                is_rotation = row.startswith("turn")
                units.append(1.0 if is_rotation else self._length_of_closure[closure])
        return read_only(1 / np.array(units))

    @cached_property
    def row_lengths(self) -> Array:
        """Length of the loops of each row, also if the row is in radians, shape (rows,), [m]."""
        lengths = list[float]()
        for closure in self.closures:
            lengths += [self._length_of_closure[closure]] * len(closure.rows)
        return read_only(np.array(lengths, dtype=float))

    def usual_size(self, rows: Indices, rates: Indices) -> float:
        """Size that shows whether a block of Phi with one dependent rate is nearly singular.

        A block with one rate is a column: its condition number is 1 at every configuration. So
        `loops.ranks` compares its only singular value with the result. The result is the norm of
        the whole rows (all columns of Phi) at the example, free of units.

        For a block with several dependent rates the result is 0: its condition number shows
        whether it is nearly singular.

        Args:
            rows: Rows of the block.
            rates: Dependent rates of the block.
        """
        if len(rates) > 1 or self.row_sizes is None:
            return 0.0
        return float(np.linalg.norm(self.row_sizes[rows]))

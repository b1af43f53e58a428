# SPDX-License-Identifier: BSD-2-Clause
"""`ClosedChain`: any Pinocchio tree of one-coordinate joints, closed and driven by motors."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from . import assembly, dynamics, mobility
from .batches import as_array, finite_array, for_each_sample
from .closures import CLOSURE_TOLERANCE, Closure, LoopKinematics
from .errors import ActuationError, ClosureError, DescriptionError, InputError, UnknownNameError
from .mechanics import Mechanics
from .noc import Actuation, JointComplement

if TYPE_CHECKING:
    from .simulation import ExternalWrenches, Torque
    from .trajectories import Trajectory

Array = NDArray[np.float64]
_Value = TypeVar("_Value")


class ClosedChain:
    """A robot with closed loops: its kinematics, its dynamics, its motion.

    Joint vectors `q` are in the order of `joint_names`, actuated ones (`va`, `aa`, `tau`) in the
    order given. Methods are safe to call from several threads.

    Args:
        model: A tree whose joints have one coordinate each; used as it is, not copied.
        closures: `Closure` objects, or pairs of frame names for frames that must coincide.
        actuated: Names of the motors' joints.
        viscous_friction: D of each joint, shape (m,); those of the model by default.
        coulomb_friction: F_c of each joint, shape (m,); those of the model by default.

    Raises:
        DescriptionError: For a joint with several coordinates, or without closures.
        UnknownNameError: For a joint or frame that is not in the model.
        ActuationError: When the joints outnumber motors and closure equations together.
    """

    def __init__(
        self,
        model: pin.Model,
        closures: Sequence[Closure | tuple[str, str]],
        actuated: Sequence[str],
        *,
        viscous_friction: ArrayLike | None = None,
        coulomb_friction: ArrayLike | None = None,
    ) -> None:
        self.model = model
        self.closures = tuple(c if isinstance(c, Closure) else Closure(*c) for c in closures)
        self.joint_names: tuple[str, ...] = tuple(list(model.names)[1:])
        _require_simple(model, self.joint_names, self.closures)
        self._actuation = Actuation.of([self._joint_index(name) for name in actuated], model.nv)
        if len(set(actuated)) != len(actuated):
            raise InputError("actuated", f"a joint stands twice in {list(actuated)}")
        viscous = model.damping if viscous_friction is None else viscous_friction
        coulomb = model.friction if coulomb_friction is None else coulomb_friction
        self.friction = dynamics.Friction(
            finite_array("viscous_friction", viscous, (model.nv,)).copy(),
            finite_array("coulomb_friction", coulomb, (model.nv,)).copy(),
        )
        self._m, self._n = model.nv, len(actuated)
        self._per_thread = threading.local()
        self._motors_match = False
        rows = self._kinematics.rows  # finds the frames, or says which is unknown
        if rows < len(self._actuation.unactuated):
            raise ActuationError(
                f"{model.nv} joints, {len(actuated)} motors and {rows} closure equations: "
                f"at least {len(self._actuation.unactuated) - rows} more motors are needed"
            )

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in self.__dict__.items() if key != "_per_thread"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._per_thread = threading.local()

    @property
    def actuated(self) -> tuple[int, ...]:
        """Indices of the motors' joints in q."""
        return tuple(int(i) for i in self._actuation.actuated)

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of each joint, "rad" or "m"."""
        kinds = [joint.shortname() for joint in list(self.model.joints)[1:]]
        return tuple("m" if kind.startswith("JointModelP") else "rad" for kind in kinds)

    # --- closures ---------------------------------------------------------------------------

    def residual(self, q: ArrayLike) -> Array:
        """How far the loops are open.

        Args:
            q: Joint coordinates, shape (m,), [rad] or [m].

        Returns:
            f(q) of Eq. (2), shape (rows,): [m] and [rad], base axes, closure after closure.
        """
        return self._at(q, lambda kinematics, _: kinematics.residual())

    def Phi(self, q: ArrayLike) -> Array:
        """Jacobian of the closures with all rows, redundant ones too, Eqs. (3), (4).

        Args:
            q: Joint coordinates on the closures, shape (m,).

        Returns:
            Shape (rows, m).
        """
        return self._at(q, lambda kinematics, _: kinematics.Phi())

    def Phi_dot(self, q: ArrayLike, q_dot: ArrayLike) -> Array:
        """Rate of `Phi` at joint rates that keep the loops closed.

        Args:
            q: Joint coordinates on the closures, shape (m,).
            q_dot: Rates of all joints, shape (m,).

        Returns:
            Shape (rows, m).
        """
        v = finite_array("q_dot", q_dot, (self._m,))

        def rate(kinematics: LoopKinematics, q: Array) -> Array:
            kinematics.set_velocity(q, v)
            return kinematics.Phi_dot(v)

        return self._at(q, rate)

    def condition_number(self, q: ArrayLike) -> float:
        """Condition number of Phi^u: infinite where the motors lose hold of the robot.

        Args:
            q: Joint coordinates on the closures, shape (m,).
        """
        return float(np.linalg.cond(self.Phi(q)[:, self._actuation.unactuated]))

    def assemble(self, q: ArrayLike, fixed: Sequence[str] | None = None) -> Array:
        """Project a configuration onto the closures by Newton's method.

        Args:
            q: A guess, shape (m,).
            fixed: Names of joints to be held; the actuated ones by default, () for none.

        Returns:
            A configuration near q with closed loops, shape (m,).

        Raises:
            ClosureError: When there is none within reach, with the residual that was left.
            UnknownNameError: For an unknown joint.
        """
        guess = self._one("q", q)
        if fixed is None:
            free = self._actuation.unactuated
        else:
            free = np.setdiff1d(np.arange(self._m), [self._joint_index(name) for name in fixed])
        return assembly.assemble(self._kinematics, guess, free)

    def mobility(self, q: ArrayLike | None = None) -> mobility.Mobility:
        """Count degrees of freedom, redundant closures and motors.

        Args:
            q: Joint coordinates on the closures, shape (m,); a generic configuration by default.

        Returns:
            A report that prints readably.

        Raises:
            ClosureError: When q is open, or when no configuration can be assembled.
        """
        if q is None:
            q = assembly.generic_configuration(self._kinematics)
        q = self._one("q", q)
        labels = [f"{c.frame_a} - {c.frame_b}: {row}" for c in self.closures for row in c.rows]
        kinematics = self._kinematics
        kinematics.set_position(q)
        kinematics.require_closed(CLOSURE_TOLERANCE)
        Phi = kinematics.Phi()
        return mobility.analyse(
            Phi, self.joint_names, self.actuated, list(self._actuation.unactuated), labels
        )

    # --- dynamics ---------------------------------------------------------------------------

    def compute_torques(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        out: Array | None = None,
        on_error: str = "raise",
    ) -> Array:
        """Inverse dynamics: the motor torques of a motion, Eq. (92).

        Args:
            q: Joint coordinates on the closures, shape (..., m), [rad] or [m].
            va: Rates of the actuated joints, shape (..., n).
            aa: Accelerations of the actuated joints, shape (..., n).
            external_wrenches: [moment; force] that the surroundings exert on each body at its mass
                centre, base axes, bodies in the order of the joints, shape (..., r, 6).
            out: Array for the result.
            on_error: "raise", or "nan" for NaN in the place of samples at fault.

        Returns:
            tau, shape (..., n), [N m] or [N].

        Raises:
            InputError: For a wrong shape or a number that is not finite.
            ClosureError: When q is open.
            SingularConfigurationError: When the motors do not hold the robot at q.
            ActuationError: When there are fewer or more motors than degrees of freedom.
        """
        m, n = self._m, self._n
        q, va, aa = as_array("q", q, (m,)), as_array("va", va, (n,)), as_array("aa", aa, (n,))
        wrenches = self._wrenches(external_wrenches)
        if q.ndim == va.ndim == aa.ndim == 1 and wrenches is out is None and on_error == "raise":
            return self._torques(q, va, aa, None)
        return for_each_sample(
            self._torques, (q, va, aa, wrenches), (1, 1, 1, 2), (n,), on_error=on_error, out=out
        )

    def _torques(self, q: Array, va: Array, aa: Array, wrenches: Array | None) -> Array:
        tau = dynamics.inverse_dynamics(*self.closed_at(q), self.friction, q, va, aa, wrenches)
        if not isfinite(tau.dot(tau)):  # cheaper than looking at each input
            _require_finite(q=q, va=va, aa=aa, tau=tau)
        return tau

    def compute_accelerations(
        self,
        q: ArrayLike,
        va: ArrayLike,
        tau: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        out: Array | None = None,
        on_error: str = "raise",
    ) -> Array:
        """Direct dynamics: the accelerations of the actuated joints under given torques, Eq. (92).

        Args:
            q: Joint coordinates on the closures, shape (..., m), [rad] or [m].
            va: Rates of the actuated joints, shape (..., n).
            tau: Motor torques, shape (..., n), [N m] or [N].
            external_wrenches: As in `compute_torques`.
            out: As in `compute_torques`.
            on_error: As in `compute_torques`.

        Returns:
            aa, shape (..., n).

        Raises:
            InputError: For a wrong shape or a number that is not finite.
            ClosureError: When q is open.
            SingularConfigurationError: When the motors do not hold the robot at q.
            ActuationError: When there are fewer or more motors than degrees of freedom.
        """
        m, n = self._m, self._n
        q, va, tau = as_array("q", q, (m,)), as_array("va", va, (n,)), as_array("tau", tau, (n,))
        wrenches = self._wrenches(external_wrenches)
        arrays = (q, va, tau, wrenches)
        return for_each_sample(
            self._accelerations, arrays, (1, 1, 1, 2), (n,), on_error=on_error, out=out
        )

    def _accelerations(self, q: Array, va: Array, tau: Array, wrenches: Array | None) -> Array:
        aa, _ = dynamics.direct_dynamics(*self.closed_at(q), self.friction, q, va, tau, wrenches)
        if not isfinite(aa.dot(aa)):
            _require_finite(q=q, va=va, tau=tau, aa=aa)
        return aa

    def noc(self, q: ArrayLike, va: ArrayLike) -> dynamics.Terms:
        """All matrices of the paper at one configuration: tau = I aa + C va - tau^g - tau^f.

        Args:
            q: Joint coordinates on the closures, shape (m,).
            va: Rates of the actuated joints, shape (n,).

        Raises:
            InputError, ClosureError, SingularConfigurationError, ActuationError: As
                `compute_torques`.
        """
        va = finite_array("va", va, (self._n,))
        q = self._one("q", q)
        return dynamics.terms(*self.closed_at(q), self.friction, q, va)

    def reduced_terms(
        self, q: ArrayLike, va: ArrayLike, *, on_error: str = "raise"
    ) -> dynamics.ReducedTerms:
        """The equations of motion in the actuated coordinates, for batches, Eqs. (93)-(96).

        Args:
            q: Joint coordinates on the closures, shape (..., m).
            va: Rates of the actuated joints, shape (..., n).
            on_error: As in `compute_torques`.

        Raises:
            InputError, ClosureError, SingularConfigurationError, ActuationError: As
                `compute_torques`.
        """
        n = self._n
        arrays = as_array("q", q, (self._m,)), as_array("va", va, (n,))
        return dynamics.ReducedTerms.of_rows(
            for_each_sample(
                self._reduced_terms, arrays, (1, 1), (2 * n * (n + 1),), on_error=on_error
            ),
            n,
        )

    def _reduced_terms(self, q: Array, va: Array) -> Array:
        terms = dynamics.terms(*self.closed_at(q), self.friction, q, va)
        row = np.concatenate(
            [terms.inertia.ravel(), terms.coriolis.ravel(), terms.gravity, terms.friction]
        )
        if not isfinite(row.dot(row)):
            _require_finite(q=q, va=va, terms=row)
        return row

    def joint_rates(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Rates of all joints, q_dot = L va, Eq. (16).

        Args:
            q: Joint coordinates on the closures, shape (..., m).
            va: Rates of the actuated joints, shape (..., n).

        Returns:
            Shape (..., m).
        """
        m, n = self._m, self._n

        def rates(q: Array, va: Array) -> Array:
            kinematics, complement = self.closed_at(q)
            return complement.factorise(kinematics.Phi()) @ va

        arrays = (finite_array("q", q, (m,)), finite_array("va", va, (n,)))
        return for_each_sample(rates, arrays, (1, 1), (m,))

    def kinetic_energy(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Kinetic energy, shape (...), [J]; arguments as `joint_rates`."""

        def energy(q: Array, q_dot: Array) -> Array:
            # Not computeKineticEnergy, which forgets the rotors of unaligned revolute joints.
            M = pin.crba(self.model, self._kinematics.data, q)
            return np.asarray(q_dot @ M @ q_dot / 2)

        q = finite_array("q", q, (self._m,))
        return for_each_sample(energy, (q, self.joint_rates(q, va)), (1, 1), ())

    def potential_energy(self, q: ArrayLike) -> Array:
        """Potential energy of the weights, zero with all masses at the origin, shape (...), [J].

        Args:
            q: Joint coordinates, shape (..., m).
        """

        def energy(q: Array) -> Array:
            return np.asarray(pin.computePotentialEnergy(self.model, self._kinematics.data, q))

        return for_each_sample(energy, (finite_array("q", q, (self._m,)),), (1,), ())

    def friction_power(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Power of friction in all joints, Eq. (87), negative or zero, shape (...), [W].

        Args:
            q: Joint coordinates on the closures, shape (..., m).
            va: Rates of the actuated joints, shape (..., n).
        """
        q_dot = self.joint_rates(q, va)
        return (self.friction.forces(q_dot) * q_dot).sum(axis=-1)

    def simulate(
        self,
        torque: Torque,
        q0: ArrayLike,
        va0: ArrayLike,
        t: ArrayLike,
        *,
        external_wrenches: ExternalWrenches = None,
        **options: Any,
    ) -> Trajectory:
        """Integrate the motion under given torques; see `sst_pin.simulation.simulate`."""
        from .simulation import simulate

        return simulate(self, torque, q0, va0, t, external_wrenches=external_wrenches, **options)

    # --- inside -----------------------------------------------------------------------------

    @property
    def _workspace(self) -> tuple[LoopKinematics, JointComplement]:
        """This thread's scratch memory."""
        try:
            return self._per_thread.workspace
        except AttributeError:
            kinematics = LoopKinematics(self.model, self.closures)
            complement = JointComplement(kinematics.rows, self._actuation)
            self._per_thread.workspace = kinematics, complement
            return kinematics, complement

    @property
    def _kinematics(self) -> LoopKinematics:
        return self._workspace[0]

    def closed_at(
        self, q: Array, tolerance: float = CLOSURE_TOLERANCE
    ) -> tuple[LoopKinematics, JointComplement]:
        """This thread's workspace at one configuration, found to be closed."""
        kinematics, complement = self._workspace
        self.require_motors_to_match(q)
        kinematics.set_position(q)
        kinematics.require_closed(tolerance)
        return kinematics, complement

    def require_motors_to_match(self, q: Array | None = None) -> None:
        """Check once, where nothing special is to be expected, that motors and freedoms agree.

        Args:
            q: Where to look when no such place is found, shape (m,).

        Raises:
            ActuationError: When they do not.
            ClosureError: When there is no such place, and q is open or not given.
        """
        if self._motors_match:
            return
        try:
            report = self.mobility()
            self._motors_match = True
        except ClosureError:  # no such place found: ask at each configuration in use
            report = self.mobility(q)
        if not report.sufficient or report.redundantly_actuated:
            self._motors_match = False
            raise ActuationError(f"the motors do not match the degrees of freedom:\n{report}")

    def mechanics(self, friction: dynamics.Friction) -> Mechanics:
        """What `simulate` asks of the robot, with a friction in the place of its own."""
        return Mechanics(self, friction)

    def _at(self, q: ArrayLike, compute: Callable[[LoopKinematics, Array], _Value]) -> _Value:
        array = self._one("q", q)
        kinematics = self._kinematics
        kinematics.set_position(array)
        return compute(kinematics, array)

    def _one(self, name: str, q: ArrayLike) -> Array:
        """A single joint vector."""
        array = finite_array(name, q, (self._m,))
        if array.ndim != 1:
            raise InputError(name, f"shape {array.shape}, expected ({self._m},): one sample")
        return array

    def _joint_index(self, name: str) -> int:
        if name not in self.joint_names:
            raise UnknownNameError("joint", name, self.joint_names)
        return int(self.model.joints[self.model.getJointId(name)].idx_v)

    def _wrenches(self, wrenches: ArrayLike | None) -> Array | None:
        if wrenches is None:
            return None
        return finite_array("external_wrenches", wrenches, (self.model.njoints - 1, 6))


def _require_simple(model: pin.Model, names: Sequence[str], closures: Sequence[Closure]) -> None:
    problems = [
        f"joint {name}: {joint.nq} coordinates and {joint.nv} rates, one of each is needed"
        + (" (a continuous joint? make it revolute with wide limits)" if joint.nq == 2 else "")
        for name, joint in zip(names, list(model.joints)[1:], strict=True)
        if (joint.nq, joint.nv) != (1, 1)
    ]
    if not closures:
        problems.append("no closures; an open tree needs pinocchio.rnea and nothing else")
    if problems:
        raise DescriptionError(f"model {model.name}", problems)


def _require_finite(**arrays: Array) -> None:
    for name, array in arrays.items():
        finite_array(name, array, array.shape)

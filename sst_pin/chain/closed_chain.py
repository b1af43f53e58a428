# SPDX-License-Identifier: BSD-2-Clause
"""`ClosedChain`: any closed and driven Pinocchio tree, its kinematics and its dynamics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import (
    finite_array,
    for_each_sample,
    names,
    positive_number,
    single_array,
    whole_number,
)
from ..errors import ClosureError, DescriptionError, InputError, MissingExtraError
from ..summaries import as_html, as_text, listed
from . import derivatives, dynamics, samples
from .assignments import require_assignable
from .backend import States
from .closures import Constraint
from .current import CurrentMechanism
from .draft import Motor, closures_of, without_locked
from .mechanism import Friction
from .mobility import Mobility, condition_number
from .samples import by_kernel
from .tree import frame_id

if TYPE_CHECKING:
    from ..compiled.casadi_functions import CasadiFunctions
    from ..compiled.jax_functions import JaxFunctions
    from ..motion.rollouts import Rollout
    from ..motion.simulation import Load, Torque
    from ..motion.trajectories import Trajectory
    from ..viewer import Viewer

Array = NDArray[np.float64]
_Chain = TypeVar("_Chain", bound="ClosedChain")


def _anything_goes(model: pin.Model) -> None:
    pass


class ClosedChain:
    """A robot with closed loops.

    `q` is a configuration of the tree, shape (nq,), on its manifold as Pinocchio has it. The
    motion is described by n independent coordinates, the rates `va` and accelerations `aa` of some
    joints: those of `coordinates`. Motors give the torques `tau`, in the order of `actuated`.
    Methods are safe to call from several threads.

    A change of `model` is taken in at the next call that finds it; `refresh()` takes it in at once.

    Args:
        model: A tree; it stays yours, the chain computes from a copy.
        closures: `Closure`, `Distance`, `Coupling`, `Rolling`, or pairs of frame names for frames
            that must coincide.
        actuated: The motors: names of joints, or for a tendon the share of each joint by name.
        coordinates: Names of the independent joints, a joint of several rates counts with all of
            them. By default the actuated ones, as many as are independent, and where they are too
            few others besides.
        locked: Names of joints that are held where `pin.neutral` puts them, or the coordinate of
            each one-coordinate joint by name.
        viscous_friction: D of each rate, shape (nv,); those of the model by default.
        coulomb_friction: F_c of each rate, shape (nv,); those of the model by default.
        stiffness: Of the joints' springs, shape (nv,), [N m/rad] or [N/m]; none by default.
        spring_reference: Where the springs are at rest, shape (nq,); `pin.neutral` by default.

    Raises:
        DescriptionError: Without closures, with joints of one name, with nothing that can move.
        UnknownNameError: For a joint or frame that is not in the model.

    Example:
        `ClosedChain(model, [Closure("rocker_end", "pivot", "3d")], ["crank"])`.
    """

    #: For `visual_model`: shapes, or what loads them.
    _shapes: pin.GeometryModel | Callable[[pin.Model], pin.GeometryModel] = pin.GeometryModel()

    def __init__(
        self,
        model: pin.Model,
        closures: Sequence[Constraint | tuple[str, str]],
        actuated: Sequence[Motor],
        *,
        coordinates: Sequence[str] | None = None,
        locked: Sequence[str] | Mapping[str, float] = (),
        viscous_friction: ArrayLike | None = None,
        coulomb_friction: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        spring_reference: ArrayLike | None = None,
    ) -> None:
        if not isinstance(model, pin.Model):
            raise InputError("model", f"a pinocchio.Model is needed, not {type(model).__name__}")
        numbers = {
            "viscous_friction": viscous_friction,
            "coulomb_friction": coulomb_friction,
            "stiffness": stiffness,
            "spring_reference": spring_reference,
        }
        self._current = CurrentMechanism(
            without_locked(model, locked) if locked else model,
            closures_of(closures),
            actuated,
            coordinates,
            numbers,
            self._examine,
        )

    # --- what it is -------------------------------------------------------------------------

    @property
    def model(self) -> pin.Model:
        """The tree. A change of it counts from the next call on; see `refresh`.

        Example:
            >>> chain.model.nq, chain.model.njoints
            (3, 4)
        """
        self._current.unseen = True
        return self._current.model

    @property
    def closures(self) -> tuple[Constraint, ...]:
        """What closes the tree.

        Example:
            >>> [str(closure) for closure in robot.closures]
            ['closedloop1_A - closedloop1_B', 'closedloop2_A - closedloop2_B']
        """
        return self._current.closures

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the tree.

        Example:
            >>> chain.joint_names
            ('crank', 'coupler', 'rocker')
        """
        return self._current.draft.space.joint_names

    @property
    def position_names(self) -> tuple[str, ...]:
        """Name of each entry of q: the joint's, with a suffix where it has several.

        Example:
            >>> sst_pin.robots.delta().position_names[-5:]
            ('motor_3', 'rod_3a_1', 'rod_3a_2', 'rod_3b_1', 'rod_3b_2')
        """
        return self._current.draft.space.position_names

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of each entry of q: "rad", "m", or "" for quaternions, cosines and sines.

        Example:
            >>> sorted(set(sst_pin.robots.excavator().joint_units))
            ['m', 'rad']
        """
        return self._current.draft.space.position_units

    @property
    def home(self) -> Array:
        """The configuration that the description calls home, its loops closed, shape (nq,).

        It stands in `model.referenceConfigurations["home"]`: from the SRDF beside a URDF, from the
        keyframe `home` of an MJCF, or put there by you. Where loops are open there, it is
        assembled, the coordinates held.

        Raises:
            DescriptionError: When the description calls no configuration so, or what is none.
            ClosureError: When the loops cannot be closed there.

        Example:
            >>> sst_pin.ClosedChain.from_urdf(sst_pin.URDF_PATH).home[:3].round(4)
            array([0.7854, 1.5708, 0.6155])
        """
        q = self._current.home()
        if q is None:
            cure = 'set model.referenceConfigurations["home"] = q; assemble(guess) computes a q'
            name = self._current.model.name
            raise DescriptionError(f"model {name}", [f"no configuration is named home; {cure}"])
        closed = self._current.first_closed(q)
        return self.assemble(q) if closed is None else closed

    @property
    def actuated(self) -> NDArray[np.intp]:
        """Indices in v of the motors' joints, motor after motor, read-only.

        Example:
            >>> robot.joint_rates(robot.home, [1, 2, 3])[robot.actuated]
            array([1., 2., 3.])
        """
        return self._current.draft.driven

    @property
    def actuation(self) -> Array:
        """B: motors that give tau exert the forces B tau on the tree; shape (nv, motors).

        Example:
            >>> chain.actuation.T
            array([[1., 0., 0.]])
        """
        return self._current.draft.motors

    @property
    def motor_names(self) -> tuple[str, ...]:
        """Name of each motor, in the order of tau.

        Example:
            >>> robot.motor_names
            ('gamma_1', 'gamma_2', 'gamma_3')
        """
        return self._current.draft.motor_names

    @property
    def motor_units(self) -> tuple[str, ...]:
        """For each motor "Nm" or "N", by the joints that it acts on.

        Example:
            >>> robot.motor_units
            ('Nm', 'Nm', 'Nm')
        """
        return self._current.draft.space.force_units(self.actuation)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the independent joints; of a joint that is one only in part, its rates.

        Raises:
            ClosureError: When they are to be chosen and no configuration can be assembled.

        Example:
            >>> chain.coordinates
            ('crank',)
        """
        mechanism = self._current.mechanism()
        return mechanism.space.names_of(mechanism.coordinates.tolist())

    @property
    def degrees_of_freedom(self) -> int:
        """Number n of the coordinates' rates.

        Example:
            >>> sst_pin.robots.stewart().degrees_of_freedom
            6
        """
        return len(self._current.mechanism().coordinates)

    @property
    def friction(self) -> Friction:
        """Of all joints, read-only.

        Example:
            >>> robot.friction.viscous
            array([0., 0., 0., 0., 0., 0., 0., 0., 0.])
        """
        return self._current.draft.friction

    @property
    def path(self) -> str:
        """What computes the dynamics, and why: compiled kernels or the reference path.

        Example:
            >>> sst_pin.SST(kernels=False).path
            'the reference path: switched off by kernels=False'
        """
        return self._current.path()

    def refresh(self) -> None:
        """Take in all changes made to `model` now.

        Every call looks for changes by itself, but one: a single sample computed by kernels looks
        at gravity, and at the rest of the model only when `robot.model` was read since the last
        call. A program that keeps the model and changes it between single samples calls `refresh`.

        Raises:
            DescriptionError, UnknownNameError: As the constructor.

        Example:
            >>> model = chain.model
            >>> model.gravity.linear = np.zeros(3)
            >>> chain.refresh()
            >>> bool(abs(chain.compute_torques(chain.home, [0], [0])) < 1e-12)
            True
        """
        self._current.take_in()

    # --- closures ---------------------------------------------------------------------------

    def residual(self, q: ArrayLike) -> Array:
        """How far the loops are open.

        Args:
            q: Configurations, shape (..., nq).

        Returns:
            f(q) of Eq. (2), shape (..., rows): [m] and [rad], closure after closure.

        Example:
            >>> bool(abs(chain.residual(chain.home)).max() < 1e-12)
            True
        """
        current = self._current
        rows = sum(len(closure.rows) for closure in self.closures)
        array = current.configurations(q)
        return for_each_sample(lambda q: current.evaluated(q).residual(), [array], (1,), (rows,))

    def Phi(self, q: ArrayLike) -> Array:
        """Jacobian of the closures with all rows, redundant ones too, Eqs. (3), (4).

        Args:
            q: Configuration on the closures, shape (nq,).

        Returns:
            Shape (rows, nv).

        Example:
            >>> chain.Phi(chain.home).shape
            (3, 3)
        """
        return self._current.evaluated(q).Phi()

    def Phi_dot(self, q: ArrayLike, q_dot: ArrayLike) -> Array:
        """Rate of `Phi` at rates of the tree that keep the loops closed.

        Args:
            q: Configuration on the closures, shape (nq,).
            q_dot: Rates v of all joints, shape (nv,).

        Returns:
            Shape (rows, nv).

        Example:
            >>> chain.Phi_dot(chain.home, chain.joint_rates(chain.home, [1])).shape
            (3, 3)
        """
        v = single_array("q_dot", q_dot, (self._current.draft.model.nv,))
        return self._current.evaluated(q).Phi_dot(v)

    def condition_number(self, q: ArrayLike) -> float:
        """Condition number of the dependent part of Phi, free of units.

        Infinite where the coordinates do not determine the motion.

        Args:
            q: Configuration on the closures, shape (nq,).

        Example:
            >>> print(round(chain.condition_number(chain.home), 2))
            2.71
        """
        Phi = self._current.scaled_Phi(q)
        return condition_number(Phi, self._current.mechanism(q).coordinates)

    def assemble(
        self,
        q: ArrayLike,
        fixed: Sequence[str] | None = None,
        *,
        tries: int = 1,
        seed: int = 0,
        limits: bool = False,
    ) -> Array:
        """Project a configuration onto the closures by Newton's method.

        Args:
            q: A guess, shape (nq,); of a robot with balls, free or endless joints also the way to
                it from `pin.neutral`, shape (nv,), without quaternions.
            fixed: Names of joints to be held; the coordinates by default, () for none.
            tries: How many starts: the guess, then random ones around it.
            seed: Of the random starts.
            limits: Whether joints of one coordinate stay within the limits of the model.

        Returns:
            A configuration near q with closed loops, shape (nq,).

        Raises:
            ClosureError: When there is none within reach, with the loops that stay open and the
                joints that are at their limits.
            InputError: For a guess of another shape, or with a quaternion that is zero.
            UnknownNameError: For an unknown joint.

        Example:
            >>> q = chain.assemble(chain.home + 0.1)
            >>> bool(abs(chain.residual(q)).max() < 1e-12)
            True
        """
        start, tries = self._current.guess(q), whole_number("tries", tries, 1)
        space = self._current.draft.space
        if fixed is not None:
            held = space.rates_of(names("fixed", fixed))
        else:
            try:
                held = self._current.mechanism().coordinates
            except ClosureError:
                held = self._current.draft.coordinates
        free = np.setdiff1d(np.arange(len(space.rate_names)), held)
        assembly = self._current.reference.workspace.assembly
        return assembly.try_starts(start, free, tries, seed, limits=limits)

    def generic_configuration(self) -> Array:
        """Some assembled configuration away from the symmetric ones, the same at each call.

        It is near `home` where the robot has one: elsewhere it may be assembled in other ways, with
        other degrees of freedom.

        Returns:
            Shape (nq,).

        Raises:
            ClosureError: When none is found.

        Example:
            >>> q = chain.generic_configuration()
            >>> bool(abs(chain.residual(q)).max() < 1e-12)
            True
        """
        return self._current.generic_configuration()

    def mobility(self, q: ArrayLike | None = None) -> Mobility:
        """Count degrees of freedom, redundant closures and motors.

        Args:
            q: Configuration on the closures, shape (nq,); a generic one by default. A mechanism
                can have assembly modes that move in different ways: then look at yours.

        Returns:
            A report that prints readably.

        Raises:
            ClosureError: When q is open, or when no configuration can be assembled.

        Example:
            >>> print(chain.mobility())
            joints              3
            closure equations   3, rank 2, 1 redundant
            degrees of freedom  1
            actuated joints     1 (crank)
            actuation           sufficient, one motor for each degree of freedom
            coordinates         crank
            condition number    2.668 (dependent joints)
            judged at           a random assembled configuration
        """
        return self._current.mobility(q)

    # --- kinematics -------------------------------------------------------------------------

    def joint_rates(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Rates of all joints, v = L va, Eq. (16).

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).

        Returns:
            Shape (..., nv).

        Example:
            >>> chain.joint_rates(chain.home, [1]).round(3)
            array([ 1.   , -1.213,  0.213])
        """
        current = self._current
        mechanism, arrays = current.arguments(q, va=va)
        reference, kernel = current.reference.rates, current.backend.joint_rates
        return by_kernel(current, reference, kernel, arrays, (1, 1), (mechanism.model.nv,))

    def joint_accelerations(self, q: ArrayLike, va: ArrayLike, aa: ArrayLike) -> Array:
        """Accelerations of all joints, L aa + L_dot va, Eqs. (8), (20).

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            aa: Their accelerations, shape (..., n).

        Returns:
            Shape (..., nv).

        Example:
            >>> chain.joint_accelerations(chain.home, [1], [0]).round(3)
            array([-0.   ,  0.561,  0.594])
        """
        mechanism, arrays = self._current.arguments(q, va=va, aa=aa)
        rates = self._current.reference.accelerations_of_tree
        return for_each_sample(rates, arrays, (1, 1, 1), (mechanism.model.nv,))

    def frame_jacobian(self, q: ArrayLike, frame: str) -> Array:
        """Jacobian of a frame along the motions that keep the loops closed.

        Args:
            q: Configurations on the closures, shape (..., nq).
            frame: Its name.

        Returns:
            [linear; angular] velocity per rate of the coordinates, base axes, at the frame's
            origin, shape (..., 6, n).

        Raises:
            UnknownNameError: For an unknown frame.

        Example:
            >>> delta = sst_pin.robots.delta()
            >>> delta.frame_jacobian(delta.home, "platform")[:3].round(3) + 0.0
            array([[-0.106,  0.053,  0.053],
                   [ 0.   , -0.091,  0.091],
                   [-0.05 , -0.05 , -0.05 ]])
        """
        current = self._current
        mechanism, arrays = current.arguments(q)
        index, n = frame_id(mechanism.model, frame), len(mechanism.coordinates)

        def reference(q: Array) -> Array:
            return current.reference.frame_jacobian(q, index)

        kernel = partial(current.backend.frame_jacobian, frame)
        return by_kernel(current, reference, kernel, arrays, (1,), (6, n))

    def frame_jacobian_rate(self, q: ArrayLike, va: ArrayLike, frame: str) -> Array:
        """Rate of `frame_jacobian` on a motion.

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            frame: Its name.

        Returns:
            J_dot, shape (..., 6, n).

        Example:
            >>> delta = sst_pin.robots.delta()
            >>> delta.frame_jacobian_rate(delta.home, [1, 0, 0], "platform").shape
            (6, 3)
        """
        mechanism, arrays = self._current.arguments(q, va=va)
        index = frame_id(mechanism.model, frame)
        return for_each_sample(
            lambda q, va: self._current.reference.frame_jacobian_rate(q, va, index),
            arrays,
            (1, 1),
            (6, len(mechanism.coordinates)),
        )

    def frame_drift(self, q: ArrayLike, va: ArrayLike, frame: str) -> Array:
        """Acceleration of a frame when the coordinates do not accelerate: J_dot va.

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            frame: Its name.

        Returns:
            [linear; angular], base axes, of the frame's origin, shape (..., 6).

        Example:
            >>> delta = sst_pin.robots.delta()
            >>> delta.frame_drift(delta.home, [1, 1, 1], "platform")[:3].round(3)
            array([-0.   , -0.   , -0.142])
        """
        mechanism, arrays = self._current.arguments(q, va=va)
        index = frame_id(mechanism.model, frame)
        return for_each_sample(
            lambda q, va: self._current.reference.frame_drift(q, va, index), arrays, (1, 1), (6,)
        )

    def frame_velocity_derivatives(
        self, q: ArrayLike, va: ArrayLike, frame: str
    ) -> derivatives.FrameVelocityDerivatives:
        """Derivatives of a frame's velocity along the motions that keep the loops closed.

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            frame: Its name.

        Returns:
            `.dq` and `.dva` of the [linear; angular] velocity J va, shapes (..., 6, n).

        Example:
            >>> delta = sst_pin.robots.delta()
            >>> delta.frame_velocity_derivatives(delta.home, [1, 0, 0], "platform").dva.shape
            (6, 3)
        """
        mechanism, arrays = self._current.arguments(q, va=va)
        n, index = len(mechanism.coordinates), frame_id(mechanism.model, frame)
        both = for_each_sample(
            lambda q, va: self._current.reference.derivatives.frame_velocity(q, va, index),
            arrays,
            (1, 1),
            (6, 2 * n),
        )
        return derivatives.FrameVelocityDerivatives(both[..., :n], both[..., n:])

    # --- dynamics ---------------------------------------------------------------------------

    def compute_torques(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        weights: ArrayLike | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """Inverse dynamics: the motor torques of a motion, Eq. (92).

        With more motors than degrees of freedom the smallest torques that bring it about.

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            aa: Accelerations of the coordinates, shape (..., n).
            external_wrenches: [moment; force] that the surroundings exert on each body at its mass
                centre, base axes, bodies in the order of the joints, shape (..., r, 6).
            weights: Of the motors' squared torques, positive, shape (motors,); all one by default.
            out: Array for the result, shape (..., motors).
            threads: How many share a batch in compiled kernels; the reference path takes one.
            on_error: "raise", or "nan": samples that fail become NaN.

        Returns:
            tau, shape (..., motors), [N m] or [N].

        Raises:
            InputError: For a wrong shape or a number that is not finite.
            ClosureError: When q is open.
            SingularConfigurationError: When the coordinates do not determine the motion at q.
            ActuationError: When the motors cannot bring about the motion.

        Example:
            >>> chain.compute_torques(chain.home, [1], [0]).round(3)
            array([0.166])
        """
        current = self._current
        if current.unseen:
            current.look()
        if external_wrenches is weights is None and on_error == "raise":
            answer = current.torques_of(q, va, aa, None, out, threads)
            if answer is not None and answer[0] is None:
                return answer[1]
        mechanism, arrays = current.arguments(q, va=va, aa=aa)
        chosen = None if weights is None else samples.motor_weights(mechanism, weights)

        def reference(q: Array, va: Array, aa: Array, wrenches: Array | None) -> Array:
            return current.reference.torques(q, va, aa, wrenches, chosen)

        return by_kernel(
            current,
            reference,
            current.backend.torques if weights is None else None,
            [*arrays, samples.external_wrenches(mechanism, external_wrenches)],
            (1, 1, 1, 2),
            (mechanism.motors.shape[1],),
            out=out,
            threads=threads,
            on_error=on_error,
        )

    def generalized_forces(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        out: Array | None = None,
        on_error: str = "raise",
    ) -> Array:
        """What a motion needs along the coordinates, whoever supplies it: L^T tau of the tree.

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            aa: Accelerations of the coordinates, shape (..., n).
            external_wrenches: As in `compute_torques`.
            out: Array for the result, shape (..., n).
            on_error: As in `compute_torques`.

        Returns:
            f, shape (..., n), [N m] or [N].

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.

        Example:
            >>> arm = sst_pin.robots.planar_4rrr()
            >>> arm.generalized_forces(arm.home, np.zeros(3), [1, 0, 0]).shape
            (3,)
        """
        current = self._current
        if current.unseen:
            current.look()
        if external_wrenches is None and on_error == "raise":
            answer = current.backend.forces_of(q, va, aa, None, out, 1)
            if answer is not None and answer[0] is None:
                return answer[1]
        mechanism, arrays = current.arguments(q, va=va, aa=aa)
        return by_kernel(
            current,
            current.reference.generalized_forces,
            current.backend.generalized_forces,
            [*arrays, samples.external_wrenches(mechanism, external_wrenches)],
            (1, 1, 1, 2),
            (len(mechanism.coordinates),),
            out=out,
            on_error=on_error,
        )

    def compute_accelerations(
        self,
        q: ArrayLike,
        va: ArrayLike,
        tau: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """Direct dynamics: the accelerations of the coordinates under given torques, Eq. (92).

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            tau: Motor torques, shape (..., motors), [N m] or [N].
            external_wrenches: As in `compute_torques`.
            out: Array for the result, shape (..., n).
            threads: As in `compute_torques`.
            on_error: As in `compute_torques`.

        Returns:
            aa, shape (..., n).

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.

        Example:
            >>> chain.compute_accelerations(chain.home, [0], [0]).round(3)
            array([-32.345])
        """
        current = self._current
        if current.unseen:
            current.look()
        if external_wrenches is None and on_error == "raise":
            answer = current.accelerations_of(q, va, tau, None, out, threads)
            if answer is not None and answer[0] is None:
                return answer[1]
        mechanism, arrays = current.arguments(q, va=va, tau=tau)
        return by_kernel(
            current,
            current.reference.accelerations,
            current.backend.accelerations,
            [*arrays, samples.external_wrenches(mechanism, external_wrenches)],
            (1, 1, 1, 2),
            (len(mechanism.coordinates),),
            out=out,
            threads=threads,
            on_error=on_error,
        )

    def noc(self, q: ArrayLike, va: ArrayLike) -> dynamics.Terms:
        """All matrices of the paper at one configuration: f = I aa + C va - tau^g - tau^f.

        Args:
            q: Configuration on the closures, shape (nq,).
            va: Rates of the coordinates, shape (n,).

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.

        Example:
            >>> terms = robot.noc(robot.home, [1, 0, 0])
            >>> terms.L.shape, terms.K.shape, terms.T.shape
            ((9, 3), (54, 9), (54, 3))
        """
        current = self._current
        single = current.single(q)
        n = len(current.mechanism(single).coordinates)
        return dynamics.terms(current.reference.workspace, single, single_array("va", va, (n,)))

    def reduced_terms(
        self, q: ArrayLike, va: ArrayLike, *, threads: int = 1, on_error: str = "raise"
    ) -> dynamics.ReducedTerms:
        """The equations of motion in the coordinates, for batches, Eqs. (93)-(96).

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            threads: As in `compute_torques`.
            on_error: As in `compute_torques`.

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.

        Example:
            >>> terms = chain.reduced_terms(chain.home, [1])
            >>> terms.inertia.round(4), terms.gravity.round(3)
            (array([[0.0049]]), array([-0.16]))
        """
        current = self._current
        mechanism, arrays = current.arguments(q, va=va)
        n = len(mechanism.coordinates)
        rows = by_kernel(
            current,
            current.reference.reduced_terms,
            current.backend.reduced_terms,
            arrays,
            (1, 1),
            (2 * n * (n + 1),),
            threads=threads,
            on_error=on_error,
        )
        return dynamics.ReducedTerms.of_rows(rows, n)

    # --- derivatives ------------------------------------------------------------------------

    def torque_derivatives(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        sign_width: float = 1e-3,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> derivatives.TorqueDerivatives:
        """Derivatives of `generalized_forces`, the torques where motor k is coordinate k.

        They are those along the motions that keep the loops closed; docs/derivatives.md.

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            aa: Accelerations of the coordinates, shape (..., n).
            external_wrenches: As in `compute_torques`, constant in base axes.
            sign_width: Coulomb friction takes tanh(v / sign_width) for the sign of the rates v,
                positive, [rad/s] or [m/s].
            out: Array for dq, dva and daa side by side, shape (..., n, 3 n).
            threads: As in `compute_torques`.
            on_error: As in `compute_torques`.

        Returns:
            `.dq`, `.dva`, `.daa`, shapes (..., n, n). Column k of dq: q moves by L e_k.

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.

        Example:
            >>> d = chain.torque_derivatives(chain.home, [1], [0])
            >>> d.dq.round(3), d.dva.round(3), d.daa.round(4)
            (array([[0.103]]), array([[0.013]]), array([[0.0049]]))
        """
        rows = samples.derivatives(
            self._current,
            "torque_derivatives",
            (q, va, aa, external_wrenches),
            sign_width,
            out,
            threads,
            on_error,
        )
        return derivatives.TorqueDerivatives.of_rows(rows)

    def acceleration_derivatives(
        self,
        q: ArrayLike,
        va: ArrayLike,
        tau: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        sign_width: float = 1e-3,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> derivatives.AccelerationDerivatives:
        """Derivatives of `compute_accelerations`, its friction smoothed by `sign_width`.

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            tau: Motor torques, shape (..., motors), [N m] or [N].
            external_wrenches: As in `torque_derivatives`.
            sign_width: As in `torque_derivatives`.
            out: Array for dq, dva and dtau side by side, shape (..., n, 2 n + motors).
            threads: As in `compute_torques`.
            on_error: As in `compute_torques`.

        Returns:
            `.dq`, `.dva`, shapes (..., n, n), and `.dtau`, shape (..., n, motors).

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.

        Example:
            >>> tau = chain.compute_torques(chain.home, [0], [0])
            >>> chain.acceleration_derivatives(chain.home, [0], tau).dtau.round(2)
            array([[202.74]])
        """
        rows = samples.derivatives(
            self._current,
            "acceleration_derivatives",
            (q, va, tau, external_wrenches),
            sign_width,
            out,
            threads,
            on_error,
        )
        return derivatives.AccelerationDerivatives.of_rows(rows)

    def linearize(
        self,
        q: ArrayLike,
        va: ArrayLike,
        tau: ArrayLike,
        *,
        dt: float | None = None,
        external_wrenches: ArrayLike | None = None,
        sign_width: float = 1e-3,
        threads: int = 1,
        on_error: str = "raise",
    ) -> tuple[Array, Array]:
        """The motion next to a state, or to each state of a trajectory: x' = A x + B u.

        x is how far the coordinates and va are off, u how far the torques are.

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            tau: Motor torques, shape (..., motors), [N m] or [N].
            dt: Step of the discrete system x_next = A x + B u with u held, [s]: the exponential of
                A and B of the state, exact for the linear system. None for the continuous one.
            external_wrenches: As in `torque_derivatives`.
            sign_width: As in `torque_derivatives`.
            threads: As in `compute_torques`.
            on_error: As in `compute_torques`.

        Returns:
            A, shape (..., 2 n, 2 n), and B, shape (..., 2 n, motors).

        Raises:
            InputError, ClosureError, SingularConfigurationError: As `compute_torques`.

        Example:
            >>> tau = chain.compute_torques(chain.home, [0], [0])
            >>> A, B = chain.linearize(chain.home, [0], tau)
            >>> A.round(2), B.round(2)
            (array([[ -0.  ,   1.  ],
                   [-17.35,  -0.  ]]), array([[  0.  ],
                   [202.74]]))
        """
        rows = samples.derivatives(
            self._current,
            "acceleration_derivatives",
            (q, va, tau, external_wrenches),
            sign_width,
            None,
            threads,
            on_error,
        )
        A, B = samples.linear_system(self._current, q, va, rows)
        return (A, B) if dt is None else derivatives.discrete(A, B, positive_number("dt", dt))

    # --- energy -----------------------------------------------------------------------------

    def kinetic_energy(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Kinetic energy, shape (...), [J]; arguments as `joint_rates`.

        Example:
            >>> print(chain.kinetic_energy(chain.home, [1]).round(4))
            0.0025
        """
        v = self.joint_rates(q, va)
        _, arrays = self._current.arguments(q)
        return for_each_sample(self._current.reference.kinetic_energy, [*arrays, v], (1, 1), ())

    def potential_energy(self, q: ArrayLike) -> Array:
        """Potential energy of weights and springs, shape (...), [J].

        The weights' is zero with all masses at the origin, the springs' at their reference.

        Args:
            q: Configurations, shape (..., nq).

        Example:
            >>> print(chain.potential_energy(chain.home).round(3))
            3.106
        """
        current = self._current
        current.look()
        array = finite_array("q", q, (current.draft.model.nq,))
        return for_each_sample(current.reference.potential_energy, (array,), (1,), ())

    def friction_power(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Power of friction in all joints, Eq. (87), negative or zero, shape (...), [W].

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).

        Example:
            >>> print(chain.friction_power(chain.home, [1]))  # without friction
            0.0
        """
        v = self.joint_rates(q, va)
        return finite_array("power", (self.friction.forces(v) * v).sum(axis=-1), ())

    def motor_rates(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Rates against which the motors work, shape (..., motors); arguments as `joint_rates`.

        Example:
            >>> chain.motor_rates(chain.home, [1])
            array([1.])
        """
        return np.asarray(self.joint_rates(q, va) @ self._current.mechanism().motors)

    # --- doors to the rooms above -----------------------------------------------------------

    def compile(self, q: ArrayLike | None = None, *, derivatives: bool = False) -> None:
        """Have the dynamics computed by kernels made for this robot.

        They are generated as C, compiled by the system's compiler (or that of the package ziglang)
        and kept in the user's cache folder, where the next start finds them. The geometry, the
        closures, the motors, and which bodies have mass and which joints friction, springs or
        rotors is folded in; the numbers of these, and gravity, change without compiling again.
        Samples that a kernel does not vouch for take the reference path. A copy, or the robot
        unpickled elsewhere, looks for its kernels there; `path` says what computes.

        Args:
            q: Configuration on the closures, shape (nq,), from around which the order of
                elimination is chosen; a generic one by default, around `home` for a robot of the
                gallery. Give one of yours when the mechanism has assembly modes that move in
                different ways.
            derivatives: Whether to have those of the dynamics ready too. They take longer to
                compile (docs/derivatives.md tells how long), and else are made at their first use.

        Raises:
            CompilationError: Without a compiler, or when it fails.
            MissingExtraError: Without CasADi, `sst-pin[compile]`.
            DescriptionError: For a joint without compiled equations.
            ClosureError: When q is open, or when no configuration can be assembled.
            SingularConfigurationError: When the coordinates do not fix the motion there.

        Example:
            >>> chain.compile()
            >>> chain.path
            'compiled kernels: avx512, 8 samples at once'
        """
        from ..compiled.backend import DERIVATIVES, FIRST, CompiledBackend

        current = self._current
        near = None if q is None else current.single(q)
        current.mechanism(near)
        kernels = FIRST + DERIVATIVES if derivatives else FIRST
        make = partial(CompiledBackend.make, names=kernels)
        current.compute_by(partial(CompiledBackend, near=near), make)

    def casadi(
        self,
        q: ArrayLike | None = None,
        *,
        external_wrenches: bool = False,
        sign_width: float = 1e-3,
        compiled: bool = False,
    ) -> CasadiFunctions:
        """The dynamics as functions of CasADi, for its optimisers, with exact derivatives.

        Args:
            q: As in `compile`.
            external_wrenches: Whether the dynamics take them as their last input, shape (r, 6).
            sign_width: Coulomb friction takes tanh(v / sign_width) for the sign of the rates v,
                positive, [rad/s] or [m/s].
            compiled: Whether they are compiled C with derivatives of first order, made as each is
                asked for and kept as `compile` keeps its kernels; else they need no compiler and
                have derivatives of every order.

        Returns:
            `.torques`, `.accelerations`, `.rates`, `.residual`, `.step` and more; see
            `sst_pin.compiled.casadi_functions.CasadiFunctions`.

        Raises:
            MissingExtraError: Without CasADi, `sst-pin[compile]`.
            CompilationError: When one is asked for that cannot be compiled.
            DescriptionError, ClosureError, SingularConfigurationError: As `compile`.

        Example:
            >>> functions = robot.casadi()
            >>> functions.torques
            Function(torques:(q[9],va[3],aa[3])->(tau[3]) SXFunction)
            >>> functions.residual.size_out(0)
            (6, 1)
        """
        try:
            from ..compiled.casadi_functions import CasadiFunctions
        except ModuleNotFoundError:
            raise MissingExtraError("casadi", "compile") from None
        current = self._current
        near = None if q is None else current.single(q)
        current.mechanism(near)
        width = positive_number("sign_width", sign_width)
        return CasadiFunctions(current.reference, near, width, external_wrenches, compiled)

    def jax(self, *, sign_width: float = 1e-3) -> JaxFunctions:
        """The dynamics as functions of JAX, for `jit`, `vmap` and `grad`, on processors.

        JAX calls back into this process, where this chain computes. So `compile` before.

        Args:
            sign_width: Coulomb friction takes tanh(v / sign_width) for the sign of the rates v in
                derivatives, positive, [rad/s] or [m/s].

        Returns:
            `.torques`, `.generalized_forces` and `.accelerations`; see
            `sst_pin.compiled.jax_functions.JaxFunctions`.

        Raises:
            MissingExtraError: Without JAX, `sst-pin[jax]`.
            InputError: While JAX computes in single precision.
            DescriptionError: For coordinates that are no single entries of q (a ball).

        Example:
            >>> import jax
            >>> jax.config.update("jax_enable_x64", True)
            >>> torques = jax.jit(chain.jax().torques)
            >>> torques(chain.home, [1], [0]).round(3).tolist()
            [0.166]
        """
        try:
            from ..compiled.jax_functions import JaxFunctions
        except ModuleNotFoundError:
            raise MissingExtraError("jax", "jax") from None
        return JaxFunctions(self, positive_number("sign_width", sign_width))

    @classmethod
    def from_urdf(
        cls: type[_Chain],
        path: str | Path,
        cuts: str | Path | None = None,
        *,
        actuated: Sequence[Motor] | None = None,
        locked: Sequence[str] = (),
    ) -> _Chain:
        """A robot from a URDF and, beside it, what a URDF cannot say: the "extended URDF" of LAAS.

        A YAML file lists closures (`closed_loop`, pairs of frames, each with its `type`), motors
        (`name_mot`) and, where needed, `gravity` and joints that really are "FIXED", "SPHERICAL"
        or "UJOINT_XY" (`joint_name`, `joint_type`). A file that lists no closures has those of the
        URDF's frames `closing_NAME_1`, `closing_NAME_2`, points that coincide. Joints that mimic
        others are coupled to them. Named configurations, `home` among them, are those of the file
        beside the URDF that ends in .srdf, where there is one.

        Args:
            path: The URDF; its meshes are not needed.
            cuts: The YAML; by default the file beside the URDF that ends in .yaml.
            actuated: The motors, as in the constructor; those of the YAML by default.
            locked: Names of joints that are held at zero. A locked motor is none.

        Raises:
            DescriptionError: When a file cannot be read, with every problem found.
            UnknownNameError: For a joint or frame that is not in the URDF.

        Example:
            >>> sst_pin.ClosedChain.from_urdf(sst_pin.URDF_PATH).motor_names
            ('gamma_1', 'gamma_2', 'gamma_3')
        """
        from .. import reading
        from ..reading.shapes import UrdfShapes

        model, closures, motors = reading.read_urdf(path, cuts, locked)
        chain = cls(model, closures, motors if actuated is None else actuated)
        chain._shapes = UrdfShapes(reading.read_text(path, "URDF"), Path(path).parent)
        return chain

    @classmethod
    def from_mjcf(
        cls: type[_Chain],
        path: str | Path,
        *,
        actuated: Sequence[Motor] | None = None,
        locked: Sequence[str] = (),
    ) -> _Chain:
        """A robot from a MuJoCo file, its loops closed by its equalities.

        MuJoCo compiles the file; `connect`, `weld`, `joint` and `tendon` equalities are read, with
        springs, dampers, friction losses and armatures of the joints. The motors are the joints and
        the fixed tendons that have an actuator; tau is the force in the joint or the tendon, gear
        times control for a `motor`. Hinges and slides count as in `qpos`; of balls and free joints
        q has the quaternion with its scalar last, and v the linear rates along the body's axes.
        Named keyframes are the model's `referenceConfigurations`, `home` is that of this name.

        Args:
            path: The MJCF.
            actuated: The motors, as in the constructor; those of the file by default.
            locked: Joints held at their reference. A joint without a name is called like its body.
                `name_X`, `name_Y`, `name_Z` hold a ball about one axis. A locked motor is none.

        Raises:
            MissingExtraError: Without MuJoCo, `sst-pin[mjcf]`.
            DescriptionError: With every problem found.
            UnknownNameError: For a name in `locked` that no joint has.

        Example:
            >>> sst_pin.ClosedChain.from_mjcf(sst_pin.MJCF_PATH).motor_names
            ('gamma_1', 'gamma_2', 'gamma_3')
        """
        from ..reading.mjcf import read_mjcf
        from ..reading.shapes import MjcfShapes

        read = read_mjcf(path, locked)
        chain = cls(
            read.model,
            read.closures,
            read.actuated if actuated is None else actuated,
            stiffness=read.stiffness,
            spring_reference=read.spring_reference,
        )
        chain._shapes = MjcfShapes(Path(path).absolute(), tuple(locked))
        return chain

    def trajectory(
        self,
        t: ArrayLike,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        tau: ArrayLike | None = None,
        *,
        stopped: str = "",
    ) -> Trajectory:
        """A motion of this robot as a value.

        Args:
            t: Times, increasing, shape (N,), [s].
            q: Configurations on the closures, shape (N, nq).
            va: Rates of the coordinates, shape (N, n).
            aa: Accelerations of the coordinates, shape (N, n).
            tau: Motor torques, shape (N, motors); those of the motion by default.
            stopped: Why it ends early.

        Example:
            >>> motion = chain.trajectory([0, 1], [chain.home] * 2, [[0]] * 2, [[0]] * 2)
            >>> motion.tau.round(3)
            array([[0.16],
                   [0.16]])
        """
        from ..motion.trajectories import Trajectory

        mechanism = self._current.mechanism()
        space = mechanism.space
        return Trajectory(
            t,
            q,
            va,
            aa,
            self.compute_torques(q, va, aa) if tau is None else tau,
            space.position_names,
            self.motor_names,
            space.position_units,
            stopped,
            coordinates=mechanism.coordinate_rate_names,
            rate_units=tuple(space.rate_units[k] for k in mechanism.coordinates),
            torque_units=space.force_units(mechanism.motors),
        )

    def simulate(
        self,
        torque: Torque,
        q0: ArrayLike,
        va0: ArrayLike,
        t: ArrayLike,
        *,
        external_wrenches: Load = None,
        method: str = "DOP853",
        rtol: float = 1e-12,
        atol: float = 1e-12,
        max_condition_number: float = 1e4,
        sign_width: float = 1e-3,
        progress: Callable[[float], None] | None = None,
    ) -> Trajectory:
        """Integrate the motion under given torques; see `sst_pin.motion.simulation.simulate`.

        Example:
            >>> motion = chain.simulate([0], chain.home, [0], np.linspace(0, 0.1, 11))
            >>> motion.q.shape
            (11, 3)
        """
        from ..motion.simulation import simulate

        return simulate(
            self,
            torque,
            q0,
            va0,
            t,
            external_wrenches=external_wrenches,
            method=method,
            rtol=rtol,
            atol=atol,
            max_condition_number=max_condition_number,
            sign_width=sign_width,
            progress=progress,
        )

    def rollout(
        self,
        tau: ArrayLike,
        q0: ArrayLike,
        va0: ArrayLike,
        dt: float,
        *,
        external_wrenches: ArrayLike | None = None,
        steps: int | None = None,
        sign_width: float = 1e-3,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Rollout:
        """Integrate many motions with a fixed step; see `sst_pin.motion.rollouts.rollout`.

        Example:
            >>> motion = chain.rollout(np.zeros((5, 100, 1)), chain.home, [0], dt=0.001)
            >>> motion.q.shape
            (5, 101, 3)
        """
        from ..motion.rollouts import rollout

        return rollout(
            self,
            tau,
            q0,
            va0,
            dt,
            external_wrenches=external_wrenches,
            steps=steps,
            sign_width=sign_width,
            threads=threads,
            on_error=on_error,
        )

    # --- pictures ---------------------------------------------------------------------------

    @property
    def visual_model(self) -> pin.GeometryModel:
        """Shapes of the bodies, as Pinocchio has them: those of the URDF or the MJCF, or yours.

        They are loaded at each call; there are none where nobody has given any. Assign a
        `pinocchio.GeometryModel` of your own to have it shown.

        Raises:
            DescriptionError: When a mesh cannot be loaded.

        Example:
            >>> [shape.name for shape in chain.visual_model.geometryObjects]
            ['crank_0', 'coupler_0', 'rocker_0']
        """
        return self._shapes(self.model) if callable(self._shapes) else self._shapes

    @visual_model.setter
    def visual_model(self, shapes: pin.GeometryModel) -> None:
        if not isinstance(shapes, pin.GeometryModel):
            kind = type(shapes).__name__
            raise InputError("visual_model", f"a pinocchio.GeometryModel is needed, not {kind}")
        self._shapes = shapes

    def show(
        self,
        what: Trajectory | ArrayLike | None = None,
        *,
        speed: float = 1.0,
        open_browser: bool = True,
    ) -> Viewer:
        """A motion or a configuration in the browser; in Jupyter, in the notebook.

        Args:
            what: A motion, or a configuration, shape (nq,); the home pose by default, or where
                there is none an assembled configuration.
            speed: Of a motion, 1 is real time.
            open_browser: Whether to serve the page and open the browser; never from Jupyter.

        Returns:
            The viewer; `save` writes the page, a picture or an animation, `close` ends serving.

        Raises:
            MissingExtraError: Without what `sst-pin[viz]` brings.
            DescriptionError: When a mesh cannot be loaded.
            InputError: For another robot's motion.

        Example:
            >>> viewer = chain.show(open_browser=False)
            >>> viewer.save("robot.html", force=True)
            >>> viewer.close()
        """
        from ..viewer import show

        return show(self, what, speed, open_browser)

    # --- inside -----------------------------------------------------------------------------

    #: Called with each model that is taken in; an SST reads its geometry, or refuses it.
    _examine: Callable[[pin.Model], Any] = staticmethod(_anything_goes)

    def __copy__(self: _Chain) -> _Chain:
        twin = type(self).__new__(type(self))
        twin.__dict__.update(self.__dict__, _current=copy(self._current))
        return twin

    def __setattr__(self, name: str, value: object) -> None:
        require_assignable(self, name)
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        return as_text(*self._summary())

    def _repr_html_(self) -> str:
        return as_html(*self._summary())

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """What it is, in a few rows; nothing is assembled for them."""
        draft = self._current.draft
        title = f"{type(self).__name__} {draft.model.name}"
        computing = [("computed by", str(self._current.backend))] if self._current.settled else []
        return title, [
            ("joints", f"{len(self.joint_names)} ({listed(self.joint_names)})"),
            ("closures", f"{len(self.closures)} ({listed([str(c) for c in self.closures], 3)})"),
            ("motors", f"{len(self.motor_names)} ({listed(self.motor_names)})"),
            ("sizes", f"nq = {draft.model.nq}, nv = {draft.model.nv}"),
            *computing,
        ]

    def states(self, sign_width: float, q: ArrayLike) -> States:
        """The state space for an integrator.

        Args:
            sign_width: By which the sign of friction is smoothed.
            q: Where motions start, shape (..., nq).

        Example:
            >>> states = chain.states(1e-3, chain.home)
        """
        self._current.mechanism(q)
        return self._current.backend.states(replace(self.friction, sign_width=sign_width))

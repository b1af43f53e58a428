# SPDX-License-Identifier: BSD-2-Clause
"""`Engine`: computes the quantities of one mechanism, by compiled kernels or the reference path."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Any, Protocol, TypedDict, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .arrays import Array, finite_array, for_each_sample, positive_number
from .dynamics import regressor
from .dynamics.derivatives import (
    AccelerationDerivatives,
    FrameVelocityDerivatives,
    TorqueDerivatives,
)
from .dynamics.dynamics import ReducedTerms
from .dynamics.quantities import Name, Quantity
from .dynamics.reactions import Reactions, axes_of, compliances_of, size_of, unpacked
from .dynamics.reference import Reference
from .dynamics.torque_sharing import preload_directions, weights_of
from .engine_arguments import EngineArguments, Wrenches
from .engine_paths import EnginePaths
from .errors import ClosureError, InputError, SingularConfigurationError
from .kernel_protocols import Kernel, Kernels
from .loops.closed_loops import ClosedLoops
from .model.mechanism import Mechanism
from .model.tree import frame_id
from .states import StateSpace

if TYPE_CHECKING:
    from typing_extensions import Unpack

#: The class of the result of `Engine._derivatives`.
DerivativesT = TypeVar("DerivativesT", TorqueDerivatives, AccelerationDerivatives)

#: `Quantity`, made once for equal arguments: making one takes as long as a small kernel. The cache
#: is bounded, because callers may vary `sign_width`.
_key = lru_cache(maxsize=1024)(Quantity)


class Options(TypedDict, total=False):
    """How samples are computed."""

    out: Array | None
    threads: int
    on_error: str


class LoadOptions(Options, total=False):
    """Loads besides the weights, and how samples are computed."""

    platform_moment: ArrayLike | None
    external_wrenches: Wrenches | None


class DerivativeOptions(Options, total=False):
    """Loads and the smoothing of friction, and how samples are computed."""

    external_wrenches: Wrenches | None
    sign_width: float


class Robot(Protocol):
    """A robot as public functions of lower packages see it: they use its engine only."""

    @property
    def engine(self) -> Engine: ...  # noqa: D102


def require_robot(name: str, value: object) -> None:
    """Refuse an argument `name` of a public function that is not a robot."""
    if isinstance(value, type):
        raise InputError(name, f"the class {value.__name__} is not a robot; make one first")
    if not isinstance(getattr(value, "engine", None), Engine):
        text = "a robot is needed, such as sst_pin.ClosedChain.from_urdf(path)"
        raise InputError(name, f"a {type(value).__name__} is not a robot; {text}")


class Engine:
    """Computes the quantities of one mechanism. An engine never changes.

    Each quantity has a method, with the arguments that `ClosedChain` describes. The method says
    what is computed. `EnginePaths` chooses the path: it asks the kernel of the quantity, by
    `Kernel.answer`, before it checks arguments; the reference path computes the samples that
    kernels do not.

    In control loops `ClosedChain` asks `Kernel.answer` itself (by `torque_kernel` and so on).
    Without an answer it calls the method with `ask_kernel=False`, so that the kernel is not asked
    again.

    Args:
        mechanism: The mechanism.
        make_kernels: Makes its kernels at their first use; None to compute by the reference path.
        kernels: What `make_kernels` makes, if it exists already. Pickling leaves it out.
        platform: Name of the frame whose body a `platform_moment` acts on.

    Attributes:
        reference: The reference path. It owns the loops and Pinocchio's data of each thread.
        loops: Closes the loops and evaluates them.
        arguments: Checks arguments.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        make_kernels: Callable[[Reference], Kernels] | None = None,
        kernels: Kernels | None = None,
        platform: str = "platform",
    ) -> None:
        self.mechanism = mechanism
        self.make_kernels = make_kernels
        self.platform = platform
        reference = Reference(mechanism)
        self.reference = reference
        # A function in place of an assembly: each thread has its own.
        self.loops = ClosedLoops(mechanism, lambda: reference.context.assembly)
        self.arguments = EngineArguments(mechanism, self.loops, platform)
        self._n = len(mechanism.coordinates)
        self._motors = mechanism.motor_count
        self._paths = EnginePaths(mechanism, reference, self.arguments, make_kernels, kernels)

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickled, (self.mechanism, self.make_kernels, self.platform)

    # --- what computes ----------------------------------------------------------------------

    @property
    def kernels(self) -> Kernels | None:
        """The compiled kernels; None where the reference path computes everything."""
        return self._paths.kernels

    @property
    def backend(self) -> str:
        """A sentence that says which backend is in use, and why."""
        return self._paths.backend

    def kernel(self, key: Quantity) -> Kernel | None:
        """The kernel of a quantity; None where the reference path computes it."""
        return self._paths.kernel(key)

    # Control loops call these directly: one more Python function would cost a third of the time.

    @cached_property
    def torque_kernel(self) -> Callable[..., Array | None] | None:
        """`Kernel.answer` of the torques."""
        kernel = self.kernel(Quantity("torques"))
        return None if kernel is None else kernel.answer

    @cached_property
    def force_kernel(self) -> Callable[..., Array | None] | None:
        """`Kernel.answer` of the generalized forces."""
        kernel = self.kernel(Quantity("generalized_forces"))
        return None if kernel is None else kernel.answer

    @cached_property
    def acceleration_kernel(self) -> Callable[..., Array | None] | None:
        """`Kernel.answer` of the accelerations."""
        kernel = self.kernel(Quantity("accelerations"))
        return None if kernel is None else kernel.answer

    # --- dynamics ---------------------------------------------------------------------------

    def torques(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        weights: ArrayLike | None = None,
        ask_kernel: bool = True,
        **options: Unpack[LoadOptions],
    ) -> Array:
        """Motor torques of a motion, shape (..., motors)."""
        of_sample: Callable[..., Array] = self.reference.torques
        if weights is not None:  # no kernel computes torques with weights
            of_sample = partial(of_sample, weights=weights_of(self.mechanism, weights))
        return self._paths.under_loads(
            _key("torques"),
            of_sample,
            (self._motors,),
            q,
            {"va": va, "aa": aa},
            kernel_exists=weights is None,
            ask_kernel=ask_kernel,
            **options,
        )

    def generalized_forces(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        ask_kernel: bool = True,
        **options: Unpack[LoadOptions],
    ) -> Array:
        """Forces along the coordinates that a motion needs, shape (..., n)."""
        key = _key("generalized_forces")
        of_sample = self.reference.generalized_forces
        vectors = {"va": va, "aa": aa}
        return self._paths.under_loads(
            key, of_sample, (self._n,), q, vectors, ask_kernel=ask_kernel, **options
        )

    def accelerations(
        self,
        q: ArrayLike,
        va: ArrayLike,
        tau: ArrayLike,
        *,
        ask_kernel: bool = True,
        **options: Unpack[LoadOptions],
    ) -> Array:
        """Accelerations of the coordinates for torques, shape (..., n)."""
        key = _key("accelerations")
        of_sample = self.reference.accelerations
        vectors = {"va": va, "tau": tau}
        return self._paths.under_loads(
            key, of_sample, (self._n,), q, vectors, ask_kernel=ask_kernel, **options
        )

    def reduced_terms(
        self, q: ArrayLike, va: ArrayLike, **options: Unpack[Options]
    ) -> ReducedTerms:
        """Mass matrix, Coriolis matrix, gravity and friction in the coordinates."""
        n = self._n
        key = _key("reduced_terms")
        of_sample = self.reference.reduced_terms
        size = 2 * n * (n + 1)  # two matrices and two vectors
        numbers = self._paths.without_loads(key, of_sample, (size,), q, {"va": va}, **options)
        return ReducedTerms.of_rows(numbers, n)

    def torque_regressor(
        self, q: ArrayLike, va: ArrayLike, aa: ArrayLike, **options: Unpack[Options]
    ) -> Array:
        """Y, shape (..., n, p): generalized forces are Y times the dynamic parameters."""
        key = _key("torque_regressor")
        of_sample = self.reference.torque_regressor
        shape = self._n, regressor.size_of(self.mechanism)
        return self._paths.without_loads(key, of_sample, shape, q, {"va": va, "aa": aa}, **options)

    def reactions(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike | None,
        tau: ArrayLike | None,
        stiffness: Mapping[str, ArrayLike] | None,
        axes: ArrayLike | None = None,
        **options: Unpack[LoadOptions],
    ) -> Reactions:
        """Wrenches in all joints and closures; `out` gets those of joints, then of closures."""
        out = options.pop("out", None)
        of_sample: Callable[..., Array] = self.reference.reactions
        if axes is not None:
            of_sample = partial(of_sample, axes=axes_of(axes))
        shape = (size_of(self.mechanism),)
        kernel_exists = stiffness is None and axes is None
        numbers = self._reaction_numbers(
            of_sample, shape, kernel_exists, q, va, aa, tau, stiffness, **options
        )
        return unpacked(self.mechanism, numbers, stiffness is not None, out)

    def unique_forces(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike | None,
        tau: ArrayLike | None,
        stiffness: Mapping[str, ArrayLike] | None,
    ) -> tuple[Array, Array]:
        """The unique parts of the forces of `reactions`, shape (..., r + closures, 3).

        r is the number of joints. The second result is the number of directions along which a force
        is not unique, shape (..., r + closures).
        """
        count = self.mechanism.model.njoints - 1 + len(self.mechanism.closures)
        of_sample = self.reference.unique_forces
        shape = (4 * count,)  # for each joint and closure three components, and the number
        kernel_exists = False
        numbers = self._reaction_numbers(of_sample, shape, kernel_exists, q, va, aa, tau, stiffness)
        table = numbers.reshape(*numbers.shape[:-1], count, 4)
        return table[..., :3], table[..., 3]

    def _reaction_numbers(
        self,
        of_sample: Callable[..., Array],
        shape: tuple[int, ...],
        kernel_exists: bool,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike | None,
        tau: ArrayLike | None,
        stiffness: Mapping[str, ArrayLike] | None,
        **options: Unpack[LoadOptions],
    ) -> Array:
        """Results of `of_sample(q, va, aa, tau, wrenches, compliances)`, shape (..., *shape).

        The caller gives either aa or tau; the other one is None and is computed first. `of_sample`
        gets both: where motors work against each other, aa alone does not determine tau.
        """
        if (aa is None) == (tau is None):
            raise InputError("aa, tau", "one of them is needed, not both")
        if aa is None:
            assert tau is not None
            aa = self.accelerations(q, va, tau, **options)
        if stiffness is not None:
            compliances = compliances_of(self.mechanism, stiffness)
            of_sample = partial(of_sample, compliances=compliances)
        vectors = {"va": va, "aa": aa}
        if self.mechanism.driven_one_to_one:
            # `of_sample` computes tau from aa: here aa determines tau.
            of_sample = _without_torques(of_sample)
        else:
            vectors["tau"] = self.torques(q, va, aa, **options) if tau is None else tau
        return self._paths.under_loads(
            _key("reactions"),
            of_sample,
            shape,
            q,
            vectors,
            kernel_exists=kernel_exists,
            **options,
        )

    # --- derivatives ------------------------------------------------------------------------

    def torque_derivatives(
        self, q: ArrayLike, va: ArrayLike, aa: ArrayLike, **options: Unpack[DerivativeOptions]
    ) -> TorqueDerivatives:
        """Derivatives of generalized forces by q, va and aa; `out` has them side by side."""
        return self._derivatives(
            TorqueDerivatives,
            "torque_derivatives",
            self.reference.torque_derivatives,
            (self._n, 3 * self._n),
            q,
            {"va": va, "aa": aa},
            **options,
        )

    def acceleration_derivatives(
        self, q: ArrayLike, va: ArrayLike, tau: ArrayLike, **options: Unpack[DerivativeOptions]
    ) -> AccelerationDerivatives:
        """Derivatives of accelerations by q, va and tau; `out` has them side by side."""
        return self._derivatives(
            AccelerationDerivatives,
            "acceleration_derivatives",
            self.reference.acceleration_derivatives,
            (self._n, 2 * self._n + self._motors),
            q,
            {"va": va, "tau": tau},
            **options,
        )

    def displacement_rates(self, q: ArrayLike, va: ArrayLike, **options: Unpack[Options]) -> Array:
        """D, shape (..., n, n): x_dot = dva + D x for displacements x from a motion.

        A second motion lies beside a first one: x is its small displacement from the first motion,
        in the coordinates, and dva are its rates va minus those of the first motion. `linearize`
        uses D.

        In these steps S selects the coordinates from the rates of all joints, and [a, b] is the
        bracket of twists:

        - The displacement of all joints is d = L x. In the coordinates it is S d = x, so that
          S d_dot = x_dot.
        - Small displacements do not commute. If the first motion has the rates v about axes of the
          body, the second one has the rates v + d_dot + [v, d].
        - In the coordinates, their difference is dva = S (d_dot + [v, d]) = x_dot + S [v, L x].
        - So x_dot = dva - S [v, L x], and column k of D is -S [v, L e_k].

        D differs from zero only if coordinates are rates whose axes turn with the body, such as
        those of balls.
        """
        key = _key("displacement_rates")
        of_sample = self.reference.displacement_rates
        return self._paths.without_loads(
            key, of_sample, (self._n, self._n), q, {"va": va}, **options
        )

    def _derivatives(
        self,
        kind: type[DerivativesT],
        name: Name,
        of_sample: Callable[..., Array],
        shape: tuple[int, int],
        q: ArrayLike,
        vectors: Mapping[str, ArrayLike],
        *,
        external_wrenches: Wrenches | None = None,
        sign_width: float = 1e-3,
        **options: Unpack[Options],
    ) -> DerivativesT:
        """Derivatives of one kind, with the sign of Coulomb friction smoothed.

        `vectors` has va, and then aa or tau.
        """
        key = _key(name, sign_width=positive_number("sign_width", sign_width))
        # `Kernel.derivatives` returns an object of this kind, and takes no wrenches and no options.
        # With wrenches or options, `under_loads` below asks `Kernel.answer`, which returns the same
        # derivatives as an array.
        returns_object = external_wrenches is None and not options
        kernel = self.kernel(key) if returns_object else None
        if kernel is not None:
            second, third = vectors.values()
            one_thread = 1
            answer: DerivativesT | None = kernel.derivatives(kind, q, second, third, one_thread)
            if answer is not None:
                return answer
        # For wrenches at frames, the derivative by q has another term: `slope` is the part of the
        # derivative of their forces that `under_loads` leaves out. It and the inertia are computed
        # before the derivatives, because `out` may share memory with the arguments.
        slope: Array | None = None
        inertia: Array | None = None
        if isinstance(external_wrenches, Mapping):
            policy = options.get("on_error", "raise")
            slope = self._slope_of_arms(external_wrenches, q, policy)
            if kind is AccelerationDerivatives:
                inertia = self.reduced_terms(q, vectors["va"], on_error=policy).inertia
        matrices = self._paths.under_loads(
            key,
            partial(of_sample, sign_width=key.sign_width),
            shape,
            q,
            vectors,
            ask_kernel=not returns_object,
            external_wrenches=external_wrenches,
            **options,
        )
        matrices = np.asarray(matrices)  # a plain view: `out` may be of a subclass of arrays
        n = self._n
        by_q = matrices[..., :n]
        by_v = matrices[..., n : 2 * n]
        by_input = matrices[..., 2 * n :]  # by aa, or by tau
        # The sums are in place, so that `out` has them too.
        if slope is not None and inertia is None:
            # The wrenches supply a part of the forces f that the motion needs.
            by_q -= slope
        elif slope is not None and inertia is not None:
            # The accelerations are M^-1 (... - f). A sample with an error is NaN, whatever is added
            # to it, and its M may be singular: it is replaced by the identity.
            is_nan = np.asarray(np.isnan(by_q).any(axis=(-2, -1)))
            M = np.where(is_nan[..., None, None], np.eye(n), inertia)
            by_q += np.linalg.solve(M, slope)
        return kind(by_q, by_v, by_input)

    def _slope_of_arms(
        self, wrenches: Mapping[str, ArrayLike], q: ArrayLike, on_error: str
    ) -> Array:
        """A part of the derivative by q of the generalized forces of wrenches, shape (..., n, n).

        `EngineArguments.wrenches` moves a wrench from its frame to the mass centre of the body: it
        adds the moment arm x force, with the arm from the mass centre to the frame.
        `under_loads` differentiates for constant wrenches at the mass centres. But the arm turns
        with the body, and so the moment changes: this change is the part computed here.
        """
        slope = np.zeros((self._n, self._n))
        for name, value in wrenches.items():
            _, wrench = self.arguments.at_frame(name, value, on_error)
            arm = self.arguments.arms(name, q)
            J = self.frame_jacobian(q, name, on_error=on_error)[..., 3:, :]  # angular, (..., 3, n)
            # The arm r of a body with the angular velocity w has the rate w x r, and the moment
            # r x force has the rate (w x r) x force. At the unit rate of coordinate k, w is column
            # k of J. Rows of these arrays are coordinates, shape (..., n, 3).
            rates_of_arm = np.cross(J.mT, arm[..., None, :])
            rates_of_moment = np.cross(rates_of_arm, wrench[..., None, :3])
            slope = slope + J.mT @ rates_of_moment.mT
        return slope

    # --- kinematics -------------------------------------------------------------------------

    def joint_rates(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Rates of all joints, v = L va, shape (..., nv)."""
        shape = (self.mechanism.model.nv,)
        return self._paths.without_loads(_key("rates"), self.reference.rates, shape, q, {"va": va})

    def joint_accelerations(self, q: ArrayLike, va: ArrayLike, aa: ArrayLike) -> Array:
        """Accelerations of all joints, L aa + L_dot va, shape (..., nv)."""
        key = _key("joint_accelerations")
        of_sample = self.reference.joint_accelerations
        shape = (self.mechanism.model.nv,)
        return self._paths.without_loads(key, of_sample, shape, q, {"va": va, "aa": aa})

    def actuator_jacobian(self, q: ArrayLike, **options: Unpack[Options]) -> Array:
        """J, shape (..., motors, n): the motors' rates are J va."""
        key = _key("actuator_jacobian")
        of_sample = self.reference.actuator_jacobian
        return self._paths.without_loads(key, of_sample, (self._motors, self._n), q, {}, **options)

    def frame_jacobian(self, q: ArrayLike, frame: str, **options: Unpack[Options]) -> Array:
        """J, shape (..., 6, n): a frame's [linear; angular] velocity is J va."""
        key = self._frame_key("frame_jacobian", frame)
        of_sample = self.reference.frame_jacobian
        return self._paths.without_loads(key, of_sample, (6, self._n), q, {}, **options)

    def frame_jacobian_rate(
        self, q: ArrayLike, va: ArrayLike, frame: str, **options: Unpack[Options]
    ) -> Array:
        """Rate of `frame_jacobian` along a motion, shape (..., 6, n)."""
        key = self._frame_key("frame_jacobian_rate", frame)
        of_sample = self.reference.frame_jacobian_rate
        return self._paths.without_loads(key, of_sample, (6, self._n), q, {"va": va}, **options)

    def frame_drift(
        self, q: ArrayLike, va: ArrayLike, frame: str, **options: Unpack[Options]
    ) -> Array:
        """[linear; angular] acceleration of a frame for aa = 0, shape (..., 6)."""
        key = self._frame_key("frame_drift", frame)
        of_sample = self.reference.frame_drift
        return self._paths.without_loads(key, of_sample, (6,), q, {"va": va}, **options)

    def frame_velocity_derivatives(
        self, q: ArrayLike, va: ArrayLike, frame: str, **options: Unpack[Options]
    ) -> FrameVelocityDerivatives:
        """Derivatives of a frame's velocity by q and va; `out` has them side by side."""
        key = self._frame_key("frame_velocity_derivatives", frame)
        of_sample = self.reference.frame_velocity_derivatives
        both = self._paths.without_loads(key, of_sample, (6, 2 * self._n), q, {"va": va}, **options)
        return FrameVelocityDerivatives(dq=both[..., : self._n], dva=both[..., self._n :])

    def _frame_key(self, name: Name, frame: Any) -> Quantity:
        """The key of a quantity of a frame.

        Anything but a name is refused here, because keys must be hashable. An unknown name is
        refused later, by `Kernels.kernel` or when the arguments are checked.
        """
        if not isinstance(frame, str):
            frame_id(self.mechanism.model, frame)  # raises the error
        return _key(name, frame)

    # --- quantities without kernels ---------------------------------------------------------

    def preload_directions(self, q: ArrayLike, on_error: str = "raise") -> Array:
        """Motor torques that move nothing, shape (..., motors, k)."""
        J = self.actuator_jacobian(q, on_error=on_error)
        if self.mechanism.driven_one_to_one:
            return np.zeros((*J.shape[:-1], 0))
        # Any basis of the directions would do. The function `preload_directions` chooses the basis
        # of the first sample near to the basis at a reference configuration. The reference is the
        # mechanism's example, a closed configuration. If there is no example, or the coordinates
        # are singular there, the reference is the first sample without an error.
        try:
            J_of_reference = self.actuator_jacobian(self.loops.example())
        except (ClosureError, SingularConfigurationError):
            J_of_reference = None
        return preload_directions(self.mechanism, J, J_of_reference, on_error)

    def line_lengths(self, q: ArrayLike) -> Array:
        """Lengths of the lines, shape (..., lines); q may have open loops."""
        array = finite_array("q", q, (self.mechanism.model.nq,))
        shape = (len(self.mechanism.lines.forces),)
        return for_each_sample(self.reference.line_lengths, [array], (1,), shape)

    def line_rates(self, q: ArrayLike, v: Array) -> Array:
        """Rates of the lengths of the lines at rates v of the tree, shape (..., lines)."""
        lines = len(self.mechanism.lines.forces)
        if not lines:  # q need not be checked again: v was computed at q
            return np.zeros((*v.shape[:-1], 0))
        arrays = [self.loops.configurations(q), v]
        return for_each_sample(self.reference.line_rates, arrays, (1, 1), (lines,))

    def state_space(self, sign_width: float) -> StateSpace:
        """The state space for an integrator, with the sign of Coulomb friction smoothed."""
        friction = replace(self.mechanism.friction, sign_width=sign_width)
        if self.kernels is None:
            return StateSpace(self.reference, friction)
        return self.kernels.state_space(friction)

    def closed(self, q: Array) -> Array:
        """The closed configuration near q with the coordinates fixed, shape (nq,)."""
        configuration = None if self.kernels is None else self.kernels.closed(q)
        return self.loops.closed(q) if configuration is None else configuration

    def moved(self, q: Array, step: Array) -> Array:
        """The configuration where the coordinates are a step further, in the same assembly mode."""
        return self.reference.moved(q, step)


def _without_torques(of_sample: Callable[..., Array]) -> Callable[..., Array]:
    """A function like `of_sample(q, va, aa, tau, wrenches)` that has no tau and passes None."""

    def with_none(q: Array, va: Array, aa: Array, wrenches: Array) -> Array:
        return of_sample(q, va, aa, None, wrenches)

    return with_none


def _unpickled(
    mechanism: Mechanism, make_kernels: Callable[..., Kernels] | None, platform: str
) -> Engine:
    """An engine from the parts that `Engine.__reduce__` gives."""
    # Unpickled arrays are writable. `replace` without changes calls the constructor of a part
    # again, which makes the part's arrays read-only. All parts with such a constructor are in
    # `parts`. The mechanism itself has one too, which `replace(mechanism, ...)` calls. The model is
    # copied, because Pinocchio crashes with mimic joints that were unpickled.
    parts = {name: replace(getattr(mechanism, name)) for name in ("friction", "springs", "lines")}
    if mechanism.weight_shares is not None:
        parts["weight_shares"] = replace(mechanism.weight_shares)
    mechanism = replace(mechanism, model=pin.Model(mechanism.model), **parts)
    return Engine(mechanism, make_kernels, platform=platform)

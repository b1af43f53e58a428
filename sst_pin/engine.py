# SPDX-License-Identifier: BSD-2-Clause
"""`Engine`: computes the quantities of one mechanism, by compiled kernels or the reference path."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, Protocol, TypedDict, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .arrays import (
    Array,
    Flags,
    Indices,
    as_array,
    finite_array,
    for_each_sample,
    positive_number,
    require_policy,
    single_array,
    whole_number,
)
from .dynamics.derivatives import AccelerationDerivatives, TorqueDerivatives
from .dynamics.quantities import Name, Quantity
from .dynamics.reactions import Reactions, compliances_of, unpacked
from .dynamics.reference import Reference
from .dynamics.torque_sharing import preload_directions
from .errors import ClosureError, InputError, SingularConfigurationError, SSTError
from .loops.assembly import Assembly, home_of
from .loops.coordinates import examples
from .loops.loops import Loops
from .loops.mobility import Mobility, condition_number, judge, scaled_Phi
from .model.closures import Rolling
from .model.mechanism import Friction, Mechanism
from .model.thresholds import CLOSURE_TOLERANCE
from .model.tree import body_of, frame_id
from .states import States
from .summaries import listed

D = TypeVar("D", TorqueDerivatives, AccelerationDerivatives)
#: Names of derivatives, and of their third argument.
_DERIVATIVES: dict[type, tuple[Name, str]] = {
    TorqueDerivatives: ("torque_derivatives", "aa"),
    AccelerationDerivatives: ("acceleration_derivatives", "tau"),
}
#: The longest first Newton step of an assembly by kernels, [rad] or robot lengths; the largest
#: ratio of a step to the one before; a step after which the next one is rounding; and rounding.
_NEAR, _SHRINKS, _LAST, _ROUNDING = 0.1, 0.1, 1e-9, 1e-14


class Options(TypedDict, total=False):
    """How samples are computed: result array, threads of kernels, "raise" or "nan"."""

    out: Array | None
    threads: int
    on_error: str


class LoadOptions(Options, total=False):
    """Loads besides the weights, and how samples are computed."""

    platform_moment: ArrayLike | None
    external_wrenches: ArrayLike | None


class DerivativeOptions(Options, total=False):
    """What derivatives depend on besides the state, and how samples are computed."""

    external_wrenches: ArrayLike | None
    sign_width: float


class Kernel(Protocol):
    """Compiled code of one quantity."""

    def answer(self, a: Any, b: Any, c: Any, load: Any, out: Any, threads: Any, /) -> Array | None:
        """The result for arguments as the caller gave them, for one sample or a batch.

        None if the arguments must be checked first, or if a sample fails the checks.
        """

    def derivatives(self, kind: Any, a: Any, b: Any, c: Any, threads: Any, /) -> Any:
        """Derivatives by a, b and c as a named tuple of this kind, or None as `answer`."""

    def many(self, arrays: tuple[Array, ...], out: Array, threads: int = 1, /) -> Indices:
        """Fill results of N samples, shape (N, size); indices of those that fail the checks.

        Arguments have shapes (N, ...), q first; external wrenches have shape (N, 6 r).
        """


class Kernels(Protocol):
    """Compiled kernels of one mechanism.

    Results are those of the functions of `Reference`. Samples that fail a check (an open loop, a
    singular configuration, a number that is not finite) are computed by the reference path, which
    raises the error where there is no result.
    """

    def __str__(self) -> str:
        """What computes, in words."""

    def kernel(self, key: Quantity, /) -> Kernel | None:
        """The kernel of a quantity, made at its first use; None if it cannot be compiled."""

    def states(self, friction: Friction) -> States:
        """The state space with this friction instead of the mechanism's."""


class Robot(Protocol):
    """A robot, as public functions of the lower rooms take it: they only use its engine."""

    @property
    def engine(self) -> Engine:
        """The engine that computes."""


class Engine:
    """Computes the quantities of one mechanism. An engine never changes.

    Args:
        mechanism: The mechanism.
        make_kernels: Makes its kernels at their first use; None to compute by the reference path.
        kernels: The kernels, if they exist already.
        platform: Name of the frame whose body a `platform_moment` acts on.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        make_kernels: Callable[[Reference], Kernels] | None = None,
        kernels: Kernels | None = None,
        platform: str = "platform",
    ) -> None:
        self.mechanism, self.make_kernels, self.platform = mechanism, make_kernels, platform
        self.reference = Reference(mechanism)
        if kernels is not None:
            self._kernels = kernels

    def __reduce__(self) -> tuple[Callable[..., Engine], tuple[object, ...]]:
        return _unpickled, (self.mechanism, self.make_kernels, self.platform)

    # --- what computes ----------------------------------------------------------------------

    @cached_property
    def _kernels(self) -> Kernels | str:
        """The kernels, or why there are none."""
        if self.make_kernels is None:
            return "no kernels yet; compile() makes them"
        try:
            return self.make_kernels(self.reference)
        except SSTError as error:
            return str(error)

    @cached_property
    def kernels(self) -> Kernels | None:
        """The compiled kernels; None where the reference path computes everything."""
        return None if isinstance(self._kernels, str) else self._kernels

    @property
    def path(self) -> str:
        """What computes, and why."""
        return f"the reference path: {self._kernels}" if self.kernels is None else str(self.kernels)

    def kernel(self, key: Quantity) -> Kernel | None:
        """The kernel of a quantity; None where the reference path computes it."""
        return None if self.kernels is None else self.kernels.kernel(key)

    @cached_property
    def torques(self) -> Callable[..., Array | None] | None:
        """`Kernel.answer` of inverse dynamics, for control loops."""
        kernel = self.kernel(Quantity("torques"))
        return None if kernel is None else kernel.answer

    @cached_property
    def accelerations(self) -> Callable[..., Array | None] | None:
        """`Kernel.answer` of direct dynamics, for control loops."""
        kernel = self.kernel(Quantity("accelerations"))
        return None if kernel is None else kernel.answer

    def states(self, sign_width: float) -> States:
        """The state space for an integrator, with the sign of Coulomb friction smoothed."""
        friction = replace(self.mechanism.friction, sign_width=sign_width)
        if self.kernels is None:
            return States(self.reference, friction)
        return self.kernels.states(friction)

    def compute(
        self,
        key: Quantity,
        q: ArrayLike,
        *,
        platform_moment: ArrayLike | None = None,
        external_wrenches: ArrayLike | None = None,
        extra: Mapping[str, Array] | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
        **arguments: Any,
    ) -> Array:
        """A quantity, for one sample or a batch; `ClosedChain` describes the arguments.

        Args:
            key: The quantity.
            q: Configurations, shape (..., nq).
            platform_moment: Moment on the platform, shape (..., 3).
            external_wrenches: Wrenches on all bodies, shape (..., r, 6).
            extra: Arguments of the reference path for which there are no kernels.
            out: Array for the result.
            threads: Number of threads of kernels.
            on_error: "raise", or "nan" to set the results of bad samples to NaN.
            arguments: The arguments after q by name, in the order of the quantity's function.

        Returns:
            The shape of the quantity, behind the leading axes of the arguments.
        """
        kind = key.properties
        if on_error == "raise" and external_wrenches is None and extra is None:
            result = self._answer(key, q, arguments, platform_moment, out, threads)
            if result is not None:
                return result
        load = self.wrenches(platform_moment, external_wrenches, on_error)
        absent = [None for value in arguments.values() if value is None and kind.tau_optional]
        if absent:
            del arguments["tau"]
        arrays: list[Array | None] = [*self.arguments(q, **arguments), *absent]
        axes = [1] * len(arrays)
        function: Callable[..., Array] = partial(kind.reference, self.reference)
        if kind.of_frame:
            function = partial(function, frame=frame_id(self.mechanism.model, key.frame))
        if kind.smooth:
            function = partial(function, sign_width=key.sign_width)
        if extra:
            function = partial(function, **extra)
        if kind.loadable:
            arrays, axes = [*arrays, load], [*axes, 2]
        require_policy(on_error)
        threads = whole_number("threads", threads, 1)
        if self.kernels is None and out is None and on_error == "raise":
            pairs = zip(arrays, axes, strict=True)
            if all(array is None or array.ndim == core for array, core in pairs):
                return function(*arrays)  # the short way for one sample

        def fill(flat: list[Array | None], result: Array) -> Indices:
            rows = [np.require(a, float, "A") for a in flat if a is not None]
            loaded = rows[-1].ndim == 3
            if loaded:
                rows[-1] = rows[-1].reshape(len(result), 6 * (self.mechanism.model.njoints - 1))
            kernel = None if extra else self.kernel(key._replace(loaded=loaded))
            if kernel is None:
                return np.arange(len(result))
            return kernel.many(tuple(rows), result, min(threads, sys.maxsize))

        shape = kind.shape(self.mechanism)
        fast = None if self.kernels is None else fill
        return for_each_sample(function, arrays, axes, shape, on_error=on_error, out=out, fast=fast)

    def _answer(
        self,
        key: Quantity,
        q: ArrayLike,
        arguments: dict[str, Any],
        moment: ArrayLike | None,
        out: Array | None,
        threads: int,
    ) -> Array | None:
        """`Kernel.answer` in the shape of the quantity."""
        shape = key.properties.shape(self.mechanism)
        unsupported = len(arguments) > 2 or (out is not None and len(shape) > 1)
        if self.kernels is None or unsupported or not isinstance(key.frame, str | None):
            return None
        kernel = self.kernels.kernel(key)
        if kernel is None:
            return None
        a, b, *_ = *arguments.values(), None, None
        result = kernel.answer(q, a, b, moment, out, threads)
        if result is not None and len(shape) > 1:
            result.shape = (*result.shape[:-1], *shape)
        return result

    def derivatives(
        self,
        kind: type[D],
        q: ArrayLike,
        va: ArrayLike,
        x: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        sign_width: float = 1e-3,
        **options: Any,
    ) -> D:
        """Derivatives of torques by q, va and aa, or of accelerations by q, va and tau."""
        name, argument = _DERIVATIVES[kind]
        key = Quantity(name, sign_width=positive_number("sign_width", sign_width))
        kernel = self.kernel(key)
        if kernel is not None and external_wrenches is None and not options:
            result: D | None = kernel.derivatives(kind, q, va, x, 1)
            if result is not None:
                return result
        options |= {"va": va, argument: x, "external_wrenches": external_wrenches}
        rows = np.asarray(self.compute(key, q, **options))
        n = rows.shape[-2]
        return kind(*np.split(rows, (n, 2 * n), axis=-1))

    def reactions(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike | None,
        tau: ArrayLike | None,
        stiffness: Mapping[str, ArrayLike] | None,
        **options: Any,
    ) -> Reactions:
        """Wrenches in all joints and closures; see `ClosedChain.reactions`."""
        inner, one_to_one = {**options, "out": None}, self.mechanism.driven_one_to_one
        if aa is None and tau is not None:
            aa = self.compute(Quantity("accelerations"), q, va=va, tau=tau, **inner)
        elif aa is None or tau is not None:
            raise InputError("aa, tau", "one of them is needed, not both")
        elif not one_to_one:
            tau = self.compute(Quantity("torques"), q, va=va, aa=aa, **inner)
        if stiffness is not None:
            options["extra"] = {"compliances": compliances_of(self.mechanism, stiffness)}
        tau = None if one_to_one else tau
        rows = self.compute(Quantity("reactions"), q, va=va, aa=aa, tau=tau, **options)
        return unpacked(self.mechanism, np.asarray(rows), stiffness is not None)

    def preload_directions(self, q: ArrayLike, on_error: str = "raise") -> Array:
        """Motor torques that move nothing, shape (..., motors, k)."""
        jacobian = Quantity("actuator_jacobian")
        J = self.compute(jacobian, q, on_error=on_error)
        try:
            regular = self.compute(jacobian, self.example())
        except (ClosureError, SingularConfigurationError):  # coordinates of another assembly mode
            regular = None
        return preload_directions(self.mechanism, J, regular, on_error)

    def line_rates(self, q: ArrayLike, v: Array) -> Array:
        """Rates of the lengths of the lines at rates v of the tree, shape (..., lines)."""
        lines = len(self.mechanism.lines.forces)
        if not lines:
            return np.zeros((*v.shape[:-1], 0))
        arrays = [self.configurations(q), v]
        return for_each_sample(self.reference.line_rates, arrays, (1, 1), (lines,))

    # --- arguments --------------------------------------------------------------------------

    def arguments(self, q: ArrayLike, **others: ArrayLike) -> list[Array]:
        """Arguments as arrays of the mechanism's shapes, q first, the others by name."""
        mechanism = self.mechanism
        mechanism.require_freedom()
        n, motors = len(mechanism.coordinates), mechanism.motors.shape[1]
        arrays = [self.configurations(q)]
        for name, value in others.items():
            try:
                arrays.append(as_array(name, value, (motors if name == "tau" else n,)))
            except InputError as error:
                if name != "tau" and n != motors:
                    error.args = (
                        f"{error.args[0]}: one for each rate of the coordinates "
                        f"{listed(mechanism.coordinate_rate_names)}; in another assembly make it "
                        "home, or give coordinates=",
                    )
                raise
        return arrays

    def configurations(self, q: ArrayLike) -> Array:
        """One or many configurations, shape (..., nq)."""
        return as_array("q", q, (self.mechanism.model.nq,))

    def wrenches(
        self, platform_moment: ArrayLike | None, external_wrenches: ArrayLike | None, on_error: str
    ) -> Array | None:
        """Wrenches on all bodies, shape (..., r, 6), with a moment on the platform, or None.

        Kernels leave out wrenches that do no work, so numbers that are not finite are refused here.
        """
        shape, wrenches = (self.mechanism.model.njoints - 1, 6), None
        if external_wrenches is not None:
            wrenches = _loads("external_wrenches", external_wrenches, shape, on_error)
        if platform_moment is None:
            return wrenches
        body = body_of(self.mechanism.model, self.platform)
        if body is None:
            raise InputError(
                "platform_moment",
                f'the robot has no body with a frame "{self.platform}"; use external_wrenches=',
            )
        moment = _loads("platform_moment", platform_moment, (3,), on_error)
        on_platform = np.zeros((*moment.shape[:-1], *shape))
        on_platform[..., body, :3] = moment
        return on_platform if wrenches is None else on_platform + wrenches

    def single(self, q: ArrayLike) -> Array:
        """One configuration on the manifold, shape (nq,)."""
        array = single_array("q", q, (self.mechanism.model.nq,))
        self.mechanism.space.require_on_manifold(array)
        return array

    # --- configurations ---------------------------------------------------------------------

    def loops_at(self, q: ArrayLike) -> Loops:
        """This thread's loops, evaluated at one configuration."""
        array = self.single(q)
        loops = self.reference.memory.loops
        loops.evaluate(array)
        return loops

    def residuals(self, q: Array) -> Array:
        """f(q) of Eq. (2), shape (..., rows)."""
        rows = (sum(len(closure.rows) for closure in self.mechanism.closures),)
        return for_each_sample(lambda q: self.loops_at(q).f, [q], (1,), rows)

    def placements(self, q: ArrayLike, frame: str) -> Array:
        """Placement of a frame in the base where the loops are closed, shape (..., 4, 4)."""
        index, scale = frame_id(self.mechanism.model, frame), self.mechanism.row_scale

        def one(q: Array) -> Array:
            loops = self.loops_at(q)
            loops.require_closed(scale)
            return np.asarray(loops.data.oMf[index].homogeneous)

        return for_each_sample(one, [self.configurations(q)], (1,), (4, 4))

    def are_closed(self, q: Array) -> Flags:
        """Whether the loops are closed as far as the dynamics asks, shape (...)."""
        gaps = np.abs(self.residuals(q) * self.mechanism.row_scale)
        return np.asarray(gaps.max(axis=-1, initial=0.0) <= CLOSURE_TOLERANCE)

    def condition_numbers(self, q: Array) -> Array:
        """Condition numbers of the dependent part of Phi, shape (...)."""
        mechanism, loops = self.mechanism, self.reference.memory.loops
        parts = loops.parts(mechanism.coordinates)

        def one(q: Array) -> Array:
            Phi = scaled_Phi(mechanism, loops, self.single(q))
            return np.asarray(condition_number(mechanism, Phi, parts))

        return for_each_sample(one, [q], (1,), ())

    def closed_near(self, q: Array) -> Array | None:
        """The closed configuration near q with the coordinates held, by kernels; None if not near.

        Newton steps that start short and shrink fast lead to the one solution nearby, which is that
        of the reference path too.
        """
        mechanism, kernel = self.mechanism, self.kernel(Quantity("closing"))
        rolling = any(isinstance(closure, Rolling) for closure in mechanism.closures)
        if kernel is None or rolling or mechanism.held_in_part:  # the path to the solution counts
            return None
        result, before = np.full((1, len(q) + 2), np.nan), _NEAR / _SHRINKS
        while True:
            failures = kernel.many((q[None],), result)
            step = pin.difference(mechanism.model, q, result[0, :-2]) / mechanism.rate_scale
            length = float(np.abs(step).max(initial=0.0))
            if not length <= _SHRINKS * before:
                return None
            if not length < _ROUNDING:  # a closed configuration stays as it is
                q, before = result[0, :-2].copy(), length
            if length < _LAST:
                return None if len(failures) else q

    def closed(self, q: Array) -> Array:
        """The closed configuration near q with the coordinates fixed, shape (nq,)."""
        configuration = self.closed_near(q)
        if configuration is None:
            configuration = self.assembly.assemble(q, self.mechanism.dependent)
        return configuration

    @property
    def assembly(self) -> Assembly:
        """Newton's method on the closures, of this thread."""
        return self.reference.memory.assembly

    def moved(self, q: Array, step: Array) -> Array:
        """The configuration where the coordinates are a step further, in the same assembly mode."""
        return self.reference.moved(q, step)

    @cached_property
    def home(self) -> Array | None:
        """The home of the model with closed loops, shape (nq,); None without one."""
        mechanism = self.mechanism
        q = home_of(mechanism)
        if q is None:
            return None
        try:
            self.loops_at(q).require_closed(mechanism.row_scale)
        except ClosureError:
            return self.assembly.assemble(q, mechanism.dependent)
        return q

    def example(self) -> Array:
        """A configuration with closed loops and without symmetry, shape (nq,)."""
        if self.mechanism.example is None:
            return next(examples(self.assembly))
        return self.mechanism.example.copy()

    def mobility(self, q: ArrayLike | None = None) -> Mobility:
        """Degrees of freedom and motors; see `ClosedChain.mobility`."""
        where = "a random assembled configuration" if q is None else "the configuration given"
        at = self.example() if q is None else self.single(q)
        return judge(self.mechanism, self.reference.memory.loops, at, where)


def _loads(name: str, value: ArrayLike, shape: tuple[int, ...], on_error: str) -> Array:
    """Loads; samples with a number that is not finite are refused, or NaN."""
    if on_error != "nan":
        return finite_array(name, value, shape)
    array = as_array(name, value, shape)
    axes = tuple(range(-len(shape), 0))
    return np.where(np.isfinite(array).all(axis=axes, keepdims=True), array, np.nan)


def _unpickled(
    mechanism: Mechanism, make_kernels: Callable[..., Kernels] | None, platform: str
) -> Engine:
    """An engine with a copy of the model: mimic joints of an unpickled model end the process.

    Arrays are read-only again.
    """
    parts = {name: replace(getattr(mechanism, name)) for name in ("friction", "springs")}
    mechanism = replace(mechanism, model=pin.Model(mechanism.model), **parts)
    return Engine(mechanism, make_kernels, platform=platform)

# SPDX-License-Identifier: BSD-2-Clause
"""`Engine`: computes the quantities of one mechanism, by compiled kernels or the reference path."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, Protocol, TypedDict, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .arrays import (
    Array,
    Indices,
    as_array,
    finite_array,
    for_each_sample,
    positive_number,
    require_policy,
    whole_number,
)
from .dynamics.derivatives import AccelerationDerivatives, TorqueDerivatives
from .dynamics.dynamics import ReducedTerms
from .dynamics.nonsmooth_rows import NonsmoothRows
from .dynamics.quantities import QUANTITIES, Name, Quantity
from .dynamics.reactions import Reactions, compliances_of, unpacked
from .dynamics.reference import Reference
from .dynamics.torque_sharing import preload_directions
from .errors import ClosureError, InputError, SingularConfigurationError, SSTError
from .loops.closed_loops import ClosedLoops
from .model.mechanism import Friction, Mechanism
from .model.tree import body_of, frame_id
from .progress import FASTER
from .states import States
from .summaries import listed

#: External wrenches: [force; moment] on all bodies at their mass centres, shape (..., r, 6), or a
#: mapping from names of frames to [force; moment] at their origins, shapes (..., 6).
Wrenches = ArrayLike | Mapping[str, ArrayLike]
D = TypeVar("D", TorqueDerivatives, AccelerationDerivatives)
#: Names of derivatives, and of their third argument.
_DERIVATIVES: dict[type, tuple[Name, str]] = {
    TorqueDerivatives: ("torque_derivatives", "aa"),
    AccelerationDerivatives: ("acceleration_derivatives", "tau"),
}


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


class Kernel(Protocol):
    """Compiled code of one quantity."""

    def answer(self, a: Any, b: Any, c: Any, load: Any, out: Any, threads: Any, /) -> Array | None:
        """The result for unchecked arguments; None if these or a sample need a check."""

    def derivatives(self, kind: Any, a: Any, b: Any, c: Any, threads: Any, /) -> Any:
        """Derivatives by a, b and c as a named tuple of this kind; None where `answer` is None."""

    def many(self, arrays: tuple[Array, ...], out: Array, threads: int = 1, /) -> Indices:
        """Fill results of N samples, shape (N, size); indices of those that fail the checks.

        Arguments have shapes (N, ...), q first; external wrenches have shape (N, 6 r).
        """


class Kernels(Protocol):
    """Compiled kernels of one mechanism, with the results of `Reference`.

    The reference path computes samples that fail a check: an open loop, a singular configuration,
    or a number that is not finite.
    """

    def __str__(self) -> str:
        """Whether kernels or the reference path compute, in words."""

    def kernel(self, key: Quantity, /) -> Kernel | None:
        """The kernel of a quantity, made at its first use; None if it cannot be compiled."""

    def closed(self, q: Array, /) -> Array | None:
        """The closed configuration near q with the coordinates fixed; None to ask the reference."""

    def states(self, friction: Friction) -> States:
        """The state space with this friction instead of the mechanism's."""

    def nonsmooth(self, rows: NonsmoothRows, loaded: bool) -> Any:
        """Steps with stops, friction and contacts; None if they cannot be compiled."""


class Robot(Protocol):
    """A robot as public functions of lower packages see it: they use its engine only."""

    @property
    def engine(self) -> Engine: ...  # noqa: D102


class Engine(ClosedLoops):
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
        super().__init__(mechanism)
        self.make_kernels, self.platform = make_kernels, platform
        self.reference = Reference(mechanism)
        self._answers = dict[Quantity, tuple[Kernel | None, tuple[int, ...]]]()
        if kernels is not None:
            self._kernels = kernels

    def __reduce__(self) -> tuple[Any, ...]:
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
    def backend(self) -> str:
        """Whether kernels or the reference path compute, in words."""
        return f"the reference path: {self._kernels}" if self.kernels is None else str(self.kernels)

    def kernel(self, key: Quantity) -> Kernel | None:
        """The kernel of a quantity; None where the reference path computes it."""
        return None if self.kernels is None else self.kernels.kernel(key)

    @cached_property
    def torques(self) -> Callable[..., Array | None] | None:
        """`Kernel.answer` of inverse dynamics, for control loops."""
        return getattr(self.kernel(Quantity("torques")), "answer", None)

    @cached_property
    def forces(self) -> Callable[..., Array | None] | None:
        """`Kernel.answer` of generalized forces."""
        return getattr(self.kernel(Quantity("generalized_forces")), "answer", None)

    @cached_property
    def accelerations(self) -> Callable[..., Array | None] | None:
        """`Kernel.answer` of direct dynamics, for control loops."""
        return getattr(self.kernel(Quantity("accelerations")), "answer", None)

    def states(self, sign_width: float) -> States:
        """The state space for an integrator, with the sign of Coulomb friction smoothed."""
        friction, kernels = replace(self.mechanism.friction, sign_width=sign_width), self.kernels
        return States(self.reference, friction) if kernels is None else kernels.states(friction)

    def compute(
        self,
        key: Quantity,
        q: ArrayLike,
        *,
        platform_moment: ArrayLike | None = None,
        external_wrenches: Wrenches | None = None,
        extra: Mapping[str, Array] | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
        **arguments: Any,
    ) -> Array:
        """A quantity of one sample or a batch; leading axes are those of the arguments.

        `ClosedChain` describes the arguments. Those after q are named, in the order of the
        quantity's function; `extra` are arguments that only the reference path accepts.
        """
        plain = on_error == "raise" and external_wrenches is None and extra is None
        if plain and self.kernels is not None and isinstance(key.frame, (str, type(None))):
            result = self._answer(key, q, arguments, platform_moment, out, threads)
            if result is not None:
                return result
        kind = QUANTITIES[key.name]
        load = self.wrenches(platform_moment, external_wrenches, on_error, q)
        absent: list[None] = []
        if kind.tau_optional and arguments["tau"] is None:
            absent = [arguments.pop("tau")]
        arrays: list[Array | None] = [*self.arguments(q, **arguments), *absent]
        axes = [1] * len(arrays)
        constants: dict[str, object] = dict(extra or {})
        if kind.of_frame:
            constants["frame"] = frame_id(self.mechanism.model, key.frame)
        if kind.smooth:
            constants["sign_width"] = key.sign_width
        function: Callable[..., Array] = partial(kind.reference, self.reference, **constants)
        if kind.loadable:
            arrays, axes = [*arrays, load], [*axes, 2]
        require_policy(on_error)
        threads = whole_number("threads", threads, 1)
        if self.kernels is None and out is None and on_error == "raise":
            pairs = zip(arrays, axes, strict=True)
            if all(array is None or array.ndim == core for array, core in pairs):
                return function(*arrays)  # one sample

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
        hint = ""
        if self.make_kernels is None:
            hint = f"computing on the slow reference path; {FASTER}"
        fast = None if self.kernels is None else fill
        return for_each_sample(
            function,
            arrays,
            axes,
            shape,
            on_error=on_error,
            out=out,
            fast=fast,
            hint=hint,
        )

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
        if key not in self._answers:
            self._answers[key] = self.kernel(key), QUANTITIES[key.name].shape(self.mechanism)
        kernel, shape = self._answers[key]
        matrix = len(shape) > 1
        if kernel is None or len(arguments) > 2 or (matrix and out is not None):
            return None
        a, b, *_ = *arguments.values(), None, None
        result = kernel.answer(q, a, b, moment, out, threads)
        if result is not None and matrix:
            result.shape = (*result.shape[:-1], *shape)
        return result

    def derivatives(
        self,
        kind: type[D],
        q: ArrayLike,
        va: ArrayLike,
        x: ArrayLike,
        *,
        external_wrenches: Wrenches | None = None,
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
        if isinstance(external_wrenches, Mapping):
            policy = options.get("on_error", "raise")
            slope = self._slope_of_arms(external_wrenches, q, policy)  # of forces by q
            if kind is TorqueDerivatives:
                rows[..., :n] -= slope
            else:
                terms = self.compute(Quantity("reduced_terms"), q, va=va, on_error=policy)
                rows[..., :n] += np.linalg.solve(ReducedTerms.of_rows(terms, n).inertia, slope)
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
        if self.mechanism.driven_one_to_one:
            return np.zeros((*J.shape[:-1], 0))
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
        n, motors = len(mechanism.coordinates), mechanism.motors.shape[1]
        if not n and (mechanism.example is None or any(map(np.size, _of_motion(others)))):
            mechanism.require_freedom()
        arrays = [as_array("q", q, (mechanism.model.nq,))]
        for name, value in others.items():
            try:
                arrays.append(as_array(name, value, (motors if name == "tau" else n,)))
            except InputError as error:
                if name != "tau" and n != motors:
                    error.args = (
                        f"{error.args[0]}: one for each rate of the coordinates "
                        f"{listed(mechanism.coordinate_rate_names)}; in another assembly make it "
                        "home, or use chain.with_coordinates([...])",
                    )
                raise
        return arrays

    def wrenches(
        self,
        platform_moment: ArrayLike | None,
        external_wrenches: Wrenches | None,
        on_error: str,
        q: ArrayLike | None = None,
    ) -> Array | None:
        """Wrenches on all bodies, shape (..., r, 6), with a moment on the platform, or None.

        Wrenches at frames need the configurations q. Kernels leave out wrenches that do no work, so
        numbers that are not finite are refused here.
        """
        shape, wrenches = (self.mechanism.model.njoints - 1, 6), None
        if isinstance(external_wrenches, Mapping):
            wrenches = self._at_mass_centres(external_wrenches, q, on_error)
        elif external_wrenches is not None:
            wrenches = _loads("external_wrenches", external_wrenches, shape, on_error)
        if platform_moment is None:
            return wrenches
        body = body_of(self.mechanism.model, self.platform)
        if body is None:
            cure = f'the robot has no body with a frame "{self.platform}"; use external_wrenches='
            raise InputError("platform_moment", cure)
        moment = _loads("platform_moment", platform_moment, (3,), on_error)
        on_platform = np.zeros((*moment.shape[:-1], *shape))
        on_platform[..., body, 3:] = moment
        return on_platform if wrenches is None else on_platform + wrenches

    def _at_mass_centres(
        self, wrenches: Mapping[str, ArrayLike], q: ArrayLike | None, on_error: str
    ) -> Array:
        """Wrenches at frames as wrenches on all bodies at their mass centres, shape (..., r, 6)."""
        if q is None:
            raise InputError(
                "external_wrenches",
                "wrenches at frames change with the pose at the mass centres, and are not possible "
                "here; give an array of wrenches on the bodies at their mass centres",
            )
        size = self.mechanism.model.njoints - 1
        on_bodies = np.zeros((size, 6))
        for name, value in wrenches.items():
            body, wrench = self._at_frame(name, value, on_error)
            force, moment = wrench[..., :3], wrench[..., 3:]
            arm = self._arms(name, q)
            try:
                shifted = moment + np.cross(arm, force)
            except ValueError:
                problem = f"shape {wrench.shape} does not fit q of shape {np.shape(q)}"
                raise InputError(f"external_wrenches[{name!r}]", problem) from None
            on_one = np.zeros((*shifted.shape[:-1], size, 6))
            on_one[..., body, :3] = force
            on_one[..., body, 3:] = shifted
            try:
                on_bodies = on_bodies + on_one
            except ValueError:
                problem = "wrenches of several frames have batches of different shapes"
                raise InputError("external_wrenches", problem) from None
        return on_bodies

    def _at_frame(self, name: str, value: ArrayLike, on_error: str) -> tuple[int, Array]:
        """The body of a frame, from 0, and the wrench at the frame, shape (..., 6)."""
        argument = f"external_wrenches[{name!r}]"
        wrench = _loads(argument, value, (6,), on_error)
        frame_id(self.mechanism.model, name)  # refuses unknown names
        body = body_of(self.mechanism.model, name)
        if body is None:
            raise InputError(
                argument, "the frame is fixed to the base, where a wrench does no work"
            )
        return body, wrench

    def _arms(self, name: str, q: ArrayLike) -> Array:
        """The way from the mass centre of a frame's body to the frame, in base axes, (..., 3).

        What is wrong with q is found where the quantity itself is computed.
        """
        model, tree = self.mechanism.model, self.assembly.loops.tree
        index = frame_id(model, name)
        frame = model.frames[index]
        # Axes of the body of the normal tree are those of the frame's parent joint.
        from_centre = frame.placement.translation - model.inertias[frame.parentJoint].lever
        body, data = tree.bodies[frame.parentJoint], tree.model.createData()

        def one(q: Array) -> Array:
            pin.forwardKinematics(tree.model, data, q)
            return np.asarray(data.oMi[body].rotation @ from_centre)

        on_tree = tree.factors * self.configurations(q)[..., tree.entries] + tree.offsets
        return for_each_sample(one, [on_tree], (1,), (3,))

    def _slope_of_arms(
        self, wrenches: Mapping[str, ArrayLike], q: ArrayLike, on_error: str
    ) -> Array:
        """Derivative of the generalized forces of wrenches at frames by q, as the arms turn.

        It is what derivatives for constant wrenches at the mass centres lack, shape (..., n, n).
        """
        n = len(self.mechanism.coordinates)
        slope = np.zeros((n, n))
        for name, value in wrenches.items():
            _, wrench = self._at_frame(name, value, on_error)
            arm = self._arms(name, q)
            J = self.compute(Quantity("frame_jacobian", name), q, on_error=on_error)[..., 3:, :]
            # An arm r of a body with the angular velocity w turns with w x r.
            turned = np.cross(J.mT, arm[..., None, :])
            moments = np.cross(turned, wrench[..., None, :3])
            slope = slope + J.mT @ moments.mT
        return slope

    def closed(self, q: Array) -> Array:
        """The closed configuration near q with the coordinates fixed, shape (nq,)."""
        configuration = None if self.kernels is None else self.kernels.closed(q)
        return super().closed(q) if configuration is None else configuration

    def moved(self, q: Array, step: Array) -> Array:
        """The configuration where the coordinates are a step further, in the same assembly mode."""
        return self.reference.moved(q, step)


def _of_motion(arguments: Mapping[str, ArrayLike]) -> Iterator[ArrayLike]:
    """The arguments with a number for each coordinate."""
    return (value for name, value in arguments.items() if name != "tau")


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
    """An engine with read-only arrays and a copied model: unpickled mimic joints would crash."""
    parts = {name: replace(getattr(mechanism, name)) for name in ("friction", "springs")}
    mechanism = replace(mechanism, model=pin.Model(mechanism.model), **parts)
    return Engine(mechanism, make_kernels, platform=platform)

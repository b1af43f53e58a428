# SPDX-License-Identifier: BSD-2-Clause
"""Compiled kernels as the backend of a chain, each made at its first use.

A kernel checks each sample: its loops are closed, no pivot is much smaller than in the sample
configurations, all numbers are finite. Samples that fail go to the reference path, one by one.
"""

import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, cast

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .. import engine, kernel_protocols
from ..arrays import Array
from ..dynamics.nonsmooth_rows import NonsmoothRows
from ..dynamics.quantities import QUANTITIES, Name, Quantity
from ..dynamics.reference import Reference
from ..dynamics.regressor import with_springs
from ..errors import ActuationError, CompilationError, MissingExtraError, SSTError
from ..model.closures import Brake, Rolling
from ..model.mechanism import Friction, Mechanism
from ..model.tree import body_of, frame_named
from . import libraries
from .compiled_states import ByColumns, CompiledStates, DerivativesByColumns
from .compiler import LONG, SINGLE, TARGETS
from .extension import binding
from .generator_inputs import fingerprint, sample_configurations
from .libraries import Code
from .nonsmooth_motions import NonsmoothCode
from .symbolic_parameters import SymbolicParameters

if TYPE_CHECKING:
    from ._binding import Kernel, RolloutKernel
    from .equations import Equations


#: `ClosedChain.compile` makes these. The others are made at their first use.
FIRST = (Quantity("torques"), Quantity("accelerations"))
#: Derivatives of the dynamics.
DERIVATIVES = (Quantity("torque_derivatives"), Quantity("acceleration_derivatives"))
#: All kernels but those of frames.
EVERY = tuple(
    Quantity(name, loaded=loaded)
    for name, kind in QUANTITIES.items()
    for loaded in (False, True)[: 1 + kind.loadable]
    if not kind.of_frame
)
#: Quantities of which one sample takes less time direction by direction, if the directions fit into
#: so many passes.
_FASTER_ALONG, _TIMES = ("torque_derivatives", "acceleration_derivatives"), 2
#: The number of coordinates squared times rates up to which batches are computed by whole matrices.
_LARGEST = 10_000
#: Quantities that need the factors of the inertia matrix in symbols, and the same number for these.
WITH_INERTIA, _LARGEST_INERTIA = ("accelerations", "acceleration_derivatives", "rollout"), 100_000
#: Number of kernels of derivatives, one for each smoothing width, at which all are dropped.
_WIDTHS = 16


def compiled_engine(
    before: engine.Engine, q: ArrayLike | None, *, derivatives: bool, every: bool
) -> engine.Engine:
    """The engine of the same mechanism with kernels; see `ClosedChain.compile`."""
    reference, keys = before.reference, FIRST + DERIVATIVES if derivatives else FIRST
    near = None if q is None else before.loops.single(q)
    if near is not None:
        reference.rates(near, np.zeros(len(before.mechanism.coordinates)))
    if derivatives and reference.derivatives.axes_move:
        keys = (*keys, Quantity("displacement_rates"))
    make = partial(CompiledBackend, near=near, platform=before.platform)
    kernels = make(reference)
    kernels.make(EVERY if every else keys)
    return engine.Engine(before.mechanism, make, kernels, before.platform)


#: Steps of Newton's method, [rad] or robot lengths: the longest first one; the largest ratio of one
#: to the one before; the longest last one; and the length below which a step is rounding.
_NEAR, _SHRINKS, _LAST, _ROUNDING = 0.1, 0.1, 1e-9, 1e-14


class CompiledBackend:
    """Dynamics of one mechanism by its compiled kernels.

    The order of elimination is chosen for configurations near `near`, shape (nq,), by default near
    the example of the mechanism. A `platform_moment` acts on the body of the frame `platform`.
    """

    def __init__(
        self, reference: Reference, near: Array | None = None, *, platform: str = ""
    ) -> None:
        self._binding = binding()
        self._reference, self._mechanism = reference, reference.mechanism
        self._robot = self._mechanism.model.name or "robot"
        self._near = near if _closed(reference, near) else None  # the robot may have changed
        self._parameters = SymbolicParameters(self._mechanism)
        body = body_of(self._mechanism.model, platform)
        self._moment = -1 if body is None else 6 * body + 3  # after the force
        self._kernels: dict[Quantity, kernel_protocols.Kernel | None] = {}
        self._equations: dict[tuple[bool, bool, bool], Equations] = {}
        self._codes: dict[Quantity, list[Code]] = {}
        self._why: dict[Quantity, str] = {}
        self._nonsmooth: dict[bool, NonsmoothCode | None] = {}
        self._lock = threading.RLock()
        self._stopped = False  # whether `make` failed: other threads then stop

    def __str__(self) -> str:
        target = self._binding.INSTRUCTIONS
        parts = [f"compiled kernels: {target}, {TARGETS[target][0]} samples at once"]
        for key, why in self._why.items():
            parts.append(f"{key} by the reference path: {' '.join(why.split())}")  # in one line
        return "; ".join(parts)

    def make(self, keys: Sequence[Quantity] = FIRST) -> None:
        """Load the kernels from the cache, or compile them."""
        from concurrent.futures import ThreadPoolExecutor  # slow to import

        shared = dict.fromkeys(map(self._shared_key, keys))
        wanted = [key for key in shared if not impossible(self._mechanism, key.name)]
        variants = [variant for key in wanted for variant in self._variants(key)]

        def prepare(variant: tuple[Quantity, str]) -> None:
            with suppress(ActuationError):  # too few motors: `_codes_of` tells it
                self._from_cache(*variant)

        with ThreadPoolExecutor() as pool:
            try:
                for _ in pool.map(prepare, variants):
                    pass
            except BaseException:  # Ctrl-C too: the other threads make no more
                self._stopped = True
                raise

    def kernel(self, key: Quantity) -> kernel_protocols.Kernel | None:
        """The kernel of a quantity, as `Kernels.kernel`; may drop those of other widths."""
        try:
            return self._kernels[key]
        except KeyError:
            pass
        if key.frame is not None:
            frame_named(self._mechanism.model, key.frame)
        if key.sign_width is not None:
            smooth = [other for other in list(self._kernels) if other.sign_width is not None]
            for other in smooth if len(smooth) >= _WIDTHS else ():
                self._kernels.pop(other, None)
        kernel: kernel_protocols.Kernel | None = None
        if key.name == "accelerations":
            kernel = self._by_columns()
        elif key.name == "acceleration_derivatives":
            kernel = self._derivatives_by_columns(key)
        self._kernels[key] = kernel or self._kernel(key)
        return self._kernels[key]

    def closed(self, q: Array) -> Array | None:
        """The closed configuration near q with the coordinates fixed; None if it is not near.

        Newton steps that start short and shrink fast lead to the same solution as the reference
        path.
        """
        mechanism, kernel = self._mechanism, self.kernel(Quantity("closing"))
        # Where rows hold rates only, or a joint in part, the path to the solution counts.
        rates_only = any(isinstance(closure, (Rolling, Brake)) for closure in mechanism.closures)
        if kernel is None or rates_only or mechanism.held_in_part:
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

    def states(self, friction: Friction) -> CompiledStates:
        """The state space with this friction instead of the mechanism's."""
        closing = cast("Kernel | None", self.kernel(Quantity("closing")))
        columns = self._by_columns(friction)
        rate, course = partial(self._rate, friction), partial(self._course, friction)
        derivatives = Quantity("acceleration_derivatives", sign_width=friction.sign_width)
        slopes = partial(self.kernel, derivatives)
        return CompiledStates(self._reference, friction, closing, slopes, rate, course, columns)

    def nonsmooth(self, rows: NonsmoothRows, loaded: bool) -> NonsmoothCode | None:
        """Compiled steps with stops, friction and contacts; None if they cannot be compiled."""
        if loaded not in self._nonsmooth:
            try:
                if problem := impossible(self._mechanism, "accelerations"):
                    raise CompilationError(problem)
                best = self._binding.INSTRUCTIONS
                self._nonsmooth[loaded] = NonsmoothCode(
                    self._mechanism,
                    self._parameters,
                    self._nonsmooth_code(rows, loaded, SINGLE[best]),
                    self._nonsmooth_code(rows, loaded, best),
                    TARGETS[best][0],
                )
            except SSTError as error:
                self._nonsmooth[loaded] = None
                self._why[Quantity("rollout", loaded=loaded)] = str(error)
        return self._nonsmooth[loaded]

    def _nonsmooth_code(self, rows: NonsmoothRows, loaded: bool, target: str) -> Code:
        """Code from the cache, or compiled now."""
        key = Quantity("rollout", loaded=loaded)
        content = fingerprint(self._mechanism, self._parameters, self._near, rows=rows)

        def source() -> list[str]:
            try:
                from . import nonsmooth_c
            except ImportError:
                raise MissingExtraError("casadi", "compile") from None
            with self._lock:
                lanes = TARGETS[target][0]
                return nonsmooth_c.library("nonsmooth", self._equations_of(key), rows, lanes)

        name = f"nonsmooth{'_loaded' if loaded else ''}"
        return Code(libraries.load(self._robot, name, content, target, source), "nonsmooth")

    # --- inside -----------------------------------------------------------------------------

    @cached_property
    def _all_numbers(self) -> SymbolicParameters:
        return SymbolicParameters(with_springs(self._mechanism), complete=True)

    @cached_property
    def _content(self) -> bytes:
        """Everything that the kernels are made from."""
        return fingerprint(self._mechanism, self._parameters, self._near)

    def _by_columns(self, friction: Friction | None = None) -> ByColumns | None:
        """Direct dynamics if the mass matrix is too large to be written out; None otherwise."""
        mechanism, forces = self._mechanism, Quantity("generalized_forces")
        small = not impossible(mechanism, "accelerations")
        if small or mechanism.lines.motors.any() or mechanism.without_mass:
            return None

        def of_loads(loaded: bool) -> "Kernel":
            kernel = self._kernel(forces._replace(loaded=loaded), friction=friction)
            if kernel is None:
                raise CompilationError(str(self))
            return kernel

        inertial, rates = self._kernel(forces, inertial=True), self._kernel(Quantity("rates"))
        if inertial is None or rates is None:
            return None
        return ByColumns(mechanism, cache(of_loads), inertial, rates)

    def _derivatives_by_columns(self, key: Quantity) -> DerivativesByColumns | None:
        """Derivatives of accelerations where these are computed by columns; None otherwise."""
        mechanism, forces = self._mechanism, key._replace(name="torque_derivatives")
        smooth = replace(mechanism.friction, sign_width=key.sign_width or 0.0)
        accelerations = self._by_columns(smooth)
        if accelerations is None or mechanism.motors[mechanism.dependent].any():
            return None

        def of_loads(loaded: bool) -> "Kernel":
            kernel = self._kernel(forces._replace(loaded=loaded))
            if kernel is None:
                raise CompilationError(str(self))
            return kernel

        return DerivativesByColumns(mechanism, accelerations, cache(of_loads))

    def _kernel(
        self,
        key: Quantity,
        word: str = "run",
        friction: Friction | None = None,
        *,
        inertial: bool = False,
    ) -> "Kernel | None":
        """A kernel with its code for single samples and for batches; None if it is impossible."""
        codes = self._codes_of(key)
        if not codes:
            return None
        friction = friction or self._mechanism.friction
        if key.sign_width is not None:
            friction = replace(friction, sign_width=key.sign_width)
        regressor = key.name == "torque_regressor"
        parameters = self._all_numbers if regressor else self._parameters
        numbers = parameters.pack(self._mechanism, friction)
        if inertial:
            numbers = parameters.inertial(numbers)
        _, outputs, *sizes = codes[0].sizes(word)
        addresses = codes[0].address(word), codes[-1].address(word)
        one, many = codes[0].prepared(numbers), codes[-1].prepared(numbers)
        loaded = None if key.loaded else partial(self._kernel, key._replace(loaded=True))
        shape = tuple(sizes), outputs
        return self._binding.Kernel(*addresses, *shape, one, codes, loaded, many, self._moment)

    def _rate(self, friction: Friction, loaded: bool) -> "Kernel | None":
        """Rates of the closed states next to some states."""
        return self._kernel(Quantity("rollout", loaded=loaded), "rate", friction)

    def _course(self, friction: Friction, loaded: bool) -> "RolloutKernel | None":
        """The kernel of a rollout; None if it is impossible."""
        codes = self._codes_of(Quantity("rollout", loaded=loaded))
        if not codes:
            return None
        code = codes[-1]
        numbers = self._parameters.pack(self._mechanism, friction)
        _, _, q, va, tau, *load = code.sizes("run")
        sizes = (q, va, tau, sum(load))
        return self._binding.RolloutKernel(code.address("run"), sizes, code.prepared(numbers), code)

    def _codes_of(self, key: Quantity) -> list[Code]:
        """A kernel's code for single samples, then for batches; empty if it is impossible."""
        key = self._shared_key(key)
        if key not in self._codes:
            from concurrent.futures import ThreadPoolExecutor  # slow to import

            try:
                with ThreadPoolExecutor() as pool:
                    variants = zip(*self._variants(key), strict=True)
                    self._codes[key] = list(pool.map(self._from_cache, *variants))
            except SSTError as error:
                self._codes[key], self._why[key] = [], str(error)
        return self._codes[key]

    def _shared_key(self, key: Quantity) -> Quantity:
        """The key of the kernel that computes this quantity."""
        if key.name == "generalized_forces" and self._mechanism.driven_one_to_one:
            key = key._replace(name="torques")
        return key._replace(sign_width=None)  # it is a parameter

    def _variants(self, key: Quantity) -> list[tuple[Quantity, str]]:
        """Keys and instruction sets of a kernel for single samples, then of one for batches."""
        if problem := impossible(self._mechanism, key.name):
            raise CompilationError(problem)
        best = self._binding.INSTRUCTIONS
        n, directions = len(self._mechanism.coordinates), key._replace(along=True)
        # Eight directions at once are slower than four.
        narrow = "avx2" if best == "avx512" else best
        suits_one = narrow if n <= TARGETS[narrow][0] else best
        if is_large(self._mechanism, key.name):
            return [(directions, suits_one)]
        if key.name in _FASTER_ALONG and 1 < n <= _TIMES * TARGETS[best][0]:
            return [(directions, suits_one), (key, best)]
        return [(key, SINGLE[best]), (key, best)]

    def _from_cache(self, key: Quantity, target: str) -> Code:
        """Code from the cache, or compiled now."""
        content, smooth = self._content, key.properties.smooth
        if key.frame is not None:
            content = fingerprint(self._mechanism, self._parameters, self._near, key.frame)

        def sources() -> list[str]:
            try:
                from . import c_code, kernels
            except ImportError:
                raise MissingExtraError("casadi", "compile") from None
            with self._lock:  # equations are made once, and CasADi is not safe for several threads
                if self._stopped:
                    raise CompilationError("given up")
                expressions = kernels.entry(self._equations_of(key), key)
                return c_code.library(key.entry, expressions, TARGETS[target][0])

        options = LONG if smooth else ()
        library = libraries.load(self._robot, str(key), content, target, sources, options)
        return Code(library, key.entry)

    def _equations_of(self, key: Quantity) -> "Equations":
        from .equations import Equations

        if key.name == "torque_regressor":
            samples = sample_configurations(self._reference, self._near)
            mechanism = with_springs(self._mechanism)
            return Equations(mechanism, samples, parameters=self._all_numbers)
        kind = key.loaded, key.properties.smooth, key.name != "reactions"
        if kind not in self._equations:
            samples = sample_configurations(self._reference, self._near)
            self._equations[kind] = Equations(self._mechanism, samples, *kind)
        return self._equations[kind]


def _closed(reference: Reference, q: Array | None) -> bool:
    """Whether q closes the loops of this robot."""
    if q is None or len(q) != reference.mechanism.model.nq:
        return False
    try:
        reference.context.evaluate(q)
    except SSTError:
        return False
    return True


def impossible(mechanism: Mechanism, quantity: Name) -> str:
    """The reason why a quantity has no kernel; empty where it has one."""
    nv, motors = mechanism.motors.shape
    n = len(mechanism.coordinates)
    if mechanism.without_mass and quantity in ("accelerations", "acceleration_derivatives"):
        return "the mass matrix is singular"
    if quantity == "actuator_jacobian" and not motors:
        return "there are no motors"
    if quantity == "torques" and motors < n:
        return f"fewer motors ({motors}) than coordinates ({n})"
    if quantity in WITH_INERTIA and n * n * nv > _LARGEST_INERTIA:
        return f"{n} coordinates of {nv} rates are too many for an inertia matrix in symbols"
    return ""


def is_large(mechanism: Mechanism, quantity: Name) -> bool:
    """Whether a quantity is computed direction by direction for batches too."""
    n, nv = len(mechanism.coordinates), mechanism.model.nv
    return QUANTITIES[quantity].by_directions and n * n * nv > _LARGEST

# SPDX-License-Identifier: BSD-2-Clause
"""Compiled kernels as the backend of a chain, each made at its first use.

A *kernel* computes a quantity, such as the torques, for one sample or many. It checks each sample:
its loops are closed, no pivot is much smaller than in the sample configurations, all numbers are
finite. Samples that fail go to the reference path, one by one.

The *key* of a kernel is a `Quantity`: the name of what it computes, with a frame, external wrenches
or the smoothing width of friction if it needs them. Masses, friction, springs and this width are
parameters of the compiled code, so kernels of all widths share one code.

A kernel computes several numbers at once, one in each lane of a vector register. The lanes hold
either samples, or *directions* of one sample, which are columns of a matrix such as a derivative
(`dynamics.quantities`). What is best differs between one sample and a batch. So a kernel has code
in two *variants*, one for single samples and one for batches; both may be the same.

`CompiledBackend.kernel` makes a kernel: `_codes_of` finds its code, `_variants` decides how to
compile it, `_load_both` and `_load` take the libraries from the cache on disk or compile them, and
`_sources_of` generates the C. `CompiledBackend.make` only fills this cache, for several kernels at
the same time.
"""

import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple, cast

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
from .compiled_states import LARGEST_RATIO, LONGEST_FIRST_STEP, CompiledStateSpace
from .compiler import LONG, SINGLE, TARGETS
from .extension import binding
from .generator_inputs import fingerprint, sample_configurations
from .libraries import Code
from .nonsmooth_motions import NonsmoothCode
from .symbolic_parameters import SymbolicParameters

if TYPE_CHECKING:
    from ._binding import Kernel, RolloutKernel
    from .equations import Equations


#: `ClosedChain.compile` makes these kernels. The others are made at their first use.
FIRST = (Quantity("torques"), Quantity("accelerations"))
#: Derivatives of the dynamics.
DERIVATIVES = (Quantity("torque_derivatives"), Quantity("acceleration_derivatives"))

#: Derivatives of one sample are computed by directions if the directions of all coordinates fit
#: into this number of vector registers. With more directions, a whole matrix takes less time.
_MOST_REGISTERS = 2
#: Single samples and batches are computed by directions if n^2 nv is larger, with n coordinates and
#: nv rates: the code of a whole matrix grows faster with the robot than the code of a direction.
_LARGEST = 10_000
#: If there are this many kernels of derivatives, one for each smoothing width, all are dropped.
_MOST_WIDTHS = 16

# Lengths of steps of Newton's method onto the closures, [rad] or robot lengths.
#: The loops are closed after a step that is shorter: the next step would be about its square.
_LONGEST_LAST_STEP = 1e-9
#: A shorter step is rounding.
_ROUNDING = 1e-14


def every_key() -> list[Quantity]:
    """The keys of all kernels but those of frames, of which a robot has many."""
    keys = []
    for name, properties in QUANTITIES.items():
        if properties.of_frame:
            continue
        keys.append(Quantity(name))
        if properties.loadable:
            keys.append(Quantity(name, loaded=True))
    return keys


def compiled_engine(
    before: engine.Engine, q: ArrayLike | None, *, derivatives: bool, every: bool
) -> engine.Engine:
    """The engine of the same mechanism with kernels; see `ClosedChain.compile`.

    Args:
        before: The engine so far.
        q: Configuration near which the order of elimination is chosen, shape (nq,), or None.
        derivatives: Whether kernels of derivatives are made now, not at their first use.
        every: Whether all kernels of `every_key` are made now.
    """
    reference = before.reference
    near = None
    if q is not None:
        near = before.loops.single(q)
        # Refuses open loops and singular configurations.
        reference.rates(near, np.zeros(len(before.mechanism.coordinates)))
    keys = list(FIRST)
    if derivatives:
        keys += DERIVATIVES
        if reference.derivatives.axes_move:
            keys.append(Quantity("displacement_rates"))  # for `ClosedChain.linearize`
    if every:
        keys = every_key()
    make_kernels = partial(CompiledBackend, near=near, platform=before.platform)
    kernels = make_kernels(reference)
    kernels.make(keys)
    return engine.Engine(before.mechanism, make_kernels, kernels, before.platform)


class Variant(NamedTuple):
    """One way to compile a kernel."""

    #: The key of the kernel; `along` says whether it computes direction by direction.
    key: Quantity
    #: The instruction set, one of `TARGETS`.
    target: str


class Variants(NamedTuple):
    """The ways to compile a kernel, for single samples and for batches; both may be the same."""

    single: Variant
    batch: Variant


class KernelCode(NamedTuple):
    """The loaded code of a kernel, for single samples and for batches; both may be the same."""

    single: Code
    batch: Code


class CompiledBackend:
    """Dynamics of one mechanism by its compiled kernels.

    Args:
        reference: The reference path of the mechanism.
        near: Configuration near which the order of elimination is chosen, shape (nq,); by default
            the example of the mechanism.
        platform: Name of the frame on whose body a `platform_moment` acts.
    """

    def __init__(
        self, reference: Reference, near: Array | None = None, *, platform: str = ""
    ) -> None:
        self._binding = binding()
        self._reference = reference
        self._mechanism = reference.mechanism
        self._robot = self._mechanism.model.name or "robot"
        # An engine of a changed robot is made with the same `near`, which may not close its loops.
        self._near = near if _closed(reference, near) else None
        self._parameters = SymbolicParameters(self._mechanism)
        body = body_of(self._mechanism.model, platform)
        #: Index of a `platform_moment` among the wrenches [force; moment] of all bodies, or -1.
        self._moment = -1 if body is None else 6 * body + 3
        # What was made so far. A kernel or a code is None if it is impossible.
        self._kernels: dict[Quantity, kernel_protocols.Kernel | None] = {}
        self._codes: dict[Quantity, KernelCode | None] = {}
        #: Equations by the arguments `loaded`, `smooth` and `welded` of `Equations`.
        self._equations: dict[tuple[bool, bool, bool], Equations] = {}
        #: C by the keys of variants, stored only while libraries are made: the two variants of a
        #: kernel may have the same key, and then their libraries are compiled from the same C.
        self._sources: dict[Quantity, list[str]] = {}
        #: Why there is no kernel, by the name of what the reference path computes instead.
        self._why: dict[str, str] = {}
        #: Nonsmooth steps by the arguments `loaded` and `many` of `nonsmooth`.
        self._nonsmooth: dict[tuple[bool, bool], NonsmoothCode | None] = {}
        #: Held while C is generated: CasADi is not safe for several threads.
        self._lock = threading.RLock()
        #: Whether `make` failed: its other threads then generate no more C. Such a backend is not
        #: used any more, because `make` raises the error to `compiled_engine`.
        self._stopped = False

    def __str__(self) -> str:
        target = self._binding.INSTRUCTIONS
        parts = [f"compiled kernels: {target}, {TARGETS[target].lanes} samples at once"]
        for name, why in self._why.items():
            parts.append(f"{name} by the reference path: {' '.join(why.split())}")  # in one line
        return "; ".join(parts)

    def make(self, keys: Sequence[Quantity] = FIRST) -> None:
        """Fill the cache on disk with the libraries of kernels, in several threads.

        The method makes no kernel: at the first use of each, `kernel` finds its library there.
        """
        from concurrent.futures import ThreadPoolExecutor  # slow to import

        variants: dict[Variant, None] = {}  # a set that keeps the order
        for key in dict.fromkeys(map(self._shared_key, keys)):
            if not impossible(self._mechanism, key.name):
                variants |= dict.fromkeys(self._variants(key))

        def load(variant: Variant) -> None:
            # The equations raise this error if the motors do not act on all coordinates, which
            # their number does not show. At the first use, `_codes_of` stores it in `_why`.
            with suppress(ActuationError):
                self._load(variant)

        with ThreadPoolExecutor() as pool:
            try:
                for _ in pool.map(load, variants):
                    pass
            except BaseException:  # Ctrl-C too: the other threads make no more
                self._stopped = True
                raise
        self._sources.clear()

    def kernel(self, key: Quantity) -> kernel_protocols.Kernel | None:
        """The kernel of a quantity, as `Kernels.kernel`."""
        try:
            return self._kernels[key]
        except KeyError:
            pass
        if key.frame is not None:
            frame_named(self._mechanism.model, key.frame)  # refuses an unknown frame
        if key.sign_width is not None:
            self._limit_widths()
        self._kernels[key] = self._new_kernel(key)
        return self._kernels[key]

    def _limit_widths(self) -> None:
        """Drop all kernels of derivatives if there are too many: a caller may vary the width."""
        smooth = [key for key in list(self._kernels) if key.sign_width is not None]
        if len(smooth) >= _MOST_WIDTHS:
            for key in smooth:
                self._kernels.pop(key, None)

    def closed(self, q: Array) -> Array | None:
        """The closed configuration near q with the coordinates fixed; None if it is not near.

        Newton steps that start short and shrink fast lead to the same solution as the reference
        path. A step is refused if it is longer than `LARGEST_RATIO`, a tenth, of the step before,
        so the loop ends soon.
        """
        mechanism = self._mechanism
        kernel = self.kernel(Quantity("closing"))
        # In two cases the solution depends on the way to it, and the reference path is asked: with
        # closures that constrain rates only, and with joints of which only some rates are
        # coordinates.
        rates_only = any(isinstance(closure, (Rolling, Brake)) for closure in mechanism.closures)
        if kernel is None or rates_only or mechanism.held_in_part:
            return None
        longest = LONGEST_FIRST_STEP
        # q after a step, then two numbers that are not needed here.
        result = np.full((1, len(q) + 2), np.nan)
        while True:
            # The kernel checks q before the step: are the loops closed, and is q regular?
            samples_that_fail = kernel.many((q[None],), result)
            q_after_step = result[0, :-2]
            step = pin.difference(mechanism.model, q, q_after_step) / mechanism.rate_scale
            length = float(np.abs(step).max(initial=0.0))
            if not length <= longest:  # NaN too
                return None
            if length >= _ROUNDING:  # a closed configuration stays as it is
                q = q_after_step.copy()
                longest = LARGEST_RATIO * length
            if length < _LONGEST_LAST_STEP:
                # The step was so short that the checks before it hold after it too.
                return None if len(samples_that_fail) else q

    def state_space(self, friction: Friction) -> CompiledStateSpace:
        """The state space with this friction instead of the mechanism's."""
        derivatives = Quantity("acceleration_derivatives", sign_width=friction.sign_width)
        return CompiledStateSpace(
            self._reference,
            friction,
            closing=cast("Kernel | None", self.kernel(Quantity("closing"))),
            derivatives=partial(self.kernel, derivatives),
            rate=partial(self._rate, friction),
            rollout=partial(self._rollout, friction),
        )

    def nonsmooth(self, rows: NonsmoothRows, loaded: bool, many: bool) -> NonsmoothCode | None:
        """Compiled steps with stops, friction and contacts; None if they cannot be compiled.

        Args:
            rows: The rows of a step. All but their gains follows from the mechanism, and gains are
                arguments of the code, so the code of the first call serves all calls.
            loaded: Whether external wrenches act.
            many: Whether the code computes several motions at once, in the lanes of a register.
        """
        if (loaded, many) not in self._nonsmooth:
            try:
                if problem := impossible(self._mechanism, "accelerations"):
                    raise CompilationError(problem)
                best = self._binding.INSTRUCTIONS
                target = best if many else SINGLE[best]
                self._nonsmooth[loaded, many] = NonsmoothCode(
                    self._mechanism,
                    self._parameters,
                    self._nonsmooth_code(rows, loaded, target),
                    TARGETS[target].lanes,
                )
            except SSTError as error:
                self._nonsmooth[loaded, many] = None
                self._why[nonsmooth_name(loaded)] = str(error)
        return self._nonsmooth[loaded, many]

    def _nonsmooth_code(self, rows: NonsmoothRows, loaded: bool, target: str) -> Code:
        """The code of nonsmooth steps from the cache, or compiled now."""
        key = Quantity("rollout", loaded=loaded)
        content = fingerprint(self._mechanism, self._parameters, self._near, rows=rows)

        def source() -> list[str]:
            try:
                from . import nonsmooth_c
            except ImportError:
                raise MissingExtraError("casadi", "compile") from None
            with self._lock:
                lanes = TARGETS[target].lanes
                return nonsmooth_c.library("nonsmooth", self._equations_of(key), rows, lanes)

        name = nonsmooth_name(loaded)
        return Code(libraries.load(self._robot, name, content, target, source), "nonsmooth")

    # --- inside -----------------------------------------------------------------------------

    @cached_property
    def _all_parameters(self) -> SymbolicParameters:
        """The parameters of the regressor: also masses, friction and springs that are zero."""
        return SymbolicParameters(with_springs(self._mechanism), complete=True)

    @cached_property
    def _content(self) -> bytes:
        """Everything that the kernels are made from."""
        return fingerprint(self._mechanism, self._parameters, self._near)

    def _new_kernel(
        self,
        key: Quantity,
        function: str = "run",
        friction: Friction | None = None,
    ) -> "Kernel | None":
        """A kernel with its code for single samples and for batches; None if it is impossible.

        Args:
            key: Its quantity.
            function: The function in the library: "run", or "rate" for the rates of the states of a
                rollout.
            friction: Friction in place of the mechanism's.
        """
        code = self._codes_of(key)
        if code is None:
            return None
        friction = friction or self._mechanism.friction
        if key.sign_width is not None:
            friction = replace(friction, sign_width=key.sign_width)
        parameters = self._parameters
        if key.name == "torque_regressor":
            parameters = self._all_parameters
        numbers = parameters.pack(self._mechanism, friction)
        sizes = code.single.sizes(function)
        # A kernel without external wrenches passes a call with a platform moment on to the kernel
        # with wrenches, which is made at the first such call. Kernels of `_rate` are never called
        # with a platform moment: states have wrenches on all bodies only.
        make_loaded = None
        if function == "run" and not key.loaded:
            make_loaded = partial(self._new_kernel, key._replace(loaded=True))
        return self._binding.Kernel(
            single=code.single.address(function),
            batch=code.batch.address(function),
            sizes=sizes.inputs,
            output=sizes.output,
            parameters=code.single.prepared(numbers),
            batch_parameters=code.batch.prepared(numbers),
            library=code,  # keeps the code in memory
            loaded=make_loaded,
            moment=self._moment,
        )

    def _rate(self, friction: Friction, loaded: bool) -> "Kernel | None":
        """The kernel that closes the loops of states and computes their rates, or None."""
        return self._new_kernel(Quantity("rollout", loaded=loaded), "rate", friction)

    def _rollout(self, friction: Friction, loaded: bool) -> "RolloutKernel | None":
        """The kernel of a rollout; None if it is impossible."""
        code = self._codes_of(Quantity("rollout", loaded=loaded))
        if code is None:
            return None
        batch = code.batch
        numbers = self._parameters.pack(self._mechanism, friction)
        q, va, tau, *load = batch.sizes("run").inputs
        sizes = (q, va, tau, sum(load))  # without external wrenches `load` is empty
        return self._binding.RolloutKernel(
            code=batch.address("run"),
            sizes=sizes,
            parameters=batch.prepared(numbers),
            library=batch,  # keeps the code in memory
        )

    def _codes_of(self, key: Quantity) -> KernelCode | None:
        """The code of a kernel; None if it is impossible, and `_why` says why."""
        key = self._shared_key(key)
        if key not in self._codes:
            try:
                self._codes[key] = self._load_both(self._variants(key))
            except SSTError as error:
                self._codes[key] = None
                self._why[str(key)] = str(error)
        return self._codes[key]

    def _shared_key(self, key: Quantity) -> Quantity:
        """The key of the code that computes this quantity; several quantities may share it."""
        if key.name == "generalized_forces" and self._mechanism.driven_one_to_one:
            key = key._replace(name="torques")
        return key._replace(sign_width=None)  # the width is a parameter of the code

    def _variants(self, key: Quantity) -> Variants:
        """How to compile a kernel for single samples and for batches."""
        if problem := impossible(self._mechanism, key.name):
            raise CompilationError(problem)
        best = self._binding.INSTRUCTIONS
        n = len(self._mechanism.coordinates)
        # Lanes with directions: eight are slower than four, if four are enough.
        target = best
        if best == "avx512" and n <= TARGETS["avx2"].lanes:
            target = "avx2"
        by_directions = Variant(key._replace(along=True), target)
        if is_large(self._mechanism, key.name):
            return Variants(single=by_directions, batch=by_directions)
        # Lanes with samples: a single sample is computed without vectors. Derivatives of the
        # dynamics (`smooth`) are the exception. Of the other quantities that can be computed by
        # directions, such as the regressor, the whole matrix is computed, unless it is large.
        by_samples = Variant(key, best)
        if key.properties.smooth and 1 < n <= _MOST_REGISTERS * TARGETS[best].lanes:
            return Variants(single=by_directions, batch=by_samples)
        return Variants(single=Variant(key, SINGLE[best]), batch=by_samples)

    def _load_both(self, variants: Variants) -> KernelCode:
        """The code of both variants, loaded at the same time; the same variant is loaded once."""
        from concurrent.futures import ThreadPoolExecutor  # slow to import

        different = list(dict.fromkeys(variants))
        try:
            with ThreadPoolExecutor() as pool:
                codes = dict(zip(different, pool.map(self._load, different), strict=True))
        finally:
            for variant in different:
                self._sources.pop(variant.key, None)
        return KernelCode(single=codes[variants.single], batch=codes[variants.batch])

    def _load(self, variant: Variant) -> Code:
        """The code of a variant from the cache, or compiled now."""
        key, target = variant
        content = self._content
        if key.frame is not None:
            content = fingerprint(self._mechanism, self._parameters, self._near, key.frame)

        options = [f"-DLANES={TARGETS[target].lanes}"]
        if key.properties.smooth:
            options += LONG
        sources = partial(self._sources_of, key)
        library = libraries.load(self._robot, str(key), content, target, sources, options)
        return Code(library, key.entry)

    def _sources_of(self, key: Quantity) -> list[str]:
        """The C of a kernel with the key of a variant: whole, or by directions if `along` is set.

        Two variants with the same key share it: the first one generates it.
        """
        try:
            from . import c_code, kernels
        except ImportError:
            raise MissingExtraError("casadi", "compile") from None
        with self._lock:
            if self._stopped:
                raise CompilationError("given up")
            sources = self._sources.get(key)
            if sources is None:
                sources = c_code.library(key.entry, kernels.entry(self._equations_of(key), key))
                self._sources[key] = sources
            return sources

    def _equations_of(self, key: Quantity) -> "Equations":
        """The symbols from which a kernel is made; kernels of one kind share them."""
        from .equations import Equations

        if key.name == "torque_regressor":
            samples = sample_configurations(self._reference, self._near)
            mechanism = with_springs(self._mechanism)
            return Equations(mechanism, samples, parameters=self._all_parameters)
        smooth = key.properties.smooth
        # Bodies that are welded together are computed as one, unless the wrenches between them are
        # wanted.
        welded = key.name != "reactions"
        kind = key.loaded, smooth, welded
        if kind not in self._equations:
            samples = sample_configurations(self._reference, self._near)
            self._equations[kind] = Equations(
                self._mechanism, samples, loaded=key.loaded, smooth=smooth, welded=welded
            )
        return self._equations[kind]


def nonsmooth_name(loaded: bool) -> str:
    """Name of the code of nonsmooth steps, with or without external wrenches."""
    return "nonsmooth_loaded" if loaded else "nonsmooth"


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
    n = len(mechanism.coordinates)
    motors = len(mechanism.motor_names)
    if mechanism.without_mass and quantity in ("accelerations", "acceleration_derivatives"):
        return "the mass matrix is singular"
    if quantity == "actuator_jacobian" and not motors:
        return "there are no motors"
    if quantity == "torques" and motors < n:
        return f"fewer motors ({motors}) than coordinates ({n})"
    return ""


def is_large(mechanism: Mechanism, quantity: Name) -> bool:
    """Whether a quantity is computed direction by direction for batches too."""
    n = len(mechanism.coordinates)
    nv = mechanism.model.nv
    return QUANTITIES[quantity].by_directions and n * n * nv > _LARGEST

# SPDX-License-Identifier: BSD-2-Clause
"""Compiled kernels as the backend of a chain, each made at its first use.

A *kernel* computes a quantity, such as the torques, for one sample or many. It checks each sample:
its loops are closed, no pivot is much smaller than in the sample configurations, all numbers are
finite. Samples that fail go to the reference path, one by one.

The *key* of a kernel is a `Quantity`: a name, with a frame, loads or a smoothing width if it needs
them. Its C is compiled in one or two *variants*: for single samples and for batches. Masses,
friction and springs are parameters of the compiled code, so several kernels share one code.
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
from .compiled_states import CompiledStateSpace
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

#: Derivatives of one sample are computed direction by direction if so many passes suffice for all
#: directions, several of which fit into a register. Whole matrices take longer then.
_MOST_PASSES = 2
#: Batches are computed by whole matrices if n^2 nv is at most this, with n coordinates and nv
#: rates: the code of a matrix grows faster than that of a direction.
_LARGEST = 10_000
#: Number of kernels of derivatives, one for each smoothing width, at which all are dropped.
_WIDTHS = 16

# Newton's method leads to the nearest closed configuration if the first step is short, and each
# step much shorter than the one before. Lengths of steps are in [rad] or robot lengths.
#: Longest first step.
_LONGEST_FIRST_STEP = 0.1
#: Largest ratio of the length of a step to that of the one before.
_LARGEST_RATIO = 0.1
#: The loops are closed after a step that is shorter: the next one would be its square.
_LONGEST_LAST_STEP = 1e-9
#: A shorter step is rounding.
_ROUNDING = 1e-14


def every_key() -> list[Quantity]:
    """The keys of all kernels but those of frames."""
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
    """The engine of the same mechanism with kernels; see `ClosedChain.compile`."""
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
            keys.append(Quantity("displacement_rates"))
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

    The order of elimination is chosen for configurations near `near`, shape (nq,), by default near
    the example of the mechanism. A `platform_moment` acts on the body of the frame `platform`.
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
        # What was made so far; None where it is not possible.
        self._kernels: dict[Quantity, kernel_protocols.Kernel | None] = {}
        self._codes: dict[Quantity, KernelCode | None] = {}
        #: Equations by whether they are loaded, smooth and welded.
        self._equations: dict[tuple[bool, bool, bool], Equations] = {}
        #: The C of kernels of which one of the two variants is not compiled yet.
        self._sources: dict[Quantity, list[str]] = {}
        #: Why there is no kernel of a quantity.
        self._why: dict[Quantity, str] = {}
        #: Nonsmooth steps by whether they are loaded, and for many motions.
        self._nonsmooth: dict[tuple[bool, bool], NonsmoothCode | None] = {}
        self._lock = threading.RLock()
        self._stopped = False  # whether `make` failed: other threads then stop

    def __str__(self) -> str:
        target = self._binding.INSTRUCTIONS
        parts = [f"compiled kernels: {target}, {TARGETS[target].lanes} samples at once"]
        for key, why in self._why.items():
            parts.append(f"{key} by the reference path: {' '.join(why.split())}")  # in one line
        return "; ".join(parts)

    def make(self, keys: Sequence[Quantity] = FIRST) -> None:
        """Load the code of kernels from the cache, or compile it, in several threads."""
        from concurrent.futures import ThreadPoolExecutor  # slow to import

        variants: dict[Variant, None] = {}  # a set that keeps the order
        for key in dict.fromkeys(map(self._shared_key, keys)):
            if not impossible(self._mechanism, key.name):
                variants |= dict.fromkeys(self._variants(key))

        def prepare(variant: Variant) -> None:
            with suppress(ActuationError):  # too few motors: `_codes_of` tells it
                self._from_cache(variant)

        with ThreadPoolExecutor() as pool:
            try:
                for _ in pool.map(prepare, variants):
                    pass
            except BaseException:  # Ctrl-C too: the other threads make no more
                self._stopped = True
                raise

    def kernel(self, key: Quantity) -> kernel_protocols.Kernel | None:
        """The kernel of a quantity, as `Kernels.kernel`."""
        try:
            return self._kernels[key]
        except KeyError:
            pass
        if key.frame is not None:
            frame_named(self._mechanism.model, key.frame)
        if key.sign_width is not None:
            self._drop_other_widths()
        self._kernels[key] = self._kernel(key)
        return self._kernels[key]

    def _drop_other_widths(self) -> None:
        """Drop all kernels of derivatives if there are too many: a caller may vary the width."""
        smooth = [key for key in list(self._kernels) if key.sign_width is not None]
        if len(smooth) >= _WIDTHS:
            for key in smooth:
                self._kernels.pop(key, None)

    def closed(self, q: Array) -> Array | None:
        """The closed configuration near q with the coordinates fixed; None if it is not near.

        Newton steps that start short and shrink fast lead to the same solution as the reference
        path.
        """
        mechanism = self._mechanism
        kernel = self.kernel(Quantity("closing"))
        # Where rows hold rates only, or a joint in part, the path to the solution counts.
        rates_only = any(isinstance(closure, (Rolling, Brake)) for closure in mechanism.closures)
        if kernel is None or rates_only or mechanism.held_in_part:
            return None
        longest = _LONGEST_FIRST_STEP
        result = np.full((1, len(q) + 2), np.nan)  # q after a step, determinant, sum of squares
        while True:
            failures = kernel.many((q[None],), result)
            after_step = result[0, :-2]
            step = pin.difference(mechanism.model, q, after_step) / mechanism.rate_scale
            length = float(np.abs(step).max(initial=0.0))
            if not length <= longest:  # NaN too
                return None
            if length >= _ROUNDING:  # a closed configuration stays as it is
                q = after_step.copy()
                longest = _LARGEST_RATIO * length
            if length < _LONGEST_LAST_STEP:
                return None if len(failures) else q

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
        """Compiled steps with stops, friction and contacts; None if they cannot be compiled."""
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
                self._why[Quantity("rollout", loaded=loaded)] = str(error)
        return self._nonsmooth[loaded, many]

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
                lanes = TARGETS[target].lanes
                return nonsmooth_c.library("nonsmooth", self._equations_of(key), rows, lanes)

        name = f"nonsmooth{'_loaded' if loaded else ''}"
        return Code(libraries.load(self._robot, name, content, target, source), "nonsmooth")

    # --- inside -----------------------------------------------------------------------------

    @cached_property
    def _all_parameters(self) -> SymbolicParameters:
        """All parameters of a regressor, with a spring wherever one is possible."""
        return SymbolicParameters(with_springs(self._mechanism), complete=True)

    @cached_property
    def _content(self) -> bytes:
        """Everything that the kernels are made from."""
        return fingerprint(self._mechanism, self._parameters, self._near)

    def _kernel(
        self,
        key: Quantity,
        function: str = "run",
        friction: Friction | None = None,
    ) -> "Kernel | None":
        """A kernel with its code for single samples and for batches; None if it is impossible.

        Args:
            key: Its quantity.
            function: The function in the library: "run", or "rate" of a rollout.
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
        return self._binding.Kernel(
            single=code.single.address(function),
            batch=code.batch.address(function),
            sizes=sizes.inputs,
            output=sizes.output,
            parameters=code.single.prepared(numbers),
            batch_parameters=code.batch.prepared(numbers),
            library=code,  # keeps the code in memory
            loaded=None if key.loaded else partial(self._kernel, key._replace(loaded=True)),
            moment=self._moment,
        )

    def _rate(self, friction: Friction, loaded: bool) -> "Kernel | None":
        """Rates of the closed states next to some states."""
        return self._kernel(Quantity("rollout", loaded=loaded), "rate", friction)

    def _rollout(self, friction: Friction, loaded: bool) -> "RolloutKernel | None":
        """The kernel of a rollout; None if it is impossible."""
        code = self._codes_of(Quantity("rollout", loaded=loaded))
        if code is None:
            return None
        batch = code.batch
        numbers = self._parameters.pack(self._mechanism, friction)
        q, va, tau, *load = batch.sizes("run").inputs
        sizes = (q, va, tau, sum(load))  # no load has size 0
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
            from concurrent.futures import ThreadPoolExecutor  # slow to import

            try:
                variants = self._variants(key)
                different = list(dict.fromkeys(variants))
                with ThreadPoolExecutor() as pool:
                    codes = list(pool.map(self._from_cache, different))
                self._codes[key] = KernelCode(single=codes[0], batch=codes[-1])
            except SSTError as error:
                self._codes[key] = None
                self._why[key] = str(error)
        return self._codes[key]

    def _shared_key(self, key: Quantity) -> Quantity:
        """The key of the kernel that computes this quantity."""
        if key.name == "generalized_forces" and self._mechanism.driven_one_to_one:
            key = key._replace(name="torques")
        return key._replace(sign_width=None)  # it is a parameter

    def _variants(self, key: Quantity) -> Variants:
        """How to compile a kernel for single samples and for batches."""
        if problem := impossible(self._mechanism, key.name):
            raise CompilationError(problem)
        best = self._binding.INSTRUCTIONS
        n = len(self._mechanism.coordinates)
        # Direction by direction, in the lanes of a vector. Eight directions at once are slower than
        # four, if four are enough.
        target = best
        if best == "avx512" and n <= TARGETS["avx2"].lanes:
            target = "avx2"
        by_directions = Variant(key._replace(along=True), target)
        if is_large(self._mechanism, key.name):
            return Variants(single=by_directions, batch=by_directions)
        whole = Variant(key, best)
        if key.properties.smooth and 1 < n <= _MOST_PASSES * TARGETS[best].lanes:
            return Variants(single=by_directions, batch=whole)
        return Variants(single=Variant(key, SINGLE[best]), batch=whole)

    def _from_cache(self, variant: Variant) -> Code:
        """Code from the cache, or compiled now."""
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
        """The C of a kernel, which is the same for single samples and for batches."""
        try:
            from . import c_code, kernels
        except ImportError:
            raise MissingExtraError("casadi", "compile") from None
        with self._lock:  # equations are made once, and CasADi is not safe for several threads
            if self._stopped:
                raise CompilationError("given up")
            # The first of the two variants generates the code, the other takes it. Threads may make
            # other kernels in between.
            sources = self._sources.pop(key, None)
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
        welded = key.name != "reactions"  # which need each body by itself
        kind = key.loaded, smooth, welded
        if kind not in self._equations:
            samples = sample_configurations(self._reference, self._near)
            self._equations[kind] = Equations(
                self._mechanism, samples, loaded=key.loaded, smooth=smooth, welded=welded
            )
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

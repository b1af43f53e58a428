# SPDX-License-Identifier: BSD-2-Clause
"""Compiled kernels as the backend of a chain.

A kernel checks each sample: its loops are closed, no pivot is much smaller than in the sample
configurations, all numbers are finite. Samples that fail these checks go to the reference path, one
by one; it computes them or raises the error. Each kernel is made at its first use.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..chain.assembly import home_of
from ..chain.closures import Closure, Distance, Rolling
from ..chain.coordinates import examples
from ..chain.mechanism import Friction, Mechanism
from ..chain.reference import Reference
from ..chain.tree import frame_named
from ..errors import (
    ActuationError,
    ClosureError,
    CompilationError,
    MissingExtraError,
    SSTError,
)
from ..extensions import missing, require_current
from . import build
from .code import Code
from .parameters import Parameters
from .states import CompiledStates
from .tree import Tree

if TYPE_CHECKING:
    from ._binding import Course, Kernel
    from .equations import Equations

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Made by `ClosedChain.compile`; the others when they are first needed.
FIRST = ("torques", "accelerations")
#: Of the dynamics.
DERIVATIVES = ("torque_derivatives", "acceleration_derivatives")
#: With variants for external wrenches.
_LOADABLE = (*FIRST, "forces", "rollout", *DERIVATIVES)
#: All kernels but those of frames.
EVERY = (
    *_LOADABLE,
    *(f"{name} loaded" for name in _LOADABLE),
    "rates",
    "joint_accelerations",
    "reduced_terms",
    "closing",
    "displacement_rates",
)
#: In their names: one sample, its directions side by side, so many times at most.
ALONG, _TIMES = "along", 2
#: Configurations by which pivots are chosen.
_SAMPLES = 8
#: Kernels that write out no matrices.
_WITHOUT_MATRICES = (
    "torques",
    "forces",
    "rates",
    "joint_accelerations",
    "frame_drift",
    "closing",
)
#: Of coordinates squared times rates, up to which inertia matrices are written out.
_LARGEST = 100_000
#: The same limit for derivatives.
_LARGEST_DERIVATIVES = 10_000
#: Ends the names of kernels that take external wrenches.
_LOADED = " loaded"
#: Begins the names of kernels whose second word is a frame.
_OF_FRAME = "frame_"
#: Kernels of derivatives that are kept, one for each width within which friction is smooth.
_WIDTHS = 16
#: What the binding is compiled from.
_BINDING = [Path(__file__).with_name(name) for name in ("_binding.pyx", "batches.h")]


class CompiledBackend:
    """Dynamics of one mechanism by kernels of its own.

    Args:
        reference: Of its mechanism.
        near: Where the order of elimination is chosen, shape (nq,); anywhere by default.
        parameters: Which numbers the kernels take; those of `Parameters` by default.
        code: Gives the code of a kernel by its name and an instruction set; from the cache by
            default.
        bearer: Body on which a moment alone is a load too, counted from 0; none by default.

    Raises:
        CompilationError: When the package was installed without its extension module, or with one
            of other sources.
        DescriptionError: When the mechanism holds something without compiled equations.
    """

    def __init__(
        self,
        reference: Reference,
        near: Array | None = None,
        *,
        parameters: Parameters | None = None,
        code: Callable[[str, str], Code] | None = None,
        bearer: int | None = None,
    ) -> None:
        try:
            from . import _binding
        except ImportError as error:
            raise CompilationError(f"{missing()} ({error})") from None
        require_current(_binding.__file__, *_BINDING)
        self._binding = _binding
        self._reference, self._mechanism = reference, reference.mechanism
        self._near = near
        self._parameters = parameters or Parameters(self._mechanism)
        self._code = code or self._from_cache
        self._moment = -1 if bearer is None else 6 * bearer
        self._numbers = self._parameters.pack(self._mechanism, self._mechanism.friction)
        self._kernels: dict[str, Kernel | None] = {}
        self._smooth: dict[tuple[str, float], Kernel | None] = {}
        self._equations: dict[tuple[bool, bool], Equations] = {}
        self._codes: dict[str, list[Code]] = {}
        self._why: dict[str, str] = {}
        self._lock = threading.RLock()
        self._given_up = False  # of one whose kernels could not be made; it is not used

    def __str__(self) -> str:
        whys = {name: " ".join(why.split()) for name, why in self._why.items()}  # in one line
        without = [f"{name} by the reference path: {why}" for name, why in whys.items()]
        lanes = build.TARGETS[self._binding.INSTRUCTIONS][0]
        instructions = f"{self._binding.INSTRUCTIONS}, {lanes} samples at once"
        return "; ".join([f"compiled kernels: {instructions}", *without])

    def make(self, names: Sequence[str] = FIRST) -> None:
        """Have kernels ready.

        Raises:
            MissingExtraError: Without CasADi, `sst-pin[compile]`, if they are not in the cache.
            CompilationError: Without a compiler, if they are not in the cache; when it fails.
        """
        from concurrent.futures import ThreadPoolExecutor  # slow to import

        wanted = [name for name in names if not impossible(self._mechanism, name)]
        variants = [variant for name in wanted for variant in self._variants(name)]
        with ThreadPoolExecutor() as pool:
            try:
                for _ in pool.map(self._prepare, variants):
                    pass
            except BaseException:  # Ctrl-C too: the other threads make no more
                self._given_up = True
                raise

    def _prepare(self, variant: tuple[str, str]) -> None:
        """Make code, unless the motors do not suffice, which `_found` tells."""
        with suppress(ActuationError):
            self._code(*variant)

    def fill(
        self,
        name: str,
        arrays: Sequence[Array | None],
        out: Array,
        threads: int,
        sign_width: float | None = None,
    ) -> Indices:
        """Fill results by a kernel and return the samples that fail its checks; as `Backend`."""
        if name == "generalized_forces":
            name = self._forces
        given = [np.require(a, float, "A") for a in arrays if a is not None]
        if given[-1].ndim == 3:
            N, bodies, _ = given[-1].shape
            name, given[-1] = name + _LOADED, given[-1].reshape(N, 6 * bodies)
        kernel = self.kernel(name) if sign_width is None else self._smoothed(name, sign_width)
        if kernel is None:
            return np.arange(len(out))
        return kernel.many(tuple(given), out, min(threads, sys.maxsize))

    def states(self, friction: Friction) -> CompiledStates:
        """The state space with this friction instead of the mechanism's."""
        return CompiledStates(self._reference, friction, self)

    # --- inside -----------------------------------------------------------------------------

    @cached_property
    def _content(self) -> bytes:
        """All that the kernels are made from."""
        content, near = _content(self._mechanism, self._parameters), self._near
        if near is None:
            near = home_of(self._mechanism)
        return content if near is None else content + near.tobytes()

    @property
    def _forces(self) -> str:
        """The kernel of the forces along the coordinates."""
        return "torques" if self._mechanism.driven_one_to_one else "forces"

    @property
    def torques_of(self) -> Callable[..., Any]:
        """Inverse dynamics of one sample or a batch, as `Backend.torques_of`."""
        return self._single("torques")

    @property
    def accelerations_of(self) -> Callable[..., Any]:
        """Direct dynamics of one sample or a batch, as `Backend.torques_of`."""
        return self._single("accelerations")

    @cached_property
    def forces_of(self) -> Callable[..., Any]:
        """Forces along the coordinates of one sample or a batch, as `Backend.torques_of`."""
        return self._single(self._forces)

    def derivatives_of(self, name: str, sign_width: float) -> Callable[..., Any]:
        """Derivatives of one sample or a batch, as `Backend.torques_of`."""
        kernel = self._smoothed(name, sign_width)
        return _nothing if kernel is None else kernel.derivatives

    def frame_of(self, name: str, frame: str) -> Callable[..., Any]:
        """A quantity of a frame, if its kernel is made already, as `Backend.torques_of`."""
        kernel = self._kernels.get(f"{name} {frame}")
        return _nothing if kernel is None else kernel.answer

    def _smoothed(self, name: str, sign_width: float) -> Kernel | None:
        """A kernel with smooth friction; those of the last few widths are kept."""
        try:
            return self._smooth[name, sign_width]
        except KeyError:
            friction = replace(self._mechanism.friction, sign_width=sign_width)
            kernel = self.kernel(name, friction)
            if len(self._smooth) >= _WIDTHS:
                self._smooth.clear()
            self._smooth[name, sign_width] = kernel
            return kernel

    def _single(self, name: str) -> Callable[..., Any]:
        kernel = self.kernel(name)
        return _nothing if kernel is None else kernel.answer

    def kernel(self, name: str, friction: Friction | None = None) -> Kernel | None:
        """A kernel; None if there is none.

        Args:
            name: One of those of `kernels.make`, with " loaded" for one that takes wrenches.
            friction: Instead of the mechanism's, in the same joints.
        """
        if friction is None and name in self._kernels:
            return self._kernels[name]
        loaded = partial(self.kernel, name + _LOADED, friction)
        kernel = self._kernel(name, "run", friction, loaded)
        if friction is None:
            self._kernels[name] = kernel
        return kernel

    def _kernel(
        self,
        name: str,
        word: str,
        friction: Friction | None,
        loaded: Callable[[], Kernel | None] | None = None,
    ) -> Kernel | None:
        """A kernel by its code for single samples, then for batches; None where there is none."""
        codes = self._found(name)
        if not codes:
            return None
        numbers = self._numbers
        if friction is not None:
            numbers = self._parameters.pack(self._mechanism, friction)
        outputs, *sizes = codes[0].sizes(word)
        return self._binding.Kernel(
            codes[0].address(word),
            codes[-1].address(word),
            tuple(sizes),
            outputs,
            codes[0].prepared(numbers),
            self._mechanism.model.gravity.linear,
            (codes, self._mechanism.model),
            loaded,
            codes[-1].prepared(numbers),
            self._moment,
        )

    def rate(self, loaded: bool, friction: Friction) -> Kernel | None:
        """Rates of the states next to those given whose loops are closed; None as above."""
        return self._kernel("rollout" + _LOADED * loaded, "rate", friction)

    def course(self, loaded: bool, friction: Friction) -> Course | None:
        """The kernel of a rollout; None where there is none."""
        codes = self._found("rollout" + _LOADED * loaded)
        if not codes:
            return None
        code = codes[-1]
        numbers = self._parameters.pack(self._mechanism, friction)
        _, q, va, tau, *load = code.sizes("run")
        sizes = (q, va, tau, sum(load))
        return self._binding.Course(code.address("run"), sizes, code.prepared(numbers), code)

    def _found(self, name: str) -> list[Code]:
        """A kernel's code for single samples, then for batches; none where there is none."""
        if name not in self._codes:
            try:
                self._codes[name] = [self._code(*variant) for variant in self._variants(name)]
            except SSTError as error:
                self._codes[name], self._why[name] = [], str(error)
        return self._codes[name]

    def _variants(self, name: str) -> list[tuple[str, str]]:
        """Names and instruction sets of a kernel for single samples, then of one for batches."""
        if problem := impossible(self._mechanism, name):
            raise CompilationError(problem)
        best = self._binding.INSTRUCTIONS
        if not _has_directions(self._mechanism, name, build.TARGETS[best][0]):
            return [(name, build.ONE[best]), (name, best)]
        # Eight directions at once are slower than four.
        narrow = "avx2" if best == "avx512" else best
        fit = len(self._mechanism.coordinates) <= build.TARGETS[narrow][0]
        first, *loaded = name.split()
        single = " ".join([first, ALONG, *loaded])
        return [(single, narrow if fit else best), (name, best)]

    def _from_cache(self, name: str, target: str) -> Code:
        """Code from the cache, or compiled now."""
        first, _, second = name.partition(" ")
        content = self._content
        of_frame = first.startswith(_OF_FRAME)
        if of_frame:
            content += _frame(self._mechanism, second)
        loaded = name.endswith(_LOADED) and not of_frame
        entry = first + "_loaded" * loaded

        def source() -> str:
            try:
                from . import c_code, kernels
            except ImportError:
                raise MissingExtraError("casadi", "compile") from None
            with self._lock:  # equations are made once, and CasADi is not for several threads
                if self._given_up:
                    raise CompilationError("given up")
                plain = name.removesuffix(_LOADED) if loaded else name
                equations = self._equations_of(loaded, smooth=plain.split()[0] in DERIVATIVES)
                made = kernels.entry(equations, plain)
                return c_code.library(entry, made, build.TARGETS[target][0])

        robot = self._mechanism.model.name
        options = build.LONG if first in DERIVATIVES else ()
        return Code(build.library(robot, name, content, target, source, options), entry)

    def _equations_of(self, loaded: bool, smooth: bool) -> Equations:
        from .equations import Equations

        if (loaded, smooth) not in self._equations:
            samples = sample_configurations(self._reference, self._near)
            self._equations[loaded, smooth] = Equations(self._mechanism, samples, loaded, smooth)
        return self._equations[loaded, smooth]


def impossible(mechanism: Mechanism, name: str) -> str:
    """Why there is no kernel of this name; empty when there is one."""
    nv, motors = mechanism.motors.shape
    n, first = len(mechanism.coordinates), name.split(maxsplit=1)[0]
    if mechanism.without_mass and first in ("accelerations", "acceleration_derivatives"):
        return "the mass matrix is singular"
    if first == "torques" and motors < n:
        return f"fewer motors ({motors}) than coordinates ({n})"
    if first not in _WITHOUT_MATRICES and n * n * nv > _LARGEST:
        return f"{n} coordinates of {nv} rates are too many for matrices to be written out"
    if first in DERIVATIVES and n * n * nv > _LARGEST_DERIVATIVES:
        return f"{n} coordinates of {nv} rates are too many for derivatives to be written out"
    return ""


def _has_directions(mechanism: Mechanism, name: str, lanes: int) -> bool:
    """Whether derivatives of one sample take less time direction by direction, `lanes` at once."""
    n, motors = len(mechanism.coordinates), mechanism.motors.shape[1]
    first = name.split(maxsplit=1)[0]
    fit = first == "torque_derivatives" or (first == "acceleration_derivatives" and motors == n)
    return fit and 1 < n <= _TIMES * lanes


def sample_configurations(reference: Reference, near: Array | None = None) -> Array:
    """Assembled configurations of a mechanism, the same at each call, shape (samples, nq).

    Args:
        reference: Of the mechanism.
        near: The first of them; a generic one by default.

    Raises:
        ClosureError: When none is found, or the one given is open.
    """
    assembly = reference.workspace.assembly
    if near is None:
        example = reference.mechanism.example
        near = next(examples(assembly)) if example is None else example
    reference.rates(near, np.zeros(len(reference.mechanism.coordinates)))
    samples = [near]
    for seed in range(4 * _SAMPLES):
        try:
            samples.append(assembly.aside(samples[seed % len(samples)], seed))
        except ClosureError:
            continue
        if len(samples) == _SAMPLES:
            break
    return np.array(samples)


def _content(mechanism: Mechanism, parameters: Parameters) -> bytes:
    """All that the kernels are made from."""
    model, tree = mechanism.model, Tree.of(mechanism.model)
    parts: list[Any] = [mechanism.closures, mechanism.length, parameters.bodies, parameters.joints]
    for link in tree.links:
        parts += [link.parent, link.kind, link.q, link.v, link.body]
        parts += [x.tobytes() for x in (link.R, link.p, link.S)]
    parts += [np.asarray(mechanism.coordinates).tobytes(), mechanism.motors.tobytes()]
    parts += [
        model.inertias[i].lever.tobytes()
        for i in range(1, model.njoints)
        if i not in parameters.bodies
    ]
    for closure in mechanism.closures:
        if isinstance(closure, (Closure, Distance)):
            parts += [_frame(mechanism, name) for name in (closure.frame_a, closure.frame_b)]
        elif isinstance(closure, Rolling):
            parts += [_frame(mechanism, name) for name in (closure.plane, closure.wheel)]
    return repr(parts).encode()


def _frame(mechanism: Mechanism, name: str) -> bytes:
    frame = frame_named(mechanism.model, name)
    return repr(frame.parentJoint).encode() + frame.placement.homogeneous.tobytes()


def _nothing(*_: object) -> None:
    return None

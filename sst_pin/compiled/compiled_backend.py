# SPDX-License-Identifier: BSD-2-Clause
"""Compiled kernels as the backend of a chain.

A kernel checks each sample: its loops are closed, no pivot is much smaller than in the sample
configurations, all numbers are finite. Samples that fail these checks go to the reference path, one
by one; it computes them or raises the error. Each kernel is made at its first use.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..chain import backend as chain
from ..chain.assembly import home_of
from ..chain.backend import Key, NoKernel
from ..chain.closures import Closure, Distance, Rolling
from ..chain.coordinates import examples
from ..chain.mechanism import Friction, Mechanism
from ..chain.reference import Reference
from ..chain.regressor import with_springs
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
from .links import LinkTree
from .open_numbers import OpenNumbers
from .states import CompiledStates

if TYPE_CHECKING:
    from ._binding import Course, Kernel
    from .equations import Equations
    from .inertia_by_columns import ByColumns


#: Made by `ClosedChain.compile`; the others when they are first needed.
FIRST = (Key("torques"), Key("accelerations"))
#: Derivatives of the dynamics.
DERIVATIVES = (Key("torque_derivatives"), Key("acceleration_derivatives"))
#: Its kernel has all masses, frictions, rotors and springs as open numbers.
REGRESSOR = Key("torque_regressor")
#: Quantities whose friction is smooth.
_SMOOTH = [key.quantity for key in DERIVATIVES]
#: Kernels with variants for external wrenches.
_LOADABLE = (*FIRST, Key("forces"), Key("rollout"), Key("reactions"), *DERIVATIVES)
#: All kernels but those of frames.
EVERY = (
    *_LOADABLE,
    *(key._replace(loaded=True) for key in _LOADABLE),
    Key("rates"),
    Key("joint_accelerations"),
    Key("actuator_jacobian"),
    Key("reduced_terms"),
    Key("closing"),
    Key("displacement_rates"),
    REGRESSOR,
)
#: Directions side by side are computed in at most so many passes.
_TIMES = 2
#: Configurations by which pivots are chosen.
_SAMPLES = 8
#: Kernels that write out no matrices.
_WITHOUT_MATRICES = (
    "torques",
    "forces",
    "rates",
    "reactions",
    "actuator_jacobian",
    "joint_accelerations",
    "frame_drift",
    "closing",
)
#: The number of coordinates squared times rates up to which inertia matrices are written out.
_LARGEST = 100_000
#: The same limit for derivatives and the regressor.
_LARGEST_DERIVATIVES = 10_000
#: Kernels of derivatives that are kept, one for each width within which friction is smooth.
_WIDTHS = 16
#: What the binding is compiled from.
_BINDING = [Path(__file__).with_name(name) for name in ("_binding.pyx", "batches.h")]


class CompiledBackend:
    """Dynamics of one mechanism by kernels of its own.

    The order of elimination is chosen near `near`, shape (nq,); by default anywhere. `code` gives
    the code of a kernel by its key and an instruction set; by default from the cache. `bearer` is a
    body on which a moment alone is a load too, counted from 0.
    """

    def __init__(
        self,
        reference: Reference,
        near: Array | None = None,
        *,
        parameters: OpenNumbers | None = None,
        code: Callable[[Key, str], Code] | None = None,
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
        self._parameters = parameters or OpenNumbers(self._mechanism)
        self._code = code or self._from_cache
        self._moment = -1 if bearer is None else 6 * bearer
        self._numbers = self._parameters.pack(self._mechanism, self._mechanism.friction)
        self._kernels: dict[Key, chain.Kernel] = {}
        self._equations: dict[tuple[bool, bool, bool], Equations] = {}
        self._codes: dict[Key, list[Code]] = {}
        self._why: dict[Key, str] = {}
        self._lock = threading.RLock()
        self._given_up = False  # of one whose kernels could not be made; it is not used

    def __str__(self) -> str:
        whys = {key: " ".join(why.split()) for key, why in self._why.items()}  # in one line
        without = [f"{key} by the reference path: {why}" for key, why in whys.items()]
        lanes = build.TARGETS[self._binding.INSTRUCTIONS][0]
        instructions = f"{self._binding.INSTRUCTIONS}, {lanes} samples at once"
        return "; ".join([f"compiled kernels: {instructions}", *without])

    def make(self, keys: Sequence[Key] = FIRST) -> None:
        """Have kernels ready, those in the cache or compiled now."""
        from concurrent.futures import ThreadPoolExecutor  # slow to import

        wanted = [key for key in keys if not impossible(self._mechanism, key.quantity)]
        variants = [variant for key in wanted for variant in self._variants(key)]
        with ThreadPoolExecutor() as pool:
            try:
                for _ in pool.map(self._prepare, variants):
                    pass
            except BaseException:  # Ctrl-C too: the other threads make no more
                self._given_up = True
                raise

    def _prepare(self, variant: tuple[Key, str]) -> None:
        """Make code, unless the motors do not suffice, which `_found` tells."""
        with suppress(ActuationError):
            self._code(*variant)

    def kernel(self, key: Key) -> chain.Kernel:
        """What computes a quantity, as `Backend.kernel`; those of the last widths are kept."""
        try:
            return self._kernels[key]
        except KeyError:
            pass
        if key.frame is not None:
            frame_named(self._mechanism.model, key.frame)
        if key.sign_width is not None:
            smooth = [made for made in list(self._kernels) if made.sign_width is not None]
            for made in smooth if len(smooth) >= _WIDTHS else ():
                self._kernels.pop(made, None)
        columns = self._by_columns() if key.quantity == "accelerations" else None
        kernel = self._kernels[key] = columns or self._kernel(key) or NoKernel()
        return kernel

    def states(self, friction: Friction) -> CompiledStates:
        """The state space with this friction instead of the mechanism's."""
        closing, course = self.kernel(Key("closing")), partial(self._course, friction)
        rate, columns = partial(self._rate, friction), self._by_columns(friction)
        derivatives = Key("acceleration_derivatives", sign_width=friction.sign_width)
        slopes = partial(self.kernel, derivatives)
        return CompiledStates(self._reference, friction, closing, slopes, rate, course, columns)

    # --- inside -----------------------------------------------------------------------------

    @cached_property
    def _all_numbers(self) -> OpenNumbers:
        return OpenNumbers(with_springs(self._mechanism), complete=True)

    @cached_property
    def _content(self) -> bytes:
        """All that the kernels are made from."""
        content, near = _content(self._mechanism, self._parameters), self._near
        if near is None:
            near = home_of(self._mechanism)
        return content if near is None else content + near.tobytes()

    def _by_columns(self, friction: Friction | None = None) -> ByColumns | None:
        """Direct dynamics where the mass matrix is too large to be written out; None elsewhere."""
        mechanism, forces = self._mechanism, Key("generalized_forces")
        if not _too_large(mechanism) or mechanism.lines.motors.any() or mechanism.without_mass:
            return None

        def of_loads(loaded: bool) -> Kernel:
            kernel = self._kernel(forces._replace(loaded=loaded), friction=friction)
            if kernel is None:
                raise CompilationError(str(self))
            return kernel

        from .inertia_by_columns import ByColumns

        inertial, rates = self._kernel(forces, inertial=True), self._kernel(Key("rates"))
        if inertial is None or rates is None:
            return None
        return ByColumns(mechanism, cache(of_loads), inertial, rates)

    def _kernel(
        self,
        key: Key,
        word: str = "run",
        friction: Friction | None = None,
        *,
        inertial: bool = False,
    ) -> Kernel | None:
        """A kernel by its code for single samples, then for batches; None where there is none."""
        codes = self._found(key)
        if not codes:
            return None
        if key.sign_width is not None:
            friction = replace(self._mechanism.friction, sign_width=key.sign_width)
        numbers = self._numbers
        if key == REGRESSOR:
            numbers = self._all_numbers.pack(self._mechanism, self._mechanism.friction)
        if friction is not None:
            numbers = self._parameters.pack(self._mechanism, friction)
        if inertial:
            numbers = self._parameters.inertial(numbers)
        outputs, *sizes = codes[0].sizes(word)
        return self._binding.Kernel(
            codes[0].address(word),
            codes[-1].address(word),
            tuple(sizes),
            outputs,
            codes[0].prepared(numbers),
            codes,
            None if key.loaded else partial(self._kernel, key._replace(loaded=True)),
            codes[-1].prepared(numbers),
            self._moment,
        )

    def _rate(self, friction: Friction, loaded: bool) -> chain.Kernel:
        """Rates of the states next to those given whose loops are closed."""
        return self._kernel(Key("rollout", loaded=loaded), "rate", friction) or NoKernel()

    def _course(self, friction: Friction, loaded: bool) -> Course | None:
        """The kernel of a rollout; None where there is none."""
        codes = self._found(Key("rollout", loaded=loaded))
        if not codes:
            return None
        code = codes[-1]
        numbers = self._parameters.pack(self._mechanism, friction)
        _, q, va, tau, *load = code.sizes("run")
        sizes = (q, va, tau, sum(load))
        return self._binding.Course(code.address("run"), sizes, code.prepared(numbers), code)

    def _found(self, key: Key) -> list[Code]:
        """A kernel's code for single samples, then for batches; none where there is none."""
        key = key._replace(sign_width=None)  # it is a parameter
        if key.quantity == "generalized_forces":
            one = self._mechanism.driven_one_to_one
            key = key._replace(quantity="torques" if one else "forces")
        if key not in self._codes:
            try:
                self._codes[key] = [self._code(*variant) for variant in self._variants(key)]
            except SSTError as error:
                self._codes[key], self._why[key] = [], str(error)
        return self._codes[key]

    def _variants(self, key: Key) -> list[tuple[Key, str]]:
        """Keys and instruction sets of a kernel for single samples, then of one for batches."""
        if problem := impossible(self._mechanism, key.quantity):
            raise CompilationError(problem)
        best = self._binding.INSTRUCTIONS
        if not _has_directions(self._mechanism, key.quantity, build.TARGETS[best][0]):
            return [(key, build.ONE[best]), (key, best)]
        # Eight directions at once are slower than four.
        narrow = "avx2" if best == "avx512" else best
        fit = len(self._mechanism.coordinates) <= build.TARGETS[narrow][0]
        return [(key._replace(along=True), narrow if fit else best), (key, best)]

    def _from_cache(self, key: Key, target: str) -> Code:
        """Code from the cache, or compiled now."""
        content, smooth = self._content, key.quantity in _SMOOTH
        if key.frame is not None:
            content += _frame(self._mechanism, key.frame)

        def source() -> str:
            try:
                from . import c_code, kernels
            except ImportError:
                raise MissingExtraError("casadi", "compile") from None
            with self._lock:  # equations are made once, and CasADi is not for several threads
                if self._given_up:
                    raise CompilationError("given up")
                made = kernels.entry(self._equations_of(key), key)
                return c_code.library(key.entry, made, build.TARGETS[target][0])

        robot, options = self._mechanism.model.name, build.LONG if smooth else ()
        library = build.library(robot, str(key), content, target, source, options)
        return Code(library, key.entry)

    def _equations_of(self, key: Key) -> Equations:
        from .equations import Equations

        if key == REGRESSOR:
            samples = sample_configurations(self._reference, self._near)
            mechanism = with_springs(self._mechanism)
            return Equations(mechanism, samples, parameters=self._all_numbers)
        kind = key.loaded, key.quantity in _SMOOTH, key.quantity != "reactions"
        if kind not in self._equations:
            samples = sample_configurations(self._reference, self._near)
            loaded, smooth, welded = kind
            self._equations[kind] = Equations(
                self._mechanism, samples, loaded, smooth, welded=welded
            )
        return self._equations[kind]


def _too_large(mechanism: Mechanism) -> bool:
    """Whether there are too many coordinates for matrices to be written out."""
    nv = mechanism.model.nv
    return len(mechanism.coordinates) ** 2 * nv > _LARGEST


def impossible(mechanism: Mechanism, quantity: str) -> str:
    """Why there is no kernel of this quantity; empty when there is one."""
    nv, motors = mechanism.motors.shape
    n = len(mechanism.coordinates)
    if mechanism.without_mass and quantity in ("accelerations", "acceleration_derivatives"):
        return "the mass matrix is singular"
    if quantity == "actuator_jacobian" and not motors:
        return "there are no motors"
    if quantity == "torques" and motors < n:
        return f"fewer motors ({motors}) than coordinates ({n})"
    if quantity not in _WITHOUT_MATRICES and _too_large(mechanism):
        return f"{n} coordinates of {nv} rates are too many for matrices to be written out"
    large = quantity in _SMOOTH or quantity == REGRESSOR.quantity
    if large and n * n * nv > _LARGEST_DERIVATIVES:
        return f"{n} coordinates of {nv} rates are too many for derivatives to be written out"
    return ""


def _has_directions(mechanism: Mechanism, quantity: str, lanes: int) -> bool:
    """Whether derivatives of one sample take less time direction by direction, `lanes` at once."""
    n, motors = len(mechanism.coordinates), mechanism.motors.shape[1]
    fit = quantity == "torque_derivatives" or (
        quantity == "acceleration_derivatives" and motors == n
    )
    return fit and 1 < n <= _TIMES * lanes


def sample_configurations(reference: Reference, near: Array | None = None) -> Array:
    """Assembled configurations, the same at each call, shape (samples, nq), `near` the first."""
    reference.mechanism.require_freedom()
    assembly = reference.memory.assembly
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


def _content(mechanism: Mechanism, parameters: OpenNumbers) -> bytes:
    """All that the kernels are made from."""
    model, tree = mechanism.model, LinkTree.of(mechanism.model)
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
    if not mechanism.lines.none:
        parts.append(mechanism.lines.motors.tobytes())
    for line in mechanism.lines.forces:
        parts += [_frame(mechanism, name) for name in (line.frame_a, line.frame_b)]
    for closure in mechanism.closures:
        if isinstance(closure, (Closure, Distance)):
            parts += [_frame(mechanism, name) for name in (closure.frame_a, closure.frame_b)]
        elif isinstance(closure, Rolling):
            parts += [_frame(mechanism, name) for name in (closure.plane, closure.wheel)]
    return repr(parts).encode()


def _frame(mechanism: Mechanism, name: str) -> bytes:
    frame = frame_named(mechanism.model, name)
    return repr(frame.parentJoint).encode() + frame.placement.homogeneous.tobytes()

# SPDX-License-Identifier: BSD-2-Clause
"""Compiled kernels as the backend of a chain.

A kernel vouches for the samples whose loops are clearly closed, whose pivots are not much smaller
than in the samples they were chosen by, and whose numbers are finite. The others go to the
reference path, one by one: it finds the answer, or raises the error that is due. Each kernel is
made when it is first asked for.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..chain.assembly import generic_configuration
from ..chain.closures import Closure, Distance, Rolling
from ..chain.mechanism import Friction, Mechanism
from ..chain.reference import Reference, ReferenceStates
from ..errors import (
    ClosureError,
    CompilationError,
    DescriptionError,
    MissingExtraError,
    SSTError,
)
from . import build
from .parameters import Parameters
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
#: Configurations by which pivots are chosen.
_SAMPLES = 8
#: Of coordinates squared times rates, up to which inertia matrices are written out.
_LARGEST = 100_000
#: Likewise, derivatives.
_LARGEST_DERIVATIVES = 10_000
#: Ends the names of kernels that take external wrenches.
_LOADED = " loaded"
#: Kernels of derivatives that are kept, one for each width within which friction is smooth.
_WIDTHS = 16
#: Samples that are worth a thread.
_SHARE = 256


class CompiledBackend:
    """Dynamics of one mechanism by kernels of its own.

    Args:
        reference: Of its mechanism.
        model: The tree whose gravity single samples watch: when it changes they are not vouched
            for.
        near: Where the order of elimination is chosen, shape (nq,); anywhere by default.

    Raises:
        CompilationError: When the package was installed without its extension module.
        DescriptionError: When the mechanism holds something without compiled equations.
    """

    def __init__(self, reference: Reference, model: pin.Model, near: Array | None = None) -> None:
        try:
            from . import _binding
        except ImportError as error:
            raise CompilationError(
                f"the extension module is missing ({error}); install sst-pin with a C compiler"
            ) from None
        self._binding = _binding
        self._reference, self._mechanism = reference, reference.mechanism
        self._model, self._near = model, near
        self._parameters = Parameters(self._mechanism)
        self._content = _content(self._mechanism, self._parameters)
        if near is not None:
            self._content += near.tobytes()
        self._numbers = self._parameters.pack(self._mechanism, self._mechanism.friction)
        self._kernels: dict[str, Kernel | None] = {}
        self._smooth: dict[tuple[str, float], Kernel | None] = {}
        self._equations: dict[tuple[bool, bool], Equations] = {}
        self._why: dict[str, str] = {}
        self._lock = threading.RLock()

    def __str__(self) -> str:
        without = [f"{name} by the reference path: {why}" for name, why in self._why.items()]
        lanes = build.TARGETS[self._binding.INSTRUCTIONS][0]
        instructions = f"{self._binding.INSTRUCTIONS}, {lanes} samples at once"
        return "; ".join([f"compiled kernels: {instructions}", *without])

    def make(self, names: Sequence[str] = FIRST) -> None:
        """Have kernels ready.

        Raises:
            MissingExtraError: Without CasADi, `sst-pin[compile]`, where they are not in the cache.
            CompilationError: Without a compiler, likewise, or when it fails.
        """
        with ThreadPoolExecutor() as pool:
            for _ in pool.map(self._made, [x for x in names if not impossible(self._mechanism, x)]):
                pass

    def torques(
        self, q: Array, va: Array, aa: Array, wrenches: Array | None, tau: Array, threads: int
    ) -> Indices:
        """Fill tau."""
        return self._fill("torques", (q, va, aa), wrenches, tau, threads)

    def generalized_forces(
        self, q: Array, va: Array, aa: Array, wrenches: Array | None, f: Array, threads: int
    ) -> Indices:
        """Fill f."""
        name = "torques" if self._mechanism.driven_one_to_one else "forces"
        return self._fill(name, (q, va, aa), wrenches, f, threads)

    def joint_rates(self, q: Array, va: Array, v: Array, threads: int) -> Indices:
        """Fill v, the rates of the tree."""
        return self._fill("rates", (q, va), None, v, threads)

    def frame_jacobian(self, frame: str, q: Array, J: Array, threads: int) -> Indices:
        """Fill rows of the Jacobian of a frame."""
        return self._fill(f"jacobian {frame}", (q,), None, J, threads)

    def accelerations(
        self, q: Array, va: Array, tau: Array, wrenches: Array | None, aa: Array, threads: int
    ) -> Indices:
        """Fill aa."""
        return self._fill("accelerations", (q, va, tau), wrenches, aa, threads)

    def reduced_terms(self, q: Array, va: Array, rows: Array, threads: int) -> Indices:
        """Fill rows of inertia, coriolis, gravity, friction."""
        return self._fill("reduced_terms", (q, va), None, rows, threads)

    def derivatives(
        self,
        name: str,
        sign_width: float,
        q: Array,
        va: Array,
        x: Array,
        wrenches: Array | None,
        rows: Array,
        threads: int,
    ) -> Indices:
        """Fill rows of derivatives by q, va and x, which is aa or tau."""
        arrays: tuple[Array, ...] = (q, va, x)
        if wrenches is not None:
            name, arrays = name + _LOADED, (*arrays, wrenches.reshape(len(wrenches), -1))
        kernel = self._smoothed(name, sign_width)
        if kernel is None:
            return np.arange(len(rows))
        return in_threads(kernel.many, arrays, rows, threads)

    def displacement_rates(self, q: Array, va: Array, rows: Array, threads: int) -> Indices:
        """Fill rows of what moving axes of joints do to a displacement."""
        return self._fill("displacement_rates", (q, va), None, rows, threads)

    def states(self, friction: Friction) -> CompiledStates:
        """The state space with a friction in the place of the mechanism's own."""
        return CompiledStates(self._reference, friction, self)

    # --- inside -----------------------------------------------------------------------------

    @property
    def torques_of(self) -> Callable[..., Any]:
        """Inverse dynamics of one sample; None where it needs care."""
        return self._single("torques")

    @property
    def accelerations_of(self) -> Callable[..., Any]:
        """Direct dynamics of one sample; None where it needs care."""
        return self._single("accelerations")

    def derivatives_of(self, name: str, sign_width: float) -> Callable[..., Any]:
        """Derivatives of one sample; None where they need care."""
        kernel = self._smoothed(name, sign_width)
        return _nothing if kernel is None else kernel.one

    def _smoothed(self, name: str, sign_width: float) -> Kernel | None:
        """A kernel with smooth friction; those of the last few widths are kept."""
        try:
            return self._smooth[name, sign_width]
        except KeyError:
            friction = replace(self._mechanism.friction, sign_width=sign_width)
            kernel = None if name in self._why else self.kernel(name, friction)
            if len(self._smooth) >= _WIDTHS:
                self._smooth.clear()
            self._smooth[name, sign_width] = kernel
            return kernel

    def _single(self, name: str) -> Callable[..., Any]:
        kernel = self.kernel(name)
        return _nothing if kernel is None else kernel.one

    def _fill(
        self,
        name: str,
        arrays: tuple[Array, ...],
        wrenches: Array | None,
        out: Array,
        threads: int,
    ) -> Indices:
        if wrenches is not None:
            name, arrays = name + _LOADED, (*arrays, wrenches.reshape(len(wrenches), -1))
        kernel = self.kernel(name)
        if kernel is None:
            return np.arange(len(out))
        return in_threads(kernel.many, arrays, out, threads)

    def kernel(self, name: str, friction: Friction | None = None) -> Kernel | None:
        """A kernel, with the friction of the mechanism or another one; None where there is none.

        Args:
            name: One of those of `kernels.make`, with " loaded" for one that takes wrenches.
            friction: In the place of the mechanism's own, in the same joints.
        """
        if friction is None and name in self._kernels:
            return self._kernels[name]
        try:
            libraries = self._made(name)
        except SSTError as error:
            self._why[name], self._kernels[name] = str(error), None
            return None
        size, outputs, *sizes = _sizes(libraries[0])
        numbers = self._numbers
        if friction is not None:
            numbers = self._parameters.pack(self._mechanism, friction)
        numbers = _prepared(libraries[0], numbers, size)
        addresses = [_address(library) for library in libraries]
        arguments = (addresses[0], addresses[-1], tuple(sizes), outputs, numbers)
        # Gravity is watched in the model's own memory, which has to stay.
        watched = self._model.gravity.linear
        kernel = self._binding.Kernel(*arguments, watched, (libraries, self._model))
        if friction is None:
            self._kernels[name] = kernel
        return kernel

    def course(self, loaded: bool, friction: Friction) -> Course | None:
        """The kernel of a rollout; None where there is none."""
        name = "rollout" + _LOADED * loaded
        if name in self._why:
            return None
        try:
            (library,) = self._made(name)
        except SSTError as error:
            self._why[name] = str(error)
            return None
        size, _, q, va, tau, *load = _sizes(library)
        numbers = self._parameters.pack(self._mechanism, friction)
        numbers = _prepared(library, numbers, size)
        sizes = (q, va, tau, sum(load))
        return self._binding.Course(_address(library), sizes, numbers, library)

    def _made(self, name: str) -> list[ctypes.CDLL]:
        """Libraries of a kernel: for single samples, then for batches."""
        if problem := impossible(self._mechanism, name):
            raise DescriptionError("compiled kernels", [problem])
        best = self._binding.INSTRUCTIONS
        # Eight samples at once take longer than four, and one sample takes as long as all.
        targets = ["avx2", best] if best == "avx512" else [best]
        first, _, second = name.partition(" ")
        if first == "rollout":
            targets = [best]
        content = self._content
        if first == "jacobian":
            content += _frame(self._mechanism, second)
        libraries = []
        for target in targets:
            source = self._source(name, build.TARGETS[target][0])
            robot = self._mechanism.model.name
            libraries.append(build.library(robot, name, content, target, source))
        return libraries

    def _source(self, name: str, lanes: int) -> Callable[[], str]:
        def source() -> str:
            try:
                from . import c_code, kernels
            except ImportError:
                raise MissingExtraError("casadi", "compile") from None
            loaded = name.endswith(_LOADED) and not name.startswith("jacobian ")
            plain = name.removesuffix(_LOADED) if loaded else name
            parts = ["state_rate", "closing"] if plain == "rollout" else [plain]
            with self._lock:  # equations are made once, and CasADi is not for several threads
                equations = self._equations_of(loaded, smooth=plain in DERIVATIVES)
                return c_code.library([kernels.make(equations, part) for part in parts], lanes)

        return source

    def _equations_of(self, loaded: bool, smooth: bool) -> Equations:
        from .equations import Equations

        if (loaded, smooth) not in self._equations:
            samples = sample_configurations(self._reference, self._near)
            self._equations[loaded, smooth] = Equations(self._mechanism, samples, loaded, smooth)
        return self._equations[loaded, smooth]


class CompiledStates(ReferenceStates):
    """The state space of a mechanism by its kernels; the reference path does what they leave.

    Args:
        reference: Of the mechanism.
        friction: In the place of the mechanism's own.
        backend: With its kernels.
    """

    def __init__(self, reference: Reference, friction: Friction, backend: CompiledBackend) -> None:
        super().__init__(reference, friction)
        self._backend = backend
        self._closing = backend.kernel("closing")

    def closed(self, states: Array) -> Array:
        """As `ReferenceStates.closed`, by Newton's method."""
        if self._closing is None:
            return super().closed(states)
        q = np.ascontiguousarray(states[..., : self._nq].reshape(-1, self._nq))
        for _ in range(4):
            result = np.empty((len(q), self._nq + 1))
            left = self._closing.many((q,), result)
            q = result[:, :-1]
            if not len(left):  # closed to 1e-6 before this step: the next one is the last
                self._closing.many((q,), result)
                return result[:, :-1].reshape(*states.shape[:-1], self._nq)
        return super().closed(states)

    def rate(self, states: Array, tau: Array, wrenches: Array | None) -> Array:
        """As `ReferenceStates.rate`."""
        kernel = self._loaded_rate if wrenches is not None else self._rate_alone
        if kernel is None:
            return super().rate(states, tau, wrenches)
        q, n = self.closed(states).reshape(-1, self._nq), states.shape[-1] - self._nq
        arrays = [q, states[..., self._nq :].reshape(-1, n), tau.reshape(len(q), -1)]
        if wrenches is not None:
            arrays.append(wrenches.reshape(len(q), -1))
        rates = np.empty((len(q), states.shape[-1]))
        if len(kernel.many(tuple(arrays), rates)):
            return super().rate(states, tau, wrenches)
        return rates.reshape(states.shape)

    def rollout(
        self,
        dt: float,
        q0: Array,
        va0: Array,
        tau: Array,
        wrenches: Array | None,
        q: Array,
        va: Array,
        threads: int,
    ) -> Indices:
        """As `ReferenceStates.rollout`; it goes on where the kernels stop."""
        course = self._backend.course(wrenches is not None, self._friction)
        if course is None:
            return super().rollout(dt, q0, va0, tau, wrenches, q, va, threads)
        load = None if wrenches is None else wrenches.reshape(len(wrenches), -1)

        def run(part: slice) -> Indices:
            on = None if load is None else load[part]
            return course.run(dt, q0[part], va0[part], tau[part], on, q[part], va[part])

        parts = _slices(len(q), threads)
        reached = np.concatenate(_on_each(run, parts))
        steps = q.shape[1] - 1
        stride = 1 if tau.shape[1] == steps else 2
        for i in np.flatnonzero(reached <= steps):
            done, one = max(int(reached[i]) - 1, 0), slice(i, i + 1)
            q_start = (q[one, done] if done else q0[one]).copy()
            va_start = (va[one, done] if done else va0[one]).copy()
            loads = None if wrenches is None else wrenches[one]
            rest = tau[one, stride * done :]
            arguments = (dt, q_start, va_start, rest, loads, q[one, done:], va[one, done:], 1)
            reached[i] = done + super().rollout(*arguments)[0]
        return reached

    @cached_property
    def _rate_alone(self) -> Kernel | None:
        return self._backend.kernel("state_rate", self._friction)

    @cached_property
    def _loaded_rate(self) -> Kernel | None:
        return self._backend.kernel("state_rate" + _LOADED, self._friction)


def impossible(mechanism: Mechanism, name: str) -> str:
    """Why there is no kernel of this name; empty when there is one."""
    nv, motors = mechanism.motors.shape
    n, first = len(mechanism.coordinates), name.split(maxsplit=1)[0]
    if first == "torques" and motors < n:
        return f"{motors} motors for {n} coordinates"
    if first not in ("torques", "forces", "rates", "closing") and n * n * nv > _LARGEST:
        return f"{n} coordinates of {nv} rates are too many for matrices to be written out"
    if first in DERIVATIVES and n * n * nv > _LARGEST_DERIVATIVES:
        return f"{n} coordinates of {nv} rates are too many for derivatives to be written out"
    return ""


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
        near = generic_configuration(assembly)
    reference.workspace.evaluate(near)
    samples = [near]
    for seed in range(4 * _SAMPLES):
        try:
            samples.append(assembly.aside(samples[seed % len(samples)], seed))
        except ClosureError:
            continue
        if len(samples) == _SAMPLES:
            break
    return np.array(samples)


def in_threads(
    fill: Callable[[tuple[Array | None, ...], Array], Indices],
    arrays: tuple[Array | None, ...],
    out: Array,
    threads: int,
) -> Indices:
    """Fill the rows of `out`, shared among threads; what is left, by index."""
    plain = tuple(None if a is None else np.require(a, float, "A") for a in arrays)

    def run(part: slice) -> Indices:
        rows = tuple(None if a is None else a[part] for a in plain)
        return fill(rows, out[part]) + part.start

    return np.concatenate(_on_each(run, _slices(len(out), threads)))


def _slices(samples: int, threads: int) -> list[slice]:
    parts = max(1, min(threads, samples // _SHARE))
    ends = [samples * k // parts for k in range(parts + 1)]
    return [slice(a, b) for a, b in pairwise(ends)]


def _on_each(run: Callable[[slice], Indices], parts: list[slice]) -> list[Indices]:
    if len(parts) == 1:
        return [run(parts[0])]
    with ThreadPoolExecutor(len(parts)) as pool:
        return list(pool.map(run, parts))


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
    frame = mechanism.model.frames[mechanism.model.getFrameId(name)]
    return repr(frame.parentJoint).encode() + frame.placement.homogeneous.tobytes()


def _prepared(library: ctypes.CDLL, numbers: Array, size: int) -> Array:
    """Parameters with the constants of a kernel behind them."""
    p = np.concatenate([numbers, np.zeros(size - len(numbers))])
    library.prepare(ctypes.c_void_p(p.ctypes.data))
    return p


def _sizes(library: ctypes.CDLL) -> list[int]:
    """Parameters with constants, numbers in the output and each input; the list ends with 0."""
    sizes = []
    numbers = (ctypes.c_int * 8).in_dll(library, "sizes")
    for number in numbers:
        if not number:
            break
        sizes.append(number)
    return sizes


def _address(library: ctypes.CDLL) -> int:
    address = ctypes.cast(library.run_kernel, ctypes.c_void_p).value
    assert address is not None
    return address


def _nothing(*_: object) -> None:
    return None

# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of many samples of one robot on a GPU or a CPU, by kernels of NVIDIA Warp."""

import sys
from collections.abc import Mapping
from copy import copy
from enum import IntEnum
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import warp as wp

from ..arrays import Array, positive_number, whole_number
from ..dynamics.derivatives import AccelerationDerivatives, TorqueDerivatives
from ..dynamics.quantities import Name, Quantity
from ..dynamics.reference import Reference
from ..errors import CompilationError, InputError
from . import kernels, libraries, warp_code
from .c_code import STYLES
from .compiled_backend import impossible
from .equations import Equations
from .generator_inputs import fingerprint, sample_configurations
from .kernel_checks import Checks
from .symbolic_parameters import SymbolicParameters

#: Precisions of the C by Warp's types of numbers.
_PRECISIONS = {style.dtype: style for style in STYLES.values()}
#: Threads of a block: few, because a thread needs many registers; blocks at the same time, 0 for
#: any number.
_BLOCK, _BLOCKS = 64, 0


class Status(IntEnum):
    """The fault of a sample."""

    GOOD = 0
    OPEN = 1  #: The loops are open.
    SINGULAR = 2  #: The configuration is singular, or nearly so.
    NOT_FINITE = 3  #: A number is not finite, or an angle is too large.
    MODE = 4  #: A step may leave the assembly mode: it needs more substeps.


class State(NamedTuple):
    """States of N robots.

    Attributes:
        q: Configurations, shape (N, nq).
        va: Rates of the coordinates, shape (N, n).
    """

    q: Any
    va: Any


class WarpBatch:
    """Dynamics of many samples of one robot on one device.

    Arguments are arrays of Warp on this device with numbers of this type, of any strides, or arrays
    that `wp.from_dlpack` takes, such as those of NumPy, PyTorch and JAX. None is copied. The first
    axis counts the N samples. A method compiles its kernel at its first call, and the caches of
    Warp and of this package keep it.

    Each method checks every sample. Results of bad samples are NaN. `status`, an array of int32,
    shape (N,), gets the reason for each sample, a `Status`; `out` gets the result. With both a call
    allocates no memory, as a CUDA graph needs it. `out` is contiguous for derivatives, side by
    side, (N, n, 3 n) or (N, n, 2 n + motors), and for placements, p above R, (N, 4, 3).

    A batch keeps the robot as it was: after `ClosedChain.refresh` make another one.

    Args:
        reference: Reference path of the robot.
        near: Configuration near which the order of elimination is chosen.
        device: Name of a device of Warp; by default its preferred one.
        dtype: "float64" or "float32".
    """

    def __init__(self, reference: Reference, near: Array | None, device: Any, dtype: str) -> None:
        if not isinstance(dtype, str) or dtype not in _PRECISIONS:
            raise InputError("dtype", f"{dtype!r} is not one of {', '.join(_PRECISIONS)}")
        self._reference = reference
        self._mechanism = reference.mechanism
        self._near = near
        self._mechanism.require_freedom()
        self.device = wp.get_device(device)
        self.dtype = getattr(wp, dtype)
        self._style = _PRECISIONS[dtype]
        self._open = SymbolicParameters(self._mechanism)
        self._modules: dict[Quantity, ModuleType] = {}
        self._equations: dict[tuple[bool, bool], Equations] = {}
        self._set(self._open.pack(self._mechanism, self._mechanism.friction))

    def __repr__(self) -> str:
        robot = self._mechanism.model.name
        samples = self.parameters.shape[0]
        each = "" if samples == 1 else f", parameters of {samples} robots"
        return f"WarpBatch({robot}: {self._style.dtype} on {self.device}{each})"

    # --- parameters -------------------------------------------------------------------------

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, as "foot_joint.mass"; a body has the name of its joint.

        A body has ten, in the axes of its joint's frame: mass, first moment, second moments of
        mass. All are proportional to its density.
        """
        return self._open.names(self._mechanism)

    def with_parameters(self, parameters: Any) -> "WarpBatch":
        """This robot with other masses, friction, springs and gravity, without a compilation.

        Args:
            parameters: In the order of `parameter_names`, shape (p,) for all robots, or (N, p). It
                is copied: later changes of it have no effect.
        """
        batch = copy(self)
        batch._set(parameters)
        return batch

    def _set(self, parameters: Any) -> None:
        if not isinstance(parameters, wp.array):
            parameters = wp.array(parameters, dtype=self.dtype, device=self.device)
        if parameters.ndim == 1:
            parameters = parameters.reshape((1, -1))
        #: Shape (N, p), or (1, p) where all robots have the same.
        self.parameters = wp.clone(self._array("parameters", parameters, (self._open.size,), None))
        self._prepared: dict[tuple[Quantity, float], Any] = {}

    # --- quantities -------------------------------------------------------------------------

    def torques(self, q: Any, va: Any, aa: Any, **options: Any) -> Any:
        """Motor torques of motions, shape (N, motors), as `ClosedChain.compute_torques`.

        Args:
            q: Configurations, shape (N, nq).
            va: Rates of the coordinates, shape (N, n).
            aa: Accelerations of the coordinates, shape (N, n).
            options: `external_wrenches`, shape (N, r, 6), `out`, `status`.
        """
        return self._run(Quantity("torques"), {"q": q, "va": va, "aa": aa}, **options)

    def generalized_forces(self, q: Any, va: Any, aa: Any, **options: Any) -> Any:
        """Forces along the coordinates, shape (N, n); arguments as those of `torques`."""
        same = self._mechanism.driven_one_to_one
        key = Quantity("torques" if same else "generalized_forces")
        return self._run(key, {"q": q, "va": va, "aa": aa}, **options)

    def accelerations(self, q: Any, va: Any, tau: Any, **options: Any) -> Any:
        """Accelerations of the coordinates under torques, shape (N, n); see `torques`."""
        return self._run(Quantity("accelerations"), {"q": q, "va": va, "tau": tau}, **options)

    def rates(self, q: Any, va: Any, **options: Any) -> Any:
        """Rates of all joints, shape (N, nv)."""
        return self._run(Quantity("rates"), {"q": q, "va": va}, **options)

    def closed(self, q: Any, **options: Any) -> Any:
        """Closed configurations next to q with the same coordinates, shape (N, nq)."""
        return self._run(Quantity("closing"), {"q": q}, **options)

    def frame_placement(self, q: Any, frame: str, **options: Any) -> tuple[Any, Any]:
        """Position and orientation of a frame in the base, shapes (N, 3) and (N, 3, 3)."""
        result = self._run(Quantity("frame_placement", frame), {"q": q}, **options)
        return result[:, 0], result[:, 1:]

    def torque_derivatives(
        self, q: Any, va: Any, aa: Any, *, sign_width: float = 1e-3, **options: Any
    ) -> TorqueDerivatives:
        """Derivatives of the generalized forces, each (N, n, n), as those of `ClosedChain`."""
        key = Quantity("torque_derivatives", sign_width=positive_number("sign_width", sign_width))
        result = self._run(key, {"q": q, "va": va, "aa": aa}, **options)
        n = self._n
        return TorqueDerivatives(*(result[:, :, k * n : (k + 1) * n] for k in range(3)))

    def acceleration_derivatives(
        self, q: Any, va: Any, tau: Any, *, sign_width: float = 1e-3, **options: Any
    ) -> AccelerationDerivatives:
        """Derivatives of the accelerations by q, va and tau, as those of `ClosedChain`."""
        width = positive_number("sign_width", sign_width)
        key = Quantity("acceleration_derivatives", sign_width=width)
        result = self._run(key, {"q": q, "va": va, "tau": tau}, **options)
        n = self._n
        parts = result[:, :, :n], result[:, :, n : 2 * n], result[:, :, 2 * n :]
        return AccelerationDerivatives(*parts)

    def step(
        self,
        state: tuple[Any, Any],
        tau: Any,
        dt: float,
        *,
        substeps: int = 1,
        sign_width: float = 1e-3,
        out: tuple[Any, Any] | None = None,
        **options: Any,
    ) -> State:
        """States after `dt` seconds with constant torques, by the classical Runge-Kutta method.

        After each substep the dependent joints are corrected, so that the loops stay closed. A
        sample is bad (`Status.MODE`) if det Phi_u changes by more than a factor of 1.25 in half a
        substep, near a singularity or between two assembly modes, or if a substep is too long.

        Args:
            state: q, shape (N, nq), and va, shape (N, n).
            tau: Motor torques, shape (N, motors).
            dt: [s]; a negative step goes back in time.
            substeps: Number of Runge-Kutta steps.
            sign_width: Rates within which Coulomb friction is smooth, [rad/s] or [m/s].
            out: Arrays for q and va; those of `state` may be used.
            options: `external_wrenches`, `status`.
        """
        steps = whole_number("substeps", substeps, 1)
        width = positive_number("sign_width", sign_width)
        key, (q, va) = Quantity("rollout", sign_width=width), state
        out = out or (None, None)
        h = float(dt) / steps
        return self._run(key, {"q": q, "va": va, "tau": tau}, out, h=h, steps=steps, **options)

    def module(self, key: Quantity) -> ModuleType:
        """Warp's kernels of a quantity, for `wp.compile_aot_module`; "rollout" makes steps."""
        if key not in self._modules:
            self._modules[key] = self._module(key)
        return self._modules[key]

    # --- inside -----------------------------------------------------------------------------

    @property
    def _n(self) -> int:
        return len(self._mechanism.coordinates)

    def _shape(self, name: str) -> tuple[int, ...]:
        """Shape of an array of one sample."""
        model = self._mechanism.model
        n = self._n
        motors = self._mechanism.motor_count
        return {
            "q": (model.nq,),
            "tau": (motors,),
            "external_wrenches": (model.njoints - 1, 6),
            "torques": (motors,),
            "rates": (model.nv,),
            "closing": (model.nq,),
            "frame_placement": (4, 3),
            "torque_derivatives": (n, 3 * n),
            "acceleration_derivatives": (n, 2 * n + motors),
        }.get(name, (n,))

    def _run(
        self,
        key: Quantity,
        inputs: dict[str, Any],
        out: Any = None,
        *,
        external_wrenches: Any = None,
        status: Any = None,
        h: float = 0.0,
        steps: int = 0,
    ) -> Any:
        """Launch the kernel of a quantity."""
        if isinstance(external_wrenches, Mapping):
            problem = "wrenches at frames; give an array of wrenches on bodies at mass centres"
            raise InputError("external_wrenches", problem)
        if external_wrenches is not None:
            key = key._replace(loaded=True)
            inputs = inputs | {kernels.WRENCHES: external_wrenches}
        count = None
        arrays = []
        for name, value in inputs.items():
            arrays.append(self._array(name, value, self._shape(name), count))
            count = arrays[0].shape[0]
        if self.parameters.shape[0] not in (1, count):
            raise InputError("q", f"{count} samples of {self.parameters.shape[0]} robots")
        if status is not None:
            status = self._array("status", status, (), count, wp.int32)
        results = []
        names = ["q", "va"] if steps else [str(key.name)]
        for name, array in zip(names, out if steps else [out], strict=True):
            shape = self._shape(name)
            if array is None:
                results.append(wp.empty((count, *shape), dtype=self.dtype, device=self.device))
            else:
                results.append(self._array("out", array, shape, count))
        module, p = self._prepare(key)
        arrays = [x if x.shape[1] else None for x in arrays]  # there may be no motors
        loads = [arrays.pop() if key.loaded else None]
        flat = [x if x.ndim == 2 else x.reshape((count, -1)) for x in results]
        arguments = [*_filled(arrays, 3), *loads, p, *_filled(flat, 2), h, steps, status]
        options = {"device": self.device, "block_dim": _BLOCK, "max_blocks": _BLOCKS}
        wp.launch(module.run, count, arguments, **options)
        return State(*results) if steps else results[0]

    def _array(
        self, name: str, value: Any, shape: tuple[int, ...], count: int | None, dtype: Any = None
    ) -> Any:
        """An argument as an array of Warp, without a copy; its first axis has `count` samples."""
        dtype = dtype or self.dtype
        if not isinstance(value, wp.array):
            if not hasattr(value, "__dlpack__"):
                raise InputError(name, "not an array of Warp, and none that DLPack can share")
            value = wp.from_dlpack(value)
        if value.shape[1:] != shape or count not in (None, value.shape[0]):
            expected = ", ".join(map(str, ("N" if count is None else count, *shape)))
            raise InputError(name, f"shape {value.shape}, expected ({expected})")
        if value.dtype != dtype or value.device != self.device:
            here = f"{value.dtype.__name__} on {value.device}"
            raise InputError(name, f"{here}, expected {dtype.__name__} on {self.device}")
        if value.ndim == 3 and name == "out" and not value.is_contiguous:
            raise InputError(name, "not contiguous")
        return value

    def _prepare(self, key: Quantity) -> tuple[ModuleType, Any]:
        """The kernels of a quantity, and the parameters followed by the constants."""
        width = -1.0 if key.sign_width is None else key.sign_width
        plain = key._replace(sign_width=None)
        module = self.module(plain)
        if (plain, width) not in self._prepared:
            robots = self.parameters.shape[0]
            p = wp.empty((module.size, robots), dtype=self.dtype, device=self.device)
            arguments = [self.parameters, width, p]
            wp.launch(module.prepare, robots, arguments, device=self.device, block_dim=_BLOCK)
            self._prepared[plain, width] = p
        return module, self._prepared[plain, width]

    def _module(self, key: Quantity) -> ModuleType:
        """A module from the cache, or generated now."""
        mechanism = self._mechanism
        name = key.name
        size: dict[Name, Name] = {"rollout": "accelerations", "frame_placement": "rates"}
        if problem := impossible(mechanism, size.get(name, name)):
            raise CompilationError(problem)
        entry = {"rollout": "step", "closing": "close"}.get(name, "run")
        if name.endswith("derivatives"):
            key = key._replace(along=True)
            entry = "along"

        def source() -> str:
            equations = self._equations_of(key.loaded, name.endswith("derivatives"))
            checks = Checks(equations, self._style.closed, self._style.rounding)
            return warp_code.module(kernels.entry(equations, key, checks), entry, self._style)

        content = fingerprint(mechanism, self._open, self._near, key.frame)
        label = f"warp {key} {self._style.dtype}"
        return _imported(libraries.text(mechanism.model.name, label, content, source))

    def _equations_of(self, loaded: bool, smooth: bool) -> Equations:
        if (loaded, smooth) not in self._equations:
            samples = sample_configurations(self._reference, self._near)
            self._equations[loaded, smooth] = Equations(self._mechanism, samples, loaded, smooth)
        return self._equations[loaded, smooth]


def _filled(arrays: list[Any], count: int) -> list[Any]:
    """Exactly `count` arrays; missing ones are None."""
    return arrays + [None] * (count - len(arrays))


@cache
def _imported(path: Path) -> ModuleType:
    """A module of Warp's kernels."""
    robot, kernel, key, _ = path.name.rsplit(".", 3)
    name = f"{robot}_{kernel}_{key[:8]}"
    module = sys.modules[name] = ModuleType(name)
    exec(compile(path.read_text("utf-8"), path, "exec"), module.__dict__)
    return module

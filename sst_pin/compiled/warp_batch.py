# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of many samples of one robot on a GPU or a CPU, by kernels of NVIDIA Warp."""

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from enum import IntEnum
from functools import cache, cached_property
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import warp as wp
from numpy.typing import ArrayLike

from ..arrays import Array, positive_number, require_word, whole_number
from ..dynamics.derivatives import AccelerationDerivatives, TorqueDerivatives
from ..dynamics.nonsmooth_rows import MotorGains, NonsmoothRows, motor_gains
from ..dynamics.quantities import Name, Quantity
from ..dynamics.reference import Reference
from ..errors import CompilationError, InputError
from . import kernels, libraries, nonsmooth_c, warp_code
from .c_code import STYLES
from .compiled_backend import impossible
from .equations import Equations
from .generator_inputs import fingerprint, sample_configurations
from .kernel_checks import Checks
from .nonsmooth_motions import parameter_values
from .symbolic_parameters import SymbolicParameters
from .warp_nonsmooth import CONTINUED, FRESH, ITERATIONS, NonsmoothState

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
    UNSOLVED = 5  #: The impulses are not solved: more `iterations`, or a shorter step. Not NaN.
    #: The start violates a contact, a rope or a stop, as `ClosedChain.rollout` refuses it; in the
    #: result of a nonsmooth step, ten times as much.
    VIOLATED = 6


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
        require_word("dtype", dtype, _PRECISIONS)
        self._reference = reference
        self._mechanism = reference.mechanism
        self._near = near
        self._mechanism.require_freedom()
        self.device = wp.get_device(device)
        self.dtype = getattr(wp, dtype)
        self._style = _PRECISIONS[dtype]
        self._open = SymbolicParameters(self._mechanism)
        self._modules: dict[Quantity, ModuleType] = {}
        self._nonsmooth_modules: dict[bool, ModuleType] = {}
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
        #: Parameters followed by the constants of a module, by module and width of the sign.
        self._prepared: dict[tuple[ModuleType, float], Any] = {}
        #: Numbers of nonsmooth steps, by the gains.
        self._nonsmooth_numbers: dict[tuple[bytes, bytes], Any] = {}

    # --- quantities -------------------------------------------------------------------------

    def torques(self, q: Any, va: Any, aa: Any, **options: Any) -> Any:
        """Motor torques of motions, shape (N, motors), as `ClosedChain.compute_torques`.

        Args:
            q: Configurations, shape (N, nq).
            va: Rates of the coordinates, shape (N, n).
            aa: Accelerations of the coordinates, shape (N, n).
            options: `external_wrenches`, [force; moment] on each body, shape (N, r, 6), `out`,
                `status`.
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
        nonsmooth: bool = False,
        motor_stiffness: ArrayLike | None = None,
        motor_damping: ArrayLike | None = None,
        motor_positions: Any = None,
        iterations: int = ITERATIONS,
        out: tuple[Any, ...] | None = None,
        **options: Any,
    ) -> State | NonsmoothState:
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
            nonsmooth: Whether joints stop at their limits (planar, ball and free joints have no
                stops), dry friction sticks, and contacts, ropes and cables act, by the steps of
                `ClosedChain.rollout(..., nonsmooth=True)`. Give the result as the next `state`: its
                impulses are where the solver starts.
            motor_stiffness: Gains of position control in the motors, shape (motors,), as those of
                `ClosedChain.rollout`, for `nonsmooth`.
            motor_damping: Gains of the rates, shape (motors,).
            motor_positions: Positions to hold, shape (N, motors).
            iterations: The most rounds of Gauss-Seidel sweeps and Newton's steps in a nonsmooth
                substep. Where they do not solve it, the status is `Status.UNSOLVED`, and the result
                is the best that they reached.
            out: Arrays for the fields of the result; those of `state` may be used.
            options: `external_wrenches`, `status`.
        """
        steps = whole_number("substeps", substeps, 1)
        width = positive_number("sign_width", sign_width)
        q, va, *_ = state
        h = float(dt) / steps
        if nonsmooth:
            positive_number("dt", dt)
            motors = self._mechanism.motor_count
            gains = motor_gains(motor_stiffness, motor_damping, motors)
            if gains.stiffness.any() and motor_positions is None:
                problem = "needed with motor_stiffness: the positions to hold, shape (N, motors)"
                raise InputError("motor_positions", problem)
            return self._nonsmooth_step(
                inputs={"q": q, "va": va, "tau": tau},
                held=motor_positions,
                start=state.impulses if isinstance(state, NonsmoothState) else None,
                gains=gains,
                h=h,
                steps=steps,
                iterations=whole_number("iterations", iterations, 0),
                out=out,
                **options,
            )
        self._mechanism.contacts.require_none("step")
        if any(x is not None for x in (motor_stiffness, motor_damping, motor_positions)):
            raise InputError("motor_stiffness, motor_damping", "only with nonsmooth=True")
        key = Quantity("rollout", sign_width=width)
        inputs = {"q": q, "va": va, "tau": tau}
        return self._smooth_step(key, inputs, out, h=h, steps=steps, **options)

    def module(self, key: Quantity) -> ModuleType:
        """Warp's kernels of a quantity, for `wp.compile_aot_module`; "rollout" makes steps."""
        if key not in self._modules:
            self._modules[key] = self._module(key)
        return self._modules[key]

    def nonsmooth_module(self, *, loaded: bool = False) -> ModuleType:
        """As `module`, of nonsmooth steps; `loaded` with external wrenches."""
        if loaded not in self._nonsmooth_modules:
            self._nonsmooth_modules[loaded] = self._nonsmooth_module(loaded)
        return self._nonsmooth_modules[loaded]

    # --- inside -----------------------------------------------------------------------------

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

    def _nonsmooth_module(self, loaded: bool) -> ModuleType:
        """A module of nonsmooth steps from the cache, or generated now."""
        mechanism = self._mechanism
        if problem := impossible(mechanism, "accelerations"):
            raise CompilationError(problem)

        def source() -> str:
            equations = self._equations_of(loaded, False)
            checks = Checks(equations, self._style.closed, self._style.rounding)
            tolerance = 2 * self._style.closed
            step = nonsmooth_c.step_source(equations, self._rows, checks, tolerance)
            return warp_code.nonsmooth_module(step, self._style)

        content = fingerprint(mechanism, self._open, self._near, rows=self._rows)
        label = f"warp nonsmooth{'_loaded' if loaded else ''} {self._style.dtype}"
        return _imported(libraries.text(mechanism.model.name, label, content, source))

    def _equations_of(self, loaded: bool, smooth: bool) -> Equations:
        if (loaded, smooth) not in self._equations:
            samples = sample_configurations(self._reference, self._near)
            self._equations[loaded, smooth] = Equations(self._mechanism, samples, loaded, smooth)
        return self._equations[loaded, smooth]

    def _run(self, key: Quantity, inputs: dict[str, Any], out: Any = None, **options: Any) -> Any:
        """The result of a quantity; `options` as those of `torques`."""
        of_user = {"out": _Result(str(key.name), out)}
        return self._launched(key, inputs, of_user, **options)["out"]

    def _smooth_step(
        self,
        key: Quantity,
        inputs: dict[str, Any],
        out: tuple[Any, ...] | None,
        *,
        h: float,
        steps: int,
        **options: Any,
    ) -> State:
        """The states after Runge-Kutta steps of length h."""
        of_q, of_va = _outputs(State._fields, out)
        of_user = {"out": _Result("q", of_q), "va_out": _Result("va", of_va)}
        results = self._launched(key, inputs, of_user, h=h, steps=steps, **options)
        return State(q=results["out"], va=results["va_out"])

    def _launched(
        self,
        key: Quantity,
        inputs: dict[str, Any],
        of_user: dict[str, "_Result"],
        *,
        external_wrenches: Any = None,
        status: Any = None,
        h: float = 0.0,
        steps: int = 0,
    ) -> dict[str, Any]:
        """Launch the kernel of a quantity; its results, by their arguments in `warp_code.RUN`.

        Args:
            key: The quantity.
            inputs: The arrays of its inputs, by name.
            of_user: The results that it fills, by their arguments.
            external_wrenches: Wrenches on bodies, or None.
            status: Array for the status of each sample, or None.
            h: Length of a step, [s].
            steps: Number of steps.
        """
        _require_on_bodies(external_wrenches)
        if external_wrenches is not None:
            key = key._replace(loaded=True)
            inputs = inputs | {kernels.WRENCHES: external_wrenches}
        arrays, count = self._arrays(inputs)
        arguments: dict[str, Any] = {"h": h, "steps": steps}
        for name, array in arrays.items():
            # The last input of motions is aa or tau.
            arguments["last" if name in ("aa", "tau") else name] = array
        arguments["status"] = self._status(status, count)
        results = {}
        for argument, (name, array) in of_user.items():
            results[argument] = self._output(name, array, count)
            flat = results[argument]
            arguments[argument] = flat if flat.ndim == 2 else flat.reshape((count, -1))
        module, arguments["p"] = self._prepare(key)
        self._launch(module, count, arguments, warp_code.RUN)
        return results

    def _nonsmooth_step(
        self,
        *,
        inputs: dict[str, Any],
        held: Any,
        start: Any,
        gains: MotorGains,
        h: float,
        steps: int,
        iterations: int,
        out: tuple[Any, ...] | None,
        external_wrenches: Any = None,
        status: Any = None,
    ) -> NonsmoothState:
        """Launch the kernel of nonsmooth steps of length h.

        `inputs` are q, va and tau; `held` are positions of the motors, and `start` are impulses, or
        None. The other arguments are those of `step`.
        """
        _require_on_bodies(external_wrenches)
        optional = {
            kernels.WRENCHES: external_wrenches,
            "motor_positions": held,
            "impulses": start,
        }
        arrays, count = self._arrays(
            inputs | {name: value for name, value in optional.items() if value is not None}
        )
        status = self._status(status, count)

        fields = NonsmoothState._fields
        results: dict[str, Any] = {}
        of_results: dict[str, Any] = {}  # arguments with two axes; None where there is nothing
        for name, of_user in zip(fields, _outputs(fields, out), strict=True):
            results[name] = self._output(name, of_user, count)
            argument = f"{name}_out" if name in ("q", "va") else name
            size = math.prod(self._shape(name))
            of_results[argument] = results[name].reshape((count, size)) if size else None
        module = self.nonsmooth_module(loaded=external_wrenches is not None)
        arguments = of_results | {
            "q": arrays["q"],
            "va": arrays["va"],
            "tau": arrays["tau"],
            kernels.WRENCHES: arrays.get(kernels.WRENCHES),
            "p": self._prepared_by(module),
            "numbers": self._numbers_of(gains),
            "held": arrays.get("motor_positions"),
            "start": arrays.get("impulses"),
            "h": h,
            "steps": steps,
            "series": iterations,
            # A step that continues another one may start with the violation which that one leaves.
            "violation": FRESH if start is None else CONTINUED,
            "status": status,
        }
        self._launch(module, count, arguments, warp_code.NONSMOOTH)
        return NonsmoothState(**results)

    def _launch(
        self,
        module: ModuleType,
        count: int,
        arguments: Mapping[str, Any],
        names: Iterable[str],
    ) -> None:
        """Launch `run` of a module for `count` samples.

        `names` are those of its arguments in their order; arguments that are missing are None.
        """
        in_order = [arguments.get(name) for name in names]
        options = {"device": self.device, "block_dim": _BLOCK, "max_blocks": _BLOCKS}
        wp.launch(module.run, count, in_order, **options)

    def _prepare(self, key: Quantity) -> tuple[ModuleType, Any]:
        """The kernels of a quantity, and the parameters followed by the constants."""
        width = -1.0 if key.sign_width is None else key.sign_width
        module = self.module(key._replace(sign_width=None))
        return module, self._prepared_by(module, width)

    def _prepared_by(self, module: ModuleType, width: float = -1.0) -> Any:
        """The parameters followed by the constants of a module, with a width of the sign."""
        if (module, width) not in self._prepared:
            robots = self.parameters.shape[0]
            p = wp.empty((module.size, robots), dtype=self.dtype, device=self.device)
            arguments = [self.parameters, width, p]
            wp.launch(module.prepare, robots, arguments, device=self.device, block_dim=_BLOCK)
            self._prepared[module, width] = p
        return self._prepared[module, width]

    @cached_property
    def _rows(self) -> NonsmoothRows:
        """The rows of nonsmooth steps, without gains of motors."""
        return NonsmoothRows(self._mechanism, motor_gains(None, None, self._mechanism.motor_count))

    def _numbers_of(self, gains: MotorGains) -> Any:
        """Numbers of nonsmooth steps, a row for each robot."""
        key = gains.stiffness.tobytes(), gains.damping.tobytes()
        if key not in self._nonsmooth_numbers:
            rows = NonsmoothRows(self._mechanism, gains)
            p = self.parameters.numpy().astype(float)
            numbers = parameter_values(rows, self._open, p)
            self._nonsmooth_numbers[key] = wp.array(numbers, dtype=self.dtype, device=self.device)
        return self._nonsmooth_numbers[key]

    @property
    def _n(self) -> int:
        return len(self._mechanism.coordinates)

    def _shape(self, name: str) -> tuple[int, ...]:
        """Shape of an array of one sample."""
        model = self._mechanism.model
        n = self._n
        motors = self._mechanism.motor_count
        shapes: dict[str, tuple[int, ...]] = {
            "q": (model.nq,),
            "va": (n,),
            "tau": (motors,),
            "external_wrenches": (model.njoints - 1, 6),
            "torques": (motors,),
            "rates": (model.nv,),
            "closing": (model.nq,),
            "frame_placement": (4, 3),
            "torque_derivatives": (n, 3 * n),
            "acceleration_derivatives": (n, 2 * n + motors),
            "motor_positions": (motors,),
        }
        if name in shapes:
            return shapes[name]
        if name in NonsmoothState._fields:
            return self._nonsmooth_shape(name)
        return (n,)

    def _nonsmooth_shape(self, name: str) -> tuple[int, ...]:
        """Shape of one sample of a result of nonsmooth steps."""
        parts = self._rows.parts
        shapes: dict[str, tuple[int, ...]] = {
            "contact_forces": (len(self._mechanism.contacts.points), 3),
            "tensions": (parts.cables.stop - parts.ropes.start,),
            "joint_forces": (self._mechanism.model.nv,),
            "line_friction": (len(self._rows.dry_lines),),
            "residual": (),
            "impulses": (self._rows.count,),
        }
        return shapes[name]

    def _arrays(self, inputs: Mapping[str, Any]) -> tuple[dict[str, Any], int]:
        """The arrays of inputs, and the number of samples.

        An array is None if a sample has no numbers in it, such as torques without motors.
        """
        count: Any = None
        arrays: dict[str, Any] = {}
        for name, value in inputs.items():
            shape = self._shape(name)
            array = self._array(name, value, shape, count)
            count = array.shape[0]
            arrays[name] = array if math.prod(shape) else None
        self._require_samples(count)
        return arrays, count

    def _status(self, status: Any, count: int) -> Any:
        """The array of the user for the status of each sample, or None."""
        if status is None:
            return None
        return self._array("status", status, (), count, wp.int32)

    def _output(self, name: str, of_user: Any, count: int) -> Any:
        """The array for a result: that of the user, or a new one."""
        shape = self._shape(name)
        if of_user is None:
            return wp.empty((count, *shape), dtype=self.dtype, device=self.device)
        return self._array("out", of_user, shape, count)

    def _require_samples(self, count: int) -> None:
        """Refuse samples that are not as many as the robots with parameters of their own."""
        if self.parameters.shape[0] not in (1, count):
            raise InputError("q", f"{count} samples of {self.parameters.shape[0]} robots")

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
        flattened = shape == () or len(shape) == 2
        if flattened and name == "out" and not value.is_contiguous:
            raise InputError(name, "not contiguous")
        return value


def _require_on_bodies(external_wrenches: Any) -> None:
    """Refuse wrenches at frames."""
    if isinstance(external_wrenches, Mapping):
        problem = "wrenches at frames; give an array of wrenches on bodies at mass centres"
        raise InputError("external_wrenches", problem)


class _Result(NamedTuple):
    """A result that a kernel fills."""

    #: Its name, which determines its shape.
    name: str
    #: The array of the user, or None for a new one.
    array: Any


def _outputs(fields: Sequence[str], out: tuple[Any, ...] | None) -> Sequence[Any]:
    """The array of the user for each field of a result, or None."""
    if out is None:
        return [None for _ in fields]
    if len(out) != len(fields):
        raise InputError("out", f"{len(out)} arrays, expected {', '.join(fields)}")
    return out


@cache
def _imported(path: Path) -> ModuleType:
    """A module of Warp's kernels."""
    robot, kernel, key, _ = path.name.rsplit(".", 3)
    name = f"{robot}_{kernel}_{key[:8]}"
    module = sys.modules[name] = ModuleType(name)
    exec(compile(path.read_text("utf-8"), path, "exec"), module.__dict__)
    return module

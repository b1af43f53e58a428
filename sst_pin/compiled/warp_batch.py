# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of many samples of one robot on a GPU or a CPU, by kernels of NVIDIA Warp.

`warp_code` generates one Python module of Warp for each quantity. A module has two kernels:

- `prepare` writes p, which holds the parameters of the robots and the constants that follow from
  the parameters alone;
- `run` computes the samples from p and the arguments, one sample in each thread.

A method of `WarpBatch`, such as `torques`, checks its arrays, takes the module of its quantity,
launches `prepare` if p is not yet known, and launches `run`.
"""

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
from ..dynamics.quantities import Quantity
from ..dynamics.reference import Reference
from ..errors import CompilationError, InputError
from . import kernels, libraries, nonsmooth_c, warp_code
from .c_code import STYLES
from .compiled_backend import impossible, nonsmooth_name
from .equations import Equations
from .generator_inputs import fingerprint, sample_configurations
from .kernel_checks import Checks
from .nonsmooth_motions import parameter_values
from .symbolic_parameters import SymbolicParameters
from .warp_nonsmooth import CONTINUED, FRESH, ITERATIONS, NonsmoothState

#: How C is written for each type of numbers, "float64" and "float32".
_STYLES = {style.dtype: style for style in STYLES.values()}
#: Threads of a block: few, because a thread needs many registers.
_BLOCK = 64
#: The most blocks at the same time; with 0 Warp sets no limit.
_BLOCKS = 0
#: `prepare` takes a smoothing width of Coulomb friction. With this number instead, it uses the
#: width in the parameters.
_WIDTH_OF_PARAMETERS = -1.0


class Status(IntEnum):
    """The fault of a sample."""

    GOOD = 0
    OPEN = 1  #: The loops are open.
    SINGULAR = 2  #: The configuration is singular, or nearly so.
    NOT_FINITE = 3  #: A number is not finite, or an angle is too large.
    MODE = 4  #: A step may leave the assembly mode: it needs more substeps.
    #: The impulses are not solved: more `iterations`, or a shorter step. The result is the best one
    #: that was reached, not NaN.
    UNSOLVED = 5
    #: The start violates a contact, a rope or a stop by more than `ClosedChain.rollout` accepts. A
    #: start that is the result of another nonsmooth step may violate them ten times as much.
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

    Arguments are arrays of Warp on the device of the batch, with numbers of its type and any
    strides, or arrays that `wp.from_dlpack` takes, such as those of NumPy, PyTorch and JAX. No
    argument is copied. The first axis counts the N samples. A method compiles its kernel at its
    first call, and the caches of Warp and of this package keep it.

    Each method checks every sample. Results of bad samples are NaN. Every method takes two optional
    arrays of the caller:

    - `status`, int32, shape (N,), gets the `Status` of each sample;
    - `out` gets the result. Derivatives stand in it side by side, shape (N, n, 3 n) for torques and
      (N, n, 2 n + motors) for accelerations. A placement is p followed by the rows of R, shape
      (N, 4, 3). In both cases `out` must be contiguous.

    A call with both arrays allocates no memory, as a CUDA graph requires.

    A batch keeps the robot as it was: after `ClosedChain.refresh` make another one.

    Args:
        reference: Reference path of the robot.
        near: Configuration near which the order of elimination is chosen.
        device: Name of a device of Warp; by default its preferred one.
        dtype: "float64" or "float32".
    """

    def __init__(self, reference: Reference, near: Array | None, device: Any, dtype: str) -> None:
        require_word("dtype", dtype, _STYLES)
        self._reference = reference
        self._mechanism = reference.mechanism
        self._near = near
        self._mechanism.require_freedom()
        self.device = wp.get_device(device)
        self.dtype = getattr(wp, dtype)
        self._style = _STYLES[dtype]
        self._symbolic_parameters = SymbolicParameters(self._mechanism)
        # What was made so far. Batches of `with_parameters` share it.
        self._modules: dict[Quantity, ModuleType] = {}
        #: Modules of nonsmooth steps by whether external wrenches act.
        self._nonsmooth_modules: dict[bool, ModuleType] = {}
        #: Equations by whether external wrenches act, and whether Coulomb friction is smooth.
        self._equations: dict[tuple[bool, bool], Equations] = {}
        numbers = self._symbolic_parameters.pack(self._mechanism, self._mechanism.friction)
        self._set_parameters(numbers)

    def __repr__(self) -> str:
        robot = self._mechanism.model.name
        samples = self.parameters.shape[0]
        each = "" if samples == 1 else f", parameters of {samples} robots"
        return f"WarpBatch({robot}: {self._style.dtype} on {self.device}{each})"

    # --- parameters -------------------------------------------------------------------------

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, such as "foot_joint.mass"; a body has the name of its joint.

        A body has ten parameters, in the frame of its joint: the mass, the first moments x, y, z
        and the second moments xx, xy, xz, yy, yz, zz of its mass. All ten are proportional to the
        density of the body.
        """
        return self._symbolic_parameters.names(self._mechanism)

    def with_parameters(self, parameters: Any) -> "WarpBatch":
        """This robot with other masses, friction, springs and gravity, without a compilation.

        Args:
            parameters: Numbers in the order of `parameter_names`: one row for all robots, shape
                (names,), or one for each robot, shape (N, names). They are copied: later changes
                have no effect.
        """
        batch = copy(self)
        batch._set_parameters(parameters)
        return batch

    def _set_parameters(self, parameters: Any) -> None:
        """Take other parameters, and drop the arrays that were computed from the previous ones."""
        if not isinstance(parameters, wp.array):
            parameters = wp.array(parameters, dtype=self.dtype, device=self.device)
        if parameters.ndim == 1:
            parameters = parameters.contiguous().reshape((1, -1))  # `reshape` needs contiguity
        shape = (self._symbolic_parameters.size,)
        #: Shape (N, names), or (1, names) if all robots have the same.
        self.parameters = wp.clone(self._array("parameters", parameters, shape, None))
        #: The arrays p of the kernels, by module and smoothing width of Coulomb friction.
        self._prepared: dict[tuple[ModuleType, float], Any] = {}
        #: Numbers of nonsmooth steps, by the stiffness and damping of the motors.
        self._nonsmooth_numbers: dict[tuple[bytes, bytes], Any] = {}

    # --- quantities -------------------------------------------------------------------------

    def torques(self, q: Any, va: Any, aa: Any, **options: Any) -> Any:
        """Motor torques of motions, shape (N, motors), as `ClosedChain.compute_torques`.

        Args:
            q: Configurations, shape (N, nq).
            va: Rates of the coordinates, shape (N, n).
            aa: Accelerations of the coordinates, shape (N, n).
            options: `out` and `status`, see `WarpBatch`; `external_wrenches`, [force; moment] on
                each of the r bodies, shape (N, r, 6), as those of `ClosedChain.compute_torques`.
        """
        return self._result(Quantity("torques"), {"q": q, "va": va, "aa": aa}, **options)

    def generalized_forces(self, q: Any, va: Any, aa: Any, **options: Any) -> Any:
        """Forces along the coordinates, shape (N, n); arguments as those of `torques`."""
        # If each motor drives one coordinate, both quantities are equal and share a kernel.
        same = self._mechanism.driven_one_to_one
        key = Quantity("torques" if same else "generalized_forces")
        return self._result(key, {"q": q, "va": va, "aa": aa}, **options)

    def accelerations(self, q: Any, va: Any, tau: Any, **options: Any) -> Any:
        """Accelerations of the coordinates under torques, shape (N, n); see `torques`."""
        return self._result(Quantity("accelerations"), {"q": q, "va": va, "tau": tau}, **options)

    def rates(self, q: Any, va: Any, **options: Any) -> Any:
        """Rates of all joints, shape (N, nv)."""
        return self._result(Quantity("rates"), {"q": q, "va": va}, **options)

    def closed(self, q: Any, **options: Any) -> Any:
        """Closed configurations next to q with the same coordinates, shape (N, nq)."""
        return self._result(Quantity("closing"), {"q": q}, **options)

    def frame_placement(self, q: Any, frame: str, **options: Any) -> tuple[Any, Any]:
        """Position and orientation of a frame in the base, shapes (N, 3) and (N, 3, 3)."""
        result = self._result(Quantity("frame_placement", frame), {"q": q}, **options)
        return result[:, 0], result[:, 1:]

    def torque_derivatives(
        self, q: Any, va: Any, aa: Any, *, sign_width: float = 1e-3, **options: Any
    ) -> TorqueDerivatives:
        """Derivatives of the generalized forces by q, va and aa, as those of `ClosedChain`.

        Each has the shape (N, n, n). Coulomb friction is smooth: the sign of a rate v is replaced
        by tanh(v / sign_width).
        """
        width = positive_number("sign_width", sign_width)
        key = Quantity("torque_derivatives", sign_width=width)
        result = self._result(key, {"q": q, "va": va, "aa": aa}, **options)
        n = self._n
        parts = result[:, :, :n], result[:, :, n : 2 * n], result[:, :, 2 * n :]
        return TorqueDerivatives(*parts)

    def acceleration_derivatives(
        self, q: Any, va: Any, tau: Any, *, sign_width: float = 1e-3, **options: Any
    ) -> AccelerationDerivatives:
        """Derivatives of the accelerations by q, va and tau, as those of `ClosedChain`.

        Shapes (N, n, n), (N, n, n) and (N, n, motors); friction as in `torque_derivatives`.
        """
        width = positive_number("sign_width", sign_width)
        key = Quantity("acceleration_derivatives", sign_width=width)
        result = self._result(key, {"q": q, "va": va, "tau": tau}, **options)
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
        sample is bad (`Status.MODE`) if a substep is too long, or if det Phi_u changes by more than
        a factor of 1.25 in half a substep. Phi_u are the columns of Phi for the dependent rates;
        its determinant changes fast near a singularity and between two assembly modes.

        Args:
            state: q, shape (N, nq), and va, shape (N, n); a `State` or a `NonsmoothState`.
            tau: Motor torques, shape (N, motors).
            dt: [s]; a negative step goes back in time.
            substeps: Number of Runge-Kutta steps.
            sign_width: Rates within which Coulomb friction is smooth, [rad/s] or [m/s].
            nonsmooth: Whether joints stop at their limits (planar, ball and free joints have no
                stops), dry friction sticks, and contacts, ropes and cables act, by the steps of
                `ClosedChain.rollout(..., nonsmooth=True)`. Give the result as the next `state`: the
                solver starts from its impulses.
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
        q, va, *_ = state  # of a NonsmoothState also the first two fields
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
                motor_positions=motor_positions,
                impulses=state.impulses if isinstance(state, NonsmoothState) else None,
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

    # --- modules ----------------------------------------------------------------------------

    def module(self, key: Quantity) -> ModuleType:
        """The module with Warp's kernels of a quantity, for `wp.compile_aot_module`.

        The module of "rollout" makes the steps of `step`.
        """
        if key not in self._modules:
            self._modules[key] = self._generated_module(key)
        return self._modules[key]

    def nonsmooth_module(self, *, loaded: bool = False) -> ModuleType:
        """The module with Warp's kernels of nonsmooth steps; `loaded` with external wrenches."""
        if loaded not in self._nonsmooth_modules:
            self._nonsmooth_modules[loaded] = self._generated_nonsmooth_module(loaded)
        return self._nonsmooth_modules[loaded]

    def _generated_module(self, key: Quantity) -> ModuleType:
        """The module of a quantity, from the cache or generated now."""
        mechanism = self._mechanism
        name = key.name
        # Steps need the accelerations.
        if problem := impossible(mechanism, "accelerations" if name == "rollout" else name):
            raise CompilationError(problem)
        # The template of the function `run`, see `warp_code.module`.
        template = {"rollout": "step", "closing": "close"}.get(name, "run")
        is_derivative = name.endswith("derivatives")
        if is_derivative:
            # The kernel computes the columns of the matrices for one coordinate after the other:
            # this code is shorter than that of whole matrices.
            key = key._replace(along=True)
            template = "along"

        def source() -> str:
            equations = self._equations_of(key.loaded, smooth=is_derivative)
            checks = Checks(equations, self._style.closed, self._style.rounding)
            return warp_code.module(kernels.entry(equations, key, checks), template, self._style)

        content = fingerprint(mechanism, self._symbolic_parameters, self._near, key.frame)
        label = f"warp {key} {self._style.dtype}"
        path = libraries.text(mechanism.model.name, label, content, source)
        return _imported(path)

    def _generated_nonsmooth_module(self, loaded: bool) -> ModuleType:
        """The module of nonsmooth steps, from the cache or generated now."""
        mechanism = self._mechanism
        if problem := impossible(mechanism, "accelerations"):
            raise CompilationError(problem)

        def source() -> str:
            equations = self._equations_of(loaded, smooth=False)
            checks = Checks(equations, self._style.closed, self._style.rounding)
            step = nonsmooth_c.step_source(equations, self._rows, checks, self._style.tolerance)
            return warp_code.nonsmooth_module(step, self._style)

        symbolic = self._symbolic_parameters
        content = fingerprint(mechanism, symbolic, self._near, rows=self._rows)
        label = f"warp {nonsmooth_name(loaded)} {self._style.dtype}"
        path = libraries.text(mechanism.model.name, label, content, source)
        return _imported(path)

    def _equations_of(self, loaded: bool, smooth: bool) -> Equations:
        """The equations with or without external wrenches, with friction that is smooth or not."""
        if (loaded, smooth) not in self._equations:
            samples = sample_configurations(self._reference, self._near)
            self._equations[loaded, smooth] = Equations(self._mechanism, samples, loaded, smooth)
        return self._equations[loaded, smooth]

    # --- launches of kernels ----------------------------------------------------------------

    def _result(
        self, key: Quantity, inputs: dict[str, Any], out: Any = None, **options: Any
    ) -> Any:
        """The result of a quantity; `options` as those of `torques`."""
        outputs = {"out": _Output(str(key.name), out)}
        return self._launch_quantity(key, inputs, outputs, **options)["out"]

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
        q_out, va_out = _caller_arrays(State._fields, out)
        outputs = {"out": _Output("q", q_out), "va_out": _Output("va", va_out)}
        results = self._launch_quantity(key, inputs, outputs, h=h, steps=steps, **options)
        return State(q=results["out"], va=results["va_out"])

    def _launch_quantity(
        self,
        key: Quantity,
        inputs: dict[str, Any],
        outputs: dict[str, "_Output"],  # defined at the end of this module
        *,
        external_wrenches: Any = None,
        status: Any = None,
        h: float = 0.0,
        steps: int = 0,
    ) -> dict[str, Any]:
        """Launch the kernel of a quantity, and return the arrays of its outputs.

        Args:
            key: The quantity.
            inputs: The arrays of its inputs, by name.
            outputs: Its outputs, by the arguments of the kernel (`warp_code.RUN`) that they fill.
            external_wrenches: Wrenches on bodies, or None.
            status: Array for the status of each sample, or None.
            h: Length of a step, [s].
            steps: Number of steps.
        """
        _require_on_bodies(external_wrenches)
        if external_wrenches is not None:
            key = key._replace(loaded=True)
            inputs = inputs | {kernels.WRENCHES: external_wrenches}
        arrays, count = self._input_arrays(inputs)
        arguments: dict[str, Any] = {"h": h, "steps": steps}
        for name, array in arrays.items():
            # aa and tau share an argument: no kernel takes both.
            arguments["last" if name in ("aa", "tau") else name] = array
        arguments["status"] = self._status_array(status, count)
        results = {}
        for argument, output in outputs.items():
            array = self._output_array(output.name, output.array, count)
            results[argument] = array
            # The kernel writes arrays with two axes.
            arguments[argument] = array if array.ndim == 2 else array.reshape((count, -1))
        width = _WIDTH_OF_PARAMETERS if key.sign_width is None else key.sign_width
        # All widths have the same code: the width is a parameter.
        module = self.module(key._replace(sign_width=None))
        arguments["p"] = self._prepared_parameters(module, width)
        self._launch(module, count, arguments, warp_code.RUN)
        return results

    def _nonsmooth_step(
        self,
        *,
        inputs: dict[str, Any],
        motor_positions: Any,
        impulses: Any,
        gains: MotorGains,
        h: float,
        steps: int,
        iterations: int,
        out: tuple[Any, ...] | None,
        external_wrenches: Any = None,
        status: Any = None,
    ) -> NonsmoothState:
        """Launch the kernel of nonsmooth steps of length h.

        `inputs` are q, va and tau. `impulses` are those from which the solver starts, None for a
        step that begins a motion. `motor_positions` may be None, too. The other arguments are those
        of `step`.
        """
        _require_on_bodies(external_wrenches)
        optional = {
            kernels.WRENCHES: external_wrenches,
            "motor_positions": motor_positions,
            "impulses": impulses,
        }
        arrays, count = self._input_arrays(
            inputs | {name: value for name, value in optional.items() if value is not None}
        )
        status = self._status_array(status, count)

        fields = NonsmoothState._fields
        results: dict[str, Any] = {}
        output_arguments: dict[str, Any] = {}
        for name, of_caller in zip(fields, _caller_arrays(fields, out), strict=True):
            array = self._output_array(name, of_caller, count)
            results[name] = array
            argument = f"{name}_out" if name in ("q", "va") else name
            # The kernel writes arrays with two axes, and takes None for an empty one.
            size = math.prod(self._shape(name))
            output_arguments[argument] = array.reshape((count, size)) if size else None
        module = self.nonsmooth_module(loaded=external_wrenches is not None)
        # By the names of the kernel's arguments, which `warp_code.NONSMOOTH` explains.
        arguments = output_arguments | {
            "q": arrays["q"],
            "va": arrays["va"],
            "tau": arrays["tau"],
            kernels.WRENCHES: arrays.get(kernels.WRENCHES),
            "p": self._prepared_parameters(module, _WIDTH_OF_PARAMETERS),
            "numbers": self._numbers_of_steps(gains),
            "held": arrays.get("motor_positions"),
            "start": arrays.get("impulses"),
            "h": h,
            "steps": steps,
            "series": iterations,
            "violation": FRESH if impulses is None else CONTINUED,
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

        `names` are the names of its arguments in their order; missing arguments are None.
        """
        in_order = [arguments.get(name) for name in names]
        options = {"device": self.device, "block_dim": _BLOCK, "max_blocks": _BLOCKS}
        wp.launch(module.run, count, in_order, **options)

    def _prepared_parameters(self, module: ModuleType, width: float) -> Any:
        """The array p of a module with a smoothing width, shape (size of p, robots).

        `prepare` computes it from the parameters. A column belongs to one robot, so that threads
        that run side by side read numbers that stand side by side.
        """
        if (module, width) not in self._prepared:
            robots = self.parameters.shape[0]
            p = wp.empty((module.size, robots), dtype=self.dtype, device=self.device)
            arguments = [self.parameters, width, p]
            wp.launch(module.prepare, robots, arguments, device=self.device, block_dim=_BLOCK)
            self._prepared[module, width] = p
        return self._prepared[module, width]

    @cached_property
    def _rows(self) -> NonsmoothRows:
        """The rows of nonsmooth steps, without gains of motors.

        Gains change numbers of the steps (`_numbers_of_steps`), but neither the code nor the rows.
        """
        return NonsmoothRows(self._mechanism, motor_gains(None, None, self._mechanism.motor_count))

    def _numbers_of_steps(self, gains: MotorGains) -> Any:
        """Numbers of nonsmooth steps (`parameter_values`), shape (1 or N, count)."""
        key = gains.stiffness.tobytes(), gains.damping.tobytes()
        if key not in self._nonsmooth_numbers:
            rows = NonsmoothRows(self._mechanism, gains)
            p = self.parameters.numpy().astype(float)
            numbers = parameter_values(rows, self._symbolic_parameters, p)
            self._nonsmooth_numbers[key] = wp.array(numbers, dtype=self.dtype, device=self.device)
        return self._nonsmooth_numbers[key]

    # --- arrays and their shapes --------------------------------------------------------------

    @property
    def _n(self) -> int:
        return len(self._mechanism.coordinates)

    def _shape(self, name: str) -> tuple[int, ...]:
        """Shape of an input or a result of one sample, by its name."""
        model = self._mechanism.model
        n = self._n
        motors = self._mechanism.motor_count
        shapes: dict[str, tuple[int, ...]] = {
            "q": (model.nq,),
            "va": (n,),
            "aa": (n,),
            "tau": (motors,),
            "external_wrenches": (model.njoints - 1, 6),
            "motor_positions": (motors,),
            "torques": (motors,),
            "generalized_forces": (n,),
            "accelerations": (n,),
            "rates": (model.nv,),
            "closing": (model.nq,),
            "frame_placement": (4, 3),
            "torque_derivatives": (n, 3 * n),
            "acceleration_derivatives": (n, 2 * n + motors),
        }
        return shapes[name] if name in shapes else self._nonsmooth_shape(name)

    def _nonsmooth_shape(self, name: str) -> tuple[int, ...]:
        """Shape of a result of nonsmooth steps of one sample, by its name."""
        parts = self._rows.parts  # the rows of cables follow those of ropes
        shapes: dict[str, tuple[int, ...]] = {
            "contact_forces": (len(self._mechanism.contacts.points), 3),
            "tensions": (parts.cables.stop - parts.ropes.start,),
            "joint_forces": (self._mechanism.model.nv,),
            "line_friction": (len(self._rows.dry_lines),),
            "residual": (),
            "impulses": (self._rows.count,),
        }
        return shapes[name]

    def _input_arrays(self, inputs: Mapping[str, Any]) -> tuple[dict[str, Any], int]:
        """The arrays of Warp for inputs, and the number N of samples.

        An array is None if it is empty for a sample, such as torques without motors.
        """
        count: Any = None
        arrays: dict[str, Any] = {}
        for name, value in inputs.items():
            shape = self._shape(name)
            array = self._array(name, value, shape, count)
            count = array.shape[0]
            arrays[name] = array if math.prod(shape) else None
        robots = self.parameters.shape[0]
        if robots not in (1, count):
            raise InputError("q", f"{count} samples of {robots} robots")
        return arrays, count

    def _status_array(self, status: Any, count: int) -> Any:
        """The array of the caller for the status of each sample, or None."""
        if status is None:
            return None
        return self._array("status", status, (), count, wp.int32)

    def _output_array(self, name: str, of_caller: Any, count: int) -> Any:
        """The array for a result: that of the caller, or a new one if it is None."""
        shape = self._shape(name)
        if of_caller is None:
            return wp.empty((count, *shape), dtype=self.dtype, device=self.device)
        array = self._array("out", of_caller, shape, count)
        # Kernels write arrays with two axes. Other results are reshaped, which needs contiguity.
        if len(shape) != 1 and not array.is_contiguous:
            raise InputError("out", "not contiguous")
        return array

    def _array(
        self, name: str, value: Any, shape: tuple[int, ...], count: int | None, dtype: Any = None
    ) -> Any:
        """An argument as an array of Warp, without a copy.

        Args:
            name: Its name, for messages.
            value: An array of Warp, or one that DLPack can share.
            shape: The shape that it must have for one sample.
            count: The number of samples, which its first axis must have; any number if None.
            dtype: The type that its numbers must have; by default that of the batch.
        """
        dtype = dtype or self.dtype
        if not isinstance(value, wp.array):
            if not hasattr(value, "__dlpack__"):
                raise InputError(name, "not an array of Warp, and none that DLPack can share")
            # `wp.from_dlpack` fails for an array without axes.
            if value.shape:
                value = wp.from_dlpack(value)
        wrong_count = count is not None and value.shape[:1] != (count,)
        if not value.shape or value.shape[1:] != shape or wrong_count:
            expected = ", ".join(map(str, ("N" if count is None else count, *shape)))
            raise InputError(name, f"shape {tuple(value.shape)}, expected ({expected})")
        if value.dtype != dtype or value.device != self.device:
            here = f"{value.dtype.__name__} on {value.device}"
            raise InputError(name, f"{here}, expected {dtype.__name__} on {self.device}")
        return value


def _require_on_bodies(external_wrenches: Any) -> None:
    """Refuse wrenches at frames, which `ClosedChain` takes as a mapping."""
    if isinstance(external_wrenches, Mapping):
        problem = "wrenches at frames; give an array of wrenches on bodies at mass centres"
        raise InputError("external_wrenches", problem)


class _Output(NamedTuple):
    """A result that a kernel writes."""

    #: Its name, which determines its shape.
    name: str
    #: The array of the caller; None for a new one.
    array: Any


def _caller_arrays(fields: Sequence[str], out: tuple[Any, ...] | None) -> Sequence[Any]:
    """The array of the caller for each field of a result; None for a new one."""
    if out is None:
        return [None for _ in fields]
    if len(out) != len(fields):
        raise InputError("out", f"{len(out)} arrays, expected {', '.join(fields)}")
    return out


@cache
def _imported(path: Path) -> ModuleType:
    """The module of Warp's kernels in a file of the cache; `libraries.text` returns its path."""
    robot, kernel, key, _ = path.name.rsplit(".", 3)  # ".py" is the last part
    name = f"{robot}_{kernel}_{key[:8]}"
    module = sys.modules[name] = ModuleType(name)
    exec(compile(path.read_text("utf-8"), path, "exec"), module.__dict__)
    return module

# SPDX-License-Identifier: BSD-2-Clause
"""The dynamics of a chain as functions of JAX, for `jit`, `vmap` and `grad` on processors.

JAX calls back into this process, where whole batches are computed: values and first derivatives of
the dynamics by the chain, all others by CasADi.
"""

import threading
from collections.abc import Callable, Sequence
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from ..arrays import Array, Indices, for_each_sample
from ..dynamics.least_torques import smallest_torques
from ..dynamics.quantities import QUANTITIES, Name
from ..dynamics.runge_kutta import runge_kutta_step
from ..engine.backend import Key
from ..engine.dispatch import computed
from ..errors import ActuationError, DescriptionError, InputError, SSTError
from ..model.closures import Rolling
from ..model.mechanism import Mechanism
from ..model.tree import frame_id
from .casadi_functions import AlongMotions, CasadiFunctions, Functions

if TYPE_CHECKING:
    from ..closed_chain import ClosedChain

#: Derivatives of an order of arrays in rows.
Values = Callable[..., Array]


class JaxFunctions(Functions):
    """Dynamics of a chain as JAX functions, by the model as it stands at each call.

    Arguments and results are those of the chain's methods, in float64; leading axes broadcast. The
    functions work with `jit`, `vmap`, `grad`, `scan` and the like, and have derivatives of every
    order, forward and reverse. The result for a bad sample and its derivatives are NaN.

    q must be a closed configuration; `closed` and `step` return such. The functions depend on the
    coordinates in q alone: the dependent joints only tell the assembly mode. So a derivative with
    respect to q is the one along the closed motions: it has values at the entries of the
    coordinates' joints, and zeros at those of the others.

    First derivatives of torques and accelerations are the chain's, with smooth friction as in
    `step`; kernels make them fast, `compile(derivatives=True)`. The others need CasADi; each order
    takes a multiple of the time and memory of the one before.

    Attributes:
        nq, n, motors: Numbers of entries in q, va, tau.

    Raises:
        InputError: If JAX uses single precision.
        DescriptionError: If the robot has a rolling contact.
    """

    def __init__(self, chain: "ClosedChain", near: Array | None, sign_width: float) -> None:
        _require_double()
        mechanism = chain._current.mechanism
        super().__init__(mechanism)
        self._chain, self._near, self._sign_width = chain, near, sign_width
        mechanism.require_freedom()
        if any(isinstance(closure, Rolling) for closure in mechanism.closures):
            problem = "with a rolling contact q has more directions than rates; use casadi()"
            raise DescriptionError("jax", [problem])
        self._along: tuple[Mechanism, AlongMotions] | None = None
        self._lock = threading.Lock()  # CasADi is not for several threads
        self._placement, self._function = cache(self._placement_of), cache(self._of_chain)

    def torques(self, q: Any, va: Any, aa: Any) -> jax.Array:
        """Inverse dynamics, shape (..., motors); with redundant motors the smallest torques.

        Raises:
            ActuationError: If the motors do not act on all coordinates.
        """
        if self._mechanism.driven_one_to_one:
            return self.generalized_forces(q, va, aa)
        if self._held < self.n:
            raise ActuationError(
                f"the motors supply {self._held} of {self.n} forces along the coordinates; "
                "use generalized_forces"
            )
        return self._function("torques")(*self._arguments(q=q, va=va, aa=aa))

    def generalized_forces(self, q: Any, va: Any, aa: Any) -> jax.Array:
        """Generalized forces of a motion, shape (..., n)."""
        return self._function("generalized_forces")(*self._arguments(q=q, va=va, aa=aa))

    def accelerations(self, q: Any, va: Any, tau: Any) -> jax.Array:
        """Direct dynamics, shape (..., n).

        Raises:
            SingularConfigurationError: If a motion moves no mass; so does `step`.
        """
        self._mechanism.require_mass()
        return self._function("accelerations")(*self._arguments(q=q, va=va, tau=tau))

    def rates(self, q: Any, va: Any) -> jax.Array:
        """Rates v of all joints, shape (..., nv)."""
        return self._function("rates")(*self._arguments(q=q, va=va))

    def tangent(self, q: Any) -> jax.Array:
        """T, shape (..., nq, n), with q_dot = T va."""
        (q,) = self._arguments(q=q)
        T: jax.Array = self._tangent(q).reshape(*q.shape[:-1], self.nq, self.n)
        return T

    def closed(self, q: Any) -> jax.Array:
        """The configurations near q whose loops are closed, with the same coordinates.

        Quaternions in q may have any length.
        """
        (q,) = self._arguments(q=q)
        parts = self._mechanism.space.unit_parts
        if parts.size:
            q = q * (1 + (1 / jnp.sqrt((q * q) @ parts) - 1) @ parts.T)
        return self._closed(q)

    def step(self, q: Any, va: Any, tau: Any, dt: Any) -> tuple[jax.Array, jax.Array]:
        """q on the closures and va after a step of the classical Runge-Kutta method of order four.

        The torques are constant during the steps dt, shape (...), [s].
        """
        self._mechanism.require_mass()
        q, va, tau, dt = self._arguments(q=q, va=va, tau=tau, dt=dt)

        def rate(when: int, x: jax.Array) -> jax.Array:
            q, va = x[..., : self.nq], x[..., self.nq :]
            return self._state_rate(self.closed(q) if when else q, va, tau)

        lead = jnp.broadcast_shapes(q.shape[:-1], va.shape[:-1])
        state = [jnp.broadcast_to(x, (*lead, x.shape[-1])) for x in (q, va)]
        x = runge_kutta_step(rate, jnp.concatenate(state, axis=-1), dt)
        return self.closed(x[..., : self.nq]), x[..., self.nq :]

    def frame_placement(self, frame: str) -> Callable[[Any], tuple[jax.Array, jax.Array]]:
        """A function q -> p, (..., 3), and R, (..., 3, 3): a frame, by its name, in the base."""
        frame_id(self._mechanism.model, frame)
        return self._placement(frame)

    def _placement_of(self, frame: str) -> Callable[[Any], tuple[jax.Array, jax.Array]]:
        by_casadi = partial(self._by_casadi, "frame_placement", frame=frame)
        values = self._differentiable(by_casadi, 12)

        def placement(q: Any) -> tuple[jax.Array, jax.Array]:
            (q,) = self._arguments(q=q)
            both = values(q)
            return both[..., :3], both[..., 3:].reshape(*q.shape[:-1], 3, 3)

        return placement

    @cached_property
    def _held(self) -> int:
        """How many coordinates the motors hold at most configurations."""
        J = self._chain.actuator_jacobian(self._chain.generic_configuration())
        units = self._mechanism.rate_scale[self._mechanism.coordinates]
        _, lost = smallest_torques(J.T, units, np.ones(self.motors), None)
        return self.n - lost.shape[1]

    # --- functions of arrays of the right shape ---------------------------------------------

    def _of_chain(self, name: Name) -> Callable[..., jax.Array]:
        """A function of `CasadiFunctions` whose values the chain computes."""

        def of_order(order: int, *arrays: Array) -> Array:
            return self._derivatives(name, order, *arrays) if order else self._values(name, *arrays)

        return self._differentiable(of_order, *QUANTITIES[name].shape(self._mechanism))

    @cached_property
    def _state_rate(self) -> Callable[..., jax.Array]:
        """q_dot and aa side by side, with the smooth friction of derivatives."""

        def values(order: int, *arrays: Array) -> Array:
            q, va, tau = _with_all_axes(arrays)
            if order:
                of_q = self._by_casadi("q_rates", order, q, va)
                by_tau = [(0, 0)] * (of_q.ndim - order) + [(0, self.motors)] * order
                aa = self._derivatives("accelerations", order, q, va, tau)
                return np.concatenate([np.pad(of_q, by_tau), aa], axis=-1 - order)
            states = self._chain._states(self._sign_width)

            def rate(q: Array, va: Array, tau: Array) -> Array:
                return states.rate(np.concatenate([q, va], axis=-1), tau, None)

            rates = _samples(rate, self.nq + self.n, q, va, tau)  # closes the loops
            rates[np.isnan(self._values("rates", q, va)).any(axis=-1)] = np.nan
            return rates

        return self._differentiable(values, self.nq + self.n)

    @cached_property
    def _tangent(self) -> Callable[..., jax.Array]:
        return self._differentiable(partial(self._by_casadi, "tangent"), self.nq * self.n)

    @cached_property
    def _closed(self) -> Callable[..., jax.Array]:
        def values(q: Array) -> Array:
            return _samples(self._chain._states(self._sign_width).closed, self.nq, q)

        on_arrays = self._on_arrays(values)

        @jax.custom_jvp
        def closed(q: jax.Array) -> jax.Array:
            return _called(on_arrays, (self.nq,), q)

        @closed.defjvp
        def _(primals: Any, tangents: Any) -> Any:
            q = closed(*primals)
            way = self._way(q, *tangents)[..., None]
            return q, (self.tangent(q) @ way)[..., 0]

        return closed

    def _differentiable(
        self, values: Values, size: int, order: int = 0
    ) -> Callable[..., jax.Array]:
        """A function of q and others, shape (..., size, N, .., N), differentiated along motions.

        `values` take the order of the derivative first; `order` is that of the function itself.
        """
        on_arrays = self._on_arrays(partial(values, order))
        by = cache(lambda: self._differentiable(values, size, order + 1))

        @jax.custom_jvp
        def function(*arrays: jax.Array) -> jax.Array:
            N = self.n + sum(x.shape[-1] for x in arrays[1:])
            return _called(on_arrays, (size, *(N,) * order), *arrays)

        @function.defjvp
        def _(primals: Any, tangents: Any) -> Any:
            rows, (dq, *others) = by()(*primals), tangents
            lead = rows.shape[: -2 - order]
            parts = [self._way(primals[0], dq), *others]
            parts = [jnp.broadcast_to(x, (*lead, x.shape[-1])) for x in parts]
            way = jnp.concatenate(parts, axis=-1).reshape(*lead, *(1,) * order, -1, 1)
            return function(*primals), (rows @ way)[..., 0]

        return function

    def _way(self, q: jax.Array, dq: jax.Array) -> jax.Array:
        """Rates of the coordinates in the change dq of q, shape (..., n)."""
        entries, single = self._entries
        if single:
            return dq[..., entries]
        T = self.tangent(q)[..., entries, :]
        T_t = jnp.swapaxes(T, -1, -2)
        return jnp.linalg.solve(T_t @ T, T_t @ dq[..., entries, None])[..., 0]

    @cached_property
    def _entries(self) -> tuple[Indices, bool]:
        """Entries of q of the coordinates' joints, and whether each is a coordinate."""
        of_rate: dict[int, range] = {}
        for joint in list(self._mechanism.model.joints)[1:]:
            for k in range(joint.nv):
                own = range(joint.nq) if joint.nq > joint.nv else range(k, k + 1)
                of_rate[joint.idx_v + k] = range(joint.idx_q + own.start, joint.idx_q + own.stop)
        parts = [of_rate[int(k)] for k in self._mechanism.coordinates]
        entries = list(dict.fromkeys(i for part in parts for i in part))
        return np.array(entries, dtype=np.intp), all(len(part) == 1 for part in parts)

    # --- inside -----------------------------------------------------------------------------

    def _values(self, name: Name, q: Array, *others: Array) -> Array:
        """A quantity by the chain; NaN where loops are open."""
        names = "va", "tau" if name == "accelerations" else "aa"
        how: dict[str, Any] = {"on_error": "nan", **dict(zip(names, others, strict=False))}
        return computed(self._chain._current, Key(name), q, **how)

    def _derivatives(self, name: Name, order: int, *arrays: Array) -> Array:
        """The chain's first derivatives of forces and accelerations, else CasADi's."""
        if order == 1 and name in ("generalized_forces", "accelerations"):
            chain, forces = self._chain, name == "generalized_forces"
            first = chain.torque_derivatives if forces else chain.acceleration_derivatives
            d = first(*arrays, sign_width=self._sign_width, on_error="nan")
            return np.concatenate(d, axis=-1)
        return self._by_casadi(name, order, *arrays)

    def _by_casadi(self, name: str, order: int, *arrays: Array, frame: str | None = None) -> Array:
        """Values of `AlongMotions`, of the model as it stands; NaN where the chain's are."""
        arrays = tuple(_with_all_axes(arrays))
        if name in QUANTITIES:
            known = self._values(cast(Name, name), *arrays)
        else:
            known = self._values("rates", *[*arrays, np.zeros(self.n)][:2])
        with self._lock:
            mechanism, made = self._chain._current.mechanism, self._along
            if made is None or made[0] is not mechanism:
                reference = self._chain._current.reference
                functions = CasadiFunctions(reference, self._near, self._sign_width)
                made = self._along = mechanism, AlongMotions(functions)
            found = made[1].values(name, order, *arrays, frame=frame)
        found[np.isnan(known).any(axis=-1)] = np.nan
        return found

    def _on_arrays(self, values: Values) -> Callable[..., Array]:
        """The callback of JAX; it refuses a robot whose coordinates have changed."""

        def on_arrays(*given: Any) -> Array:
            results = values(*map(np.asarray, given))
            now = self._chain._current.mechanism.coordinates
            if not np.array_equal(now, self._mechanism.coordinates):
                problem = "the robot has other coordinates now; call jax() again, near this q"
                raise DescriptionError("jax", [problem])
            return results

        return on_arrays

    def _arguments(self, **arguments: Any) -> list[jax.Array]:
        """In double precision, checked, with as many leading axes each; dt as a column."""
        _require_double()
        sizes = {"q": self.nq, "va": self.n, "aa": self.n, "tau": self.motors}
        arrays = []
        for name, value in arguments.items():
            try:
                array = jnp.asarray(value)
            except (TypeError, ValueError) as error:
                raise InputError(name, f"not an array of numbers ({error})") from None
            if array.dtype.kind not in "iuf":
                raise InputError(name, f"not an array of real numbers (dtype {array.dtype})")
            if name == "dt":
                array = array[..., None]
            elif array.shape[-1:] != (sizes[name],):
                raise InputError(name, f"shape {array.shape}, expected (..., {sizes[name]})")
            arrays.append(array.astype(jnp.float64))
        leads = [x.shape[:-1] for x in arrays]
        try:
            axes = len(jnp.broadcast_shapes(*leads))
        except ValueError:
            raise InputError("batch", f"leading axes {leads} do not broadcast") from None
        return [x.reshape((1,) * (axes + 1 - x.ndim) + x.shape) for x in arrays]


def _called(
    function: Callable[..., Array], shape: tuple[int, ...], *arrays: jax.Array
) -> jax.Array:
    """A function on this process's arrays, a batch at once."""
    lead = jnp.broadcast_shapes(*(array.shape[:-1] for array in arrays))
    result = jax.eval_shape(partial(jnp.zeros, (*lead, *shape), jnp.float64))
    found: jax.Array = jax.pure_callback(function, result, *arrays, vmap_method="expand_dims")
    return found


def _with_all_axes(arrays: Sequence[Array]) -> list[Array]:
    """Arrays with the leading axes of all."""
    lead = np.broadcast_shapes(*(x.shape[:-1] for x in arrays))
    return [np.broadcast_to(x, (*lead, x.shape[-1])) for x in arrays]


def _samples(function: Callable[..., Array], size: int, *arrays: Array) -> Array:
    """A function of many samples, one by one where some are at fault: these become NaN."""

    def fill(flat: list[Array | None], results: Array) -> Indices:
        try:
            results[:] = function(*flat)
        except SSTError:
            return np.arange(len(results))
        return np.arange(0)

    axes = [1] * len(arrays)
    return for_each_sample(function, arrays, axes, (size,), on_error="nan", fast=fill)


def _require_double() -> None:
    if jnp.zeros(()).dtype != np.float64:
        raise InputError(
            "jax", "single precision is on; call jax.config.update('jax_enable_x64', True)"
        )

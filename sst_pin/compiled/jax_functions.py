# SPDX-License-Identifier: BSD-2-Clause
"""The dynamics of a chain as functions of JAX, for `jit`, `vmap` and `grad` on processors.

JAX calls back into this process, where the chain computes whole batches by whatever it computes by.
What JAX differentiates are the chain's own derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import DescriptionError, InputError

if TYPE_CHECKING:
    from ..chain.closed_chain import ClosedChain
    from ..chain.mechanism import Mechanism


class JaxFunctions:
    """Dynamics of a chain as JAX functions.

    Arguments and results are those of the chain's methods, in float64; leading axes broadcast. The
    functions work with `jit`, `vmap`, `grad`, `jacfwd` and `jacrev`. Derivatives are of
    first order. The result for a bad sample is NaN, as with `on_error="nan"`.

    q must be a closed configuration. A derivative with respect to q is the one along the closed
    motions: it has values at the entries of the coordinates, and zeros at the dependent joints.

    Args:
        chain: The robot; changes of its model take effect at the next call. For speed, call
            `compile(derivatives=True)` before.
        sign_width: In derivatives, Coulomb friction uses tanh(v / sign_width) instead of the sign
            of v.

    Raises:
        InputError: If JAX uses single precision.
        DescriptionError: If a coordinate is not a single entry of q (a ball, a free-flyer).
    """

    def __init__(self, chain: ClosedChain, sign_width: float) -> None:
        if jnp.zeros(()).dtype != np.float64:
            raise InputError(
                "jax", "single precision is on; call jax.config.update('jax_enable_x64', True)"
            )
        self._chain, self._sign_width = chain, sign_width
        entries, n = _entries(chain._current.mechanism()), chain.degrees_of_freedom
        by = chain.torque_derivatives
        self._forces = self._function(chain.generalized_forces, by, entries, n)
        by_tau = chain.acceleration_derivatives
        self._accelerations = self._function(chain.compute_accelerations, by_tau, entries, n)

    def generalized_forces(self, q: Any, va: Any, aa: Any) -> jax.Array:
        """Generalized forces of a motion, shape (..., n); the torques if motor k is coordinate k.

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            aa: Their accelerations, shape (..., n).
        """
        return self._forces(*_doubles(q, va, aa))

    def torques(self, q: Any, va: Any, aa: Any) -> jax.Array:
        """Inverse dynamics, shape (..., motors); arguments as `generalized_forces`.

        Raises:
            DescriptionError: If the motors are not the coordinates.
        """
        if not self._chain._current.mechanism().driven_one_to_one:
            problem = "the motors are not the coordinates; use generalized_forces"
            raise DescriptionError("jax", [problem])
        return self.generalized_forces(q, va, aa)

    def accelerations(self, q: Any, va: Any, tau: Any) -> jax.Array:
        """Direct dynamics, shape (..., n).

        Args:
            q: Configurations on the closures, shape (..., nq).
            va: Rates of the coordinates, shape (..., n).
            tau: Motor torques, shape (..., motors).
        """
        return self._accelerations(*_doubles(q, va, tau))

    def _function(
        self,
        values: Callable[..., Any],
        derivatives: Callable[..., Any],
        entries: list[int],
        n: int,
    ) -> Callable[..., jax.Array]:
        """A function of q, va and x, differentiated by its derivatives along the motions."""

        def on_arrays(*arrays: Any) -> Any:
            return values(*map(np.asarray, arrays), on_error="nan")

        def on_arrays_by(*arrays: Any) -> Any:
            plain = map(np.asarray, arrays)
            d = derivatives(*plain, sign_width=self._sign_width, on_error="nan")
            return np.concatenate(d, axis=-1)

        @jax.custom_jvp
        def by(q: jax.Array, va: jax.Array, x: jax.Array) -> jax.Array:
            return _called(on_arrays_by, (n, 2 * n + x.shape[-1]), q, va, x)

        @by.defjvp
        def _second_order(primals: Any, tangents: Any) -> Any:
            problem = "derivatives are of first order; CasADi's functions have those of every order"
            raise InputError("jax", problem)

        @jax.custom_jvp
        def function(q: jax.Array, va: jax.Array, x: jax.Array) -> jax.Array:
            return _called(on_arrays, (n,), q, va, x)

        def jvp(primals: Any, tangents: Any) -> Any:
            q, va, x = primals
            rows = by(q, va, x)
            dq, dva, dx = tangents
            parts = [dq[..., entries], dva, dx]
            lead = rows.shape[:-2]
            parts = [jnp.broadcast_to(part, (*lead, part.shape[-1])) for part in parts]
            change = jnp.einsum("...ij,...j->...i", rows, jnp.concatenate(parts, axis=-1))
            return function(q, va, x), change

        function.defjvp(jvp)
        return function


def _called(function: Callable[..., Any], shape: tuple[int, ...], *arrays: jax.Array) -> jax.Array:
    """A function on this process's arrays, a batch at once."""
    lead = jnp.broadcast_shapes(*(array.shape[:-1] for array in arrays))
    result = jax.eval_shape(partial(jnp.zeros, (*lead, *shape), jnp.float64))
    found: jax.Array = jax.pure_callback(function, result, *arrays, vmap_method="expand_dims")
    return found


def _doubles(*arrays: Any) -> tuple[jax.Array, ...]:
    return tuple(jnp.asarray(array, dtype=jnp.float64) for array in arrays)


def _entries(mechanism: Mechanism) -> list[int]:
    """The entry of q of each coordinate."""
    of_rate: dict[int, int] = {}
    for joint in list(mechanism.model.joints)[1:]:
        if joint.nq == joint.nv:
            of_rate |= {joint.idx_v + k: joint.idx_q + k for k in range(joint.nv)}
    problems = [
        f"coordinate {name} is not a single entry of q"
        for k, name in zip(mechanism.coordinates, mechanism.coordinate_rate_names, strict=True)
        if int(k) not in of_rate
    ]
    if problems:
        raise DescriptionError("jax", problems)
    return [of_rate[int(k)] for k in mechanism.coordinates]

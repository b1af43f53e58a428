# SPDX-License-Identifier: BSD-2-Clause
"""One sample or many: by kernels, and by the reference path if they fail a kernel's checks."""

import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import (
    Array,
    Indices,
    as_array,
    finite_array,
    for_each_sample,
    positive_number,
    require_policy,
    single_array,
    whole_number,
)
from ..dynamics.derivatives import AccelerationDerivatives, TorqueDerivatives
from ..dynamics.quantities import Name
from ..errors import InputError
from ..model.closures import Rolling
from ..model.mechanism import Mechanism
from ..model.tree import frame_id
from .backend import Key
from .current import Current

D = TypeVar("D", TorqueDerivatives, AccelerationDerivatives)
#: Names of derivatives, and of their third argument.
_NAMES: dict[type, tuple[Name, str]] = {
    TorqueDerivatives: ("torque_derivatives", "aa"),
    AccelerationDerivatives: ("acceleration_derivatives", "tau"),
}
#: The longest first step of an assembly by kernels, [rad] or robot lengths; the part of it that the
#: next one may have at most; a step behind which the next one is below rounding; and rounding.
_NEAR, _SHRINKS, _LAST, _ROUNDING = 0.1, 0.1, 1e-9, 1e-14


def computed(
    current: Current,
    key: Key,
    q: ArrayLike,
    *,
    load: Array | None = None,
    special: Mapping[str, Array] | None = None,
    out: Array | None = None,
    threads: int = 1,
    on_error: str = "raise",
    **others: Any,
) -> Array:
    """A quantity by its kernel; samples that fail its checks by the reference path, or its errors.

    `others` are the arguments after q by name, where only the tau of reactions may be None, `load`
    wrenches on all bodies, shape (..., r, 6), `special` arguments of the reference path for which
    there are no kernels; the rest is as in `ClosedChain`.
    """
    without: list[None] = []
    if key.quantity == "reactions" and others["tau"] is None:
        without = [others.pop("tau")]
    arrays: list[Array | None] = [*current.arguments(q, **others), *without]
    axes, mechanism = [1] * len(arrays), current.mechanism
    reference: Callable[..., Array] = getattr(current.reference, key.quantity)
    if key.kind.of_frame:
        reference = partial(reference, frame=frame_id(mechanism.model, key.frame))
    if key.sign_width is not None:
        reference = partial(reference, key.sign_width)
    if special:
        reference = partial(reference, **special)
    if key.kind.loadable:
        arrays, axes = [*arrays, load], [*axes, 2]
    require_policy(on_error)
    threads = whole_number("threads", threads, 1)
    if out is None and on_error == "raise" and not current.has_kernels:
        pairs = zip(arrays, axes, strict=True)
        if all(array is None or array.ndim == core for array, core in pairs):
            return reference(*arrays)  # the short way for one sample

    def fill(flat: list[Array | None], result: Array) -> Indices:
        if special:
            return np.arange(len(result))
        given = [np.require(a, float, "A") for a in flat if a is not None]
        loaded = given[-1].ndim == 3
        if loaded:
            given[-1] = given[-1].reshape(len(result), 6 * (mechanism.model.njoints - 1))
        kernel = current.backend.kernel(key._replace(loaded=loaded))
        return kernel.many(tuple(given), result, min(threads, sys.maxsize))

    shape = key.kind.shape(mechanism)
    return for_each_sample(reference, arrays, axes, shape, on_error=on_error, out=out, fast=fill)


def assembled(current: Current, q: Array) -> Array | None:
    """The closed configuration near q with the coordinates held, by kernels; None if not near.

    Steps of Newton's method that start short and shrink fast lead to the one solution nearby, which
    is that of the reference path too.
    """
    mechanism, kernel = current.mechanism, current.backend.kernel(Key("closing"))
    rolling = any(isinstance(closure, Rolling) for closure in mechanism.closures)
    if rolling or mechanism.held_in_part:
        return None  # the way to the solution counts
    result, before = np.full((1, len(q) + 2), np.nan), _NEAR / _SHRINKS
    while True:
        refused = kernel.many((q[None],), result)
        way = pin.difference(mechanism.model, q, result[0, :-2]) / mechanism.rate_scale
        length = float(np.abs(way).max(initial=0.0))
        if not length <= _SHRINKS * before:
            return None
        if not length < _ROUNDING:  # what is closed stays as it is
            q, before = result[0, :-2].copy(), length
        if length < _LAST:
            return None if len(refused) else q


def of_frame(
    current: Current,
    key: Key,
    q: ArrayLike,
    out: Array | None,
    threads: int,
    on_error: str,
    **va: Any,
) -> Array:
    """A quantity of a frame, shape (..., 6, columns), or (..., 6) for its drift."""
    if out is None and on_error == "raise" and isinstance(key.frame, str):
        kernel = current.backend.kernel(key)
        rows = kernel.answer(q, va.get("va"), None, None, None, threads)
        if rows is not None:
            rows.shape = (*rows.shape[:-1], *key.kind.shape(current.mechanism))
            return rows
    return computed(current, key, q, out=out, threads=threads, on_error=on_error, **va)


def derivatives(
    current: Current,
    kind: type[D],
    arguments: tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike | None],
    sign_width: float,
    out: Array | None,
    threads: int,
    on_error: str,
) -> D:
    """Derivatives of the dynamics with smooth friction; `arguments` end with external wrenches."""
    width = sign_width
    if type(width) is not float or not 0 < width < np.inf:
        width = positive_number("sign_width", sign_width)
    name, third = _NAMES[kind]
    key = Key(name, sign_width=width)
    q, va, x, wrenches = arguments
    if wrenches is out is None and on_error == "raise":
        found: D | None = current.backend.kernel(key).derivatives(kind, q, va, x, threads)
        if found is not None:
            return found
    load = external_wrenches(current.mechanism, wrenches, on_error)
    how: dict[str, Any] = {third: x, "out": out, "threads": threads, "on_error": on_error}
    rows = np.asarray(computed(current, key, q, va=va, load=load, **how))
    n = rows.shape[-2]
    return kind(*np.split(rows, (n, 2 * n), axis=-1))


def linear_system(
    current: Current, q: ArrayLike, va: ArrayLike, d: AccelerationDerivatives
) -> tuple[Array, Array]:
    """A, shape (..., 2 n, 2 n), and B, shape (..., 2 n, motors), of the state next to a motion."""
    rows = np.concatenate(d, axis=-1)
    n = rows.shape[-2]
    both = np.zeros((*rows.shape[:-2], 2 * n, rows.shape[-1]))
    both[..., :n, n : 2 * n] = np.eye(n)
    both[..., n:, :] = rows
    if current.reference.derivatives.axes_move:
        rates = computed(current, Key("displacement_rates"), q, va=va, on_error="nan")
        both[..., :n, :n] = rates
    return both[..., : 2 * n], both[..., 2 * n :]


def motor_weights(mechanism: Mechanism, weights: ArrayLike) -> Array:
    """Weights of the motors' squared torques, positive, shape (motors,)."""
    array = single_array("weights", weights, (mechanism.motors.shape[1],))
    if not (array > 0).all():
        raise InputError("weights", "must be positive")
    return array


def external_wrenches(
    mechanism: Mechanism, wrenches: ArrayLike | None, on_error: str
) -> Array | None:
    """Wrenches on all bodies, shape (..., r, 6), or None.

    Kernels leave out those that do no work, so what is not finite is looked for here.
    """
    if wrenches is None:
        return None
    shape = mechanism.model.njoints - 1, 6
    if on_error != "nan":
        return finite_array("external_wrenches", wrenches, shape)
    array = as_array("external_wrenches", wrenches, shape)
    finite = np.isfinite(array).all(axis=(-2, -1), keepdims=True)
    return np.where(finite, array, np.nan)

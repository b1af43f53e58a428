# SPDX-License-Identifier: BSD-2-Clause
"""One sample or many: by kernels, and by the reference path if they fail a kernel's checks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import (
    as_array,
    finite_array,
    for_each_sample,
    positive_number,
    require_policy,
    single_array,
    whole_number,
)
from ..errors import InputError
from .backend import Indices, Key
from .current import Current
from .derivatives import AccelerationDerivatives, TorqueDerivatives
from .mechanism import Mechanism
from .tree import frame_id

Array = NDArray[np.float64]
D = TypeVar("D", TorqueDerivatives, AccelerationDerivatives)
#: Of derivatives: of what computes them, and of their third argument.
_NAMES = {
    TorqueDerivatives: ("torque_derivatives", "aa"),
    AccelerationDerivatives: ("acceleration_derivatives", "tau"),
}


def by_kernel(
    current: Current,
    reference: Callable[..., Array],
    kernel: Key | None,
    arrays: Sequence[Array | None],
    core_axes: Sequence[int],
    result: tuple[int, ...],
    *,
    out: Array | None = None,
    threads: int = 1,
    on_error: str = "raise",
) -> Array:
    """A batch by the kernel; samples that fail its checks by the reference path, with its errors.

    Args:
        current: Whose kernel it is.
        reference: One sample by the reference path, of this shape.
        kernel: What computes it; None for the reference path alone. Loads follow from arrays.
        arrays: Arguments; None stays None.
        core_axes: Number of core axes of each.
        result: Shape of a result.
        out: Where results go, shape (..., *result).
        threads: How many share the batch in the kernel.
        on_error: "raise", or "nan": samples that fail become NaN.
    """
    require_policy(on_error)
    threads = whole_number("threads", threads, 1)
    if out is None and on_error == "raise" and not current.has_kernels:
        for array, axes in zip(arrays, core_axes, strict=True):
            if array is not None and array.ndim != axes:
                break
        else:
            return reference(*arrays)  # the short way for one sample

    def fill(flat: list[Array | None], result: Array) -> Indices:
        if kernel is None:
            return np.arange(len(result))
        key, given = kernel, [np.require(a, float, "A") for a in flat if a is not None]
        if given[-1].ndim == 3:
            N, bodies, _ = given[-1].shape
            key, given[-1] = key._replace(loaded=True), given[-1].reshape(N, 6 * bodies)
        return current.backend.kernel(key).many(tuple(given), result, min(threads, sys.maxsize))

    return for_each_sample(
        reference, arrays, core_axes, result, on_error=on_error, out=out, fast=fill
    )


def derivatives(
    current: Current,
    kind: type[D],
    arguments: tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike | None],
    sign_width: float,
    out: Array | None,
    threads: int,
    on_error: str,
) -> D:
    """Derivatives of dynamics with smoothed friction.

    Args:
        current: Whose they are.
        kind: Of which function.
        arguments: q, va, aa or tau, and external wrenches.
        sign_width: Of the smoothing.
        out: Where results go.
        threads: As in `by_kernel`.
        on_error: As in `by_kernel`.
    """
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
    arrays: list[Array]
    arrays = current.arguments(q, va=va, **{third: x})
    mechanism, n = current.mechanism, len(current.mechanism.coordinates)
    rows = by_kernel(
        current,
        partial(getattr(current.reference, name), width),
        key,
        [*arrays, external_wrenches(mechanism, wrenches, on_error)],
        (1, 1, 1, 2),
        (n, 2 * n + arrays[-1].shape[-1]),
        out=out,
        threads=threads,
        on_error=on_error,
    )
    return kind.of_rows(rows)


def of_frame(
    current: Current,
    name: str,
    frame: str,
    arguments: Sequence[ArrayLike],
    out: Array | None,
    threads: int,
    on_error: str,
) -> Array:
    """A quantity of a frame, shape (..., 6, columns), or (..., 6) for its drift.

    Args:
        current: Whose it is.
        name: Of the method of `Reference`.
        frame: Its name.
        arguments: q, and va where it is needed.
        out: Where results go.
        threads: As in `by_kernel`.
        on_error: As in `by_kernel`.
    """
    key = Key(name, frame)
    if out is None and on_error == "raise" and isinstance(frame, str):
        first, second = arguments if len(arguments) == 2 else (*arguments, None)
        rows = current.backend.kernel(key).answer(first, second, None, None, None, threads)
        if rows is not None:
            n = len(current.reference.mechanism.coordinates)
            rows.shape = (*rows.shape[:-1], *_shape(name, n))
            return rows
    q, *va = arguments
    mechanism, arrays = current.mechanism, current.arguments(q, **({"va": va[0]} if va else {}))
    reference = partial(getattr(current.reference, name), frame=frame_id(mechanism.model, frame))

    return by_kernel(
        current,
        reference,
        key,
        arrays,
        (1,) * len(arrays),
        _shape(name, len(mechanism.coordinates)),
        out=out,
        threads=threads,
        on_error=on_error,
    )


def _shape(name: str, n: int) -> tuple[int, ...]:
    """Of what there is of a frame."""
    if name == "frame_drift":
        return (6,)
    return 6, 2 * n if name == "frame_velocity_derivatives" else n


def linear_system(
    current: Current, q: ArrayLike, va: ArrayLike, d: AccelerationDerivatives
) -> tuple[Array, Array]:
    """A, shape (..., 2 n, 2 n), and B, shape (..., 2 n, motors), of the state next to a motion.

    Args:
        current: Whose they are.
        q: Configurations.
        va: Rates.
        d: Derivatives of the accelerations.
    """
    rows = np.concatenate(d, axis=-1)
    n = rows.shape[-2]
    both = np.zeros((*rows.shape[:-2], 2 * n, rows.shape[-1]))
    both[..., :n, n : 2 * n] = np.eye(n)
    both[..., n:, :] = rows
    if current.reference.derivatives.axes_move:
        arrays = current.arguments(q, va=va)
        reference, key = current.reference.derivatives.displacement_rates, Key("displacement_rates")
        both[..., :n, :n] = by_kernel(
            current, reference, key, arrays, (1, 1), (n, n), on_error="nan"
        )
    return both[..., : 2 * n], both[..., 2 * n :]


def motor_weights(mechanism: Mechanism, weights: ArrayLike) -> Array:
    """Weights of the motors' squared torques, shape (motors,).

    Raises:
        InputError: When one is not positive.
    """
    array = single_array("weights", weights, (mechanism.motors.shape[1],))
    if not (array > 0).all():
        raise InputError("weights", "must be positive")
    return array


def external_wrenches(
    mechanism: Mechanism, wrenches: ArrayLike | None, on_error: str
) -> Array | None:
    """Wrenches on all bodies, shape (..., r, 6), or None.

    Kernels leave out those that do no work. So one that is not finite is looked for here; where
    samples at fault become NaN, all wrenches of its sample do.
    """
    if wrenches is None:
        return None
    shape = mechanism.model.njoints - 1, 6
    if on_error != "nan":
        return finite_array("external_wrenches", wrenches, shape)
    array = as_array("external_wrenches", wrenches, shape)
    finite = np.isfinite(array).all(axis=(-2, -1), keepdims=True)
    return np.where(finite, array, np.nan)

# SPDX-License-Identifier: BSD-2-Clause
"""One sample or many: by kernels where they vouch for it, else by the reference path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import (
    finite_array,
    for_each_sample,
    positive_number,
    require_policy,
    single_array,
    whole_number,
)
from ..errors import InputError
from .backend import Indices
from .current import CurrentMechanism
from .mechanism import Mechanism

Array = NDArray[np.float64]


def by_kernel(
    current: CurrentMechanism,
    reference: Callable[..., Array],
    kernel: Callable[..., Indices] | None,
    arrays: Sequence[Array | None],
    core_axes: Sequence[int],
    size: int,
    *,
    out: Array | None = None,
    threads: int = 1,
    on_error: str = "raise",
) -> Array:
    """A batch by the kernel, what it leaves by the reference path, with its errors.

    Args:
        current: Whose kernel it is.
        reference: One sample by the reference path, a result of shape (size,).
        kernel: Samples in a row, as the methods of `Backend`.
        arrays: Arguments; None is handed on as it is.
        core_axes: Number of core axes of each.
        size: Of a result.
        out: Where results go, shape (..., size).
        threads: How many share the batch in the kernel.
        on_error: "raise", or "nan": samples that fail become NaN.
    """
    require_policy(on_error)
    threads = whole_number("threads", threads, 1)
    pairs = zip(arrays, core_axes, strict=True)
    single = all(array is None or array.ndim == axes for array, axes in pairs)
    if single and out is None and on_error == "raise" and not current.has_kernels:
        return reference(*arrays)

    def fill(flat: list[Array | None], result: Array) -> Indices:
        return np.arange(len(result)) if kernel is None else kernel(*flat, result, threads)

    return for_each_sample(
        reference, arrays, core_axes, (size,), on_error=on_error, out=out, fast=fill
    )


def derivatives(
    reference: Callable[..., Array],
    arrays: Sequence[Array | None],
    result: tuple[int, ...],
    sign_width: float,
    on_error: str,
) -> Array:
    """Derivatives of dynamics with smoothed friction, sample by sample.

    Args:
        reference: Of the smoothing and one sample, a matrix of shape `result`.
        arrays: q, va, aa or tau, and wrenches or None.
        result: Shape of the matrix.
        sign_width: Of the smoothing.
        on_error: As in `by_kernel`.
    """
    width = positive_number("sign_width", sign_width)
    function = partial(reference, width)
    return for_each_sample(function, arrays, (1, 1, 1, 2), result, on_error=on_error)


def motor_weights(mechanism: Mechanism, weights: ArrayLike) -> Array:
    """Weights of the motors' squared torques, shape (motors,).

    Raises:
        InputError: When one is not positive.
    """
    array = single_array("weights", weights, (mechanism.motors.shape[1],))
    if not (array > 0).all():
        raise InputError("weights", "not positive")
    return array


def external_wrenches(mechanism: Mechanism, wrenches: ArrayLike | None) -> Array | None:
    """Wrenches on all bodies, shape (..., r, 6), or None."""
    if wrenches is None:
        return None
    return finite_array("external_wrenches", wrenches, (mechanism.model.njoints - 1, 6))

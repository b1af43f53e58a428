# SPDX-License-Identifier: BSD-2-Clause
"""Checks arguments, and applies functions of one sample to batches.

An array of shape (..., *core) holds samples of the shape `core`. The axes before these core axes
are those of a batch: without them the array is a single sample.
"""

import math
import operator
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set
from fnmatch import fnmatchcase
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError, SSTError, UnknownNameError
from .progress import counted

# Arrays of real numbers, of indices, and of booleans.
Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Flags = NDArray[np.bool_]
_FLOAT64 = np.dtype(np.float64)
T = TypeVar("T")
_Numbers = TypeVar("_Numbers", Array, Indices)
#: The default policy for samples that fail. Control loops test `on_error is RAISE`, which is fast
#: and works for any object that a caller may pass. If it is another object, they check `on_error`.
RAISE = "raise"


def as_array(name: str, value: ArrayLike | None, core: tuple[int, ...]) -> Array:
    """The value as float64 of shape (..., *core); anything but real numbers is refused.

    Masked arrays are refused too. Numbers may be infinite or NaN, see `finite_array`.
    """
    if type(value) is np.ndarray and value.shape == core and value.dtype is _FLOAT64:
        return value  # the short way for one sample in a control loop
    if value is None:
        raise InputError(name, "None, expected an array of numbers")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InputError(name, f"not an array of numbers ({error})") from error
    if array.dtype.kind not in "iuf":
        raise InputError(name, f"not an array of numbers (dtype {array.dtype}, expected real ones)")
    if _masked(value):
        raise InputError(name, "a masked array; fill its gaps, e.g. by value.filled(nan)")
    array = array.astype(float, copy=False)
    last_axes = array.shape[max(array.ndim - len(core), 0) :]
    if last_axes != core:
        wanted = f"(..., {str(core)[1:-1].rstrip(',')})"
        raise InputError(name, f"shape {array.shape}, expected {wanted}")
    return array


def _masked(value: object) -> bool:
    """Whether a value is or contains a masked array; NumPy would ignore its mask."""
    if isinstance(value, (list, tuple)):
        return any(map(_masked, value))
    return isinstance(value, np.ma.MaskedArray)


def finite_array(name: str, value: ArrayLike, core: tuple[int, ...]) -> Array:
    """`as_array`, every number finite; the error names the samples of a batch."""
    array = as_array(name, value, core)
    finite = np.isfinite(array)
    if finite.all():
        return array
    indices = np.argwhere(~finite)[0]  # of the first bad entry
    entry = float(array[tuple(indices)])
    batch_axes = array.ndim - len(core)
    in_sample = [int(i) for i in indices[batch_axes:]]
    error = InputError(name, f"entry {in_sample} is {entry}" if core else f"{entry} is not finite")
    core_axes = tuple(range(batch_axes, array.ndim))
    at_fault = ~finite.all(axis=core_axes)  # which samples
    raise of_samples(error, np.asarray(at_fault))


def single_array(name: str, value: ArrayLike | None, shape: tuple[int, ...]) -> Array:
    """One sample of exactly this shape, every number finite."""
    array = as_array(name, value, ())
    if array.shape != shape:
        raise InputError(name, f"shape {array.shape}, expected {shape}: one sample")
    return finite_array(name, array, shape)


def for_each_sample(
    function: Callable[..., Array],
    arrays: Sequence[Array | None],
    core_axes: Sequence[int],
    result: tuple[int, ...],
    *,
    on_error: str = "raise",
    out: Array | None = None,
    fast: Callable[[list[Array | None], Array], NDArray[np.intp]] | None = None,
    hint: str = "",
) -> Array:
    """Apply a function of single samples to a batch: the leading axes of the arrays, broadcast.

    Args:
        function: Computes the result of one sample, from a sample of each array.
        arrays: Arrays with a batch of samples or one sample for all. Instead of an array it may be
            None, which the function gets then.
        core_axes: Number of core axes of each array.
        result: Shape of the result of one sample.
        on_error: With "nan" samples that fail become NaN. With "raise" the error is that of the
            first sample at fault, and names all samples with an error of this class.
        out: Gets the results, shape (..., *result). It may overlap the arrays; after an error it
            may hold a part of the results.
        fast: Fills results, shape (samples, size), from the samples of each array, shape
            (samples, ...). It returns the indices of the samples that it leaves to `function`.
        hint: Logged if the work takes long.

    Returns:
        Results, shape (..., *result), with the axes of the batch in front. It is `out` if given.
    """
    require_policy(on_error)
    batch, samples = flattened(arrays, core_axes)
    require_fitting(out, batch + result)
    count = math.prod(batch)

    # Results are written directly into `out` where that is safe; else they are copied at the end.
    writes_into_out = out is not None and _holds_results(out, samples)
    if out is not None and writes_into_out:
        results = np.asarray(out).reshape(count, *result)
    else:
        results = empty((count, *result))

    remaining: Iterable[int] = range(count)
    if fast is not None:
        remaining = fast(samples, results.reshape(count, math.prod(result))).tolist()

    failures = dict[int, SSTError]()
    for i in counted(remaining, "samples", count, hint):
        sample = [None if array is None else array[i] for array in samples]
        try:
            results[i] = function(*sample)
        except SSTError as error:
            results[i] = np.nan
            failures[i] = error
    if failures and on_error == "raise":
        first = next(iter(failures.values()))
        of_its_class = [i for i, error in failures.items() if type(error) is type(first)]
        name_samples(first, of_its_class, batch)
        raise first

    if out is None:
        return results.reshape(batch + result)
    if not writes_into_out:
        out[...] = results.reshape(batch + result)
    return out


def _holds_results(out: Array, samples: Iterable[Array | None]) -> bool:
    """Whether results can be written into `out` one by one.

    `out` must be dense, and share no memory with an argument that is still needed.
    """
    dense = np.asarray(out)  # a plain array, also for subclasses such as memory maps
    if not dense.flags.carray:
        return False
    arguments = [array for array in samples if array is not None]
    return not any(np.may_share_memory(array, dense) for array in arguments)


def require_policy(on_error: str) -> None:
    """Check `on_error`, the policy for samples that fail."""
    require_word("on_error", on_error, ("raise", "nan"))


def require_word(name: str, value: str, known: Collection[str]) -> None:
    """Refuse a value that is not one of the known words."""
    if not isinstance(value, str) or value not in known:
        raise InputError(name, f"{value!r} unknown; known: {', '.join(filter(None, known))}")


def require_flags(**flags: bool) -> None:
    """Refuse arguments, by their names, that are neither True nor False."""
    for name, value in flags.items():
        if not isinstance(value, (bool, np.bool)):
            raise InputError(name, f"{value!r}: True or False is needed")


def empty(shape: tuple[int, ...]) -> Array:
    """An empty array for results; raises an error if it does not fit in memory."""
    try:
        return np.empty(shape)
    except (MemoryError, ValueError):
        raise InputError("batch", f"results of shape {shape} do not fit into memory") from None


def in_order(name: str, value: Iterable[T], of: str = "names") -> tuple[T, ...]:
    """A sequence as a tuple; strings, mappings and sets (without order) raise an error."""
    if isinstance(value, (str, Mapping, Set)) or not isinstance(value, Iterable):
        raise InputError(name, f"{value!r}: a sequence of {of} is needed, such as a list")
    return tuple(value)


def names(name: str, value: Iterable[str]) -> tuple[str, ...]:
    """A sequence of names as a tuple; a single string or an entry that is no string is refused."""
    if isinstance(value, Mapping):
        raise InputError(name, f"{value!r}: a sequence of names is needed; it takes no values")
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InputError(name, f"{value!r}: a sequence of names is needed")
    words = tuple(value)
    if not all(isinstance(word, str) for word in words):
        raise InputError(name, f"{words!r}: each must be a string")
    return words


def matching_names(kind: str, pattern: str, known: Sequence[str]) -> list[str]:
    """The known names that match a pattern, such as "crank.*", in their order.

    A pattern that is itself a known name matches this name only: a name such as "leg[1].mass" may
    contain characters that have a meaning in patterns.

    Args:
        kind: What the names are, such as "parameter", for the message of the error.
        pattern: A name, or a pattern as in `fnmatch`.
        known: All names.

    Raises:
        UnknownNameError: If no name matches.
    """
    if pattern in known:
        return [pattern]
    matches = [name for name in known if fnmatchcase(name, pattern)]
    if not matches:
        raise UnknownNameError(kind, pattern, known)
    return matches


def require_instance(name: str, value: object, kind: type) -> None:
    """Refuse an argument that is not of this class."""
    if not isinstance(value, kind):
        raise InputError(name, f"a {kind.__name__} is needed, not {type(value).__name__}")


def whole_number(name: str, value: int, least: int) -> int:
    """A count of at least `least`."""
    if type(value) is int and value >= least:
        return value  # the short way for one sample in a control loop
    if isinstance(value, (bool, np.bool)):
        raise InputError(name, f"{value!r} is not a whole number")
    try:
        number = operator.index(value)
    except TypeError:
        raise InputError(name, f"{value!r} is not a whole number") from None
    if number < least:
        raise InputError(name, f"{number}, expected at least {least}")
    return number


def positive_number(name: str, value: float, *, or_zero: bool = False) -> float:
    """A finite number above 0, or 0 where it may be."""
    if isinstance(value, float) and 0 < value < np.inf:
        return float(value)  # the short way, ten times as fast
    number = float(single_array(name, value, ()))
    if number < 0 or (number == 0 and not or_zero):
        raise InputError(name, f"{number:g} is {'below' if or_zero else 'not above'} 0")
    return number


def one_or_each(name: str, value: ArrayLike, count: int, *, or_zero: bool = False) -> Array:
    """Positive numbers: one for all, or one for each of `count`; `or_zero` allows 0."""
    numbers = finite_array(name, value, ())
    if numbers.shape not in ((), (count,)) or (numbers < 0).any() or not (or_zero or numbers.all()):
        which = "not negative" if or_zero else "positive"
        raise InputError(name, f"needed: a number that is {which}, or {count} of them")
    return numbers


def batch_shape(arrays: Sequence[Array | None], core_axes: Sequence[int]) -> tuple[int, ...]:
    """The shape of the batch: the broadcast of the leading axes of the arrays."""
    leading = list[tuple[int, ...]]()
    for array, axes in zip(arrays, core_axes, strict=True):
        if array is not None:
            leading.append(array.shape[: array.ndim - axes])
    try:
        return np.broadcast_shapes(*leading)
    except ValueError:
        raise InputError("batch", f"leading axes {leading} do not broadcast") from None


def flattened(
    arrays: Sequence[Array | None], core_axes: Sequence[int]
) -> tuple[tuple[int, ...], list[Array | None]]:
    """The shape of the batch, and each array broadcast to it as samples, shape (count, *core).

    The batch is the broadcast of the leading axes; count is its number of samples. The arrays are
    views where NumPy can make them. None stays None.
    """
    batch = batch_shape(arrays, core_axes)
    samples = list[Array | None]()
    for array, axes in zip(arrays, core_axes, strict=True):
        if array is None:
            samples.append(None)
            continue
        core = array.shape[array.ndim - axes :]
        try:
            everywhere = np.broadcast_to(array, batch + core)
            samples.append(everywhere.reshape(math.prod(batch), *core))
        except (MemoryError, ValueError):
            raise InputError("batch", f"{batch} samples do not fit into memory") from None
    return batch, samples


E = TypeVar("E", bound=SSTError)


def of_samples(error: E, at_fault: Flags) -> E:
    """The error with the indices of the samples that failed; unchanged for a single sample."""
    name_samples(error, np.flatnonzero(at_fault).tolist(), at_fault.shape)
    return error


def name_samples(error: SSTError, flat: Sequence[int], batch: tuple[int, ...]) -> None:
    """Add the samples that failed to an error, by their numbers in the flattened batch."""
    if batch:
        indices = zip(*np.unravel_index(flat, batch), strict=True)
        error.name_samples([tuple(map(int, index)) for index in indices], math.prod(batch))


def require_fitting(out: Array | None, shape: tuple[int, ...]) -> None:
    """Check that `out` is a float64 array of a shape that can be written to, or None."""
    if out is None:
        return
    if not isinstance(out, np.ndarray) or out.dtype != _FLOAT64 or not out.flags.writeable:
        raise InputError("out", "not a float64 array that can be written to")
    if _masked(out):
        raise InputError("out", "a masked array; masked entries may not be written")
    if out.shape != shape:
        raise InputError("out", f"shape {out.shape}, expected {shape}")
    strides = zip(shape, out.strides, strict=True)
    if out.size and any(size > 1 and not stride for size, stride in strides):
        raise InputError("out", "entries share memory, as those of numpy.broadcast_to")


def names_matching_any(kind: str, patterns: Iterable[str], known: Sequence[str]) -> list[str]:
    """The known names that match at least one pattern, in their order; see `matching_names`."""
    matches = set[str]()
    for pattern in patterns:
        matches.update(matching_names(kind, pattern, known))
    return [name for name in known if name in matches]


def read_only(array: _Numbers) -> _Numbers:
    """A read-only copy."""
    copy = np.array(array)
    copy.flags.writeable = False
    return copy


def in_one_turn(angles: ArrayLike) -> Array:
    """Angles wrapped to [-pi, pi), [rad]; any shape."""
    return np.asarray((np.asarray(angles) + np.pi) % (2 * np.pi) - np.pi)

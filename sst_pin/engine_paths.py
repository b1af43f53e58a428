# SPDX-License-Identifier: BSD-2-Clause
"""`EnginePaths`: computes a quantity by its compiled kernel or by the reference path."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array, Indices, for_each_sample, require_policy, whole_number
from .dynamics.quantities import Quantity
from .dynamics.reference import Reference
from .engine_arguments import EngineArguments, Wrenches
from .errors import SSTError
from .kernel_protocols import Kernel, Kernels
from .model.mechanism import Mechanism
from .model.tree import frame_id
from .progress import FASTER


class EnginePaths:
    """Computes a quantity of one mechanism for a sample or a batch.

    The two paths are the kernels and the reference path. `without_loads` and `under_loads` take
    these steps, until there is a result:

    1. They ask `Kernel.answer`, with unchecked arguments, because checks take longer than a kernel.
       If the arguments are wrong, or a sample fails a check of the kernel, there is no answer.
    2. They check the arguments. If they are wrong, they raise an error.
    3. For a batch they call `Kernel.many`. A single sample that got no answer in step 1 skips this:
       it would fail the same checks of the kernel.
    4. The reference path computes the samples that are left. It finds the result or raises the
       error.

    The arguments of these methods are:

    - `key`: which quantity it is;
    - `of_sample`: the function of the reference path that computes one sample;
    - `shape`: the shape of the result for one sample;
    - `q`: configurations;
    - `vectors`: the other arguments by their names, in the order of `of_sample`, such as va and aa;
    - loads and options as for `ClosedChain`.

    Args:
        mechanism: The mechanism.
        reference: Its reference path.
        arguments: Checks arguments.
        make_kernels: Makes the kernels at their first use; None to compute by the reference path.
        kernels: What `make_kernels` makes, if it exists already.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        reference: Reference,
        arguments: EngineArguments,
        make_kernels: Callable[[Reference], Kernels] | None,
        kernels: Kernels | None,
    ) -> None:
        self._mechanism = mechanism
        self._reference = reference
        self._arguments = arguments
        self._make_kernels = make_kernels
        if kernels is not None:
            self._kernels_or_reason = kernels  # in place of the cached property

    # --- kernels ----------------------------------------------------------------------------

    @cached_property
    def _kernels_or_reason(self) -> Kernels | str:
        """The kernels, or a text that says why there are none."""
        if self._make_kernels is None:
            return "no kernels yet; compile() makes them"
        try:
            return self._make_kernels(self._reference)
        except SSTError as error:
            return str(error)

    @cached_property
    def kernels(self) -> Kernels | None:
        """The compiled kernels; None where the reference path computes everything."""
        kernels = self._kernels_or_reason
        return None if isinstance(kernels, str) else kernels

    @property
    def backend(self) -> str:
        """A sentence that says which backend is in use, and why."""
        if self.kernels is None:
            return f"the reference path: {self._kernels_or_reason}"
        return str(self.kernels)

    def kernel(self, key: Quantity) -> Kernel | None:
        """The kernel of a quantity; None where the reference path computes it."""
        return None if self.kernels is None else self.kernels.kernel(key)

    # --- quantities -------------------------------------------------------------------------

    def without_loads(
        self,
        key: Quantity,
        of_sample: Callable[..., Array],
        shape: tuple[int, ...],
        q: ArrayLike,
        vectors: Mapping[str, ArrayLike],
        *,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """A quantity that has no loads; the reference path is `of_sample(q, *vectors)`."""
        require_policy(on_error)
        # Step 1.
        kernel = self.kernel(key)
        unanswered = False
        can_answer = on_error == "raise" and _can_answer(shape, vectors, out)
        if kernel is not None and can_answer:
            answer = _answer(kernel, shape, q, vectors, None, out, threads)
            if answer is not None:
                return answer
            unanswered = True
        # Step 2.
        if key.frame is not None:
            of_sample = partial(of_sample, frame=frame_id(self._mechanism.model, key.frame))
        samples = self._arguments.state(q, **vectors)
        # Steps 3 and 4.
        return self._each_sample(
            of_sample,
            samples,
            [1 for _ in samples],
            shape,
            kernel,
            unanswered=unanswered,
            out=out,
            threads=threads,
            on_error=on_error,
        )

    def under_loads(
        self,
        key: Quantity,
        of_sample: Callable[..., Array],
        shape: tuple[int, ...],
        q: ArrayLike,
        vectors: Mapping[str, ArrayLike],
        *,
        kernel_exists: bool = True,
        ask_kernel: bool = True,
        platform_moment: ArrayLike | None = None,
        external_wrenches: Wrenches | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """A quantity under loads; the reference path is `of_sample(q, *vectors, wrenches)`.

        A quantity has two kernels. The first one takes no wrenches; its `Kernel.answer` takes a
        moment on the platform. The second one (`loaded`) takes wrenches on all bodies.

        `kernel_exists` is False if neither can compute what is asked for, such as torques with
        weights. `ask_kernel` is False if the caller has done step 1 already, without an answer.
        """
        require_policy(on_error)
        # Step 1, with the first kernel, if there are no wrenches.
        kernel = None
        if kernel_exists and external_wrenches is None:
            kernel = self.kernel(key)
        unanswered = not ask_kernel
        can_answer = on_error == "raise" and _can_answer(shape, vectors, out)
        if kernel is not None and ask_kernel and can_answer:
            answer = _answer(kernel, shape, q, vectors, platform_moment, out, threads)
            if answer is not None:
                return answer
            unanswered = True
        # Step 2. From here on, a moment on the platform is one of the wrenches on all bodies.
        wrenches = self._arguments.wrenches(platform_moment, external_wrenches, on_error, q)
        state = self._arguments.state(q, **vectors)
        axes = [1 for _ in state]
        axes.append(2)  # of the wrenches
        # Steps 3 and 4. `Kernel.many` of the first kernel takes no moment on the platform, so that
        # the second kernel gets all loads. A sample that the first one did not answer would fail
        # the same checks in the second one: loops closed, pivots sound, numbers finite.
        if kernel_exists and wrenches is not None:
            kernel = self.kernel(key._replace(loaded=True))
        return self._each_sample(
            of_sample,
            [*state, wrenches],
            axes,
            shape,
            kernel,
            unanswered=unanswered,
            out=out,
            threads=threads,
            on_error=on_error,
        )

    def _each_sample(
        self,
        of_sample: Callable[..., Array],
        samples: Sequence[Array | None],
        axes: Sequence[int],
        shape: tuple[int, ...],
        kernel: Kernel | None,
        *,
        unanswered: bool,
        out: Array | None,
        threads: int,
        on_error: str,
    ) -> Array:
        """Results for checked arrays, by steps 3 and 4.

        Args:
            of_sample: The reference path; its arguments are a sample of each of `samples`.
            samples: Arrays with a sample or a batch, None for no loads.
            axes: Number of axes of one sample, for each of `samples`.
            shape: Shape of the result of one sample.
            kernel: The kernel, None if there is none.
            unanswered: Whether step 1 was done, and gave no answer.
            out: Array for the results, or None.
            threads: Number of threads of `Kernel.many`.
            on_error: "raise" or "nan", for samples that fail.
        """
        threads = whole_number("threads", threads, 1)
        is_single = all(
            array is None or array.ndim == count for array, count in zip(samples, axes, strict=True)
        )
        # A single sample that got no answer would fail the same checks in `Kernel.many`, so that
        # step 3 is skipped. There is one exception: `Kernel.answer` gives no answer if `out` shares
        # memory with an argument, without a look at the sample. `Kernel.many` may compute this
        # sample, because `for_each_sample` gives it another array, and copies the result to `out`.
        if is_single and unanswered and not _shares_memory(out, samples):
            kernel = None
        if is_single and kernel is None and out is None and on_error == "raise":
            return of_sample(*samples)
        hint = ""
        if self._make_kernels is None:
            hint = f"computing on the slow reference path; {FASTER}"
        fill = None
        if kernel is not None:
            # A Python integer may be too large for the integer in C that a kernel takes.
            fill = partial(_fill, kernel, min(threads, sys.maxsize))
        return for_each_sample(
            of_sample, samples, axes, shape, on_error=on_error, out=out, fast=fill, hint=hint
        )


def _can_answer(
    shape: tuple[int, ...], vectors: Mapping[str, ArrayLike], out: Array | None
) -> bool:
    """Whether `Kernel.answer` can be asked.

    It takes at most two vectors besides q. It gives a matrix as a row of its entries, and so cannot
    write matrices into `out`.
    """
    is_matrix = len(shape) > 1
    return len(vectors) <= 2 and not (is_matrix and out is not None)


def _answer(
    kernel: Kernel,
    shape: tuple[int, ...],
    q: ArrayLike,
    vectors: Mapping[str, ArrayLike],
    moment: ArrayLike | None,
    out: Array | None,
    threads: int,
) -> Array | None:
    """The result of `Kernel.answer` in the shape of the quantity, or None.

    Args:
        kernel: The kernel.
        shape: Shape of the result of one sample.
        q: Configurations.
        vectors: The other arguments, by their names, at most two.
        moment: The moment on the platform, the only load that `Kernel.answer` takes.
        out: As for `ClosedChain`.
        threads: As for `ClosedChain`.
    """
    second, third, *_ = (*vectors.values(), None, None)  # None for a vector that is not there
    result = kernel.answer(q, second, third, moment, out, threads)
    if len(shape) > 1 and result is not None:
        result = result.reshape(*result.shape[:-1], *shape)
    return result


def _shares_memory(out: object, samples: Sequence[Array | None]) -> bool:
    """Whether `out` may share memory with an argument; `Kernel.answer` gives no answer then."""
    return isinstance(out, np.ndarray) and any(
        array is not None and np.may_share_memory(array, out) for array in samples
    )


def _fill(kernel: Kernel, threads: int, flat: list[Array | None], result: Array) -> Indices:
    """Fill results, shape (N, size), by a kernel; indices of the samples that it leaves.

    `flat` are the arguments of N samples, shape (N, ...), None for no wrenches.
    """
    arguments = []
    for array in flat:
        if array is not None:
            size = int(np.prod(array.shape[1:]))  # of one sample
            arguments.append(np.require(array, float, "A").reshape(len(result), size))
    return kernel.many(tuple(arguments), result, threads)

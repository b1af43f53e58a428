# SPDX-License-Identifier: BSD-2-Clause
# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False
"""Compiled kernels for NumPy: float64 rows in, float64 rows out, nothing else."""

cimport cython
cimport numpy as cnp
from libc.stddef cimport ptrdiff_t
from cpython.long cimport PyLong_AsLongAndOverflow
from cpython.mem cimport PyMem_RawCalloc, PyMem_RawFree, PyMem_RawMalloc
from libc.stdint cimport uintptr_t
from libc.string cimport memset

import numpy as np

cnp.import_array()

cdef extern from *:
    """
    static const char *const sources = SOURCES;
    static const char *instructions(void)
    {
    #if defined(__x86_64__)
        __builtin_cpu_init();
        if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
            return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")
                && __builtin_cpu_supports("avx512vl") ? "avx512" : "avx2";
    #endif
        return "plain";
    }
    """
    const char *sources
    const char *instructions()

cdef extern from "batches.h":
    ctypedef struct rows:
        char *data
        ptrdiff_t row
        ptrdiff_t column
    ctypedef struct courses:
        rows at
        ptrdiff_t step
    ctypedef int (*run_function)(
        const rows *, const rows *, const double *, ptrdiff_t, unsigned char *
    ) noexcept nogil
    ctypedef int (*roll_function)(
        const rows *, const courses *, ptrdiff_t, const courses *, const double *, double,
        ptrdiff_t, ptrdiff_t, ptrdiff_t *
    ) noexcept nogil
    bint run_shared(
        run_function, int, const rows *, const rows *, const double *, ptrdiff_t, unsigned char *,
        ptrdiff_t, ptrdiff_t
    ) noexcept nogil
    void roll_shared(
        roll_function, const rows *, const courses *, ptrdiff_t, const courses *, const double *,
        double, ptrdiff_t, ptrdiff_t, ptrdiff_t *, ptrdiff_t, ptrdiff_t
    ) noexcept nogil

cdef enum:
    MOST_ARRAYS = 5  # inputs of a kernel
    FEW = 64  # flags of so many samples, or loads made from moments, take no large memory

#: What the processor offers: "avx512", "avx2" or "plain".
INSTRUCTIONS = instructions().decode()
#: The hash of the sources when this module was compiled.
SOURCES = sources.decode()


cdef inline bint is_plain(object array, int ndim, Py_ssize_t size):
    """Whether it is an aligned float64 array of this many axes, the last of this size."""
    return (
        type(array) is cnp.ndarray
        and cnp.PyArray_TYPE(<cnp.ndarray>array) == cnp.NPY_DOUBLE
        and cnp.PyArray_ISBEHAVED_RO(<cnp.ndarray>array)
        and cnp.PyArray_NDIM(<cnp.ndarray>array) == ndim
        and cnp.PyArray_DIM(<cnp.ndarray>array, ndim - 1) == size
    )


cdef object as_floats(object argument):
    """Python's numbers in a list, or an array of other real numbers, as float64.

    Anything else is returned as it is.
    """
    if type(argument) is list or type(argument) is tuple:
        for x in argument:
            if not isinstance(x, float) and type(x) is not int:
                return argument
    elif type(argument) is not cnp.ndarray:
        return argument
    elif argument.dtype.kind not in "iuf" or argument.dtype.char == "d":
        return argument
    try:
        return np.array(argument, dtype=np.float64)
    except OverflowError:  # a whole number that is too large
        return argument


cdef inline Py_ssize_t number_of(object threads):
    """Number of threads; 0 if the argument is not a positive integer."""
    cdef int overflow = 0
    cdef Py_ssize_t number
    if type(threads) is not int:
        return 0
    number = PyLong_AsLongAndOverflow(threads, &overflow)
    if overflow > 0:  # a huge number of threads is allowed: there are never more than are useful
        return 1 << 40
    return max(number, 0)


cdef rows rows_of(cnp.ndarray array):
    """A 2-D array with a row for each sample, or a 1-D one, the row of all samples."""
    cdef rows result
    cdef int ndim = cnp.PyArray_NDIM(array)
    result.data = cnp.PyArray_BYTES(array)
    result.row = cnp.PyArray_STRIDE(array, 0) if ndim > 1 else 0
    result.column = cnp.PyArray_STRIDE(array, ndim - 1)
    return result


cdef bint overlap(const rows *a, int size_a, const rows *b, int size_b, Py_ssize_t count) noexcept:
    """Whether two arrays may share memory: results would then overwrite inputs."""
    cdef char *low_a
    cdef char *high_a
    cdef char *low_b
    cdef char *high_b
    low_a, high_a = bounds(a, size_a, count)
    low_b, high_b = bounds(b, size_b, count)
    return low_a <= high_b and low_b <= high_a


cdef inline (char *, char *) bounds(const rows *x, int size, Py_ssize_t count) noexcept:
    """First and last number of an array."""
    cdef ptrdiff_t down = (count - 1) * x.row if count > 0 else 0
    cdef ptrdiff_t across = (size - 1) * x.column
    return x.data + min(down, 0) + min(across, 0), x.data + max(down, 0) + max(across, 0)


@cython.final
cdef class Kernel:
    """A compiled function of rows of numbers.

    Args:
        single: Address of the code for one sample.
        batch: Address of the code for batches.
        sizes: Numbers of a sample in each input.
        output: Numbers of a sample in the output.
        parameters: Run-time parameters; a copy is kept.
        library: Kept alive with the kernel.
        loaded: Returns the kernel with external loads, or None.
        batch_parameters: Those of `batch`, if they differ from those of `single`.
        moment: Index in the load of three numbers that can be given alone; -1 for none.
    """

    cdef run_function single, batch
    cdef int arrays, output, moment
    cdef int sizes[MOST_ARRAYS]
    cdef cnp.ndarray parameters, batch_parameters
    cdef object library, loaded

    def __cinit__(
        self, uintptr_t single, uintptr_t batch, tuple sizes, int output,
        cnp.ndarray parameters not None, library, loaded=None, batch_parameters=None, int moment=-1,
    ):
        if len(sizes) > MOST_ARRAYS or not single or not batch:
            raise ValueError("no such kernel")
        self.single, self.batch = <run_function>single, <run_function>batch
        self.arrays, self.output, self.moment = len(sizes), output, moment
        for i in range(self.arrays):
            self.sizes[i] = sizes[i]
        self.parameters = np.array(parameters, dtype=np.float64, order="C")
        self.library, self.loaded = library, loaded
        self.batch_parameters = self.parameters
        if batch_parameters is not None:
            self.batch_parameters = np.array(batch_parameters, dtype=np.float64, order="C")

    def answer(self, a, b, c, load, out, threads):
        """The result, or None if the caller has to check the arguments and compute it itself.

        The kernel's inputs are the first of a, b, c, shape (size,) or (N, size); the others must be
        None. With a load, a moment on the body that bears one, shape (3,) or (N, 3), the kernel
        `loaded` computes the result. The result is None if an input is not an array of numbers, or
        a list, of such a shape, if `threads` is not a positive integer, if `out` is not a plain
        array or overlaps an input, or if a sample fails its checks.
        """
        cdef Kernel kernel = self
        if load is not None and self.arrays < 4:
            if callable(self.loaded):
                self.loaded = self.loaded()
            kernel = self.loaded
            if kernel is None:
                return None
        return kernel.compute(a, b, c, load, out, threads)

    def derivatives(self, kind, a, b, c, threads):
        """Derivatives by a, b and c, as many rows as b, or None where `answer` is None.

        Args:
            kind: The named tuple that they make, shapes (..., n, n), (..., n, n), (..., n, m).
        """
        cdef cnp.npy_intp shape[3]
        cdef cnp.npy_intp strides[3]
        cdef cnp.ndarray rows, part
        cdef int ndim, columns = 2 * self.sizes[1] + self.sizes[2], width, i
        cdef char *at
        if self.arrays != 3 or columns * self.sizes[1] != self.output:
            raise TypeError("no kernel of derivatives")
        result = self.compute(a, b, c, None, None, threads)
        if result is None:
            return None
        rows = result
        ndim, at = cnp.PyArray_NDIM(rows), cnp.PyArray_BYTES(rows)
        shape[0] = cnp.PyArray_DIM(rows, 0)
        strides[0], strides[ndim] = self.output * sizeof(double), sizeof(double)
        strides[ndim - 1] = columns * sizeof(double)
        shape[ndim - 1] = self.sizes[1]
        parts = []
        for i in range(3):
            width = shape[ndim] = self.sizes[max(i, 1)]
            part = cnp.PyArray_New(
                cnp.ndarray, ndim + 1, shape, cnp.NPY_DOUBLE, strides, at, 0,
                cnp.NPY_ARRAY_WRITEABLE, None,
            )
            cnp.set_array_base(part, rows)
            parts.append(part)
            at += width * sizeof(double)
        return tuple.__new__(kind, parts)

    cdef compute(self, a, b, c, load, out, threads):
        """`answer` by this kernel; arguments are converted only if they are no plain arrays."""
        result = self.compute_plain(a, b, c, load, out, threads)
        if result is not None:
            return result
        floats_a, floats_b, floats_c = as_floats(a), as_floats(b), as_floats(c)
        if floats_a is a and floats_b is b and floats_c is c:
            return None
        return self.compute_plain(floats_a, floats_b, floats_c, load, out, threads)

    cdef compute_plain(self, a, b, c, load, out, threads):
        """`compute` for plain float64 arrays; None for others."""
        cdef rows inputs[4]
        cdef rows output
        cdef cnp.npy_intp shape[2]
        cdef Py_ssize_t count = -1  # one sample, until an array with more is taken
        cdef bint moment = load is not None
        cdef Py_ssize_t number = number_of(threads)
        cdef int i, size
        if (
            self.arrays > 4 or not number or (moment and self.moment < 0)
            or not self.take(a, 0, self.sizes[0], inputs, &count)
            or not self.take(b, 1, self.sizes[1], inputs, &count)
            or not self.take(c, 2, self.sizes[2], inputs, &count)
            or not self.take(load, 3, 3, inputs, &count)
        ):
            return None
        shape[0], shape[1] = count, self.output
        if out is None:
            if count < 0:
                out = cnp.PyArray_SimpleNew(1, shape + 1, cnp.NPY_DOUBLE)
            else:
                try:
                    out = cnp.PyArray_SimpleNew(2, shape, cnp.NPY_DOUBLE)
                except MemoryError:
                    return None  # the caller raises the error
        elif (
            not is_plain(out, 1 if count < 0 else 2, self.output)
            or not cnp.PyArray_ISWRITEABLE(<cnp.ndarray>out)
            or (count >= 0 and cnp.PyArray_DIM(<cnp.ndarray>out, 0) != count)
        ):
            return None
        output = rows_of(<cnp.ndarray>out)
        if (count > 1 and not output.row) or (self.output > 1 and not output.column):
            return None  # its samples, or entries, are one in memory
        for i in range(self.arrays):
            size = 3 if moment and i == 3 else self.sizes[i]
            if overlap(&inputs[i], size, &output, self.output, count):
                return None
        if moment:
            return out if self.run_with_moment(inputs, &output, count) else None
        return out if self.run(inputs, &output, count, number) else None

    cdef inline bint run(
        self, const rows *inputs, const rows *output, Py_ssize_t count, Py_ssize_t threads
    ) noexcept:
        """Whether all samples pass their checks; a count of -1 is one sample."""
        cdef unsigned char few[FEW]
        cdef unsigned char *flags = few
        cdef const double *parameters = numbers_of(self.batch_parameters)
        cdef bint any_bad
        if count < 0:
            return not self.single(inputs, output, numbers_of(self.parameters), 1, few)
        if count > FEW:
            flags = <unsigned char *>PyMem_RawMalloc(count)
            if not flags:
                return False
        with nogil:
            any_bad = run_shared(
                self.batch, self.arrays, inputs, output, parameters, count, flags, self.numbers(),
                threads,
            )
        if flags != few:
            PyMem_RawFree(flags)
        return not any_bad

    cdef inline ptrdiff_t numbers(self) noexcept nogil:
        """Number of inputs and outputs of a sample."""
        cdef ptrdiff_t result = self.output
        for i in range(self.arrays):
            result += self.sizes[i]
        return result

    cdef bint run_with_moment(self, rows *inputs, rows *output, Py_ssize_t count) noexcept:
        """`run` with moments, shape (3,) each, as the last input.

        The loads, in which each moment is three entries and all others are zero, are made for some
        samples at a time. `inputs` and `output` are moved on.
        """
        cdef rows moments = inputs[3]
        cdef int size = self.sizes[3]
        cdef Py_ssize_t first = 0, some = 1 if count < 0 else min(count, <Py_ssize_t>FEW), k
        cdef int i
        cdef double *loads = <double *>PyMem_RawCalloc(max(some, 1) * size, sizeof(double))
        cdef bint good = loads != NULL
        inputs[3].data = <char *>loads
        inputs[3].row, inputs[3].column = size * sizeof(double), sizeof(double)
        while good and first < abs(count):
            some = min(some, abs(count) - first)
            for k in range(some):
                for i in range(3):
                    loads[k * size + self.moment + i] = (
                        <double *>(moments.data + (first + k) * moments.row + i * moments.column)
                    )[0]
            good = self.run(inputs, output, -1 if count < 0 else some, 1)
            first += some
            for i in range(3):
                inputs[i].data += some * inputs[i].row
            output.data += some * output.row
        PyMem_RawFree(loads)
        return good

    cdef inline bint take(self, object array, int i, int size, rows *inputs, Py_ssize_t *count):
        """Whether argument i has this size; then inputs[i] and, of a batch, the count are set."""
        cdef Py_ssize_t samples
        if i >= self.arrays:
            return array is None
        if not is_plain(array, 1, size):
            if not is_plain(array, 2, size):
                return False
            samples = cnp.PyArray_DIM(<cnp.ndarray>array, 0)
            if count[0] >= 0 and samples != count[0]:
                return False
            count[0] = samples
        inputs[i] = rows_of(<cnp.ndarray>array)
        return True

    def many(self, tuple arrays not None, cnp.ndarray out not None, Py_ssize_t threads=1):
        """Fill `out` and return the indices of the samples that fail their checks.

        Args:
            arrays: float64, of shape (N, size), (size,) for all samples, or None for zeros.
            out: float64, shape (N, output), which shares no memory with the inputs.
            threads: Number of threads.

        Raises:
            TypeError, ValueError: For anything else.
        """
        cdef rows inputs[MOST_ARRAYS]
        cdef rows output
        cdef cnp.ndarray bad
        cdef cnp.ndarray parameters
        cdef const double *p
        cdef unsigned char *flags
        cdef Py_ssize_t count
        cdef run_function run
        cdef int i, any_bad
        if len(arrays) != self.arrays:
            raise TypeError(f"{len(arrays)} arrays, {self.arrays} are needed")
        if not is_plain(out, 2, self.output) or not cnp.PyArray_ISWRITEABLE(out):
            raise TypeError("out is not a float64 array of rows that can be written to")
        count = cnp.PyArray_DIM(out, 0)
        for i in range(self.arrays):
            array = arrays[i]
            if array is None:
                memset(&inputs[i], 0, sizeof(rows))
            elif is_plain(array, 1, self.sizes[i]) or (
                is_plain(array, 2, self.sizes[i])
                and cnp.PyArray_DIM(<cnp.ndarray>array, 0) == count
            ):
                inputs[i] = rows_of(<cnp.ndarray>array)
            else:
                raise TypeError(f"array {i} is not float64 of shape ({count}, {self.sizes[i]})")
        bad = np.zeros(max(count, 1), dtype=np.uint8)
        output = rows_of(out)
        if count > 1:
            run, parameters = self.batch, self.batch_parameters
        else:
            run, parameters = self.single, self.parameters
        p = numbers_of(parameters)
        flags = <unsigned char *>cnp.PyArray_DATA(bad)
        with nogil:
            any_bad = run_shared(
                run, self.arrays, inputs, &output, p, count, flags, self.numbers(), threads
            )
        return np.flatnonzero(bad) if any_bad else np.empty(0, dtype=np.intp)


@cython.final
cdef class RolloutKernel:
    """A compiled rollout: many states with a fixed step.

    Args:
        code: Address of the code.
        sizes: Numbers in q, va, tau and in the load.
        parameters: Run-time parameters; a copy is kept.
        library: Kept alive with the kernel.
    """

    cdef roll_function code
    cdef int sizes[4]
    cdef cnp.ndarray parameters
    cdef object library

    def __cinit__(self, uintptr_t code, tuple sizes, parameters, library):
        if len(sizes) != 4 or not code:
            raise ValueError("no such kernel")
        self.code = <roll_function>code
        for i in range(4):
            self.sizes[i] = sizes[i]
        self.parameters = np.array(parameters, dtype=np.float64, order="C")
        self.library = library

    def run(
        self, double step, cnp.ndarray q0 not None, cnp.ndarray va0 not None,
        cnp.ndarray tau not None, cnp.ndarray load, cnp.ndarray q not None,
        cnp.ndarray va not None, cnp.ndarray verdicts not None, Py_ssize_t threads=1,
    ):
        """Fill the states and return the number of valid states of each sample, shape (N,).

        Args:
            step: Time step, [s].
            q0: Shape (N, nq).
            va0: Shape (N, n).
            tau: Shape (N, steps, motors), held over each step, or (N, 2 steps + 1, motors).
            load: Shape (N, size), or None.
            q: Shape (N, steps + 1, nq), to be filled; NaN for states that fail their checks.
            va: Shape (N, steps + 1, n), filled in the same way.
            verdicts: Shape (N, steps + 1, 2), filled in the same way: det Phi_u without units, and
                1 where it changes little in the step from there, else 0.
            threads: Number of threads.

        Raises:
            TypeError: For anything else.
        """
        cdef rows inputs[3]
        cdef courses torques
        cdef courses outputs[3]
        cdef Py_ssize_t count, steps
        cdef ptrdiff_t half = 0  # distance of the torques in the middle of a step, if there are any
        cdef ptrdiff_t numbers = self.sizes[0] + self.sizes[1] + self.sizes[2]
        cdef cnp.ndarray reached
        cdef ptrdiff_t *reached_states
        cdef const double *p
        if cnp.PyArray_NDIM(q0) != 2 or cnp.PyArray_NDIM(q) != 3:
            raise TypeError("q0 has no two axes, or q no three")
        count = cnp.PyArray_DIM(q0, 0)
        steps = cnp.PyArray_DIM(q, 1) - 1
        if not self.fit(count, steps, q0, va0, tau, load, q, va, verdicts):
            raise TypeError("the shapes of the arrays do not match")
        inputs[0] = rows_of(q0)
        inputs[1] = rows_of(va0)
        memset(&inputs[2], 0, sizeof(rows))
        if load is not None:
            inputs[2] = rows_of(load)
        torques = course_of(tau)
        if cnp.PyArray_DIM(tau, 1) != steps:
            half = torques.step
            torques.step = 2 * half
        outputs[0] = course_of(q)
        outputs[1] = course_of(va)
        outputs[2] = course_of(verdicts)
        reached = np.zeros(max(count, 1), dtype=np.intp)
        reached_states = <ptrdiff_t *>cnp.PyArray_DATA(reached)
        p = numbers_of(self.parameters)
        with nogil:
            roll_shared(
                self.code, inputs, &torques, half, outputs, p, step, steps, count, reached_states,
                numbers, threads,
            )
        return reached[:count]

    cdef bint fit(
        self, Py_ssize_t count, Py_ssize_t steps, cnp.ndarray q0, cnp.ndarray va0,
        cnp.ndarray tau, cnp.ndarray load, cnp.ndarray q, cnp.ndarray va, cnp.ndarray verdicts,
    ):
        """Whether the arguments of `run` are plain arrays of `count` motions with these steps."""
        cdef cnp.ndarray result
        if not (
            steps >= 0
            and is_plain(q0, 2, self.sizes[0])
            and is_plain(va0, 2, self.sizes[1])
            and (load is None or is_plain(load, 2, self.sizes[3]))
            and is_plain(tau, 3, self.sizes[2])
            and is_plain(q, 3, self.sizes[0])
            and is_plain(va, 3, self.sizes[1])
            and is_plain(verdicts, 3, 2)
        ):
            return False
        for array in (q0, va0, load, tau, q, va, verdicts):
            if array is not None and array.shape[0] != count:
                return False
        for result in (q, va, verdicts):
            if cnp.PyArray_DIM(result, 1) != steps + 1 or not cnp.PyArray_ISWRITEABLE(result):
                return False
        return cnp.PyArray_DIM(tau, 1) in (steps, 2 * steps + 1)


cdef courses course_of(cnp.ndarray array):
    """An array of the steps of many samples, shape (N, steps, size)."""
    cdef courses result
    result.at.data = cnp.PyArray_BYTES(array)
    result.at.row = cnp.PyArray_STRIDE(array, 0)
    result.at.column = cnp.PyArray_STRIDE(array, 2)
    result.step = cnp.PyArray_STRIDE(array, 1)
    return result


cdef inline const double *numbers_of(cnp.ndarray array) noexcept:
    return <const double *>cnp.PyArray_DATA(array)

# SPDX-License-Identifier: BSD-2-Clause
# cython: language_level=3, boundscheck=False, wraparound=False, initializedcheck=False
"""Compiled kernels for NumPy: float64 arrays in, float64 arrays out, nothing else.

`Kernel` evaluates a function for one sample or many, `RolloutKernel` integrates motions. Both hand
the memory of NumPy's arrays to C, which `batches.h` shares among threads.
"""

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
    ctypedef struct sample_array:
        char *data
        ptrdiff_t sample_stride
        ptrdiff_t number_stride
    ctypedef struct motion_array:
        sample_array at
        ptrdiff_t step_stride
    ctypedef int (*run_function)(
        const sample_array *inputs, const sample_array *output, const double *p, ptrdiff_t count,
        unsigned char *bad
    ) noexcept nogil
    ctypedef int (*roll_function)(
        const sample_array *inputs, const motion_array *tau, ptrdiff_t half,
        const motion_array *states, const double *p, double h, ptrdiff_t steps, ptrdiff_t count,
        ptrdiff_t *reached
    ) noexcept nogil
    bint run_shared(
        run_function run, int arrays, const sample_array *inputs, const sample_array *output,
        const double *p, ptrdiff_t count, unsigned char *bad, ptrdiff_t numbers, ptrdiff_t threads
    ) noexcept nogil
    void roll_shared(
        roll_function roll, const sample_array *inputs, const motion_array *tau, ptrdiff_t half,
        const motion_array *states, const double *p, double h, ptrdiff_t steps, ptrdiff_t count,
        ptrdiff_t *reached, ptrdiff_t numbers, ptrdiff_t threads
    ) noexcept nogil

cdef enum:
    MOST_ARRAYS = 5  # the most inputs of a kernel
    FEW = 64  # flags of up to this number of samples are on the stack; loads are made for as many

#: What the processor offers: "avx512", "avx2" or "plain".
INSTRUCTIONS = instructions().decode()
#: The hash of the sources when this module was compiled.
SOURCES = sources.decode()


cdef inline bint is_plain(object array, int ndim, Py_ssize_t size):
    """Whether the array is aligned float64 with `ndim` axes, the last one of length `size`."""
    return (
        type(array) is cnp.ndarray
        and cnp.PyArray_TYPE(<cnp.ndarray>array) == cnp.NPY_DOUBLE
        and cnp.PyArray_ISBEHAVED_RO(<cnp.ndarray>array)
        and cnp.PyArray_NDIM(<cnp.ndarray>array) == ndim
        and cnp.PyArray_DIM(<cnp.ndarray>array, ndim - 1) == size
    )


cdef object as_floats(object argument):
    """A list of Python's numbers, or an array of other real numbers, as a float64 array.

    Anything else is returned as it is: the caller refuses it.
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


cdef sample_array samples_of(cnp.ndarray array):
    """The samples of an array, shape (N, size), or (size,) if all samples are the same."""
    cdef sample_array result
    cdef int ndim = cnp.PyArray_NDIM(array)
    result.data = cnp.PyArray_BYTES(array)
    result.sample_stride = cnp.PyArray_STRIDE(array, 0) if ndim > 1 else 0
    result.number_stride = cnp.PyArray_STRIDE(array, ndim - 1)
    return result


cdef bint overlap(
    const sample_array *a, int size_a, const sample_array *b, int size_b, Py_ssize_t count
) noexcept:
    """Whether two arrays may share memory: results would then overwrite inputs."""
    cdef char *low_a
    cdef char *high_a
    cdef char *low_b
    cdef char *high_b
    low_a, high_a = bounds(a, size_a, count)
    low_b, high_b = bounds(b, size_b, count)
    return low_a <= high_b and low_b <= high_a


cdef inline (char *, char *) bounds(const sample_array *x, int size, Py_ssize_t count) noexcept:
    """Addresses of the first and the last number of an array in memory; strides can be negative."""
    cdef ptrdiff_t down = (count - 1) * x.sample_stride if count > 0 else 0
    cdef ptrdiff_t across = (size - 1) * x.number_stride
    return x.data + min(down, 0) + min(across, 0), x.data + max(down, 0) + max(across, 0)


@cython.final
cdef class Kernel:
    """A compiled function of arrays of samples.

    Args:
        single: Address of the code for one sample.
        batch: Address of the code for batches.
        sizes: Length of a sample in each input.
        output: Length of a sample in the output.
        parameters: Run-time parameters; a copy is kept.
        library: The loaded library with the code; it is kept alive with the kernel.
        loaded: Returns the kernel of the same quantity with external loads, or None.
        batch_parameters: Run-time parameters of `batch`, if they differ from those of `single`.
        moment: Index in the load of a moment, three numbers, which can be given instead of the
            whole load; -1 if there is none.
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

        The result is None if an argument is not as below, or if a sample fails its checks.

        Args:
            a: First input, shape (size,) or (N, size): an array or a list of numbers.
            b: Second input, in the same way; None if the kernel has only one.
            c: Third input, in the same way; None if the kernel has only two.
            load: The moment that can be given alone, shape (3,) or (N, 3), or None. With a moment,
                the kernel `loaded` computes the result. Its fourth input is the whole load, which
                has the moment and zeros. A kernel with four inputs computes the result itself.
            out: Where the result is written, a float64 array that shares no memory with the inputs;
                None for a new array.
            threads: Number of threads, a positive integer.
        """
        cdef Kernel kernel = self
        if load is not None and self.arrays < 4:
            if callable(self.loaded):
                self.loaded = self.loaded()  # from now on the kernel, or None
            kernel = self.loaded
            if kernel is None:
                return None
        return kernel.compute(a, b, c, load, out, threads)

    def derivatives(self, kind, a, b, c, threads):
        """Derivatives by a, b and c; None where `answer` is None.

        For each sample the kernel computes one matrix, [by a, by b, by c], with n rows, as many as
        b has numbers. The three results are views of it. Derivatives by a, which is q, are along
        the coordinates: they have n columns too.

        Args:
            kind: The named tuple of the derivatives, shapes (..., n, n), (..., n, n), (..., n, m).
            a: q, as in `answer`.
            b: va, shape (..., n).
            c: aa or tau, shape (..., m).
            threads: As in `answer`.
        """
        cdef cnp.npy_intp shape[3]
        cdef cnp.npy_intp strides[3]
        cdef cnp.ndarray matrices, part
        cdef int n = self.sizes[1], m = self.sizes[2], columns = 2 * n + m, ndim, width
        cdef char *first
        if self.arrays != 3 or columns * n != self.output:
            raise TypeError("no kernel of derivatives")
        result = self.compute(a, b, c, None, None, threads)
        if result is None:
            return None
        matrices = result  # shape (output,) or (N, output): the matrices row by row
        ndim, first = cnp.PyArray_NDIM(matrices), cnp.PyArray_BYTES(matrices)
        # The last two axes of a view are rows and columns; a batch has the axis of samples before.
        # For one sample ndim is 1, and the second line overwrites the axis of samples.
        shape[0], strides[0] = cnp.PyArray_DIM(matrices, 0), self.output * sizeof(double)
        shape[ndim - 1], strides[ndim - 1] = n, columns * sizeof(double)
        strides[ndim] = sizeof(double)
        parts = []
        for width in (n, n, m):
            shape[ndim] = width
            part = cnp.PyArray_New(
                cnp.ndarray, ndim + 1, shape, cnp.NPY_DOUBLE, strides, first, 0,
                cnp.NPY_ARRAY_WRITEABLE, None,
            )
            cnp.set_array_base(part, matrices)
            parts.append(part)
            first += width * sizeof(double)
        return tuple.__new__(kind, parts)

    cdef compute(self, a, b, c, load, out, threads):
        """`answer` by this kernel. Arguments that are not float64 arrays are converted."""
        result = self.compute_plain(a, b, c, load, out, threads)
        if result is not None:
            return result
        floats_a, floats_b, floats_c = as_floats(a), as_floats(b), as_floats(c)
        if floats_a is a and floats_b is b and floats_c is c:
            return None
        return self.compute_plain(floats_a, floats_b, floats_c, load, out, threads)

    cdef compute_plain(self, a, b, c, load, out, threads):
        """`compute` for float64 arrays; None for others."""
        cdef sample_array inputs[4]
        cdef sample_array output
        cdef cnp.npy_intp shape[2]
        cdef Py_ssize_t count = -1  # no axis of samples, until an input has one
        cdef bint with_moment = load is not None
        cdef Py_ssize_t thread_count = number_of(threads)
        cdef int i, size
        if (
            self.arrays > 4 or not thread_count or (with_moment and self.moment < 0)
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
        output = samples_of(<cnp.ndarray>out)
        # Samples of `out`, or its entries, must not have the same place in memory.
        if count > 1 and not output.sample_stride:
            return None
        if self.output > 1 and not output.number_stride:
            return None
        for i in range(self.arrays):
            size = 3 if with_moment and i == 3 else self.sizes[i]
            if overlap(&inputs[i], size, &output, self.output, count):
                return None
        if with_moment:
            return out if self.run_with_moment(inputs, &output, count) else None
        return out if self.run(inputs, &output, count, thread_count) else None

    cdef inline bint run(
        self, const sample_array *inputs, const sample_array *output, Py_ssize_t count,
        Py_ssize_t threads,
    ) noexcept:
        """Fill the output; returns whether all samples pass their checks.

        A count of -1 means one sample without an axis of samples.
        """
        cdef unsigned char few[FEW]
        cdef unsigned char *flags = few  # not zeroed: nobody reads which samples fail
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
                self.batch, self.arrays, inputs, output, parameters, count, flags,
                self.numbers_per_sample(), threads,
            )
        if flags != few:
            PyMem_RawFree(flags)
        return not any_bad

    cdef inline ptrdiff_t numbers_per_sample(self) noexcept nogil:
        """Number of inputs and outputs of a sample."""
        cdef ptrdiff_t result = self.output
        for i in range(self.arrays):
            result += self.sizes[i]
        return result

    cdef bint run_with_moment(
        self, sample_array *inputs, sample_array *output, Py_ssize_t count
    ) noexcept:
        """`run` with moments instead of loads, inputs[3], shape (3,) each.

        In a load, three entries are the moment and all others are zero. Loads are made for some
        samples at a time: `inputs` and `output` then begin at the first of these.
        """
        cdef sample_array moments = inputs[3]
        cdef int size = self.sizes[3]
        cdef Py_ssize_t first = 0, some = 1 if count < 0 else min(count, <Py_ssize_t>FEW), k
        cdef int i
        cdef double *loads = <double *>PyMem_RawCalloc(max(some, 1) * size, sizeof(double))
        cdef char *moment
        cdef double *entry
        cdef bint good = loads != NULL
        inputs[3].data = <char *>loads
        inputs[3].sample_stride, inputs[3].number_stride = size * sizeof(double), sizeof(double)
        while good and first < abs(count):
            some = min(some, abs(count) - first)
            for k in range(some):
                moment = moments.data + (first + k) * moments.sample_stride
                for i in range(3):
                    entry = <double *>(moment + i * moments.number_stride)
                    loads[k * size + self.moment + i] = entry[0]
            good = self.run(inputs, output, -1 if count < 0 else some, 1)
            first += some
            for i in range(3):
                inputs[i].data += some * inputs[i].sample_stride
            output.data += some * output.sample_stride
        PyMem_RawFree(loads)
        return good

    cdef inline bint take(
        self, object array, int i, int size, sample_array *inputs, Py_ssize_t *count
    ):
        """Take an argument as inputs[i]; returns whether its shape is (size,) or (N, size).

        N must be the count of the arguments before; it becomes the count if they have none. An
        argument beyond the inputs of the kernel must be None.
        """
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
        inputs[i] = samples_of(<cnp.ndarray>array)
        return True

    def many(self, tuple arrays not None, cnp.ndarray out not None, Py_ssize_t threads=1):
        """Fill `out` and return the indices of the samples that fail their checks.

        Args:
            arrays: The inputs, each a float64 array of shape (N, size); of shape (size,) if it is
                the same for all samples; or None for zeros.
            out: float64, shape (N, output), which shares no memory with the inputs.
            threads: Number of threads.

        Raises:
            TypeError: If an argument has another type or shape.
        """
        cdef sample_array inputs[MOST_ARRAYS]
        cdef sample_array output
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
            raise TypeError(f"out is not a writeable float64 array of shape (N, {self.output})")
        count = cnp.PyArray_DIM(out, 0)
        for i in range(self.arrays):
            array = arrays[i]
            if array is None:
                memset(&inputs[i], 0, sizeof(sample_array))
            elif is_plain(array, 1, self.sizes[i]) or (
                is_plain(array, 2, self.sizes[i])
                and cnp.PyArray_DIM(<cnp.ndarray>array, 0) == count
            ):
                inputs[i] = samples_of(<cnp.ndarray>array)
            else:
                raise TypeError(f"array {i} is not float64 of shape ({count}, {self.sizes[i]})")
        bad = np.zeros(max(count, 1), dtype=np.uint8)
        output = samples_of(out)
        if count > 1:
            run, parameters = self.batch, self.batch_parameters
        else:
            run, parameters = self.single, self.parameters
        p = numbers_of(parameters)
        flags = <unsigned char *>cnp.PyArray_DATA(bad)
        with nogil:
            any_bad = run_shared(
                run, self.arrays, inputs, &output, p, count, flags, self.numbers_per_sample(),
                threads,
            )
        return np.flatnonzero(bad) if any_bad else np.empty(0, dtype=np.intp)


@cython.final
cdef class RolloutKernel:
    """A compiled rollout: it integrates motions with steps of one length.

    Args:
        code: Address of the code.
        sizes: Lengths of q, va, tau and of the load.
        parameters: Run-time parameters; a copy is kept.
        library: The loaded library with the code; it is kept alive with the kernel.
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
        """Fill the states and return the number of valid states of each motion, shape (N,).

        Args:
            step: Time step, [s].
            q0: Configurations at the start, shape (N, nq).
            va0: Rates of the coordinates at the start, shape (N, n).
            tau: Torques: constant in each step, shape (N, steps, motors), or at the beginning and
                in the middle of each step and at the end, shape (N, 2 steps + 1, motors).
            load: Constant external loads, shape (N, size), or None.
            q: Filled with the configurations, shape (N, steps + 1, nq). States from the first
                invalid one on are NaN.
            va: Filled with the rates in the same way, shape (N, steps + 1, n).
            verdicts: Filled in the same way, shape (N, steps + 1, 2): det Phi_u without units, and
                1 where the step from this state is sound, else 0. c/driver.h says what is sound.
            threads: Number of threads.

        Raises:
            TypeError: If an argument has another type or shape.
        """
        cdef sample_array inputs[3]
        cdef motion_array torques
        cdef motion_array outputs[3]
        cdef Py_ssize_t count, steps
        cdef ptrdiff_t half = 0  # bytes from the torques at the beginning of a step to its middle
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
        inputs[0] = samples_of(q0)
        inputs[1] = samples_of(va0)
        memset(&inputs[2], 0, sizeof(sample_array))
        if load is not None:
            inputs[2] = samples_of(load)
        torques = motions_of(tau)
        if cnp.PyArray_DIM(tau, 1) != steps:  # two samples for each step
            half = torques.step_stride
            torques.step_stride = 2 * half
        outputs[0] = motions_of(q)
        outputs[1] = motions_of(va)
        outputs[2] = motions_of(verdicts)
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
        """Whether the arguments of `run` are float64 arrays of `count` motions of `steps` steps."""
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


cdef motion_array motions_of(cnp.ndarray array):
    """The samples of many motions, shape (N, steps, size)."""
    cdef motion_array result
    result.at.data = cnp.PyArray_BYTES(array)
    result.at.sample_stride = cnp.PyArray_STRIDE(array, 0)
    result.at.number_stride = cnp.PyArray_STRIDE(array, 2)
    result.step_stride = cnp.PyArray_STRIDE(array, 1)
    return result


cdef inline const double *numbers_of(cnp.ndarray array) noexcept:
    return <const double *>cnp.PyArray_DATA(array)

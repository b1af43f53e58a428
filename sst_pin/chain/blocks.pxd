# SPDX-License-Identifier: BSD-2-Clause
# cython: language_level=3
"""Types by which Cython compiles `blocks.py`."""

cimport cython

cdef extern from *:
    """
    const char made_of[] = MADE_OF;  /* the hash of the sources when they were compiled */
    """

cdef class Block:
    cdef readonly object dependent
    cdef readonly double largest, smallest
    cdef Py_ssize_t[::1] _rows, _dependent, _coordinates, _numbers, _order
    cdef double[::1] _row_scale, _rate_scale, _diagonal, _factors, _squares, _products
    cdef double[::1] _L, _A, _B, _b

    @cython.locals(A=double[::1], B=double[::1], squares=double[::1], scale=double[::1], x=double,
                   factor=double, row=Py_ssize_t, at=Py_ssize_t, i=Py_ssize_t, j=Py_ssize_t,
                   k=Py_ssize_t, m=Py_ssize_t, d=Py_ssize_t, n=Py_ssize_t)
    cdef void factorise(self, const double[:, ::1] Phi) noexcept
    @cython.locals(A=double[::1], squares=double[::1], order=Py_ssize_t[::1], p=Py_ssize_t,
                   at=Py_ssize_t, i=Py_ssize_t, j=Py_ssize_t, d=Py_ssize_t)
    cdef void _bring_largest_to(self, Py_ssize_t k) noexcept
    @cython.locals(A=double[::1], w=double[::1], squares=double[::1], length=double, x=double,
                   u=double, factor=double, pivot=double, row=Py_ssize_t, at=Py_ssize_t,
                   i=Py_ssize_t, j=Py_ssize_t, m=Py_ssize_t, d=Py_ssize_t)
    cdef void _reflect(self, Py_ssize_t k) noexcept
    @cython.locals(A=double[::1], w=double[::1], u=double, row=Py_ssize_t, at=Py_ssize_t,
                   i=Py_ssize_t, j=Py_ssize_t, k=Py_ssize_t, m=Py_ssize_t, d=Py_ssize_t)
    cdef void _solve(self, double[::1] B, Py_ssize_t n) noexcept
    @cython.locals(b=double[::1], i=Py_ssize_t, k=Py_ssize_t, at=Py_ssize_t)
    cdef void add_solution(self, const double[:] c, double sign, double[:] x) noexcept
    @cython.locals(i=Py_ssize_t, j=Py_ssize_t, n=Py_ssize_t)
    cdef void write_L(self, double[:, ::1] L) noexcept
    @cython.locals(s=double, i=Py_ssize_t, j=Py_ssize_t, n=Py_ssize_t)
    cdef void follow(self, const double[:] a, double[:] x) noexcept
    @cython.locals(s=double, i=Py_ssize_t, j=Py_ssize_t, n=Py_ssize_t)
    cdef void reduce(self, const double[:] x, double[::1] a) noexcept

cdef class Blocks:
    cdef readonly list blocks
    cdef readonly double least
    cdef Py_ssize_t[::1] _coordinates
    cdef Py_ssize_t _nv

    @cython.locals(block=Block, sound=bint)
    cpdef bint decompose(self, const double[:, ::1] Phi, double tolerance) except *
    @cython.locals(block=Block, k=Py_ssize_t)
    cdef void _write_L(self, double[:, ::1] L) except *
    @cython.locals(block=Block, k=Py_ssize_t)
    cdef void _follow(self, const double[:] a, double[:] x) except *
    @cython.locals(block=Block)
    cdef void _add_solution(self, const double[:] c, double sign, double[:] x) except *
    @cython.locals(block=Block, k=Py_ssize_t)
    cdef void _reduce(self, const double[:] x, double[::1] a) except *

# SPDX-License-Identifier: BSD-2-Clause
# cython: language_level=3
"""Types by which Cython compiles `closure_kinds.py`."""

cimport cython

cdef extern from *:
    """
    const char made_of[] = MADE_OF;  /* the hash of the sources when they were compiled */
    """

ctypedef (double, double, double, double) number
ctypedef (number, number, number) vector

cdef number times(number a, number b) noexcept
cdef number minus(number a, number b) noexcept
cdef vector difference(vector a, vector b) noexcept
cdef vector along(vector a, number s) noexcept
@cython.locals(x=number, y=number, z=number)
cdef number dot(vector a, vector b) noexcept
cdef vector cross(vector a, vector b) noexcept
@cython.locals(square=number, s=double, f=double, f_1=double, f_2=double, mixed=double)
cdef vector unit(vector a) noexcept
@cython.locals(x=double, y=double, z=double)
cdef vector world_axis(int k) noexcept

cdef vector vector_at(double[:, :, ::1] x, int k) noexcept
cdef void put_vector(double[:, :, :, :] W, int side, int row, int i, vector u) noexcept
cdef void put_number(double[:, :, :, :] W, int side, int row, int i, number x) noexcept

cdef class Frame:
    cdef object _data
    cdef readonly object index, placement, parts, columns, rates
    cdef double[:, :, ::1] _parts
    cdef double[::1] twist, acceleration
    cdef double[:] _p, _joint_p, _v, _a
    cdef double[:, :] _R, _joint_R

    @cython.locals(i=int, k=int)
    cpdef void place(self) except *
    @cython.locals(i=int, j=int, k=int, m=int, x=double[:, :, ::1], t=double[::1])
    cpdef void move(self) except *
    @cython.locals(i=int, j=int, m=int, p=double[:], R=double[:, :])
    cdef void _to_world(self, double[:] of_joint, double[::1] x) noexcept
    cdef vector origin(self) noexcept
    cdef vector axis(self, int k) noexcept

cdef class Moved:
    cdef Py_ssize_t[::1] columns, rates

cdef class Pair:
    cdef readonly Frame B, A
    cdef readonly object at, rates
    cdef Moved _of_B, _of_A
    cdef Py_ssize_t[::1] _rates
    cdef object _numbers
    cdef Py_ssize_t _first
    cdef double[:, :, :, :] _W
    cdef double[:] _f, _drift

    cdef void residual(self) except *
    cpdef void wrenches(self) except *
    @cython.locals(moved=Moved, sign=double, x=double, side=int, i=int, k=Py_ssize_t,
                   n=Py_ssize_t, column=Py_ssize_t)
    cdef void product(self, int part, double[:, ::1] J, double[:, ::1] Phi) except *
    @cython.locals(W=double[:, :, :, :], drift=double[:], B=Frame, A=Frame, i=int, k=int)
    cdef void drift(self) except *
    cdef void _hold_velocity(self, int row, vector u, vector of_b, vector of_a) noexcept
    cdef void _hold_turn(self, int row, vector u) noexcept

cdef class Weld(Pair):
    @cython.locals(screw=double[:])
    cdef void residual(self) except *

cdef class Point(Pair):
    @cython.locals(d=vector, f=double[:])
    cdef void residual(self) except *
    @cython.locals(k=int)
    cpdef void wrenches(self) except *

cdef class Mask(Pair):
    cdef readonly list slides, angles
    cdef readonly bint orientation
    cdef int _along

    @cython.locals(B=Frame, A=Frame, f=double[:], d=vector, i=int, j=int, k=int, row=int,
                   first=int, sign=double, size=double, turn=double[:])
    cdef void residual(self) except *
    @cython.locals(B=Frame, A=Frame, i=int, j=int, k=int, row=int, sign=double)
    cpdef void wrenches(self) except *

cdef class Rod(Pair):
    cdef double _length

    @cython.locals(d=vector)
    cdef void residual(self) except *
    @cython.locals(B=vector, A=vector)
    cpdef void wrenches(self) except *

cdef class Wheel(Pair):
    cdef double _radius
    cdef bint _ball

    @cython.locals(height=number)
    cdef void residual(self) except *
    @cython.locals(k=int, contact=vector)
    cpdef void wrenches(self) except *
    @cython.locals(up=vector, z=vector)
    cdef vector _contact(self) noexcept

@cython.locals(frame=Frame, pair=Pair)
cpdef place(list frames, list pairs)
@cython.locals(square=double, i=Py_ssize_t)
cpdef double length(const double[:] f, const double[:] scale) except? -1
@cython.locals(pair=Pair)
cpdef products(list pairs, int part, double[:, ::1] J, double[:, ::1] Phi)
@cython.locals(frame=Frame, pair=Pair)
cpdef move(list frames, list pairs)

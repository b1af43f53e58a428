# SPDX-License-Identifier: BSD-2-Clause
"""Vectors, rotations, placements, twists and linear systems in numbers of mpmath.

A vector is a list of three numbers, a matrix a list of rows, a placement a pair of a rotation and
an origin. A twist is a pair (omega, v0) of the angular velocity and the velocity of the body's
point at the base's origin.
"""

from mpmath import cos, matrix, mp, mpf, radians, sin

mp.dps = 60
#: Pivots below this are those of redundant rows.
REDUNDANT = mpf("1e-9")

UNIT = [[mpf(int(i == j)) for j in range(3)] for i in range(3)]
ZERO = [mpf(0)] * 3


# --- vectors and rotations ------------------------------------------------------------------------


def vector(values):
    """Three numbers, decimals taken as they are printed."""
    return [mpf(repr(value)) for value in values]


def add(*vectors):
    """The sum of vectors."""
    return [sum(parts) for parts in zip(*vectors, strict=True)]


def scaled(factor, u):
    """A factor times a vector."""
    return [factor * x for x in u]


def minus(u, v):
    """u - v."""
    return [x - y for x, y in zip(u, v, strict=True)]


def dot(u, v):
    """The scalar product."""
    return sum(x * y for x, y in zip(u, v, strict=True))


def cross(u, v):
    """The cross product."""
    a, b, c = u
    x, y, z = v
    return [b * z - c * y, c * x - a * z, a * y - b * x]


def times(R, u):
    """A matrix times a vector."""
    return [dot(row, u) for row in R]


def product(A, B):
    """The product of two matrices."""
    columns = list(zip(*B, strict=True))
    return [[dot(row, column) for column in columns] for row in A]


def turn(axis, angle):
    """The rotation about a unit vector, by Rodrigues' formula."""
    x, y, z = axis
    s = sin(angle)
    c = cos(angle)
    d = 1 - c
    return [
        [c + d * x * x, d * x * y - s * z, d * x * z + s * y],
        [d * x * y + s * z, c + d * y * y, d * y * z - s * x],
        [d * x * z - s * y, d * y * z + s * x, c + d * z * z],
    ]


def rotation_of(quaternion):
    """The rotation of a unit quaternion x, y, z, w."""
    x, y, z, w = quaternion
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]


# --- placements and twists ------------------------------------------------------------------------


def placement(record):
    """Rotation and origin of a described placement."""
    roll, pitch, yaw = (radians(mpf(repr(angle))) for angle in record["rpy_degrees"])
    R = product(turn(UNIT[2], yaw), product(turn(UNIT[1], pitch), turn(UNIT[0], roll)))
    return R, vector(record["xyz"])


def composed(frame, local):
    """The placement in the base of a placement `local` in a frame."""
    R, p = frame
    S, s = local
    return product(R, S), add(p, times(R, s))


def rate_of_twist(V, S):
    """Rate of a twist S that is fixed in a body of twist V."""
    omega, v = V
    a, m = S
    return cross(omega, a), add(cross(omega, m), cross(v, a))


def sum_of_twists(twists, factors):
    """Sum of factor times twist."""
    omega = ZERO
    v = ZERO
    for (a, m), factor in zip(twists, factors, strict=True):
        omega = add(omega, scaled(factor, a))
        v = add(v, scaled(factor, m))
    return omega, v


# --- linear systems -------------------------------------------------------------------------------


def independent_rows(J):
    """Indices of independent rows, as many as the rank, by elimination with full pivoting."""
    remaining = {i: list(row) for i, row in enumerate(J)}
    independent = []
    while remaining:
        # The largest entry, in row i and column k.
        entries = []
        for i, row in remaining.items():
            for k, x in enumerate(row):
                entries.append((abs(x), i, k))
        size, i, k = max(entries, key=lambda entry: entry[0])
        if size < REDUNDANT:
            break
        independent.append(i)
        pivot = remaining.pop(i)
        for row in remaining.values():
            factor = row[k] / pivot[k]
            row[:] = [x - factor * y for x, y in zip(row, pivot, strict=True)]
    return sorted(independent)


def solve(A, b):
    """The solution of a regular system."""
    if not b:
        return []
    return mp.lu_solve(A, matrix(b))

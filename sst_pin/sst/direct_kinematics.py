# SPDX-License-Identifier: BSD-2-Clause
"""Every real assembly of an SST for given motor angles.

Motor angles fix the passive axes u_k = e_{k+3}. The normal of arc k is perpendicular to u_k:
u_k . R m_k = 0 with m_k the normal in {E}. In the unit quaternion p of R these are three quadrics
p^T A_k p = 0, which meet in eight points of projective space, complex ones included. The null space
of the Macaulay matrix of degree four contains all eight: there, multiplication by a ratio of linear
forms is an 8 x 8 matrix whose eigenvectors are the solutions. Newton's method polishes them.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import SingularConfigurationError

_N_SOLUTIONS = 8
#: Imaginary part of a unit quaternion above which a solution is complex. Two close solutions are
#: exact to the square root of rounding only, so Newton's method decides.
_IMAGINARY = 1e-4
#: Largest residual of a polished solution.
_POLISHED = 1e-13
#: Quaternions closer than this are one solution.
_APART = 1e-6

#: Monomials in the four components of a quaternion, as sorted tuples of indices.
_DEGREE_2, _DEGREE_3, _DEGREE_4 = (
    list(itertools.combinations_with_replacement(range(4), degree)) for degree in (2, 3, 4)
)
_INDEX_4 = {monomial: i for i, monomial in enumerate(_DEGREE_4)}
#: _TIMES_P[i, j]: index of (monomial i of degree 3) times p_j among those of degree 4.
_TIMES_P = np.array([[_INDEX_4[tuple(sorted((*m, j)))] for j in range(4)] for m in _DEGREE_3])
#: _SQUARE[i, j]: index of the product of two monomials of degree 2 among those of degree 4.
_SQUARE = np.array([[_INDEX_4[tuple(sorted(a + b))] for b in _DEGREE_2] for a in _DEGREE_2])
#: Two generic linear forms; the same at every call, so results repeat to the bit.
_FORMS = np.random.default_rng(1).normal(size=(2, 4))


def orientations(u: Array, m: Array) -> Array:
    """All rotations R with u_k . R m_k = 0 for k = 1, 2, 3, shape (n, 3, 3), n <= 8, in any order.

    The rows of u are unit vectors in the base, those of m in {E}. Raises a
    SingularConfigurationError if the star can move while the motors are fixed.
    """
    from scipy.spatial.transform import Rotation

    # p^T A_k p = u_k . R(p) m_k for unit quaternions p = (x, y, z, w)
    A = np.empty((3, 4, 4))
    A[:, 3, 3] = cosine = (u * m).sum(axis=1)
    A[:, 3, :3] = A[:, :3, 3] = np.cross(m, u)
    outer = u[:, :, None] * m[:, None, :]
    A[:, :3, :3] = outer + outer.swapaxes(1, 2) - cosine[:, None, None] * np.eye(3)
    solutions: list[Array] = []
    for candidate in _intersections(A):
        # Turn the largest component real: a real solution becomes real as a whole.
        p = candidate * np.exp(-1j * np.angle(candidate[np.argmax(np.abs(candidate))]))
        if np.abs(p.imag).max() > _IMAGINARY:
            continue
        polished = _polish(A, p.real)
        if polished is not None and all(
            min(np.abs(polished - known).max(), np.abs(polished + known).max()) > _APART
            for known in solutions
        ):
            solutions.append(polished)
    if not solutions:
        return np.empty((0, 3, 3))
    return Rotation.from_quat(np.array(solutions)).as_matrix()


def _intersections(A: Array) -> NDArray[np.complex128]:
    """The eight common points of three quadrics, unit vectors as rows, complex in general."""
    macaulay = np.zeros((3, len(_DEGREE_2), len(_DEGREE_4)))
    coefficients = np.array([A[:, i, j] * (1 if i == j else 2) for i, j in _DEGREE_2])
    for row, columns in enumerate(_SQUARE):  # each quadric times each monomial of degree 2
        macaulay[:, row, columns] = coefficients.T
    _, singular_values, V = np.linalg.svd(macaulay.reshape(-1, len(_DEGREE_4)))
    largest, least = singular_values[[0, len(_DEGREE_4) - _N_SOLUTIONS - 1]]
    if least < 1e-10 * largest:
        raise SingularConfigurationError(
            "the motor angles do not determine the star: it can move while the motors are fixed",
            float(largest / least),
        )
    null = V[-_N_SOLUTIONS:].T  # columns span the values of all monomials at the solutions
    numerator, denominator = (np.einsum("mjs,j->ms", null[_TIMES_P], form) for form in _FORMS)
    multiplication = np.linalg.lstsq(denominator, numerator, rcond=None)[0]
    _, eigenvectors = np.linalg.eig(multiplication)
    values = null @ eigenvectors  # monomials at the solutions, columns
    cubes = values[_TIMES_P]  # (degree 3, component, solution)
    best = np.abs(cubes).sum(axis=1).argmax(axis=0)  # the largest monomial of each solution
    p = cubes[best, :, np.arange(_N_SOLUTIONS)]
    return np.asarray(p / np.linalg.norm(p, axis=1)[:, None])


def _polish(A: Array, p: Array) -> Array | None:
    """Newton's method on the quadrics and |p| = 1; None where there is no real solution."""
    for _ in range(30):
        residual = np.append(p @ A @ p, p @ p - 1)
        if np.abs(residual).max() < _POLISHED / 10:
            break
        jacobian = 2 * np.vstack([p @ A, p])
        p = p - np.linalg.lstsq(jacobian, residual, rcond=1e-12)[0]
    p = p / np.linalg.norm(p)
    return p if np.abs(p @ A @ p).max() < _POLISHED else None

# SPDX-License-Identifier: BSD-2-Clause
"""Every real assembly of an SST for given motor angles.

Motor angles fix the passive axes u_k = e_{k+3} in the base. The normal m_k of arc k, which is fixed
in {E}, is perpendicular to u_k: u_k . R m_k = 0. With R by the unit quaternion p = (x, y, z, w),
these are three quadratic equations, or quadrics,

    p^T A_k p = 0,    k = 1, 2, 3.

Three quadrics meet in eight points of projective space (Bezout's theorem), complex ones included.
Newton's method would find some of them. Linear algebra finds all (H. J. Stetter, Numerical
Polynomial Algebra, SIAM 2004):

1. Multiply each quadric by each of the 10 monomials of degree two, such as x^2 or x y. The results
   are 30 equations of degree four, which are linear in the 35 monomials of degree four. Their
   coefficients are the Macaulay matrix, shape (30, 35). Its null space has dimension eight: the
   values z of the 35 monomials at each of the eight solutions are in it, and span it.
2. Let the columns of N span the null space, so that each solution has z = N c with eight numbers c.
   The c are eigenvectors of a matrix, as follows. Let d be the 20 monomials of degree three at a
   solution p, and take two linear forms a . p and b . p with generic a, b. The vector (a . p) d is
   linear in the monomials of degree four, z = N c. So it is S_a c with a matrix S_a of shape
   (20, 8), the same for all solutions. In the same way, (b . p) d = S_b c. Both are multiples of d,
   with the ratio r = (a . p) / (b . p). So S_a c = r S_b c. S_b has rank eight, so that
   pinv(S_b) S_a c = r c: each c is an eigenvector of this 8 x 8 matrix. The eigenvalues r differ,
   so that the eigenvectors are unique. (Degree three is not enough in step 1: its null space has
   dimension eight too, but then S_b has rank seven.)
3. From an eigenvector follows z = N c. The products of one monomial of degree three with x, y, z, w
   are entries of z and proportional to p. Newton's method removes the rounding of the eigenvectors.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import SingularConfigurationError

#: Number of solutions, complex ones included.
_N_SOLUTIONS = 8
#: A monomial in the four components of a quaternion, as their sorted indices: (0, 0, 3) is x^2 w.
_Monomial = tuple[int, ...]


def _monomials(degree: int) -> list[_Monomial]:
    """All monomials of a degree."""
    return list(itertools.combinations_with_replacement(range(4), degree))


_DEGREE_1 = _monomials(1)
_DEGREE_2 = _monomials(2)
_DEGREE_3 = _monomials(3)
_DEGREE_4 = _monomials(4)


def _products(first: list[_Monomial], second: list[_Monomial]) -> NDArray[np.intp]:
    """Index in `_DEGREE_4` of each monomial of the first list times each of the second."""
    indices = np.empty((len(first), len(second)), dtype=np.intp)
    for i, a in enumerate(first):
        for j, b in enumerate(second):
            indices[i, j] = _DEGREE_4.index(tuple(sorted(a + b)))
    return indices


#: Products of monomials of degree three with x, y, z, w, and of two monomials of degree two.
_CUBIC_TIMES_P = _products(_DEGREE_3, _DEGREE_1)
_QUADRATIC_TIMES_QUADRATIC = _products(_DEGREE_2, _DEGREE_2)
#: Two generic linear forms a . p and b . p; the same at every call, so results repeat to the bit.
_FORM_A, _FORM_B = np.random.default_rng(1).normal(size=(2, 4))
#: The Macaulay matrix has rank 35 - 8 = 27 if the quadrics meet in eight points. They meet in a
#: curve if the 27th singular value, the largest first, is below this part of the largest one.
_CURVE = 1e-10
#: Imaginary part of a unit quaternion above which a solution is complex. Two close solutions are
#: exact to the square root of rounding only, so this threshold is large. Whether such a solution is
#: real, Newton's method decides.
_IMAGINARY = 1e-4
#: Quaternions closer than this are one solution.
_APART = 1e-6
#: Largest residual of a solution after Newton's method.
_POLISHED = 1e-13
#: The most steps of Newton's method.
_STEPS = 30


def orientations(u: Array, m: Array) -> Array:
    """All rotations R with u_k . R m_k = 0 for k = 1, 2, 3, shape (n, 3, 3), n <= 8, in any order.

    The rows of u are unit vectors in the base, the rows of m unit vectors in {E}.

    Raises:
        SingularConfigurationError: If the star can move while the motors are fixed.
    """
    from scipy.spatial.transform import Rotation

    A = _quadrics(u, m)
    solutions: list[Array] = []
    for candidate in _intersections(A):
        # A solution is known up to a complex factor: a real solution p may appear as c p. Then all
        # its components have the phase of c, or the opposite one. This phase is removed.
        largest = candidate[np.argmax(np.abs(candidate))]
        p = candidate * np.exp(-1j * np.angle(largest))
        if np.abs(p.imag).max() > _IMAGINARY:
            continue
        polished = _polish(A, p.real)
        if polished is not None and not _is_among(polished, solutions):
            solutions.append(polished)
    if not solutions:
        return np.empty((0, 3, 3))
    return Rotation.from_quat(np.array(solutions)).as_matrix()


def _quadrics(u: Array, m: Array) -> Array:
    """A_k with p^T A_k p = u_k . R(p) m_k for unit quaternions p = (x, y, z, w), (3, 4, 4).

    With v = (x, y, z): u . R m = (w^2 - v . v) u . m + 2 (u . v) (m . v) + 2 w v . (m x u).
    """
    A = np.empty((3, 4, 4))
    cosine = (u * m).sum(axis=1)
    cross = np.cross(m, u)
    outer = u[:, :, None] * m[:, None, :]
    A[:, :3, :3] = outer + outer.mT - cosine[:, None, None] * np.eye(3)
    A[:, 3, :3] = cross
    A[:, :3, 3] = cross
    A[:, 3, 3] = cosine
    return A


def _is_among(p: Array, solutions: list[Array]) -> bool:
    """Whether a quaternion, or its opposite, is one of the solutions."""
    for known in solutions:
        if min(np.abs(p - known).max(), np.abs(p + known).max()) <= _APART:
            return True
    return False


def _intersections(A: Array) -> NDArray[np.complex128]:
    """The eight common points of three quadrics, unit vectors as rows, complex in general.

    The steps are those of the module's docstring.
    """
    # 1. The Macaulay matrix, and its null space.
    coefficients = np.empty((3, len(_DEGREE_2)))  # of each quadric, by monomial
    for column, (i, j) in enumerate(_DEGREE_2):
        coefficients[:, column] = A[:, i, j] if i == j else 2 * A[:, i, j]
    # For each quadric and each monomial that multiplies it, one row. The product with each of the
    # ten monomials of the quadric is one column, which gets the coefficient of this monomial.
    macaulay = np.zeros((3, len(_DEGREE_2), len(_DEGREE_4)))
    for factor, columns in enumerate(_QUADRATIC_TIMES_QUADRATIC):
        macaulay[:, factor, columns] = coefficients  # both of shape (3, 10)
    _, singular_values, Vt = np.linalg.svd(macaulay.reshape(-1, len(_DEGREE_4)))
    largest = singular_values[0]
    rank = len(_DEGREE_4) - _N_SOLUTIONS
    least = singular_values[rank - 1]
    if least < _CURVE * largest:
        raise SingularConfigurationError(
            "the motor angles do not determine the star: it can move while the motors are fixed",
            float(largest / least),
        )
    N = Vt[-_N_SOLUTIONS:].T  # shape (35, 8)

    # 2. Multiplication by (a . p) / (b . p) in the null space, and its eigenvectors.
    products = N[_CUBIC_TIMES_P]  # (cubic monomial, component of p, column of N)
    S_a = np.einsum("mjs,j->ms", products, _FORM_A)  # sums over the components of p
    S_b = np.einsum("mjs,j->ms", products, _FORM_B)
    multiplication = np.linalg.lstsq(S_b, S_a, rcond=None)[0]  # pinv(S_b) S_a
    _, eigenvectors = np.linalg.eig(multiplication)
    monomials = N @ eigenvectors  # z at each solution, shape (35, 8)

    # 3. The products of a cubic monomial with x, y, z, w are proportional to p. For each solution
    # the monomial with the largest products is taken, which have the least relative rounding.
    at_solutions = monomials[_CUBIC_TIMES_P]  # (cubic monomial, component of p, solution)
    best = np.abs(at_solutions).sum(axis=1).argmax(axis=0)  # a cubic monomial for each solution
    p = at_solutions[best, :, np.arange(_N_SOLUTIONS)]  # (solution, component of p)
    return np.asarray(p / np.linalg.norm(p, axis=1)[:, None])


def _polish(A: Array, p: Array) -> Array | None:
    """Newton's method on the three quadrics and |p| = 1; None if it finds no real solution."""
    for _ in range(_STEPS):
        residual = np.append(p @ A @ p, p @ p - 1)
        if np.abs(residual).max() < _POLISHED / 10:
            break
        jacobian = 2 * np.vstack([p @ A, p])
        p = p - np.linalg.lstsq(jacobian, residual, rcond=1e-12)[0]
    p = p / np.linalg.norm(p)
    return p if np.abs(p @ A @ p).max() < _POLISHED else None

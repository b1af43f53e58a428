# SPDX-License-Identifier: BSD-2-Clause
"""Small helpers for CasADi's symbols: constants, sparse vectors, a symmetric solve."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from casadi import SX
from numpy.typing import NDArray

from .elimination import total
from .tree import clean

Array = NDArray[np.float64]
#: Entries by index, zeros left out; each is a scalar symbol or a number.
Sparse = dict[int, Any]


def sx(a: Array) -> SX:
    """Numbers as symbols, zeros left out."""
    return ca.sparsify(SX(ca.DM(clean(a))))


def is_zero(x: Any) -> bool:
    """Whether a scalar is 0 whatever the symbols are."""
    return bool(x.is_zero()) if isinstance(x, SX) else x == 0


def add(a: Mapping[int, Any], b: Mapping[int, Any]) -> Sparse:
    """Sum of two sparse vectors."""
    return dict(a) | {i: a[i] + x if i in a else x for i, x in b.items()}


def definite(inverses: list[Any]) -> Any:
    """More than 1 where one over a pivot of a symmetric matrix is negative."""
    return 1e30 * total(ca.fabs(x) - x for x in inverses)


def solve_symmetric(A: SX, b: SX) -> tuple[SX, list[Any]]:
    """x with A x = b for a symmetric A, by L D L^T, and one over each entry of D; b has columns."""
    n = A.shape[0]
    L: list[dict[int, Any]] = [{} for _ in range(n)]  # below the diagonal, by column
    D: list[Any] = []
    inverses: list[Any] = []
    for j in range(n):
        D.append(A[j, j] - total(x**2 * D[k] for k, x in L[j].items()))
        inverses.append(1 / D[j])
        for i in range(j + 1, n):
            both = L[i].keys() & L[j].keys()
            entry = A[i, j] - total(L[i][k] * L[j][k] * D[k] for k in sorted(both))
            if not is_zero(entry):
                L[i][j] = entry * inverses[j]
    x = [b[i, :] for i in range(n)]
    for i in range(n):
        x[i] -= total(entry * x[k] for k, entry in L[i].items())
    x = [value * inverse for value, inverse in zip(x, inverses, strict=True)]
    for i in reversed(range(n)):
        for k, entry in L[i].items():
            x[k] -= entry * x[i]
    return ca.vertcat(*x), inverses

# SPDX-License-Identifier: BSD-2-Clause
"""Small helpers for CasADi's symbols: constants, sparse vectors, a symmetric solve."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
from casadi import SX

from ..arrays import Array
from .elimination import total
from .links import clean

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


def solve_symmetric(A: SX, b: SX) -> tuple[SX, list[Any]]:
    """x with A x = b for a symmetric A, by L D L^T, and one over each entry of D, row by row."""
    n, order = A.shape[0], _elimination(A)
    A, b = A[order, order], b[order, :]
    L: list[dict[int, Any]] = [{} for _ in range(n)]  # rows, below the diagonal
    LD: list[dict[int, Any]] = [{} for _ in range(n)]
    inverses: list[Any] = []
    for j in range(n):
        inverses.append(1 / (A[j, j] - total(x * L[j][k] for k, x in LD[j].items())))
        for i in range(j + 1, n):
            both = sorted(L[i].keys() & L[j].keys())
            entry = A[i, j] - total(LD[i][k] * L[j][k] for k in both)
            if not is_zero(entry):
                LD[i][j], L[i][j] = entry, entry * inverses[j]
    x = [b[i, :] for i in range(n)]
    for i in range(n):
        x[i] -= total(entry * x[k] for k, entry in L[i].items())
    x = [value * inverse for value, inverse in zip(x, inverses, strict=True)]
    for i in reversed(range(n)):
        for k, entry in L[i].items():
            x[k] -= entry * x[i]
    own = [order.index(i) for i in range(n)]
    return ca.vertcat(*(x[k] for k in own)), [inverses[k] for k in own]


def _elimination(A: SX) -> list[int]:
    """An order in which elimination fills few zeros: next is who has the fewest neighbours."""
    n = A.shape[0]
    near = [{j for j in range(n) if j != i and not is_zero(A[i, j])} for i in range(n)]
    order: list[int] = []
    while len(order) < n:
        i = min(set(range(n)).difference(order), key=lambda k: (len(near[k]), k))
        for j in near[i]:
            near[j] = (near[j] | near[i]) - {i, j}
        order.append(i)
    return order

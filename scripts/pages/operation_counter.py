# SPDX-License-Identifier: BSD-2-Clause
"""A scalar that counts: every operation executed on it, and what of them a result needs."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # of numbers of any kind

KINDS = ("additions", "multiplications", "divisions", "square roots", "trig")
ADD, MULTIPLY, DIVIDE, ROOT, TRIG = KINDS

#: CasADi's instructions that are arithmetic; a change of sign is free.
_INSTRUCTIONS = {
    ca.OP_ADD: ADD,
    ca.OP_SUB: ADD,
    ca.OP_MUL: MULTIPLY,
    ca.OP_TWICE: MULTIPLY,
    ca.OP_SQ: MULTIPLY,
    ca.OP_DIV: DIVIDE,
    ca.OP_INV: DIVIDE,
    ca.OP_SQRT: ROOT,
    ca.OP_SIN: TRIG,
    ca.OP_COS: TRIG,
    ca.OP_ATAN2: TRIG,
}
_FREE = {ca.OP_NEG, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}

#: The symbol of every structural zero.
_ZERO = ca.SX(0.0)


def _known(value: float) -> ca.SX:
    return ca.SX(float(value)) if value else _ZERO


def _subtract_from(a: Any, b: Any) -> Any:
    return b - a


@dataclass(frozen=True, eq=False)
class Number:
    """A number that tells a tally of each operation and knows its own expression.

    Attributes:
        value: What it is.
        symbol: How it came about.
        tally: Where operations are counted by kind.
    """

    value: float
    symbol: ca.SX
    tally: Counter[str]

    def _do(self, kind: str, function: Callable[..., Any], *others: Any) -> Number:
        if any(isinstance(other, np.ndarray) for other in others):
            return NotImplemented  # NumPy comes back with each entry
        self.tally[kind] += 1
        operands = [self, *(o if isinstance(o, Number) else self._constant(o) for o in others)]
        value = float(function(*(x.value for x in operands)))
        symbols = [x.symbol for x in operands]
        if any(symbol is _ZERO for symbol in symbols) and kind == MULTIPLY:
            symbol = _ZERO  # as CasADi would find, in a tenth of the time
        elif symbols[-1] is _ZERO and kind == ADD and function is not _subtract_from:
            symbol = symbols[0]
        else:
            symbol = function(*symbols)
        return Number(value, symbol, self.tally)

    def _constant(self, value: float) -> Number:
        return Number(float(value), _known(value), self.tally)

    def __add__(self, other: Any) -> Number:
        if type(other) is int and other == 0:
            return self  # where np.einsum begins a sum: no work
        return self._do(ADD, operator.add, other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Number:
        return self._do(ADD, operator.sub, other)

    def __rsub__(self, other: Any) -> Number:
        return self._do(ADD, _subtract_from, other)

    def __mul__(self, other: Any) -> Number:
        return self._do(MULTIPLY, operator.mul, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Number:
        return self._do(DIVIDE, operator.truediv, other)

    def __rtruediv__(self, other: Any) -> Number:
        return self._do(DIVIDE, lambda a, b: b / a, other)

    def __neg__(self) -> Number:
        return Number(-self.value, -self.symbol, self.tally)

    # Under these names NumPy's functions call upon what an array of objects holds.
    def sqrt(self) -> Number:
        """For `np.sqrt`."""
        return self._do(ROOT, ca.sqrt)

    def sin(self) -> Number:
        """For `np.sin`."""
        return self._do(TRIG, ca.sin)

    def cos(self) -> Number:
        """For `np.cos`."""
        return self._do(TRIG, ca.cos)

    def arctan2(self, other: Any) -> Number:
        """For `np.arctan2`."""
        return self._do(TRIG, ca.atan2, other)

    def conjugate(self) -> Number:
        """For `np.linalg.norm`."""
        return self

    def __float__(self) -> float:
        return self.value

    def __lt__(self, other: Any) -> bool:
        return self.value < float(other)


class Count(NamedTuple):
    """What a formula costs.

    Attributes:
        executed: Operations as a matrix program executes them.
        generated: Operations of the expression of the results.
        values: The results.
        function: The expression, from all arguments in one column to all results in one.
    """

    executed: Counter[str]
    generated: Counter[str]
    values: NDArray[np.float64]
    function: ca.Function


def count(
    formula: Callable[..., Array], *arguments: Array, constants: Iterable[Array] = ()
) -> Count:
    """Count the operations of a formula.

    Args:
        formula: Takes arrays, returns an array, by arithmetic, square roots, sin, cos and arctan2.
        arguments: Arrays of floats; none of their entries is taken for a structural zero or one.
        constants: Arrays that come before the arguments and whose zeros and ones are structural.
    """
    tally: Counter[str] = Counter()
    symbols: list[ca.SX] = []

    def unknown(value: float) -> Number:
        symbols.append(ca.SX.sym(f"x_{len(symbols)}"))
        return Number(float(value), symbols[-1], tally)

    def known(value: float) -> Number:
        return Number(float(value), _known(value), tally)

    given = [_each(known, array) for array in constants]
    result = np.ravel(formula(*given, *(_each(unknown, array) for array in arguments)))
    expression = ca.cse(ca.vertcat(*(number.symbol for number in result)))
    function = ca.Function("formula", [ca.vertcat(*symbols)], [expression])
    values = np.array([number.value for number in result])
    return Count(tally, operations(function), values, function)


def operations(function: ca.Function) -> Counter[str]:
    """Operations of an expression by kind."""
    codes = [function.instruction_id(i) for i in range(function.n_instructions())]
    return Counter(_INSTRUCTIONS[code] for code in codes if code not in _FREE)


def _each(make: Callable[[float], Number], array: Array) -> Array:
    numbers = np.empty(np.shape(array), dtype=object)
    for index, value in np.ndenumerate(np.asarray(array)):
        numbers[index] = make(value)
    return numbers

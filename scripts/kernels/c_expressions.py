# SPDX-License-Identifier: BSD-2-Clause
"""Formulas that write themselves down in C: arithmetic on `Expr` gives text, zeros fall away."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass, field
from functools import reduce
from operator import add

ATOM, PRODUCT, SUM = range(3)


@dataclass(frozen=True)
class Expr:
    """An expression of C.

    Attributes:
        text: Its source.
        level: How loosely it binds: ATOM, PRODUCT, SUM.
        value: What it is when it is a number.
    """

    text: str
    level: int = ATOM
    value: float | None = None

    @staticmethod
    def of(x: Expr | float) -> Expr:
        if isinstance(x, Expr):
            return x
        return Expr(repr(float(x)), ATOM if x >= 0 else PRODUCT, float(x))

    def within(self, level: int) -> str:
        return self.text if self.level <= level else f"({self.text})"

    def __neg__(self) -> Expr:
        if self.value is not None:
            return Expr.of(-self.value)
        if self.text.startswith("-") and self.level <= PRODUCT:
            return Expr(self.text[1:], self.level)
        return Expr(f"-{self.within(PRODUCT)}", PRODUCT)

    def __add__(self, other: Expr | float) -> Expr:
        a, b = self, Expr.of(other)
        if a.value == 0:
            return b
        if b.value == 0:
            return a
        if b.text.startswith("-") and b.level <= PRODUCT:
            return Expr(f"{a.text} - {b.text[1:]}", SUM)
        return Expr(f"{a.text} + {b.text}", SUM)

    def __sub__(self, other: Expr | float) -> Expr:
        a, b = self, Expr.of(other)
        if b.value == 0:
            return a
        if a.value == 0 or (b.text.startswith("-") and b.level <= PRODUCT):
            return a + -b if a.value == 0 else Expr(f"{a.text} + {b.text[1:]}", SUM)
        return Expr(f"{a.text} - {b.within(PRODUCT)}", SUM)

    def __mul__(self, other: Expr | float) -> Expr:
        a, b = self, Expr.of(other)
        if a.value == 0 or b.value == 0:
            return Expr.of(0.0)
        if a.value == 1:
            return b
        if b.value == 1:
            return a
        if b.text.startswith("-") and b.level <= PRODUCT:
            return -(a * Expr(b.text[1:], b.level))
        return Expr(f"{a.within(PRODUCT)} * {b.within(ATOM)}", PRODUCT)

    def __truediv__(self, other: Expr | float) -> Expr:
        return Expr(f"{self.within(PRODUCT)} / {Expr.of(other).within(ATOM)}", PRODUCT)

    def __radd__(self, other: float) -> Expr:
        return Expr.of(other) + self

    def __rmul__(self, other: float) -> Expr:
        return Expr.of(other) * self


Vector = tuple[Expr, Expr, Expr]


def total(terms: list[Expr]) -> Expr:
    return reduce(add, terms)


def dot(a: Vector, b: Vector) -> Expr:
    return total([x * y for x, y in zip(a, b, strict=True)])


def cross(a: Vector, b: Vector) -> Vector:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def plus(*vectors: Vector) -> Vector:
    x, y, z = (total(list(components)) for components in zip(*vectors, strict=True))
    return x, y, z


def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scaled(factor: Expr, a: Vector) -> Vector:
    return factor * a[0], factor * a[1], factor * a[2]


def unit(i: int) -> Vector:
    x, y, z = (Expr.of(float(i == j)) for j in range(3))
    return x, y, z


def symmetric(upper: list[Expr], a: Vector) -> Vector:
    """Product of a symmetric matrix, given as xx, xy, xz, yy, yz, zz, with a vector."""
    xx, xy, xz, yy, yz, zz = upper
    return dot((xx, xy, xz), a), dot((xy, yy, yz), a), dot((xz, yz, zz), a)


@dataclass
class Body:
    """The body of a C function, statement after statement; what no result needs is left out."""

    _statements: list[tuple[str, str, str]] = field(default_factory=list)  # section, names, text
    _section: str = ""

    def section(self, text: str) -> None:
        """Begin a group of statements under a comment."""
        self._section = text

    def let(self, name: str, value: Expr) -> Expr:
        """Name a value, unless it is a name or a number already."""
        if value.level == ATOM:
            return value
        self._statements.append((self._section, name, f"const real {name} = {value.text};"))
        return Expr(name)

    def let_vector(self, name: str, vector: Vector) -> Vector:
        x, y, z = (self.let(f"{name}{c}", v) for c, v in zip("xyz", vector, strict=True))
        return x, y, z

    def statement(self, results: list[str], text: str) -> list[Expr]:
        """Lines of C that declare and set the results."""
        self._statements.append((self._section, " ".join(results), text))
        return [Expr(name) for name in results]

    def put(self, target: str, value: Expr) -> None:
        """Assign a result."""
        self._statements.append((self._section, "", f"{target} = {value.text};"))

    def text(self) -> str:
        needed: set[str] = set()
        kept = []
        for section, names, text in reversed(self._statements):
            if not names or needed & set(names.split()):
                needed |= set(re.findall(r"[A-Za-z_]\w*", text))
                kept.append((section, text))
        lines, current = [], ""
        for section, text in reversed(kept):
            if section != current:
                lines += ["", f"    /* {section} */"]
                current = section
            for line in text.splitlines():
                lines += wrapped(line)
        return "\n".join(lines).lstrip("\n")


def wrapped(line: str) -> list[str]:
    """A statement in lines of at most 99 characters, broken before + and - and after commas."""
    indent = "    " + " " * (len(line) - len(line.lstrip()))
    glued = re.sub(r"(?<!,) (?![+-] )|(?<= [+-]) ", "\0", line.lstrip())
    lines = textwrap.wrap(
        glued, 99, initial_indent=indent, subsequent_indent=indent + "    ",
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip
    return [part.replace("\0", " ") for part in lines]

# SPDX-License-Identifier: BSD-2-Clause
"""Builds C functions from statements, one statement for each operation."""

import re
from collections.abc import Mapping, Sequence
from heapq import heappop, heappush
from itertools import pairwise

#: Characters of a line.
_WIDTH = 94
#: The most statements of an undivided function.
LARGEST = 7000
#: The most statements of the parts of a divided function.
_PART = 500

# For `with_results_in_memory`:
#: A function of no more statements stays as it is.
_FEW = 300
#: A result that is not used for more statements than this is stored in the array.
_NEAR = 120
#: Entries of the array that are read by one pointer, half of them on each side of it.
_REACH = 32
#: The most pointers whose target is hidden from the compiler.
_POINTERS = 12

#: Names of results of statements.
_RESULT = re.compile(r"\b(?:ti?|s|c)\d+\b")
#: Sine and cosine of a number of the input.
_TURN = re.compile(r"real s(\d+), c\d+; sines_cosines\(1, &(x\[\d+\])")


def function(head: str, lines: Sequence[str]) -> str:
    """A function by its head and its statements."""
    return "\n    ".join([f"{head}\n{{", *_wrapped(lines)]) + "\n}\n"


def together(lines: Sequence[str]) -> list[str]:
    """Statements with the sines and cosines of all inputs before them, several at once."""
    names: dict[str, str] = {}
    angles: list[str] = []
    others: list[str] = []
    for line in lines:
        turn = _TURN.match(line)
        if turn is None:
            others.append(line)
            continue
        number, angle = turn.groups()
        names[f"s{number}"] = f"s[{len(angles)}]"
        names[f"c{number}"] = f"c[{len(angles)}]"
        angles.append(angle)
    others = [_renamed(line, names) for line in others]
    if not angles:
        return others
    n = len(angles)
    arrays = f"real s[{n}], c[{n}]; const real angles[] = {{{', '.join(angles)}}};"
    return [arrays, f"sines_cosines({n}, angles, s, c);", *others]


def with_results_in_memory(lines: Sequence[str]) -> list[str]:
    """Statements of a function in which results wait in an array for a distant use.

    The compiler then allocates registers for few results at a time. Measured with GCC 12 on AVX-512
    for torques and accelerations of the Stewart platform and the Delta, a large function compiles
    in half of the time, runs on a batch in 70 to 80 % of the time, and on one sample in 80 to 93 %.
    Without the `__asm__`, which hides the array from the compiler, most of that is lost: it moves
    the results back into registers. The smaller kernels of the SST gain nothing.

    An offset from the stack pointer takes four bytes, a small offset from another pointer one byte.
    So several pointers into the array make the machine code for one sample shorter.
    """
    if len(lines) <= _FEW:
        return list(lines)
    statements_with = _statements_with_results(lines)
    read_from = _first_distant_uses(statements_with)

    # Store each of these results after the statement that makes it, and read it from the array from
    # its distant use on. Its entry is free after its last use.
    places: dict[str, int] = {}
    unused_places: list[int] = []  # a heap: the lowest place is used first
    size = 0
    body: list[str] = []
    for i, line in enumerate(lines):
        used = list(dict.fromkeys(_used(line)))
        names = {x: _place(places[x]) for x in used if x in places and i >= read_from[x]}
        body.append(_renamed(line, names))
        for result in used:
            if result not in read_from:
                continue
            if result not in places:
                if not unused_places:
                    heappush(unused_places, size)
                    size += 1
                places[result] = heappop(unused_places)
                body.append(f"{_place(places[result])} = {result};")
            if i == statements_with[result][-1]:
                heappush(unused_places, places[result])

    # Declare the array and the pointers into it.
    pointers = -(-size // _REACH)
    declarations: list[str] = []
    if pointers:
        declarations.append(f"real room[{_REACH * pointers}];")
    for k in range(pointers):
        declarations.append(f"real *w{k} = room + {_REACH * k + _REACH // 2};")
        if k < _POINTERS:  # hides from the compiler that it points to the stack
            declarations.append(f'__asm__("" : "+r"(w{k}));')
    return declarations + body


def _statements_with_results(lines: Sequence[str]) -> dict[str, list[int]]:
    """The numbers of the statements with each result; the first of them makes the result."""
    statements_with: dict[str, list[int]] = {}
    for i, line in enumerate(lines):
        for result in _used(line):
            statements_with.setdefault(result, []).append(i)
    return statements_with


def _first_distant_uses(statements_with: Mapping[str, Sequence[int]]) -> dict[str, int]:
    """The first statement that uses a result long after the statement with it before.

    Results without such a use are left out.
    """
    distant_uses: dict[str, int] = {}
    for result, numbers in statements_with.items():
        for before, after in pairwise(numbers):
            if after - before > _NEAR:
                distant_uses[result] = after
                break
    return distant_uses


def _place(k: int) -> str:
    """Entry k of the array, by the pointer to the middle of its part."""
    return f"w{k // _REACH}[{k % _REACH - _REACH // 2}]"


def pieces(lines: Sequence[str], largest: int | None = None) -> list[Sequence[str]]:
    """Statements in one piece if there are at most `largest`, else in pieces of at most `_PART`.

    The pieces have equal lengths. By default `largest` is `LARGEST`.
    """
    if len(lines) <= (largest or LARGEST):
        return [lines]
    count = -(-len(lines) // _PART)  # rounded up, as the next one
    size = -(-len(lines) // count)
    return [lines[i : i + size] for i in range(0, len(lines), size)]


def in_parts(pieces: Sequence[Sequence[str]]) -> tuple[list[list[str]], int]:
    """Statements of functions that run one after the other, and the size of their array w.

    Compile time grows faster than the size of a function. So a long function becomes one for each
    piece. Results of a piece that later pieces use are in w; an entry of w is used again after the
    last use of its result.
    """
    last = dict[str, int]()  # the last piece that uses each result
    for k, piece in enumerate(pieces):
        for line in piece:
            last |= dict.fromkeys(_used(line), k)
    places = dict[str, int]()  # entries of w, by result
    unused_places = list[int]()
    size = 0
    bodies = list[list[str]]()
    for k, piece in enumerate(pieces):
        # Results of earlier pieces are read from w.
        at = {result: f"w[{place}]" for result, place in places.items()}
        body = [_renamed(line, at) for line in piece]
        for result in at:
            if last[result] == k:
                unused_places.append(places.pop(result))

        # Results of this piece that later ones use are written to w at its end.
        results = {result for line in piece for result in _used(line)} - at.keys()
        for result in sorted(results):
            if last[result] > k:
                if not unused_places:
                    unused_places.append(size)
                    size += 1
                places[result] = unused_places.pop()
                body.append(f"w[{places[result]}] = {result};")
        bodies.append(body)
    return bodies, size


def _renamed(line: str, names: Mapping[str, str]) -> str:
    """A statement with other names for some results."""
    return _RESULT.sub(lambda match: names.get(match[0], match[0]), line)


def _used(line: str) -> list[str]:
    """Names of results in a statement."""
    return _RESULT.findall(line)


def _wrapped(statements: Sequence[str]) -> list[str]:
    """Statements in lines of some hundred characters."""
    lines = [""]
    for statement in statements:
        if len(lines[-1]) + len(statement) > _WIDTH:
            lines.append("")
        if lines[-1]:
            lines[-1] += " "
        lines[-1] += statement
    return lines

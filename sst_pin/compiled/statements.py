# SPDX-License-Identifier: BSD-2-Clause
"""Builds C functions from statements, one statement for each operation.

A statement is a text such as `const real t7 = t3 * x[2];`. It defines a *result*, here t7, and uses
results of statements before it. `c_code` calls these functions, in this order:

1. `pieces` and `in_parts` make several functions of a long one; `with_sines_together` moves the
   sines and cosines of a short function to its beginning;
2. `with_results_in_memory` stores results in an array until a distant use;
3. `function` writes the text of a function.
"""

import re
from collections.abc import Mapping, Sequence
from heapq import heappop, heappush
from itertools import pairwise

#: The most characters of a line.
_WIDTH = 94
#: The most statements of an undivided function.
LARGEST = 7000
#: The most statements of the parts of a divided function.
_PART = 500

# For `with_results_in_memory`:
#: A function with this number of statements or fewer stays as it is.
_FEW = 300
#: A *distant use* of a result comes more than this number of statements after the use before it. A
#: result with a distant use is stored in an array.
_NEAR = 120
#: Pointers divide the array: each of them points to the middle of this number of entries.
_REACH = 32
#: An `__asm__` statement after a pointer hides from the compiler where it points. At most this many
#: pointers have such a statement.
_POINTERS = 12

#: Names of results of statements.
RESULT = re.compile(r"\b(?:ti?|s|c)\d+\b")
#: The statement for the sine and the cosine of an entry of x; groups: number of the result, entry.
_SINE_AND_COSINE = re.compile(r"real s(\d+), c\d+; sines_cosines\(1, &(x\[\d+\])")


def function(head: str, lines: Sequence[str]) -> str:
    """The text of a function, from its head and its statements."""
    return "\n    ".join([f"{head}\n{{", *_wrapped(lines)]) + "\n}\n"


def with_sines_together(lines: Sequence[str]) -> list[str]:
    """Statements in which one call computes the sines and cosines of all entries of x, first."""
    names: dict[str, str] = {}  # new names of results
    angles: list[str] = []
    others: list[str] = []
    for line in lines:
        match = _SINE_AND_COSINE.match(line)
        if match is None:
            others.append(line)
            continue
        number, angle = match.groups()
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
    """Statements of a function in which results are stored in an array until a distant use.

    The compiler then allocates registers for few results at a time. Measured with GCC 12 on AVX-512
    for torques and accelerations of the Stewart platform and the Delta, a large function compiles
    in half of the time, runs on a batch in 70 to 80 % of the time, and on one sample in 80 to 93 %.
    The `__asm__` hides the array from the compiler. Without it, the compiler moves the results back
    into registers, and most of the gain is lost. The smaller kernels of the SST gain nothing.

    The array has the name `room`, and the pointers into it are w0, w1, and so on. An offset from
    the stack pointer takes four bytes, a small offset from another pointer one byte. So several
    pointers make the machine code for one sample shorter.
    """
    if len(lines) <= _FEW:
        return list(lines)
    statements_with = _statements_with_results(lines)
    distant_uses = _first_distant_uses(statements_with)

    # A result with a distant use is stored in the array after the statement that defines it. From
    # its distant use on, it is read from the array. Its entry is free after its last use.
    places: dict[str, int] = {}
    free_places: list[int] = []  # a heap: the lowest place is used first
    size = 0
    body: list[str] = []
    for i, line in enumerate(lines):
        results = list(dict.fromkeys(_results_in(line)))
        names = {x: _place(places[x]) for x in results if x in places and i >= distant_uses[x]}
        body.append(_renamed(line, names))
        for result in results:
            if result not in distant_uses:
                continue
            if result not in places:
                if not free_places:
                    heappush(free_places, size)
                    size += 1
                places[result] = heappop(free_places)
                body.append(f"{_place(places[result])} = {result};")
            if i == statements_with[result][-1]:
                heappush(free_places, places[result])

    # Declare the array and the pointers into it.
    pointers = -(-size // _REACH)  # rounded up
    declarations: list[str] = []
    if pointers:
        declarations.append(f"real room[{_REACH * pointers}];")
    for k in range(pointers):
        declarations.append(f"real *w{k} = room + {_REACH * k + _REACH // 2};")
        if k < _POINTERS:  # hides from the compiler that it points to the stack
            declarations.append(f'__asm__("" : "+r"(w{k}));')
    return declarations + body


def _statements_with_results(lines: Sequence[str]) -> dict[str, list[int]]:
    """The indices of the statements with each result; the first of them defines the result."""
    statements_with: dict[str, list[int]] = {}
    for i, line in enumerate(lines):
        for result in _results_in(line):
            statements_with.setdefault(result, []).append(i)
    return statements_with


def _first_distant_uses(statements_with: Mapping[str, Sequence[int]]) -> dict[str, int]:
    """The first distant use of each result: more than `_NEAR` statements after the one before.

    Results without a distant use are left out.
    """
    distant_uses: dict[str, int] = {}
    for result, indices in statements_with.items():
        for before, after in pairwise(indices):
            if after - before > _NEAR:
                distant_uses[result] = after
                break
    return distant_uses


def _place(k: int) -> str:
    """Entry k of the array, by the pointer to the middle of the `_REACH` entries around it."""
    return f"w{k // _REACH}[{k % _REACH - _REACH // 2}]"


def pieces(lines: Sequence[str], largest: int = LARGEST) -> list[Sequence[str]]:
    """Statements in one piece if there are at most `largest`, else in pieces of at most `_PART`.

    The pieces have equal lengths; the last one may be shorter.
    """
    if len(lines) <= largest:
        return [lines]
    count = -(-len(lines) // _PART)  # rounded up
    size = -(-len(lines) // count)  # rounded up
    return [lines[i : i + size] for i in range(0, len(lines), size)]


def in_parts(pieces: Sequence[Sequence[str]]) -> tuple[list[list[str]], int]:
    """Statements of a function for each piece, and the size of the array w that they share.

    Compile time grows faster than the size of a function. So a long function becomes several
    functions, which run one after the other. A result that later pieces use is stored in w. Its
    entry of w is free after the last piece that uses it. The caller provides w and hands it to each
    function. The pointers w0, w1, ... of `with_results_in_memory` point into another array.
    """
    last_piece = dict[str, int]()  # the last piece that uses each result
    for k, piece in enumerate(pieces):
        for line in piece:
            last_piece |= dict.fromkeys(_results_in(line), k)
    places = dict[str, int]()  # entries of w, by result
    free_places = list[int]()
    size = 0
    bodies = list[list[str]]()
    for k, piece in enumerate(pieces):
        # Results of earlier pieces are read from w.
        earlier = {result: f"w[{place}]" for result, place in places.items()}
        body = [_renamed(line, earlier) for line in piece]
        for result in earlier:
            if last_piece[result] == k:
                free_places.append(places.pop(result))

        # Results of this piece that later pieces use are written to w at its end.
        results = {result for line in piece for result in _results_in(line)} - earlier.keys()
        for result in sorted(results):
            if last_piece[result] > k:
                if not free_places:
                    free_places.append(size)
                    size += 1
                places[result] = free_places.pop()
                body.append(f"w[{places[result]}] = {result};")
        bodies.append(body)
    return bodies, size


def _renamed(line: str, names: Mapping[str, str]) -> str:
    """A statement with other names for some results."""
    return RESULT.sub(lambda match: names.get(match[0], match[0]), line)


def _results_in(line: str) -> list[str]:
    """Names of results in a statement, defined or used."""
    return RESULT.findall(line)


def _wrapped(statements: Sequence[str]) -> list[str]:
    """Statements, several in a line of at most `_WIDTH` characters."""
    lines = [""]
    for statement in statements:
        if len(lines[-1]) + len(statement) > _WIDTH:
            lines.append("")
        if lines[-1]:
            lines[-1] += " "
        lines[-1] += statement
    return lines

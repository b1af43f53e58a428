# SPDX-License-Identifier: BSD-2-Clause
"""Kernels as C99: straight-line code on `real`, a number or a vector of samples."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import NamedTuple

import casadi as ca

from ..chain.mechanism import AT_REST
from .kernels import Kernel
from .parameters import SIGN_WIDTH

_WIDTH = 94
#: Arguments of the sign of a rate besides it: its width, and what is slower is at rest.
_OF_SIGNS = f"p[{SIGN_WIDTH}], N({AT_REST})"
_BINARY = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/"}
#: By its operands.
_FORMS = {
    ca.OP_LE: "AT_MOST({0}, {1})",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_FABS: "ABSOLUTE({0})",
    ca.OP_SQRT: "SQUARE_ROOT({0})",
    ca.OP_TANH: "tangent({0})",
}
#: What differs for numbers of the parameters alone, which are no vectors.
_OF_NUMBERS = {ca.OP_FABS: "{0} < 0 ? -{0} : {0}", ca.OP_LE: "{0} <= {1}"}
#: Statements of a function that is not cut, and of the parts of one that is.
_LARGEST, _PART = 7000, 500
#: Names of results of statements.
_RESULT = re.compile(r"\b(?:ti?|s|c)\d+\b")
#: Sine and cosine of a number of the input.
_TURN = re.compile(r"real s(\d+), c\d+; sines_cosines\(1, &(x\[\d+\])")
#: Numbers of the input.
_INPUT = re.compile(r"\bx\[\d+\]")


def part(name: str) -> str:
    """The text of a file that goes into every library."""
    return (files(__package__) / "c" / name).read_text(encoding="utf-8")


class Body(NamedTuple):
    """The C of a kernel.

    Attributes:
        text: `void <name>(const real *x, const number *p, real *y)`, and before it
            `void <name>_constants(number *p)`. x holds the inputs one after the other, p the open
            parameters, then the constants that `<name>_constants` makes of them; y gets the output,
            then the checks, then what parts of the function hand on. Where the kernel has
            directions, `<name>_once` comes first, with the same arguments: it computes what does
            not depend on them.
        size: Of p.
        room: Size of y.
    """

    text: str
    size: int
    room: int


def body(kernel: Kernel, size: int | None = None, suffix: str = "") -> Body:
    """The C of a kernel; what depends on the parameters alone is apart, to be computed once.

    Args:
        kernel: What is to be computed.
        size: Of p before its constants; that of the parameters by default.
        suffix: Of numbers: "f" in single precision.
    """
    function = ca.Function(
        kernel.name,
        [ca.vertcat(*kernel.inputs), kernel.parameters],
        [ca.densify(ca.vertcat(kernel.output, kernel.checks))],
        {"cse": True},
    )
    writer = _Writer(size or kernel.parameters.numel())
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        arguments = function.instruction_input(k)
        (target, *place) = function.instruction_output(k)
        if operation == ca.OP_CONST:
            number = repr(float(function.instruction_constant(k))) + suffix
            writer.names[target] = f"({number})" if number[0] == "-" else number, "number"
        elif operation == ca.OP_INPUT:
            array, i = arguments
            writer.names[target] = (f"x[{i}]", "real") if array == 0 else (f"p[{i}]", "number")
        elif operation == ca.OP_OUTPUT:
            result = writer.use(writer.names[arguments[0]], "real")
            writer.lines["real"].append(f"y[{place[0]}] = (real){{0}} + {result};")
        else:
            operands = [writer.names[i] for i in arguments]
            writer.names[target] = writer.write(f"t{k}", operation, operands)
    prepare = f"static void {kernel.name}_constants(number *p)"
    texts = [_function(prepare, ["(void)p;", *writer.lines["number"]])]
    lines, room = writer.lines["real"], kernel.output.numel() + kernel.checks.numel()
    if len(lines) <= _LARGEST and not kernel.directions:
        functions = {kernel.name: ["(void)p;", *_together(lines)]}
    else:
        whole = {kernel.name: lines}
        if kernel.directions:
            inputs = sum(symbols.numel() for symbols in kernel.inputs)
            once, each = _split(lines, range(inputs - kernel.directions, inputs))
            whole = {f"{kernel.name}_once": once, kernel.name: each}
        pieces = {name: _pieces(lines) for name, lines in whole.items()}
        parts, handed_on = _parts(kernel.name, list(pieces.values()))
        numbers = iter(range(len(parts)))
        functions = {
            name: [f"{kernel.name}_{next(numbers)}(x, p, y, y + {room});" for _ in own]
            for name, own in pieces.items()
        }
        texts += parts
        room += handed_on
    for name, statements in functions.items():
        head = f"static void {name}(const real *x, const number *p, real *y)"
        texts.append(_function(head, statements))
    return Body("\n".join(texts), writer.size, room)


def _function(head: str, lines: Sequence[str]) -> str:
    return "\n    ".join([f"{head}\n{{", *_wrapped(lines)]) + "\n}\n"


def _together(lines: Sequence[str]) -> list[str]:
    """Statements with the sines and cosines of all inputs before them, several at once."""
    names: dict[str, str] = {}
    angles: list[str] = []
    for found in filter(None, map(_TURN.match, lines)):
        names |= {f"{x}{found[1]}": f"{x}[{len(angles)}]" for x in "sc"}
        angles.append(found[2])
    rest = [_renamed(line, names) for line in lines if not _TURN.match(line)]
    if not angles:
        return rest
    n, listed = len(angles), ", ".join(angles)
    arrays = f"real s[{n}], c[{n}]; const real angles[] = {{{listed}}};"
    return [arrays, f"sines_cosines({n}, angles, s, c);", *rest]


def _split(lines: Sequence[str], inputs: range) -> tuple[list[str], list[str]]:
    """Statements that do not depend on some inputs, and those that do."""
    once: list[str] = []
    each: list[str] = []
    of_inputs, depending = {f"x[{i}]" for i in inputs}, set[str]()
    for line in lines:
        used = _used(line)
        if not depending.isdisjoint(used) or not of_inputs.isdisjoint(_INPUT.findall(line)):
            depending.update(used[:1] if line.startswith("const") else used)
            each.append(line)
        else:
            once.append(line)
    return once, each


def _pieces(lines: Sequence[str]) -> list[Sequence[str]]:
    """Statements, cut where they are many."""
    if len(lines) <= _LARGEST:
        return [lines]
    size = -(-len(lines) // -(-len(lines) // _PART))
    return [lines[i : i + size] for i in range(0, len(lines), size)]


def _parts(name: str, groups: Sequence[Sequence[Sequence[str]]]) -> tuple[list[str], int]:
    """Functions for `real` that run one after the other, and the size of w.

    A compiler takes more than proportionally long for a large function. What parts compute for
    later ones goes by the array w. All groups but the first may run several times.
    """
    parts = [part for group in groups for part in group]
    last = {result: k for k, part in enumerate(parts) for line in part for result in _used(line)}
    for part in groups[0] if len(groups) > 1 else []:
        for line in part:
            kept = (result for result in _used(line) if last[result] >= len(groups[0]))
            last.update(dict.fromkeys(kept, len(parts)))
    places: dict[str, int] = {}
    free: list[int] = []
    handed_on, texts = 0, []
    for k, part in enumerate(parts):
        at = {result: f"w[{place}]" for result, place in places.items()}
        body = [_renamed(line, at) for line in part]
        free += [places.pop(result) for result in at if last[result] == k]
        made = {result for line in part for result in _used(line)} - at.keys()
        for result in sorted(made):
            if last[result] > k:
                if not free:
                    free.append(handed_on)
                    handed_on += 1
                places[result] = free.pop()
                body.append(f"w[{places[result]}] = {result};")
        head = (
            f"PART {name}_{k}(const real *x, const number *p, real *restrict y, real *restrict w)"
        )
        texts.append(_function(head, ["(void)x, (void)p, (void)y, (void)w;", *body]))
    return texts, handed_on


def _renamed(line: str, names: Mapping[str, str]) -> str:
    """A statement with other names for some results."""
    return _RESULT.sub(lambda found: names.get(found[0], found[0]), line)


def _used(line: str) -> list[str]:
    """Names of results in a statement."""
    return _RESULT.findall(line)


def _wrapped(statements: Sequence[str]) -> list[str]:
    """Statements in lines of some hundred characters."""
    lines = [""]
    for statement in statements:
        if len(lines[-1]) + len(statement) > _WIDTH:
            lines.append("")
        lines[-1] += " " * bool(lines[-1]) + statement
    return lines


#: What an expression is called, and its type: "real" of a sample, "number" of the parameters alone.
_Name = tuple[str, str]


class _Writer:
    """Statements of a kernel, those of parameters apart from those of samples.

    Attributes:
        names: What stands in each place of the work vector.
        lines: Statements by the type of their result.
        size: Of p.
    """

    def __init__(self, size: int) -> None:
        self.names: dict[int, _Name] = {}
        self.lines: dict[str, list[str]] = {"real": [], "number": []}
        self.size = size
        self._constants: dict[str, str] = {}
        self._turns: dict[str, int] = {}
        self._inverses: dict[_Name, _Name] = {}
        self._directions: dict[str, str] = {}  # not yet written; what each is the direction of

    def use(self, name: _Name, kind: str) -> str:
        """A name in a statement of a type; `prepare` leaves constants in p for samples."""
        text, own = name
        if text in self._directions:
            of = self._directions.pop(text)
            self.lines[own].append(f"const {own} {text} = direction({of}, {_OF_SIGNS});")
        if kind == own or text[0] != "t":
            return text
        if text not in self._constants:
            self._constants[text] = f"p[{self.size}]"
            self.size += 1
            self.lines[own].append(f"{self._constants[text]} = {text};")
        return self._constants[text]

    def write(self, name: str, operation: int, operands: list[_Name]) -> _Name:
        """One operation, and what its result is called."""
        if operation == ca.OP_INV:
            return self._inverse(operands[0])
        if operation == ca.OP_DIV:
            operation, operands = ca.OP_MUL, [operands[0], self._inverse(operands[1])]
        kind = "real" if "real" in {kind for _, kind in operands} else "number"
        if operation == ca.OP_SIGN:
            self._directions[name] = self.use(operands[0], kind)
            return name, kind
        if operation == ca.OP_MUL and kind == "real":
            for (text, _), (factor, of_factor) in (operands, operands[::-1]):
                if text in self._directions and of_factor == "number":
                    x, F = self._directions[text], self.use((factor, of_factor), kind)
                    line = f"const real {name} = rubbing({x}, {F}, {_OF_SIGNS});"
                    self.lines[kind].append(line)
                    return name, kind
        texts = [self.use(operand, kind) for operand in operands]
        first = texts[0]
        if operation in (ca.OP_SIN, ca.OP_COS):
            t = self._turns.setdefault(first, len(self._turns))
            declared = f"real s{t}, c{t}; sines_cosines(1, &{first}, &s{t}, &c{t});"
            if declared not in self.lines[kind]:
                self.lines[kind].append(declared)
            return f"{'s' if operation == ca.OP_SIN else 'c'}{t}", kind
        if operation in _BINARY:
            text = f"{first} {_BINARY[operation]} {texts[1]}"
        else:
            forms = _FORMS if kind == "real" else _FORMS | _OF_NUMBERS
            text = forms[operation].format(*texts)
        self.lines[kind].append(f"const {kind} {name} = {text};")
        return name, kind

    def _inverse(self, name: _Name) -> _Name:
        """One over it: divisions take long, and many are by the same pivots."""
        text, kind = name
        if name not in self._inverses:
            self._inverses[name] = f"ti{len(self._inverses)}", kind
            self.lines[kind].append(f"const {kind} {self._inverses[name][0]} = 1 / {text};")
        return self._inverses[name]


def library(name: str, kernels: Sequence[Kernel], lanes: int) -> str:
    """Source of a library with one entry.

    Args:
        name: Of the entry.
        kernels: One; or "closing" and "state_rate" for rollouts.
        lanes: How many samples at once.
    """
    heads = [f"#define LANES {lanes}\n#define NAME(x) x", part("real.h"), part("driver.h")]
    return "\n".join([*heads, source({name: kernels})])


def source(entries: Mapping[str, Sequence[Kernel]]) -> str:
    """Functions that run kernels on rows of samples, to stand behind real.h and driver.h.

    What a library offers of each entry, every name in the macro NAME: `run_<entry>` and
    `sizes_run_<entry>` (of p, of the output, of each input, -1), `prepare_<entry>`; of rollouts
    `rate_<entry>` and its sizes too, which takes q and va in one array.

    Args:
        entries: Kernels as for `library`, by name. Those of the same name are written once.
    """
    parts: list[str] = []
    bodies: dict[str, Body] = {}
    for entry, kernels in entries.items():
        size = None
        for kernel in kernels:
            if kernel.name not in bodies:
                bodies[kernel.name] = body(kernel, size)
                parts.append(bodies[kernel.name].text)
            size = bodies[kernel.name].size
        last = kernels[-1]
        inputs = [symbols.numel() for symbols in last.inputs]
        outputs, checks = last.output.numel(), last.checks.numel()
        directions = last.directions
        numbers: dict[str, object] = {
            "entry": entry,
            "calls": "\n    ".join(f"{kernel.name}_constants(p);" for kernel in kernels),
            "size": size,
            "name": last.name,
            "q": inputs[0],
            "inputs": sum(inputs),
            "outputs": outputs,
            "results": outputs * max(directions, 1),
            "directions": directions,
            "checks": checks,
            "room": max(bodies[kernel.name].room for kernel in kernels),
        }
        parts.append(_PREPARE.format(**numbers))
        word, close, arrays = "run", "NULL", inputs[:-1] if directions else inputs
        if len(kernels) > 1:
            q, va, tau, *load = inputs
            word, close, arrays = "rate", kernels[0].name, [q + va, tau, *load]
            more = {"va": va, "tau": tau, "load": sum(load), "states": q + va, "close": close}
            parts.append(_ROLL.format(**more, **numbers))
            parts.append(_SIZES.format(word="run", sizes=_listed(inputs), **numbers))
        numbers |= {"word": word, "sizes": _listed(arrays), "arrays": len(arrays)}
        parts.append((_ALONG if directions else _RUN).format(close=close, **numbers))
        parts.append(_SIZES.format(**numbers))
    return "\n".join(parts)


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))


_PREPARE = """\
void NAME(prepare_{entry})(double *p)
{{
    {calls}
}}
"""

_SIZES = """\
const int NAME(sizes_{word}_{entry})[] = {{{size}, {results}, {sizes}, -1}};
"""

_RUN = """\
int NAME({word}_{entry})(const rows *in, const rows *out, const double *p, ptrdiff_t count,
    unsigned char *bad)
{{
    static const int sizes_in[] = {{{sizes}}};
    real x[{inputs}], y[{room}];
    return run({name}, {close}, {arrays}, sizes_in, {q}, {inputs}, {outputs}, {checks}, x, y, in,
        out, p, count, bad);
}}
"""

_ALONG = """\
int NAME({word}_{entry})(const rows *in, const rows *out, const double *p, ptrdiff_t count,
    unsigned char *bad)
{{
    static const int sizes_in[] = {{{sizes}}};
    real x[{inputs}], y[{room}];
    return along({name}_once, {name}, {arrays}, sizes_in, {q}, {directions}, {inputs}, {outputs},
        {checks}, x, y, in, out, p, count, bad);
}}
"""

_ROLL = """\
int NAME(run_{entry})(const rows *in, const courses *tau, ptrdiff_t half, const courses *out,
    const double *p, double h, ptrdiff_t steps, ptrdiff_t count, ptrdiff_t *reached)
{{
    static const stepper f = {{{q}, {va}, {tau}, {load}, {checks}, {name}, {close}}};
    real x[{inputs}], y[{room}], start[{states}], sum[{states}];
    return roll(&f, x, y, start, sum, in, tau, half, out, p, h, steps, count, reached);
}}
"""

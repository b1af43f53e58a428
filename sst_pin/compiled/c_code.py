# SPDX-License-Identifier: BSD-2-Clause
"""Kernels as C99: straight-line code on `real`, a number or a vector of samples."""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from math import isfinite
from string import Template
from typing import NamedTuple

import casadi as ca

from ..loops.continuity import TRAVEL
from ..model.thresholds import AT_REST, BEND, CLOSURE_TOLERANCE
from . import statements
from .compiled_states import CHANGE, NEARBY
from .kernel_checks import CLOSED
from .kernels import SymbolicKernel
from .open_numbers import SIGN_WIDTH

#: Arguments of the sign function after the rate: its width, and the rate below which a joint rests.
_OF_SIGNS = f"p[{SIGN_WIDTH}], N({AT_REST})"
#: C of each operation; {0} and {1} are its operands.
_FORMS = {
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_LE: "AT_MOST({0}, {1})",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_FABS: "ABSOLUTE({0})",
    ca.OP_SQRT: "SQUARE_ROOT({0})",
    ca.OP_TANH: "tangent({0})",
}
#: Other forms for scalars, which depend on parameters only.
_OF_NUMBERS = {ca.OP_FABS: "{0} < 0 ? -{0} : {0}", ca.OP_LE: "{0} <= {1}"}


def part(name: str) -> str:
    """The text of a file that goes into every library."""
    return (files(__package__) / "c" / name).read_text(encoding="utf-8")


def filled(name: str, values: Mapping[str, object]) -> str:
    """The text of a file with its blanks filled in."""
    return Template(part(name)).substitute(values)


class Style(NamedTuple):
    """Numbers of a precision in C."""

    type: str
    suffix: str
    digits: int
    head: str
    closed: float  #: Largest residual of closed loops, times the scale of the rows.
    rounding: float  #: Rounding, relative.
    angle: float  #: Largest entry of q.
    dtype: str
    last_step: float  #: After a Newton step up to this length the loops are closed.


#: Angles that are rounded to 24 bits leave loops open by some 1e-6.
STYLES = {
    "double": Style("double", "", 17, "", CLOSED, 2.0**-52, 1e6, "float64", 1e-8),
    "single": Style("float", "f", 9, "#define SINGLE\n", 1e-4, 2.0**-23, 1e3, "float32", 1e-5),
}


class KernelSource(NamedTuple):
    """The C of a kernel."""

    #: `void <name>(const real *x, parameters p, real *y)`, and before it
    #: `void <name>_constants(constants p)`. x holds the inputs one after the other, p the open
    #: parameters, then the constants that `<name>_constants` makes of them; y gets the output, then
    #: the checks, then what parts of the function hand on. Where the kernel has directions,
    #: `<name>_once` runs first, with the same arguments, for what does not depend on the direction.
    text: str
    #: Sizes of p and of y.
    size: int
    room: int


def body(
    kernel: SymbolicKernel, size: int | None = None, suffix: str = "", *, in_memory: bool = False
) -> KernelSource:
    """The C of a kernel. Terms that depend on p only are computed apart.

    With `in_memory` (GNU C), results that are used much later are kept in an array.

    `size` is that of p before its constants, `suffix` that of numbers, "f" in single precision.
    """
    writer = written(kernel, size, suffix)
    prepare = f"static void {kernel.name}_constants(constants p)"
    texts = [statements.function(prepare, ["(void)p;", *writer.lines["number"]])]
    lines, room = writer.lines["real"], kernel.output.numel() + kernel.checks.numel()
    arranged = statements.with_results_in_memory if in_memory else list
    if len(lines) <= statements.LARGEST and not kernel.directions:
        functions = {kernel.name: ["(void)p;", *arranged(statements.together(lines))]}
    else:
        whole = {kernel.name: lines}
        if kernel.directions:
            inputs = sum(symbols.numel() for symbols in kernel.inputs.values())
            once, each = statements.split(lines, range(inputs - kernel.directions, inputs))
            whole = {f"{kernel.name}_once": once, kernel.name: each}
        pieces = {name: statements.pieces(lines) for name, lines in whole.items()}
        parts, handed_on = statements.in_parts(list(pieces.values()))
        numbers = iter(range(len(parts)))
        functions = {
            name: [f"{kernel.name}_{next(numbers)}(x, p, y, y + {room});" for _ in pieces_of_one]
            for name, pieces_of_one in pieces.items()
        }
        arguments = "const real *x, parameters p, real *restrict y, real *restrict w"
        for k, piece in enumerate(parts):
            lines = ["(void)x, (void)p, (void)y, (void)w;", *arranged(piece)]
            texts.append(statements.function(f"PART {kernel.name}_{k}({arguments})", lines))
        room += handed_on
    for name, statements_of in functions.items():
        head = f"static void {name}(const real *x, parameters p, real *y)"
        texts.append(statements.function(head, statements_of))
    return KernelSource("\n".join(texts), writer.size, room)


def written(kernel: SymbolicKernel, size: int | None = None, suffix: str = "") -> "Writer":
    """Statements of a kernel, each in a form that is C; the arguments are those of `body`."""
    function = ca.Function(
        kernel.name,
        [ca.vertcat(*kernel.inputs.values()), kernel.parameters],
        [ca.densify(ca.vertcat(kernel.output, kernel.checks))],
        {"cse": True},
    )
    writer = Writer(size or kernel.parameters.numel())
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        arguments = function.instruction_input(k)
        (target, *place) = function.instruction_output(k)
        if operation == ca.OP_CONST:
            number = _literal(float(function.instruction_constant(k)), suffix)
            writer.names[target] = f"({number})" if number[0] == "-" else number, "number"
        elif operation == ca.OP_INPUT:
            array, i = arguments
            writer.names[target] = (f"x[{i}]", "real") if array == 0 else (f"p[{i}]", "number")
        elif operation == ca.OP_OUTPUT:
            result = writer.use(writer.names[arguments[0]], "real")
            writer.lines["real"].append(f"y[{place[0]}] = REAL({result});")
        else:
            operands = [writer.names[i] for i in arguments]
            writer.names[target] = writer.write(f"t{k}", operation, operands)
    return writer


def _literal(x: float, suffix: str) -> str:
    """A number in C; infinity and NaN too, as those of a robot without mass."""
    if isfinite(x):
        return repr(x) + suffix
    large = f"1e38{suffix} * 1e38{suffix}" if suffix else "1e308 * 1e308"
    return f"({large})" if x > 0 else f"(-({large}))" if x < 0 else f"(0 * ({large}))"


#: The name of an expression and its type: "real" of a sample, "number" of the parameters alone.
_Name = tuple[str, str]


class Writer:
    """Statements of a kernel, those of parameters apart from those of samples."""

    def __init__(self, size: int) -> None:
        self.names: dict[int, _Name] = {}  # the result in each place of the work vector
        self.lines: dict[str, list[str]] = {"real": [], "number": []}  # by the type of their result
        self.size = size  # of p
        self._constants: dict[str, str] = {}
        self._turns: dict[str, int] = {}
        self._inverses: dict[_Name, _Name] = {}
        self._directions: dict[str, str] = {}  # not yet written, with the arguments

    def use(self, name: _Name, kind: str) -> str:
        """The text of a name in a statement of a type; for samples, constants are read from p."""
        text, type_name = name
        if text in self._directions:
            of = self._directions.pop(text)
            line = f"const {type_name} {text} = direction({of}, {_OF_SIGNS});"
            self.lines[type_name].append(line)
        if kind == type_name or text[0] != "t":
            return text
        if text not in self._constants:
            self._constants[text] = f"p[{self.size}]"
            self.size += 1
            self.lines[type_name].append(f"{self._constants[text]} = {text};")
        return self._constants[text]

    def write(self, name: str, operation: int, operands: list[_Name]) -> _Name:
        """One operation, and the name of its result."""
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
        forms = _FORMS if kind == "real" else _FORMS | _OF_NUMBERS
        self.lines[kind].append(f"const {kind} {name} = {forms[operation].format(*texts)};")
        return name, kind

    def _inverse(self, name: _Name) -> _Name:
        """The reciprocal: divisions are slow, and many have the same divisor."""
        text, kind = name
        if name not in self._inverses:
            self._inverses[name] = f"ti{len(self._inverses)}", kind
            self.lines[kind].append(f"const {kind} {self._inverses[name][0]} = 1 / {text};")
        return self._inverses[name]


def library(entry: str, kernels: Sequence[SymbolicKernel], lanes: int) -> str:
    """Source of the library of a kernel, or of "closing" and "state_rate" for rollouts.

    It offers `run_<entry>`, which runs the kernel on rows of samples, `sizes_run_<entry>` (of p, of
    the output, of each input, -1) and `prepare_<entry>`. For rollouts, `run_<entry>` makes steps;
    `rate_<entry>`, with its sizes, runs "state_rate" on samples with q and va in one array.
    """
    parts = [f"#define LANES {lanes}", part("real.h"), part("driver.h")]
    size, room = None, 0
    for kernel in kernels:
        text, size, own_room = body(kernel, size, in_memory=True)
        parts.append(text)
        room = max(room, own_room)
    last = kernels[-1]
    inputs = [symbols.numel() for symbols in last.inputs.values()]
    outputs, directions = last.output.numel(), last.directions
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
        "checks": last.checks.numel(),
        "room": room,
    }
    parts.append(filled("entries/prepare.c", numbers))
    word, close, arrays = "run", "NULL", inputs[:-1] if directions else inputs
    if len(kernels) > 1:
        q, va, tau, *load = inputs
        word, close, arrays = "rate", kernels[0].name, [q + va, tau, *load]
        more = {"va": va, "tau": tau, "load": sum(load), "states": q + va, "close": close}
        more |= {"units": ", ".join(map(repr, kernels[0].units)), "bend": BEND}
        more |= {"close_checks": kernels[0].checks.numel(), "tolerance": CLOSURE_TOLERANCE}
        more |= {"travel": TRAVEL, "nearby": NEARBY * TRAVEL, "change": CHANGE}
        parts.append(filled("entries/roll.c", numbers | more))
        runs = {"word": "run", "sizes": ", ".join(map(str, inputs))}
        parts.append(filled("entries/sizes.c", numbers | runs))
    sizes = ", ".join(map(str, arrays))
    numbers |= {"word": word, "sizes": sizes, "arrays": len(arrays), "close": close}
    parts.append(filled(f"entries/{'along' if directions else 'run'}.c", numbers))
    parts.append(filled("entries/sizes.c", numbers))
    return "\n".join(parts)

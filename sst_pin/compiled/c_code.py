# SPDX-License-Identifier: BSD-2-Clause
"""Kernels as C99: straight-line code on `real`, a number or a vector of samples."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.resources import files
from math import isfinite
from string import Template
from typing import NamedTuple

import casadi as ca
from casadi import SX

from ..loops.continuity import TRAVEL
from ..model.thresholds import AT_REST, BEND, CLOSURE_TOLERANCE
from . import statements
from .along_directions import Directions
from .compiled_states import CHANGE, NEARBY
from .kernel_checks import CLOSED
from .kernels import SymbolicKernel
from .symbolic_parameters import SIGN_WIDTH

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


#: Arguments of the functions of passes.
_OF_PASSES = (
    "const number *restrict x, parameters p, const number *restrict o, const real *d, "
    "real *restrict y"
)


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

    #: `void <name>_constants(constants p)`, which makes constants of the open parameters, and the
    #: kernel, `void <name>(const real *x, parameters p, real *y)`. x holds the inputs one after the
    #: other, p the open parameters, then these constants; y gets the output, then the checks, then
    #: what parts of the function hand on.
    #:
    #: A kernel along directions has `<name>_once` with these arguments instead; y gets the factors
    #: of its solution before the checks.
    text: str
    #: Sizes of p and of y.
    size: int
    room: int
    #: Of a kernel along directions `<name>_once` and the functions of its passes,
    #: `void <name>_pass_<k>(x, p, const number *o, const real *d, real *y)`. o is the y of `_once`,
    #: d the direction, y gets the results, then the checks, then what parts hand on.
    functions: tuple[str, ...] = ()
    #: The largest y of a pass.
    room_of_passes: int = 0


def body(
    kernel: SymbolicKernel, size: int | None = None, suffix: str = "", *, in_memory: bool = False
) -> KernelSource:
    """The C of a kernel. Terms that depend on p only are computed apart.

    With `in_memory` (GNU C), results that are used much later are kept in an array.

    `size` is that of p before its constants, `suffix` that of numbers, "f" in single precision.
    """
    writer = written(kernel, size, suffix)
    name = kernel.name
    prepare = f"static void {name}_constants(constants p)"
    constants = statements.function(prepare, ["(void)p;", *writer.lines[NUMBER]])
    arranged = statements.with_results_in_memory if in_memory else list
    lines = writer.lines[ONCE]
    room = writer.room
    arguments = "const real *x, parameters p, real *restrict y"
    if kernel.along is None:
        text, room = _function("static", name, arguments, lines, room, arranged)
        return KernelSource(f"{constants}\n{text}", writer.size, room)
    once, room = _function("SEPARATE", f"{name}_once", arguments, lines, room, arranged)
    functions = [once]
    rooms = []
    arguments = _OF_PASSES
    for k, part in enumerate(kernel.along.passes):
        lines = writer.lines[k]
        of_pass = part.results.numel() + part.checks.numel()
        code = _function("SEPARATE", f"{name}_pass_{k}", arguments, lines, of_pass, arranged)
        functions.append(code[0])
        rooms.append(code[1])
    return KernelSource(constants, writer.size, room, tuple(functions), max(rooms))


def _function(
    storage: str,
    name: str,
    arguments: str,
    lines: Sequence[str],
    room: int,
    arranged: Callable[[Sequence[str]], list[str]],
) -> tuple[str, int]:
    """A function of some statements, divided into parts if it is long, and the size of its y."""
    names = [argument.split()[-1].lstrip("*") for argument in arguments.split(", ")]
    unused = " ".join(f"(void){x};" for x in names if x != "y")
    head = f"{storage} void {name}({arguments})"
    if len(lines) <= statements.LARGEST:
        return statements.function(head, [unused, *arranged(statements.together(lines))]), room
    parts, handed_on = statements.in_parts(statements.pieces(lines))
    texts: list[str] = []
    calls: list[str] = []
    for k, part in enumerate(parts):
        of_part = f"PART {name}_{k}({arguments}, real *restrict w)"
        texts.append(statements.function(of_part, [f"{unused} (void)w;", *arranged(part)]))
        calls.append(f"{name}_{k}({', '.join(names)}, y + {room});")
    texts.append(statements.function(head, calls))
    return "\n".join(texts), room + handed_on


def written(kernel: SymbolicKernel, size: int | None = None, suffix: str = "") -> "Writer":
    """Statements of a kernel, each in a form that is C; the arguments are those of `body`."""
    inputs = [ca.vertcat(*kernel.inputs.values()), kernel.parameters]
    passes = kernel.along.passes if kernel.along else []
    solution = kernel.along.solution if kernel.along else None
    factors = SX(0, 1) if solution is None else solution.factors
    outputs = [ca.vertcat(kernel.output, factors, kernel.checks)]
    for part in passes:
        inputs.append(part.direction)
        outputs.append(ca.vertcat(part.results, part.checks))
    function = ca.Function(kernel.name, inputs, list(map(ca.densify, outputs)), {"cse": True})
    writer = Writer(size or kernel.parameters.numel(), outputs[0].numel(), len(passes))
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        arguments = function.instruction_input(k)
        (target, *place) = function.instruction_output(k)
        if operation == ca.OP_CONST:
            number = _literal(float(function.instruction_constant(k)), suffix)
            writer.names[target] = f"({number})" if number[0] == "-" else number, NUMBER
        elif operation == ca.OP_INPUT:
            array, i = arguments
            kind = _KINDS_OF_INPUTS.get(array, array - len(_KINDS_OF_INPUTS))
            writer.names[target] = f"{_NAMES[min(kind, 0)]}[{i}]", kind
        elif operation == ca.OP_OUTPUT:
            kind = target - 1
            result = writer.use(writer.names[arguments[0]], kind)
            writer.lines[kind].append(f"y[{place[0]}] = REAL({result});")
        else:
            operands = [writer.names[i] for i in arguments]
            writer.names[target] = writer.write(f"t{k}", operation, operands)
    return writer


def _literal(x: float, suffix: str) -> str:
    """A number in C; infinity and NaN too, as those of a robot without mass."""
    if isfinite(x):
        return repr(x) + suffix
    infinity = "1e308 * 1e308"
    if suffix:  # single precision
        infinity = f"1e38{suffix} * 1e38{suffix}"
    if x > 0:
        return f"({infinity})"
    if x < 0:
        return f"(-({infinity}))"
    return f"(0 * ({infinity}))"  # NaN


#: What an expression depends on: the parameters alone, the sample too, or, from 0 on, the number of
#: a pass, the direction of that pass too.
NUMBER, ONCE = -2, -1
#: The array in which inputs of each kind are; passes have their own directions.
_NAMES = {NUMBER: "p", ONCE: "x", 0: "d"}
#: Kinds of the first inputs of CasADi's functions; the others are directions of passes.
_KINDS_OF_INPUTS = {0: ONCE, 1: NUMBER}
#: The name of an expression and what it depends on.
_Name = tuple[str, int]


class Writer:
    """Statements of a kernel, by what they depend on.

    Args:
        size: Number of open parameters.
        room: Number of results and checks that are computed once.
        passes: Number of passes along directions.
    """

    def __init__(self, size: int, room: int, passes: int = 0) -> None:
        self.names: dict[int, _Name] = {}  # the result in each place of the work vector
        self.lines: dict[int, list[str]] = {kind: [] for kind in range(NUMBER, passes)}
        self.size = size  # of p, the constants included
        self.room = room  # of y, the results that the passes use included
        self._constants: dict[str, str] = {}  # places in p of results that depend on p only
        self._handed_on: dict[str, str] = {}  # places in y of results that passes use
        self._turns: dict[str, int] = {}  # numbers of sine and cosine, by the angle
        self._inverses: dict[_Name, _Name] = {}  # reciprocals, by the number
        # Arguments of signs that are not written yet: a sign times a constant is one operation.
        self._directions: dict[str, str] = {}

    def use(self, name: _Name, kind: int) -> str:
        """The text of a name in a statement of a kind.

        Samples read constants from p, and passes read what is computed once from o.
        """
        text, depends_on = name
        lines = self.lines[depends_on]
        if text in self._directions:
            rate = self._directions.pop(text)
            declared = f"const {_type(depends_on)} {text}"
            lines.append(f"{declared} = direction({rate}, {_OF_SIGNS});")
        is_result = text[0] in "tsc"  # of a statement; the others are inputs and literals
        if kind == depends_on or not is_result:
            return text
        if depends_on == NUMBER:
            if text not in self._constants:
                self._constants[text] = f"p[{self.size}]"
                self.size += 1
                lines.append(f"{self._constants[text]} = {text};")
            return self._constants[text]
        if text not in self._handed_on:
            self._handed_on[text] = f"[{self.room}]"
            self.room += 1
            lines.append(f"y{self._handed_on[text]} = {text};")
        return f"o{self._handed_on[text]}"

    def write(self, name: str, operation: int, operands: list[_Name]) -> _Name:
        """One operation, and the name of its result."""
        if operation == ca.OP_INV:
            return self._inverse(operands[0])
        if operation == ca.OP_DIV:
            operation = ca.OP_MUL
            operands = [operands[0], self._inverse(operands[1])]
        kind = max(kind for _, kind in operands)
        lines = self.lines[kind]
        type_name = _type(kind)
        if operation == ca.OP_SIGN:
            self._directions[name] = self.use(operands[0], kind)
            return name, kind
        if operation == ca.OP_MUL and kind != NUMBER:
            for (text, _), (factor, of_factor) in (operands, operands[::-1]):
                if text in self._directions and of_factor == NUMBER:
                    x = self._directions[text]
                    F = self.use((factor, of_factor), kind)
                    lines.append(f"const real {name} = rubbing({x}, {F}, {_OF_SIGNS});")
                    return name, kind
        texts = [self.use(operand, kind) for operand in operands]
        first = texts[0]
        if operation in (ca.OP_SIN, ca.OP_COS):
            t = self._turns.setdefault(first, len(self._turns))
            declared = f"real s{t}, c{t}; sines_cosines(1, &{first}, &s{t}, &c{t});"
            if declared not in lines:
                lines.append(declared)
            return f"{'s' if operation == ca.OP_SIN else 'c'}{t}", kind
        forms = _FORMS | _OF_NUMBERS if kind == NUMBER else _FORMS
        lines.append(f"const {type_name} {name} = {forms[operation].format(*texts)};")
        return name, kind

    def _inverse(self, name: _Name) -> _Name:
        """The reciprocal: divisions are slow, and many have the same divisor."""
        text, kind = name
        if name not in self._inverses:
            inverse = f"ti{len(self._inverses)}"
            self._inverses[name] = inverse, kind
            self.lines[kind].append(f"const {_type(kind)} {inverse} = 1 / {text};")
        return self._inverses[name]


def _type(kind: int) -> str:
    """The C type of an expression."""
    return "number" if kind == NUMBER else "real"


def library(entry: str, kernels: Sequence[SymbolicKernel]) -> list[str]:
    """Sources of the library of a kernel, or of "closing" and "state_rate" for rollouts.

    It offers `run_<entry>`, which runs the kernel on rows of samples, `sizes_run_<entry>` (of p, of
    the output, of each input, -1) and `prepare_<entry>`. For rollouts, `run_<entry>` makes steps;
    `rate_<entry>`, with its sizes, runs "state_rate" on samples with q and va in one array.

    An option of the compiler defines LANES, the number of samples that are computed at once. Of a
    kernel along directions it is the number of directions; what is computed once for a sample is
    in a source of its own, on plain numbers.
    """
    head = part("real.h")
    parts = [head, part("driver.h")]
    sources = list[str]()
    size = None
    room = 0
    of_passes = 0
    for kernel in kernels:
        source = body(kernel, size, in_memory=True)
        size = source.size
        room = max(room, source.room)
        of_passes = source.room_of_passes
        parts.append(source.text)
        if source.functions:
            once, *passes = source.functions
            sources.append(f"#undef LANES\n#define LANES 1\n{head}\n{once}")
            sources += [f"{head}\n{text}" for text in passes]
    last = kernels[-1]
    arrays = [symbols.numel() for symbols in last.inputs.values()]
    along = last.along
    outputs = last.output.numel()
    numbers: dict[str, object] = {
        "entry": entry,
        "calls": "\n    ".join(f"{kernel.name}_constants(p);" for kernel in kernels),
        "size": size,
        "name": last.name,
        "q": arrays[0],
        "inputs": sum(arrays),
        "outputs": outputs,
        "results": along.size if along else outputs,
        "checks": last.checks.numel(),
        "room": room,
    }
    parts.append(filled("entries/prepare.c", numbers))
    word = "run"
    close = "NULL"
    if len(kernels) > 1:
        q, va, tau, *load = arrays
        word = "rate"
        close = kernels[0].name
        arrays = [q + va, tau, *load]
        more = {"va": va, "tau": tau, "load": sum(load), "states": q + va, "close": close}
        more |= {"units": ", ".join(map(repr, kernels[0].units)), "bend": BEND}
        more |= {"close_checks": kernels[0].checks.numel(), "tolerance": CLOSURE_TOLERANCE}
        more |= {"travel": TRAVEL, "nearby": NEARBY * TRAVEL, "change": CHANGE}
        parts.append(filled("entries/roll.c", numbers | more))
        runs = {"word": "run", "sizes": ", ".join(map(str, (q, va, tau, *load)))}
        parts.append(filled("entries/sizes.c", numbers | runs))
    numbers |= {"word": word, "sizes": _listed(arrays), "arrays": len(arrays), "close": close}
    if along is None:
        parts.append(filled("entries/run.c", numbers))
    else:
        numbers |= blanks_of_directions(along) | _blanks_of_passes(last.name, along)
        parts.append(filled("entries/along.c", numbers | {"room_of_passes": of_passes}))
    parts.append(filled("entries/sizes.c", numbers))
    return ["\n".join(parts), *sources]


def _blanks_of_passes(name: str, along: Directions) -> dict[str, object]:
    """Texts for the blanks that list the passes of a kernel in C."""
    declarations = [f"void {name}_once(const number *x, parameters p, number *restrict y);"]
    passes = []
    for k, part in enumerate(along.passes):
        declarations.append(f"void {name}_pass_{k}({_OF_PASSES});")
        sizes = len(part.coordinates), len(part.places), part.checks.numel()
        arrays = f"directions_{k}, places_{k}, strides_{k}"
        passes.append(f"{{{name}_pass_{k}, {_listed(sizes)}, {arrays}}}")
    return {"declarations": "\n".join(declarations), "passes": ", ".join(passes)}


def blanks_of_directions(along: Directions) -> dict[str, object]:
    """Texts for the blanks of the templates of kernels along directions, in C and in Warp."""
    tables = list[str]()
    order = list[int]()
    entries = list[tuple[int, int]]()
    for k, part in enumerate(along.passes):
        numbers = {
            "directions": part.coordinates,
            "places": [place.first for place in part.places],
            "strides": [place.stride for place in part.places],
        }
        arrays = (f"{name}_{k}[] = {{{_listed(x)}}}" for name, x in numbers.items())
        tables.append(f"static const int {', '.join(arrays)};")
    if along.solution is not None:
        order = along.solution.order
        entries = along.solution.entries
    return {
        "results": along.size,
        "tables": "\n    ".join(tables),
        "count": len(along.passes),
        "known_at": _listed(along.places),
        "width": along.width,
        "rank": len(order),
        "order": _listed(order),
        "entries": len(entries),
        "entry_at": _listed([i for entry in entries for i in entry]),
    }


def _listed(numbers: Iterable[int]) -> str:
    """Numbers of an array in C; an empty one gets a zero."""
    return ", ".join(map(str, numbers)) or "0"

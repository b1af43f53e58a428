# SPDX-License-Identifier: BSD-2-Clause
"""The statements of a kernel in C: one for each operation of its CasADi function.

A kernel *along directions* computes a matrix column by column (`along_directions`). Its C consists
of a function that runs once for a sample, and of *passes*, functions that compute the columns of a
group of coordinates. Any other kernel has no passes.

Arrays of the statements:

    x   the inputs of the sample, one after the other
    p   the symbolic parameters, then constants that are computed from them alone
    y   of the function that runs once: results, the factors with which the passes solve, checks;
        of a pass: results, checks
    d   in a pass, the direction: a rate for each coordinate of the pass
    o   in a pass, the array y of the function that runs once for the sample

What depends on parameters only is computed once for all samples, and what depends on the sample
only is computed once for all directions. So each expression is written into the statements of what
it *depends on*:

    OF_PARAMETERS   the parameters alone
    OF_SAMPLE       the sample, too
    k = 0, 1, ...   the direction of pass k, too

These are the *sorts* of statements: -2, -1, 0, and so on. They run in this order. So the result of
an operation has the largest sort of its operands. Passes do not read each other's results. If a
statement needs a result of an earlier sort, this result is stored: constants at the end of p,
results of the sample at the end of y.

`written` translates the CasADi function operation by operation; a `Writer` holds the statements.

**Coulomb friction.** CasADi has two operations for F sign(v): a sign, and a product with the
constant F. In C both are one call `rubbing(v, F, ...)`, which returns at once if F is zero. So a
sign is not written at once. It is *pending* until an operation other than such a product uses it.
"""

from math import isfinite
from typing import NamedTuple

import casadi as ca
from casadi import SX

from ..model.thresholds import AT_REST
from .kernels import SymbolicKernel
from .symbolic_parameters import SIGN_WIDTH

OF_PARAMETERS = -2
OF_SAMPLE = -1

#: Arguments of the sign function after the rate: its width, and the rate below which a joint rests.
_SIGN_ARGUMENTS = f"p[{SIGN_WIDTH}], N({AT_REST})"
#: C of each operation; {0} and {1} are its operands. c/real.h defines the macros and functions.
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
#: Other forms for expressions of the parameters, which are scalars.
_FORMS_OF_SCALARS = {ca.OP_FABS: "{0} < 0 ? -{0} : {0}", ca.OP_LE: "{0} <= {1}"}


class Expression(NamedTuple):
    """An expression in C."""

    #: The name of a result of a statement, an entry of an array, or a literal.
    text: str
    #: What it depends on: the sort of statements that it belongs to.
    depends_on: int

    @property
    def is_result(self) -> bool:
        """Whether it is a result of a statement; their names begin with t, s or c."""
        return self.text[0] in "tsc"


def written(kernel: SymbolicKernel, p_size: int | None = None, suffix: str = "") -> "Writer":
    """The statements of a kernel.

    Args:
        kernel: The kernel.
        p_size: Size of p before the constants of this kernel; by default the number of parameters.
        suffix: The suffix of literals, "f" in single precision.
    """
    # The CasADi function. Inputs: x, p, then the direction of each pass. Outputs: y of the function
    # that runs once (of a kernel without passes: its only one), then y of each pass.
    inputs = [ca.vertcat(*kernel.inputs.values()), kernel.parameters]
    passes = []
    factors = SX(0, 1)
    if kernel.along is not None:
        passes = kernel.along.passes
        if kernel.along.solution is not None:
            factors = kernel.along.solution.factors
    outputs = [ca.vertcat(kernel.output, factors, kernel.checks)]
    for part in passes:
        inputs.append(part.direction)
        outputs.append(ca.vertcat(part.results, part.checks))
    function = ca.Function(kernel.name, inputs, list(map(ca.densify, outputs)), {"cse": True})

    writer = Writer(p_size or kernel.parameters.numel(), outputs[0].numel(), len(passes))
    # An instruction reads and writes entries of a work array; each holds an expression.
    work = dict[int, Expression]()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        arguments = function.instruction_input(k)
        if operation == ca.OP_OUTPUT:
            output, entry = function.instruction_output(k)
            # Output 0 is y of the function that runs once, whose sort is -1, and so on.
            writer.store(entry, work[arguments[0]], in_function=output - 1)
            continue
        (target,) = function.instruction_output(k)
        if operation == ca.OP_CONST:
            work[target] = _literal(float(function.instruction_constant(k)), suffix)
        elif operation == ca.OP_INPUT:
            work[target] = _input(*arguments)
        else:
            work[target] = writer.write(f"t{k}", operation, [work[i] for i in arguments])
    return writer


def _input(number: int, entry: int) -> Expression:
    """An entry of an input of the CasADi function: of x, p, or the direction of a pass."""
    if number == 0:
        return Expression(f"x[{entry}]", OF_SAMPLE)
    if number == 1:
        return Expression(f"p[{entry}]", OF_PARAMETERS)
    return Expression(f"d[{entry}]", number - 2)


def _literal(x: float, suffix: str) -> Expression:
    """A number in C. Infinity and NaN occur for a robot without mass, for instance."""
    infinity = "1e308 * 1e308"
    if suffix:  # single precision
        infinity = f"1e38{suffix} * 1e38{suffix}"
    if isfinite(x):
        text = repr(x) + suffix
        if text[0] == "-":
            text = f"({text})"
    elif x > 0:
        text = f"({infinity})"
    elif x < 0:
        text = f"(-({infinity}))"
    else:  # NaN
        text = f"(0 * ({infinity}))"
    return Expression(text, OF_PARAMETERS)


class Writer:
    """Writes statements, sorted by what they depend on.

    Args:
        p_size: Size of p before the constants of this kernel.
        y_size: Size of y in the function that runs once, before results are stored for passes.
        passes: Number of passes along directions.

    Attributes:
        lines: The statements of each sort.
        p_size: Size of p, with the constants that were stored so far.
        y_size: Size of y, with the results for passes that were stored so far.
    """

    def __init__(self, p_size: int, y_size: int, passes: int = 0) -> None:
        self.lines: dict[int, list[str]] = {sort: [] for sort in range(OF_PARAMETERS, passes)}
        self.p_size = p_size
        self.y_size = y_size
        #: The entry of p that stores a result of parameters, by the name of the result.
        self._in_p: dict[str, str] = {}
        #: The index "[k]" in y, which passes read as o, of a result of the sample, by its name.
        self._in_y: dict[str, str] = {}
        #: The number k of the sine sk and the cosine ck, by the angle.
        self._angles: dict[str, int] = {}
        #: Reciprocals of expressions.
        self._inverses: dict[Expression, Expression] = {}
        #: The rates v of pending signs, by the name of the sign; see the module.
        self._pending_signs: dict[str, str] = {}

    def store(self, entry: int, result: Expression, in_function: int) -> None:
        """Write an entry of y of a function: in_function is `OF_SAMPLE` or the number of a pass."""
        text = self._make_available(result, in_function)
        self.lines[in_function].append(f"y[{entry}] = REAL({text});")

    def write(self, name: str, operation: int, operands: list[Expression]) -> Expression:
        """Write one operation, whose result gets a name."""
        if operation == ca.OP_INV:
            return self._inverse(operands[0])
        if operation == ca.OP_DIV:
            operation = ca.OP_MUL
            operands = [operands[0], self._inverse(operands[1])]
        depends_on = max(operand.depends_on for operand in operands)
        lines = self.lines[depends_on]
        if operation == ca.OP_SIGN:
            self._pending_signs[name] = self._make_available(operands[0], depends_on)
            return Expression(name, depends_on)
        if operation == ca.OP_MUL and self._write_friction(name, operands):
            return Expression(name, depends_on)
        texts = [self._make_available(operand, depends_on) for operand in operands]
        if operation in (ca.OP_SIN, ca.OP_COS):
            # One statement makes both, at the first use of one of them.
            angle = texts[0]
            if angle not in self._angles:
                k = len(self._angles)
                self._angles[angle] = k
                lines.append(f"real s{k}, c{k}; sines_cosines(1, &{angle}, &s{k}, &c{k});")
            letter = "s" if operation == ca.OP_SIN else "c"
            return Expression(f"{letter}{self._angles[angle]}", depends_on)
        form = _FORMS[operation]
        if depends_on == OF_PARAMETERS:
            form = _FORMS_OF_SCALARS.get(operation, form)
        lines.append(f"const {_type(depends_on)} {name} = {form.format(*texts)};")
        return Expression(name, depends_on)

    def _write_friction(self, name: str, operands: list[Expression]) -> bool:
        """Write the product of a pending sign and a constant; False if it is another product.

        The sign stays pending, because the call takes the rate, not the sign.
        """
        depends_on = max(operand.depends_on for operand in operands)
        if depends_on == OF_PARAMETERS:
            return False
        first, second = operands
        for sign, factor in ((first, second), (second, first)):
            if sign.text in self._pending_signs and factor.depends_on == OF_PARAMETERS:
                rate = self._pending_signs[sign.text]
                force = self._make_available(factor, depends_on)
                call = f"rubbing({rate}, {force}, {_SIGN_ARGUMENTS})"
                self.lines[depends_on].append(f"const real {name} = {call};")
                return True
        return False

    def _inverse(self, x: Expression) -> Expression:
        """The reciprocal, which is written at its first use.

        A quotient becomes a product with it: divisions are slow, and many have the same divisor.
        """
        if x not in self._inverses:
            inverse = Expression(f"ti{len(self._inverses)}", x.depends_on)
            self._inverses[x] = inverse
            text = self._make_available(x, x.depends_on)
            self.lines[x.depends_on].append(
                f"const {_type(x.depends_on)} {inverse.text} = 1 / {text};"
            )
        return self._inverses[x]

    def _make_available(self, x: Expression, sort: int) -> str:
        """The text by which statements of a sort read x, once this has written what they need.

        It writes x itself if x is a pending sign, and a copy in p or y if x is a result of an
        earlier sort. All functions can read inputs and literals as they are.
        """
        if x.text in self._pending_signs:
            self._write_pending_sign(x)
        if sort == x.depends_on or not x.is_result:
            return x.text
        if x.depends_on == OF_PARAMETERS:
            return self._copy_to_p(x)
        return self._copy_to_y(x)

    def _write_pending_sign(self, sign: Expression) -> None:
        """Write a sign, which is then a result as any other."""
        rate = self._pending_signs.pop(sign.text)
        self.lines[sign.depends_on].append(
            f"const {_type(sign.depends_on)} {sign.text} = direction({rate}, {_SIGN_ARGUMENTS});"
        )

    def _copy_to_p(self, x: Expression) -> str:
        """The entry of p with a result of parameters; its first reader makes the copy."""
        if x.text not in self._in_p:
            self._in_p[x.text] = f"p[{self.p_size}]"
            self.p_size += 1
            self.lines[x.depends_on].append(f"{self._in_p[x.text]} = {x.text};")
        return self._in_p[x.text]

    def _copy_to_y(self, x: Expression) -> str:
        """The entry of o with a result of the sample; its first reader makes the copy.

        The function that runs once writes it as y, and a pass reads the same array as o.
        """
        if x.text not in self._in_y:
            self._in_y[x.text] = f"[{self.y_size}]"
            self.y_size += 1
            self.lines[x.depends_on].append(f"y{self._in_y[x.text]} = {x.text};")
        return f"o{self._in_y[x.text]}"


def _type(depends_on: int) -> str:
    """The C type of an expression."""
    return "number" if depends_on == OF_PARAMETERS else "real"

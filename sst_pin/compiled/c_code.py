# SPDX-License-Identifier: BSD-2-Clause
"""Kernels as C99: straight-line code on `real`, which is a double or a vector of samples."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files

import casadi as ca

from .kernels import Kernel
from .parameters import SIGN_WIDTH

_BINARY = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/"}
_UNARY = {
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_FABS: "ABSOLUTE({0})",
    ca.OP_SQRT: "square_root({0})",
}


def part(name: str) -> str:
    """The text of a file that goes into every library."""
    return (files(__package__) / "c" / name).read_text(encoding="utf-8")


def body(kernel: Kernel) -> str:
    """The C function `void <name>(const real *x, const double *p, real *y)` of a kernel.

    x holds its inputs one after the other, p the open parameters, y its output, then its checks.
    """
    function = ca.Function(
        kernel.name,
        [ca.vertcat(*kernel.inputs), kernel.parameters],
        [ca.densify(ca.vertcat(kernel.output, kernel.checks))],
        {"cse": True},
    )
    names: dict[int, tuple[str, str]] = {}  # of what stands in the work vector, with its type
    turns: dict[str, str] = {}
    lines = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        arguments = function.instruction_input(k)
        (target, *place) = function.instruction_output(k)
        if operation == ca.OP_CONST:
            number = repr(float(function.instruction_constant(k)))
            names[target] = (f"({number})" if number[0] == "-" else number), "double"
            continue
        if operation == ca.OP_INPUT:
            array, i = arguments
            names[target] = (f"x[{i}]", "real") if array == 0 else (f"p[{i}]", "double")
            continue
        if operation == ca.OP_OUTPUT:
            lines.append(f"y[{place[0]}] = (real){{0}} + {names[arguments[0]][0]};")
            continue
        operands = [names[i] for i in arguments]
        first = operands[0][0]
        kind = "real" if ("real" in {kind for _, kind in operands}) else "double"
        if operation in (ca.OP_SIN, ca.OP_COS):
            if first not in turns:
                turns[first] = str(len(turns))
                t = turns[first]
                lines.append(f"real s{t}, c{t}; sine_cosine({first}, &s{t}, &c{t});")
            names[target] = ("s" if operation == ca.OP_SIN else "c") + turns[first], "real"
            continue
        if operation in _BINARY:
            text = f"{first} {_BINARY[operation]} {operands[1][0]}"
        elif operation == ca.OP_SIGN:
            text = f"direction({first}, p[{SIGN_WIDTH}])"
        else:
            text = _UNARY[operation].format(first)
        name = f"t{k}"
        lines.append(f"const {kind} {name} = {text};")
        names[target] = name, kind
    return (
        "\n    ".join(
            [
                f"static void {kernel.name}(const real *x, const double *p, real *y)\n{{",
                "(void)p;",
                *lines,
            ]
        )
        + "\n}\n"
    )


def library(kernels: Sequence[Kernel], lanes: int) -> str:
    """Source of a library that runs one kernel on rows of samples, or the two of a rollout.

    Args:
        kernels: One; or "state_rate" and "closing".
        lanes: How many samples at once.
    """
    first = kernels[0]
    sizes = [symbols.numel() for symbols in first.inputs]
    outputs, checks = first.output.numel(), first.checks.numel()
    parts = [f"#define LANES {lanes}", part("real.h"), part("driver.h"), *map(body, kernels)]
    listed = ", ".join(map(str, sizes))
    numbers = f"const int sizes[] = {{{outputs}, {listed}, 0}};"
    if len(kernels) == 1:
        entry = _ENTRY.format(
            name=first.name,
            sizes=listed,
            arrays=len(sizes),
            inputs=sum(sizes),
            outputs=outputs,
            checks=checks,
            total=outputs + checks,
        )
    else:
        second = kernels[1]
        entry = _ROLL.format(
            rate=first.name,
            close=second.name,
            q=sizes[0],
            va=sizes[1],
            tau=sizes[2],
            load=sum(sizes[3:]),
            checks=checks,
            inputs=sum(sizes),
            outputs=max(outputs + checks, second.output.numel() + second.checks.numel()),
            states=sizes[0] + sizes[1],
        )
    return "\n".join([*parts, numbers, entry])


_ENTRY = """
int run_kernel(const rows *in, const rows *out, const double *p, ptrdiff_t count,
    unsigned char *bad)
{{
    static const int sizes_in[] = {{{sizes}}};
    real x[{inputs}], y[{total}];
    return run({name}, {arrays}, sizes_in, {inputs}, {outputs}, {checks}, x, y, in, out, p,
        count, bad);
}}
"""

_ROLL = """
int run_kernel(const rows *in, const courses *tau, ptrdiff_t half, const courses *out,
    const double *p, double h, ptrdiff_t steps, ptrdiff_t count, ptrdiff_t *reached)
{{
    static const stepper f = {{{q}, {va}, {tau}, {load}, {checks}, {rate}, {close}}};
    real x[{inputs}], y[{outputs}], start[{states}], sum[{states}];
    return roll(&f, x, y, start, sum, in, tau, half, out, p, h, steps, count, reached);
}}
"""

# SPDX-License-Identifier: BSD-2-Clause
"""Functions of CasADi, and their first derivatives, as compiled C that CasADi calls."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
from casadi import SX, Function, Sparsity

from . import build, c_code
from .kernels import Kernel


def compiled(robot: str, function: Function, order: int) -> Function:
    """The same function as an external one, from the cache or compiled now.

    Args:
        robot: A name to tell the library by.
        function: Of expressions in `SX`.
        order: Of its derivatives: with 1 it has a Jacobian, with 0 none.

    Raises:
        CompilationError: Without a compiler, or when it fails.
    """
    name, content = function.name(), f"{order} {function.serialize()}".encode()

    def source() -> str:
        functions = [function, function.jacobian()] if order else [function]
        heads = [c_code.part("real.h"), "#include <math.h>\n"]
        return "\n".join([*heads, *map(_source, functions)])

    library = build.library(robot, f"casadi_{name}", content, "plain", source)
    return ca.external(name, library._name)


def _source(function: Function) -> str:
    """A function of CasADi in C, and what CasADi asks about it."""
    name, symbols = function.name(), function.sx_in()
    inputs, results = ([SX(x.nz[:]) for x in group] for group in (symbols, function.call(symbols)))
    kernel = Kernel(f"{name}_body", tuple(inputs), SX(0, 1), ca.vertcat(*results), SX(0, 1))
    body = c_code.body(kernel)
    sizes_in, sizes_out = ([x.numel() for x in group] for group in (inputs, results))
    numbers = {
        "name": name,
        "inputs": max(sum(sizes_in), 1),
        "room": body.room,
        "size": max(body.size, 1),
        "takes": _copies("x[{at} + k] = arg[{i}] ? arg[{i}][k] : 0;", sizes_in),
        "gives": _copies("if (res[{i}])\n            res[{i}][k] = y[{at} + k];", sizes_out),
    }
    patterns_in = [function.sparsity_in(i) for i in range(len(inputs))]
    patterns_out = [function.sparsity_out(i) for i in range(len(results))]
    about = [
        _about(name, "in", function.name_in(), patterns_in),
        _about(name, "out", function.name_out(), patterns_out),
    ]
    return "\n".join([body.text, _CALL.format(**numbers), *about])


def _copies(statement: str, sizes: Sequence[int]) -> str:
    """Loops over the numbers of each array, which stand one after the other."""
    loops = []
    for i, size in enumerate(sizes):
        body = statement.format(i=i, at=sum(sizes[:i]))
        if size:
            loops.append(f"for (int k = 0; k < {size}; k++)\n        {body}")
    return "\n    ".join(loops)


def _about(name: str, side: str, names: Sequence[str], patterns: Sequence[Sparsity]) -> str:
    """Names and patterns of the inputs or outputs."""
    lists = [
        f"static const long long {name}_{side}_{i}[] = {{{', '.join(map(str, x.compress()))}}};"
        for i, x in enumerate(patterns)
    ]
    return _ABOUT.format(
        name=name,
        side=side,
        count=len(names),
        lists="\n".join(lists),
        listed=", ".join(f"{name}_{side}_{i}" for i in range(len(names))),
        names=", ".join(f'"{x}"' for x in names),
    )


_CALL = """\
int {name}(const double **arg, double **res, long long *iw, double *w, int mem)
{{
    double x[{inputs}], y[{room}], p[{size}];
    (void)iw, (void)w, (void)mem;
    {takes}
    {name}_body_constants(p);
    {name}_body(x, p, y);
    {gives}
    return 0;
}}
"""

_ABOUT = """\
{lists}

long long {name}_n_{side}(void)
{{
    return {count};
}}

const long long *{name}_sparsity_{side}(long long i)
{{
    static const long long *const patterns[] = {{{listed}}};
    return patterns[i];
}}

const char *{name}_name_{side}(long long i)
{{
    static const char *const names[] = {{{names}}};
    return names[i];
}}
"""

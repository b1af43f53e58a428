# SPDX-License-Identifier: BSD-2-Clause
"""Kernels for NVIDIA Warp: Python modules whose native functions hold the C of `c_code`.

A thread computes one sample. The statements are those of the C, in a class of a native function, as
C++ allows no function in a function.
"""

from collections.abc import Iterable, Sequence

from ..loops.continuity import TRAVEL
from ..model.thresholds import BEND
from . import c_code
from .c_code import Style
from .compiled_states import CHANGE, NEARBY
from .kernels import WRENCHES, SymbolicKernel
from .open_numbers import SIGN_WIDTH

#: The longest first Newton step onto the closures, [rad] or robot lengths, and the largest ratio of
#: a step to the one before.
_NEAR, _SHRINKS = 0.1, 0.1

_MODULE = '''\
"""A kernel of sst_pin for Warp."""
import sys
import warp as wp

real, rows = wp.{dtype}, wp.array2d(dtype=wp.{dtype})
wp.set_module_options({{"enable_backward": False}}, sys.modules[__name__])


@wp.func_native({prepare!r})
def prepare_sample(i: int, numbers: rows, width: real, p: rows): ...


@wp.kernel
def prepare(numbers: rows, width: real, p: rows):
    prepare_sample(wp.tid(), numbers, width, p)


@wp.func_native({run!r})
def run_sample(i: int, {typed}): ...


@wp.kernel
def run({typed}):
    run_sample(wp.tid(), {names})


size = {size}
'''


def module(kernels: Sequence[SymbolicKernel], entry: str, style: Style) -> str:
    """A Python module of Warp's kernels `prepare` and `run`, and `size`, the rows of p.

    Args:
        kernels: The kernel, for steps the one of closing before it.
        entry: "run", "along", "close" or "step".
        style: Numbers of its precision.
    """
    size, room, texts = None, 0, []
    for kernel in kernels:
        source = c_code.body(kernel, size, style.suffix)
        size, room = source.size, max(room, source.room)
        texts.append(source.text)
    last, sizes = kernels[-1], {x: s.numel() for x, s in kernels[-1].inputs.items()}
    arrays = [x for x, n in sizes.items() if n and x != "direction"]
    blanks = {
        "name": last.name,
        "close": kernels[0].name,
        "arrays": ", ".join(f"const rows &{x}" for x in arrays),
        "takes": "\n    ".join(_takes(sizes)),
        "directions": last.directions,
        "q": sizes["q"],
        "states": last.output.numel(),
        "inputs": sum(sizes.values()),
        "outputs": last.output.numel(),
        "room": room,
        "checks": last.checks.numel(),
        "close_checks": kernels[0].checks.numel(),
        "units": ", ".join(map(repr, last.units)),
        "change": f"N({CHANGE})",
        "nearby": NEARBY * TRAVEL,
        "travel": TRAVEL,
        "bend": BEND,
        "near": _NEAR,
        "shrinks": _SHRINKS,
        "tolerance": 2 * style.closed,
        "open": last.parameters.numel(),
        "sign_width": SIGN_WIDTH,
        "constants": "\n    ".join(f"{kernel.name}_constants(own);" for kernel in kernels),
    }
    functions = "\n".join(texts)
    results = ["q_next", "va_next"] if entry == "step" else ["out"]
    scalars = ["h", "steps"] if entry == "step" else []
    arrays += ["p", *results]
    types = dict.fromkeys(arrays, "rows") | {"h": "real", "steps": "int"}
    types |= {WRENCHES: f"wp.array3d(dtype=wp.{style.dtype})", "status": "wp.array1d(dtype=int)"}
    names = [*arrays, *scalars, "status"]
    return _MODULE.format(
        dtype=style.dtype,
        prepare=_native("prepare", ["numbers", "width", "p"], functions, style, blanks),
        run=_native(entry, names, functions, style, blanks),
        typed=", ".join(f"{name}: {types[name]}" for name in names),
        names=", ".join(names),
        size=size,
    )


def _native(
    entry: str, names: Sequence[str], functions: str, style: Style, blanks: dict[str, object]
) -> str:
    """The body of a native function."""
    parts = [
        "#undef LANES\n#undef TURNS\n#define restrict __restrict__",
        f"{style.head}#define LAST_STEP N({style.last_step})\nstruct kernel {{",
        c_code.part("real.h"),
        c_code.part("warp.h"),
        functions,
        c_code.filled(f"entries/warp_{entry}.h", blanks),
        f"}};\nkernel::run(i, {', '.join(names)});".replace("status", "status.data"),
    ]
    return "\n".join(parts)


def _takes(sizes: dict[str, int]) -> Iterable[str]:
    at = 0
    for name, size in sizes.items():
        if size and name != "direction":
            take = "take_wrenches" if name == WRENCHES else "take"
            yield f"{take}(x + {at}, {name}, i, {size});"
        at += size

# SPDX-License-Identifier: BSD-2-Clause
"""Python modules of kernels for NVIDIA Warp, whose native functions hold the C of `c_code`.

A module has two kernels. `prepare` computes p, an array of the parameters and the constants that
depend on them alone. `run` computes the samples, one in each thread. The text of a native function
stands inside a function of C++, where no other function can be defined. So all functions of the C
are members of a class.
"""

from collections.abc import Mapping, Sequence

from ..loops.continuity import TRAVEL
from ..model.thresholds import BEND
from . import c_code
from .along_directions import Directions
from .c_code import KernelSources, Style
from .compiled_states import CHANGE, NEARBY
from .kernels import WRENCHES, SymbolicKernel
from .nonsmooth_c import SOLVER, StepSource
from .symbolic_parameters import SIGN_WIDTH

#: Newton's method onto the closures: the longest first step, [rad] or robot lengths, and the
#: largest ratio of a step to the one before. Steps that start short and shrink as fast lead to the
#: one solution nearby: with both numbers, all further steps together are at most 0.011.
_LONGEST_FIRST_STEP = 0.1
_LARGEST_RATIO = 0.1

# Arguments of the kernels and their types. Arrays that a quantity does not need are None.
_PREPARE = {
    "numbers": "rows",  # the parameters
    "width": "real",  # of the sign of dry friction; negative: as in the parameters
    "p": "rows",  # the result
}
#: Arguments of `run` from which a generated kernel takes its inputs, in this order. Some kernels
#: take only the first ones: "closing" q, and the terms of nonsmooth steps q and va.
_SAMPLES = {
    "q": "rows",
    "va": "rows",
    "last": "rows",  # aa or tau
}
#: Arguments of `run`.
RUN = _SAMPLES | {
    WRENCHES: "loads",
    "p": "rows",
    "out": "rows",  # for steps q
    "va_out": "rows",
    "h": "real",  # length of a step, [s]
    "steps": "int",
    "status": "flags",
}
#: Arguments of `run` for nonsmooth steps.
NONSMOOTH = {
    "q": "rows",
    "va": "rows",
    "tau": "rows",
    WRENCHES: "loads",
    "p": "rows",
    "numbers": "rows",  # of contacts, ropes, cables, stops, friction and gains
    "held": "rows",  # positions of the motors
    "start": "rows",  # impulses where the solver starts
    # the results, in the order of `NonsmoothState`
    "q_out": "rows",
    "va_out": "rows",
    "contact_forces": "rows",
    "tensions": "rows",
    "joint_forces": "rows",
    "line_friction": "rows",
    "residual": "rows",
    "impulses": "rows",
    "h": "real",  # length of a step, [s]
    "steps": "int",
    "series": "int",  # the most rounds of the solver in a step
    "violation": "real",  # at the start, relative to that with which a motion may start
    "status": "flags",
}

#: The start of a module; `size` is the number of rows of p.
_HEAD = '''\
"""Kernels of sst_pin for Warp."""
import sys
import warp as wp

real, rows = wp.{dtype}, wp.array2d(dtype=wp.{dtype})
loads, flags = wp.array3d(dtype=real), wp.array1d(dtype=int)
wp.set_module_options({{"enable_backward": False}}, sys.modules[__name__])
size = {size}
'''
_KERNEL = """

@wp.func_native({body!r})
def {name}_sample(i: int, {arguments}): ...


@wp.kernel
def {name}({arguments}):
    {name}_sample(wp.tid(), {names})
"""


def module(kernels: Sequence[SymbolicKernel], entry: str, style: Style) -> str:
    """The text of a module that evaluates a generated kernel or makes smooth steps.

    Args:
        kernels: The kernel. For steps: "closing", then the kernel of the rates of a state.
        entry: Template of `run`: "run"; "along" for derivatives; "close" for "closing"; "step".
        style: Numbers of its precision.
    """
    kernel = kernels[-1]
    sources = c_code.bodies(kernels, style.suffix, recompute=True)
    blanks = _blanks_of_inputs(kernel) | {
        "name": kernel.name,
        "room": sources.room,
        "outputs": kernel.output.numel(),
        "checks": kernel.checks.numel(),
    }
    if kernel.along is not None:
        blanks |= _blanks_of_directions(kernel.along)
        blanks["room_of_passes"] = sources.room_of_passes
    if entry in ("close", "step"):
        blanks |= _blanks_of_closing(kernels[0], style)
    run = _kernel("run", RUN, sources, [c_code.filled(f"entries/warp_{entry}.h", blanks)], style)
    return _module(kernels, sources, run, style)


def nonsmooth_module(source: StepSource, style: Style) -> str:
    """The text of a module that makes nonsmooth steps."""
    _, terms, _ = source.kernels
    sources = c_code.bodies(source.kernels, style.suffix, recompute=True)
    blanks = _blanks_of_inputs(terms) | source.blanks | {"room": sources.room}
    code = [
        *map(c_code.part, (*SOLVER, "nonsmooth_move.h")),
        c_code.filled("entries/warp_nonsmooth.h", blanks),
    ]
    run = _kernel("run", NONSMOOTH, sources, code, style)
    return _module(source.kernels, sources, run, style)


def _module(
    kernels: Sequence[SymbolicKernel], sources: KernelSources, run: str, style: Style
) -> str:
    """The text of a module with this kernel `run`."""
    constants = "\n    ".join(f"{kernel.name}_constants(own);" for kernel in kernels)
    blanks = {
        "parameters": kernels[-1].parameters.numel(),
        "sign_width": SIGN_WIDTH,
        "constants": constants,
    }
    code = [c_code.filled("entries/warp_prepare.h", blanks)]
    prepare = _kernel("prepare", _PREPARE, sources, code, style)
    head = _HEAD.format(dtype=style.dtype, size=sources.size)
    return head + prepare + run


def _kernel(
    name: str,
    arguments: Mapping[str, str],
    sources: KernelSources,
    code: Sequence[str],
    style: Style,
) -> str:
    """The text of a kernel. `code` follows the generated functions and defines the C `run`.

    In C, N(x) is a literal in the precision of the kernel. LANES and TURNS are macros of kernels
    for several samples at once; where they are not defined, real.h makes `real` one number.
    """
    names = ", ".join(arguments)
    body = [
        f"#undef LANES\n#undef TURNS\n#define restrict __restrict__\n{style.head}",
        f"#define LAST_STEP N({style.last_step})\nstruct kernel {{",
        *map(c_code.part, ("real.h", "distances.h", "warp.h")),
        *sources.texts,
        *sources.functions,
        *code,
        f"}};\nkernel::run(i, {names});",
    ]
    return _KERNEL.format(
        body="\n".join(body),
        name=name,
        arguments=", ".join(f"{argument}: {kind}" for argument, kind in arguments.items()),
        names=names,
    )


# --- blanks of the templates ------------------------------------------------------------------


def _blanks_of_inputs(kernel: SymbolicKernel) -> dict[str, object]:
    """Blanks of x, the inputs of a kernel one after the other."""
    sizes = {name: symbols.numel() for name, symbols in kernel.inputs.items()}
    loads = sizes.pop(WRENCHES, None)  # the last input, if there are any
    takes = []
    start = 0
    for array, size in zip(_SAMPLES, sizes.values(), strict=False):
        takes.append(f"take(x + {start}, {array}, i, {size});")
        start += size
    if loads is not None:
        takes.append(f"take_wrenches(x + {start}, {WRENCHES}, i, {loads});")
        start += loads
    return {"takes": "\n    ".join(takes), "q": sizes["q"], "inputs": start}


def _blanks_of_directions(along: Directions) -> dict[str, object]:
    """Blanks of "along", a kernel of derivatives in some passes."""
    calls = []
    for k, part in enumerate(along.passes):
        sizes = f"{len(part.coordinates)}, {len(part.places)}, {part.checks.numel()}"
        calls.append(f"PASS({k}, {sizes})")
    return c_code.blanks_of_directions(along) | {"passes": "\n    ".join(calls)}


def _blanks_of_closing(closing: SymbolicKernel, style: Style) -> dict[str, object]:
    """Blanks of "close" and "step", which call the kernel "closing"."""
    newton: dict[str, object] = {
        "close": closing.name,
        "close_checks": closing.checks.numel(),
        "units": c_code.listed(closing.units),
        "longest_first_step": _LONGEST_FIRST_STEP,
        "largest_ratio": _LARGEST_RATIO,
    }
    # What a sound step is; warp_step.h has the formulas. The tolerance is that of closed loops in
    # the precision of the kernel, twice the bound `closed` of its checks.
    step: dict[str, object] = {
        "bend": BEND,
        "tolerance": 2 * style.closed,
        "travel": TRAVEL,
        "nearby": NEARBY * TRAVEL,
        "change": f"N({CHANGE})",
    }
    return newton | step

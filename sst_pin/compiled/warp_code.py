# SPDX-License-Identifier: BSD-2-Clause
"""Generates Python modules with kernels for NVIDIA Warp, from the C of `c_code`.

`module` writes the module of a quantity, `nonsmooth_module` that of nonsmooth steps. A module has
two kernels:

- `prepare` computes the array p: the parameters of a robot, then the constants that depend on the
  parameters alone. Each thread computes one robot.
- `run` computes the results. Each thread computes one sample.

A kernel calls one *native function*, which is a text in C++. Warp copies this text into the body of
a function, and C++ allows no function inside another one, but a class. So all functions of the C
become static members of a class `kernel`. The last statement of the text calls `kernel::run`.

The text consists of generated C and of templates, files of the folder `c`. A template has blanks,
such as ${name}, for the texts and numbers of a robot. Functions `_blanks_of_...` return the
contents of the blanks by their names.
"""

from collections.abc import Mapping, Sequence

from ..loops.continuity import TRAVEL
from ..model.thresholds import BEND
from . import c_code
from .along_directions import Directions
from .c_code import KernelSources, Style
from .compiled_states import CHANGE, LARGEST_RATIO, LONGEST_FIRST_STEP, NEARBY
from .kernels import WRENCHES, SymbolicKernel
from .nonsmooth_c import SOLVER, StepSource
from .symbolic_parameters import SIGN_WIDTH

# Arguments of the kernels in their order, with their types; `_HEAD` defines these. An array that a
# quantity does not need is None.
#: Arguments of `prepare`.
_PREPARE = {
    "numbers": "rows",  # the parameters, a row for each robot
    "width": "real",  # smoothing width of dry friction; if negative, the width in the parameters
    "p": "rows",  # the result, a column for each robot
}
#: Arguments of `run`; "rows" have a row for each sample, except for p.
RUN = {
    "q": "rows",
    "va": "rows",
    "last": "rows",  # aa or tau
    WRENCHES: "loads",
    "p": "rows",
    "out": "rows",  # the result; for steps q
    "va_out": "rows",  # for steps
    "h": "real",  # length of a step, [s]
    "steps": "int",
    "status": "flags",
}
#: Arguments of `run` that hold the inputs of a kernel, in the order of the inputs. Some kernels
#: have only the first ones: "closing" has q, and the terms of nonsmooth steps have q and va.
_INPUTS = ("q", "va", "last")
#: Arguments of `run` for nonsmooth steps.
NONSMOOTH = {
    "q": "rows",
    "va": "rows",
    "tau": "rows",
    WRENCHES: "loads",
    "p": "rows",
    "numbers": "rows",  # `nonsmooth_motions.parameter_values`
    "held": "rows",  # positions that the motors hold
    "start": "rows",  # impulses from which the solver starts
    # The results, in the order of `NonsmoothState`:
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
    "violation": "real",  # largest violation at the start; see `warp_nonsmooth.FRESH`
    "status": "flags",
}

#: The start of a module; `size` is the size of p for one robot.
_HEAD = '''\
"""Kernels of sst_pin for Warp."""
import sys
import warp as wp

real, rows = wp.{dtype}, wp.array2d(dtype=wp.{dtype})
loads, flags = wp.array3d(dtype=real), wp.array1d(dtype=int)
wp.set_module_options({{"enable_backward": False}}, sys.modules[__name__])
size = {size}
'''
#: A kernel and its native function; i is the number of the thread.
_KERNEL = """

@wp.func_native({body!r})
def {name}_sample(i: int, {arguments}): ...


@wp.kernel
def {name}({arguments}):
    {name}_sample(wp.tid(), {names})
"""


def module(kernels: Sequence[SymbolicKernel], template: str, style: Style) -> str:
    """The text of a module that evaluates a generated kernel or makes smooth steps.

    Args:
        kernels: The kernel. For steps: "closing", then "state_rate".
        template: The template of `run`: "close" calls the kernel "closing" until the loops are
            closed, "step" makes steps, "along" computes derivatives along directions, and "run"
            evaluates any other kernel.
        style: The precision.
    """
    kernel = kernels[-1]
    sources = c_code.bodies(kernels, style.suffix, recompute=True)
    blanks = _blanks_of_inputs(kernel) | {
        "name": kernel.name,
        "y_size": sources.y_size,
        "outputs": kernel.output.numel(),
        "checks": kernel.checks.numel(),
    }
    if kernel.along is not None:
        blanks |= _blanks_of_directions(kernel.along)
        blanks["y_size_of_passes"] = sources.y_size_of_passes
    if template in ("close", "step"):
        closing = kernels[0]  # for "close" the only kernel
        blanks |= _blanks_of_closing(closing, style)
    code = [c_code.filled(f"entries/warp_{template}.h", blanks)]
    run = _kernel_text("run", RUN, sources, code, style)
    return _module_text(kernels, sources, run, style)


def nonsmooth_module(source: StepSource, style: Style) -> str:
    """The text of a module that makes nonsmooth steps."""
    _, terms, _ = source.kernels
    sources = c_code.bodies(source.kernels, style.suffix, recompute=True)
    blanks = _blanks_of_inputs(terms) | source.blanks | {"y_size": sources.y_size}
    code = [
        *map(c_code.part, (*SOLVER, "nonsmooth_move.h")),
        c_code.filled("entries/warp_nonsmooth.h", blanks),
    ]
    run = _kernel_text("run", NONSMOOTH, sources, code, style)
    return _module_text(source.kernels, sources, run, style)


def _module_text(
    kernels: Sequence[SymbolicKernel], sources: KernelSources, run: str, style: Style
) -> str:
    """The text of a module; `run` is the text of its second kernel."""
    constants = "\n    ".join(f"{kernel.name}_constants(own);" for kernel in kernels)
    blanks = {
        "parameters": kernels[-1].parameters.numel(),
        "sign_width": SIGN_WIDTH,
        "constants": constants,
    }
    code = [c_code.filled("entries/warp_prepare.h", blanks)]
    prepare = _kernel_text("prepare", _PREPARE, sources, code, style)
    head = _HEAD.format(dtype=style.dtype, size=sources.p_size)
    return head + prepare + run


def _kernel_text(
    name: str,
    arguments: Mapping[str, str],
    sources: KernelSources,
    code: Sequence[str],
    style: Style,
) -> str:
    """The text of a kernel with its native function.

    In C, N(x) is a literal in the precision of the kernel. LANES and TURNS are macros of kernels
    for several samples at once; where they are not defined, real.h makes `real` one number.

    Args:
        name: "prepare" or "run".
        arguments: Its arguments with their types.
        sources: The generated functions.
        code: The texts that follow the generated functions. They define `run` of the class.
        style: The precision.
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
    """Blanks that copy the inputs of a kernel to its array x, one after the other."""
    sizes = {name: symbols.numel() for name, symbols in kernel.inputs.items()}
    loads = sizes.pop(WRENCHES, None)  # the last input, if external wrenches act
    takes = []
    start = 0
    for array, size in zip(_INPUTS, sizes.values(), strict=False):
        takes.append(f"take(x + {start}, {array}, i, {size});")
        start += size
    if loads is not None:
        takes.append(f"take_wrenches(x + {start}, {WRENCHES}, i, {loads});")
        start += loads
    return {"takes": "\n    ".join(takes), "q": sizes["q"], "inputs": start}


def _blanks_of_directions(along: Directions) -> dict[str, object]:
    """Blanks of "along", which calls a function for each pass, as `along_directions` says."""
    calls = []
    for k, part in enumerate(along.passes):
        # The macro PASS takes the numbers of directions, of results, and of checks.
        sizes = f"{len(part.coordinates)}, {len(part.places)}, {part.checks.numel()}"
        calls.append(f"PASS({k}, {sizes})")
    return c_code.blanks_of_directions(along) | {"passes": "\n    ".join(calls)}


def _blanks_of_closing(closing: SymbolicKernel, style: Style) -> dict[str, object]:
    """Blanks of "close" and "step", which call the kernel "closing"."""
    newton: dict[str, object] = {
        "close": closing.name,
        "close_checks": closing.checks.numel(),
        "units": c_code.listed(closing.units),
        "longest_first_step": LONGEST_FIRST_STEP,
        "largest_ratio": LARGEST_RATIO,
    }
    # Bounds of a sound step, which stays in its assembly mode: warp_step.h has the formulas.
    step: dict[str, object] = {
        "bend": BEND,
        "tolerance": style.tolerance,
        "travel": TRAVEL,
        "nearby": NEARBY * TRAVEL,
        "change": f"N({CHANGE})",
    }
    return newton | step

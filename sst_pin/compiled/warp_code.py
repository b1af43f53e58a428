# SPDX-License-Identifier: BSD-2-Clause
"""Kernels for NVIDIA Warp: Python modules whose native functions hold the C of `c_code`.

A thread computes one sample. The statements are those of the C. They are in a class, because C++
allows no function inside a function.
"""

from collections.abc import Mapping, Sequence

from ..loops.continuity import TRAVEL
from ..model.thresholds import BEND
from . import c_code
from .c_code import Style
from .compiled_states import CHANGE, NEARBY
from .kernels import WRENCHES, SymbolicKernel
from .nonsmooth_c import StepSource
from .symbolic_parameters import SIGN_WIDTH

#: The longest first Newton step onto the closures, [rad] or robot lengths, and the largest ratio of
#: a step to the one before.
_NEAR, _SHRINKS = 0.1, 0.1
#: Arguments of the kernels; arrays that a quantity does not need are None.
_PREPARE = {"numbers": "rows", "width": "real", "p": "rows"}
_RUN = dict.fromkeys(("q", "va", "last"), "rows") | {WRENCHES: "loads"}
_RUN |= dict.fromkeys(("p", "out", "va_out"), "rows")
_RUN |= {"h": "real", "steps": "int", "status": "flags"}
#: Arguments of the kernel of nonsmooth steps.
_STEP = {
    "q": "rows",
    "va": "rows",
    "tau": "rows",
    WRENCHES: "loads",
    "p": "rows",  # parameters and constants of the generated kernels
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
#: Files that stand before the kernels, and those that stand after them.
_HELPERS = ("real.h", "warp.h")
_SOLVER = ("ways.h", "nonsmooth_solver.h", "nonsmooth_move.h")
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
    """A Python module of Warp's kernels `prepare` and `run`, and `size`, the rows of p.

    Args:
        kernels: The kernel, for steps the one of closing before it.
        entry: "run", "along", "close" or "step".
        style: Numbers of its precision.
    """
    return _module(kernels, style, _RUN, entry, (), _blanks(kernels, style))


def nonsmooth_module(source: StepSource, style: Style) -> str:
    """As `module`, of nonsmooth steps."""
    closing, terms, _ = source.kernels
    blanks = _blanks([closing, terms], style) | source.blanks
    blanks["constants"] = _constants(source.kernels)
    return _module(source.kernels, style, _STEP, "nonsmooth", _SOLVER, blanks)


def _module(
    kernels: Sequence[SymbolicKernel],
    style: Style,
    arguments_of_run: Mapping[str, str],
    entry: str,
    files: Sequence[str],
    blanks: dict[str, object],
) -> str:
    """The text of a module; `run` is in the template of `entry`, with `files` before it."""
    size = None
    room = 0
    of_passes = 0
    texts = list[str]()
    for kernel in kernels:
        source = c_code.body(kernel, size, style.suffix, recompute=True)
        size = source.size
        room = max(room, source.room)
        of_passes = source.room_of_passes
        texts += [source.text, *source.functions]
    blanks = blanks | {"room": room, "room_of_passes": of_passes}
    parts = [_HEAD.format(dtype=style.dtype, size=size)]
    functions = (
        ("prepare", _PREPARE, "prepare", ()),
        ("run", arguments_of_run, entry, files),
    )
    for name, arguments, file, needed in functions:
        names = ", ".join(arguments)
        body = [
            f"#undef LANES\n#undef TURNS\n#define restrict __restrict__\n{style.head}",
            f"#define LAST_STEP N({style.last_step})\nstruct kernel {{",
            *map(c_code.part, _HELPERS),
            *texts,
            *map(c_code.part, needed),
            c_code.filled(f"entries/warp_{file}.h", blanks),
            f"}};\nkernel::run(i, {names});",
        ]
        typed = ", ".join(f"{x}: {kind}" for x, kind in arguments.items())
        values = {"body": "\n".join(body), "name": name, "arguments": typed, "names": names}
        parts.append(_KERNEL.format(**values))
    return "".join(parts)


def _constants(kernels: Sequence[SymbolicKernel]) -> str:
    """Calls that compute what depends on the parameters alone."""
    return "\n    ".join(f"{kernel.name}_constants(own);" for kernel in kernels)


def _blanks(kernels: Sequence[SymbolicKernel], style: Style) -> dict[str, object]:
    """Texts for the blanks of the templates."""
    first, last = kernels[0], kernels[-1]
    at = 0
    takes = []
    for array, (name, symbols) in zip(_RUN, last.inputs.items(), strict=False):
        if name == WRENCHES:
            takes.append(f"take_wrenches(x + {at}, {name}, i, {symbols.numel()});")
        else:
            takes.append(f"take(x + {at}, {array}, i, {symbols.numel()});")
        at += symbols.numel()
    along: dict[str, object] = {}
    if last.along is not None:
        sizes = ((len(x.coordinates), len(x.places), x.checks.numel()) for x in last.along.passes)
        calls = (f"PASS({k}, {', '.join(map(str, size))})" for k, size in enumerate(sizes))
        along = c_code.blanks_of_directions(last.along) | {"passes": "\n    ".join(calls)}
    return along | {
        "name": last.name,
        "close": first.name,
        "takes": "\n    ".join(takes),
        "q": last.inputs["q"].numel(),
        "inputs": at,
        "outputs": last.output.numel(),
        "checks": last.checks.numel(),
        "close_checks": first.checks.numel(),
        "units": ", ".join(map(repr, last.units)),
        "bend": BEND,
        "travel": TRAVEL,
        "nearby": NEARBY * TRAVEL,
        "change": f"N({CHANGE})",
        "near": _NEAR,
        "shrinks": _SHRINKS,
        "tolerance": 2 * style.closed,
        "open": last.parameters.numel(),
        "sign_width": SIGN_WIDTH,
        "constants": _constants(kernels),
    }

# SPDX-License-Identifier: BSD-2-Clause
"""The C of nonsmooth steps: generated kernels of the terms, and a solver written by hand."""

from collections.abc import Sequence

import numpy as np

from ..dynamics.nonsmooth_rows import LARGEST_BEND, NonsmoothRows
from ..loops.continuity import TRAVEL
from ..model.thresholds import CLOSURE_TOLERANCE
from . import kernels
from .c_code import body, filled, part
from .equations import Equations
from .kernel_checks import Checks
from .nonsmooth_kernel import NonsmoothTerms, advance
from .nonsmooth_motions import DETERMINANT_CHANGE, LEAST_DETERMINANT


def library(entry: str, equations: Equations, rows: NonsmoothRows, lanes: int) -> list[str]:
    """Source of a library with `run_<entry>`, which makes steps, for `lanes` samples at once."""
    # A step calls three generated kernels: `close` closes the loops, `terms` evaluates the terms of
    # the impulses, and `move` moves q.
    checks = Checks(equations)
    symbols = NonsmoothTerms(equations, rows)
    close = kernels.make(equations, "closing", checks)
    terms = symbols.kernel(checks)
    move = advance(equations)
    parts = [f"#define LANES {lanes}"]
    parts += [part(name) for name in ("real.h", "driver.h", "nonsmooth.h")]
    size = None  # of p: the kernels share one array of parameters, to which each adds its constants
    room = 0  # the largest number of intermediate results of a kernel
    for kernel in (close, terms, move):
        source = body(kernel, size, in_memory=True)
        size = source.size
        room = max(room, source.room)
        parts.append(source.text)

    # Numbers of this robot for the templates entries/prepare.c, sizes.c and nonsmooth.c.
    mechanism = rows.mechanism
    contacts = mechanism.contacts
    layout = symbols.layout
    inputs = [x.numel() for x in terms.inputs.values()]  # q, va, then the rest
    outputs = terms.output.numel()
    counts = (  # the first members of `rows_of_robot` in nonsmooth.h, in their order
        layout.n,
        inputs[0],  # q
        sum(inputs[2:]),  # load
        mechanism.motor_count,  # motors
        len(rows.kinds),  # m
        len(contacts.points),  # contacts
        len(contacts.ropes),  # ropes
        len(rows.cables),  # cables
        len(rows.stops),  # stops
        len(rows.dry),  # dry
        len(layout.implicit_row),  # implicit
    )
    determinants = np.abs(equations.at_samples(equations.pivots.determinant))
    of_library: dict[str, object] = {
        "entry": entry,
        "word": "run",
        "calls": "\n    ".join(f"{kernel.name}_constants(p);" for kernel in (close, terms, move)),
        "size": size,
        "sizes": _listed(inputs),
        "results": outputs,
    }
    # `places` are the further members of `rows_of_robot`.
    of_rows: dict[str, object] = {
        "counts": _listed(counts),
        "places": _listed(list(layout.places.values())),
        "outputs": outputs,
        "checks": terms.checks.numel(),
        "row_start": _listed(layout.row_start),
        "row_column": _listed(layout.row_column),
        "impulse_row": _listed(layout.impulse_row),
        "impulse_sign": _listed(layout.impulse_sign),
        "implicit_row": _listed(layout.implicit_row),
        "stop_position": _listed([stop.position for stop in rows.stops]),
    }
    # Members of `nonsmooth_stepper` in nonsmooth.h, which say when a step is refused.
    of_stepper: dict[str, object] = {
        "terms": terms.name,
        "close_checks": close.checks.numel(),
        "units": ", ".join(map(repr, close.units)),
        "bend": LARGEST_BEND,
        "tolerance": CLOSURE_TOLERANCE,
        "travel": TRAVEL,
        "change": DETERMINANT_CHANGE,
        "least": LEAST_DETERMINANT * float(determinants.max()),
    }
    # Sizes of arrays.
    of_workspace: dict[str, object] = {
        "n": layout.n,
        "m": len(rows.kinds),
        "q": inputs[0],
        "inputs": sum(inputs),
        "room": room,
    }
    numbers = of_library | of_rows | of_stepper | of_workspace
    names = ("prepare", "sizes", "nonsmooth")
    parts += [filled(f"entries/{name}.c", numbers) for name in names]
    return ["\n".join(parts)]


def _listed(numbers: Sequence[int]) -> str:
    """Numbers of an array of C, which must not be empty."""
    return ", ".join(map(str, numbers)) or "0"

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
    # A step calls three generated kernels: one evaluates the terms of the impulses, one moves q,
    # and one closes the loops.
    checks = Checks(equations)
    terms = NonsmoothTerms(equations, rows)
    kernel = terms.kernel(checks)
    close = kernels.make(equations, "closing", checks)
    generated = close, kernel, advance(equations)
    parts = [f"#define LANES {lanes}"]
    parts += [part(name) for name in ("real.h", "driver.h", "nonsmooth.h")]
    size = None
    room = 0  # the largest number of intermediate results of a kernel
    for each in generated:
        source = body(each, size, in_memory=True)
        size = source.size
        room = max(room, source.room)
        parts.append(source.text)

    # Numbers that the solver in entries/nonsmooth.c takes from this robot.
    mechanism = rows.mechanism
    layout = terms.layout
    inputs = [symbols.numel() for symbols in kernel.inputs.values()]  # q, va, then the rest
    contacts = mechanism.contacts
    motors = mechanism.motor_count
    counts = (  # the first members of `rows_of_robot` in nonsmooth.h, in their order
        layout.n,
        inputs[0],
        sum(inputs[2:]),
        motors,
        len(rows.kinds),
        len(contacts.points),
        len(contacts.ropes),
        len(rows.cables),
        len(rows.stops),
        len(rows.dry),
        len(layout.implicit_row),
    )
    determinants = np.abs(equations.at_samples(equations.pivots.determinant))
    numbers: dict[str, object] = {
        "entry": entry,
        "calls": "\n    ".join(f"{each.name}_constants(p);" for each in generated),
        "size": size,
        "word": "run",
        "results": kernel.output.numel(),
        "sizes": _listed(inputs),
        "row_start": _listed(layout.row_start),
        "row_column": _listed(layout.row_column),
        "impulse_row": _listed(layout.impulse_row),
        "impulse_sign": _listed(layout.impulse_sign),
        "implicit_row": _listed(layout.implicit_row),
        "stop_position": _listed([stop.position for stop in rows.stops]),
        "units": ", ".join(map(repr, close.units)),
        "counts": _listed(counts),
        "places": _listed(list(layout.places.values())),
        "terms": kernel.name,
        "outputs": kernel.output.numel(),
        "checks": kernel.checks.numel(),
        "close_checks": close.checks.numel(),
        "bend": LARGEST_BEND,
        "tolerance": CLOSURE_TOLERANCE,
        "travel": TRAVEL,
        "change": DETERMINANT_CHANGE,
        "least": LEAST_DETERMINANT * float(determinants.max()),
        "n": layout.n,
        "m": len(rows.kinds),
        "q": inputs[0],
        "inputs": sum(inputs),
        "room": room,
    }
    names = ("prepare", "sizes", "nonsmooth")
    parts += [filled(f"entries/{name}.c", numbers) for name in names]
    return ["\n".join(parts)]


def _listed(numbers: Sequence[int]) -> str:
    """Numbers of an array of C, which must not be empty."""
    return ", ".join(map(str, numbers)) or "0"

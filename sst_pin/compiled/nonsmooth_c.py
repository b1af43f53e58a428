# SPDX-License-Identifier: BSD-2-Clause
"""The C of nonsmooth steps: generated kernels, and a solver written by hand.

`step_source` makes what a step is made from: three kernels, and the numbers of a robot for the
*blanks* of templates, such as ${name} in a file of the folder `c`. `library` makes the C of it;
`warp_code` makes a module of Warp of it.
"""

from typing import NamedTuple

import numpy as np

from ..dynamics.nonsmooth_rows import LARGEST_BEND, NonsmoothRows
from ..loops.continuity import TRAVEL
from ..model.thresholds import CLOSURE_TOLERANCE
from . import kernels
from .c_code import bodies, filled, listed, part
from .equations import Equations
from .kernel_checks import Checks
from .kernels import SymbolicKernel
from .nonsmooth_kernel import NonsmoothTerms, advance
from .nonsmooth_motions import DETERMINANT_CHANGE, LEAST_DETERMINANT

#: Files of the folder `c` that make a step of one robot.
SOLVER = ("dense_solvers.h", "impulses.h", "nonsmooth_step.h")


class StepSource(NamedTuple):
    """What the code of a step is made from, in C and for Warp."""

    #: In this order: `closing` closes the loops, `nonsmooth_terms` evaluates the terms of the
    #: impulses (`nonsmooth_kernel`), and `advance` computes the rates of q.
    kernels: tuple[SymbolicKernel, SymbolicKernel, SymbolicKernel]
    #: Texts and numbers of this robot for the blanks of the templates, by name.
    blanks: dict[str, object]


def step_source(
    equations: Equations, rows: NonsmoothRows, checks: Checks, tolerance: float = CLOSURE_TOLERANCE
) -> StepSource:
    """The kernels and numbers of a step.

    Args:
        equations: The equations of the robot.
        rows: The rows of the impulses.
        checks: Checks of the kernels.
        tolerance: Tolerance of closed loops, free of units.
    """
    symbols = NonsmoothTerms(equations, rows)
    close = kernels.make(equations, "closing", checks)
    terms = symbols.kernel(checks)
    mechanism = rows.mechanism
    contacts = mechanism.contacts
    layout = symbols.layout
    inputs = [x.numel() for x in terms.inputs.values()]  # q, va, then external wrenches
    # Blanks of nonsmooth_tables.h for the `robot_tables` of nonsmooth_step.h. The counts are the
    # first members of this structure, in their order there.
    counts = {
        "n": layout.n,
        "q": inputs[0],
        "load": sum(inputs[2:]),
        "motors": mechanism.motor_count,
        "m": len(rows.kinds),
        "contacts": len(contacts.points),
        "ropes": len(contacts.ropes),
        "cables": len(rows.cables),
        "stops": len(rows.stops),
        "dry": len(rows.dry_friction),
        "implicit": len(layout.implicit_row),
    }
    of_rows: dict[str, object] = {
        "counts": listed(list(counts.values())),
        "places": listed(list(layout.places.values())),
        "outputs": terms.output.numel(),
        "checks": terms.checks.numel(),
        "row_start": listed(layout.row_start),
        "row_column": listed(layout.row_column),
        "impulse_row": listed(layout.impulse_row),
        "impulse_sign": listed(layout.impulse_sign),
        "implicit_row": listed(layout.implicit_row),
        "stop_position": listed([stop.position for stop in rows.stops]),
        "joint_rate": listed([*(stop.rate for stop in rows.stops), *rows.dry_rates.tolist()]),
        "dry_lines": len(rows.dry_lines),
    }
    scales = {
        "coordinate_scale": listed(mechanism.rate_scale[mechanism.coordinates].tolist()),
        "gap_scale": listed(rows.gap_scale.tolist()),
    }
    # Blanks of nonsmooth_tables.h for the `bounds_of_step` of nonsmooth_move.h.
    determinants = np.abs(equations.at_samples(equations.pivots.determinant))
    of_bounds: dict[str, object] = {
        "units": listed(close.units),
        "bend": LARGEST_BEND,
        "tolerance": tolerance,
        "travel": TRAVEL,
        "change": DETERMINANT_CHANGE,
        "least": LEAST_DETERMINANT * float(determinants.max()),
    }
    # Blanks for the sizes of arrays.
    sizes: dict[str, object] = {
        "n": counts["n"],
        "m": counts["m"],
        "motors": counts["motors"],
        "q": counts["q"],
        "rates": mechanism.model.nv,
        "inputs": sum(inputs),
    }
    blanks = of_rows | scales | of_bounds | sizes
    blanks["tables"] = filled("entries/nonsmooth_tables.h", blanks).rstrip()
    return StepSource((close, terms, advance(equations)), blanks)


def library(entry: str, equations: Equations, rows: NonsmoothRows, lanes: int) -> list[str]:
    """Source of a library with `run_<entry>`, which makes steps, for `lanes` samples at once."""
    source = step_source(equations, rows, Checks(equations))
    code = bodies(source.kernels, in_memory=True)
    texts = [
        f"#define LANES {lanes}",
        *map(part, ("real.h", "distances.h", "driver.h", *SOLVER)),
        *code.texts,
        *map(part, ("nonsmooth_move.h", "nonsmooth.h")),
    ]
    _, terms, _ = source.kernels
    of_library: dict[str, object] = {
        "entry": entry,
        "word": "run",
        "calls": "\n    ".join(f"{kernel.name}_constants(p);" for kernel in source.kernels),
        "p_size": code.p_size,
        "y_size": code.y_size,
        "sizes": listed([x.numel() for x in terms.inputs.values()]),
        "results": terms.output.numel(),
    }
    blanks = of_library | source.blanks
    names = ("prepare", "sizes", "nonsmooth")
    texts += [filled(f"entries/{name}.c", blanks) for name in names]
    return ["\n".join(texts)]

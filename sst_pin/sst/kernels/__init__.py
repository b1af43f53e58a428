# SPDX-License-Identifier: BSD-2-Clause
"""The kernels of the SST: those of `compile()`, with the geometry left open.

`scripts/kernels/make_kernels.py` writes the C, and the JavaScript of pages. The files named after
instruction sets compile `kernels.c` at installation; derivatives are compiled at their first use,
into the cache. The environment variable SST_PIN_KERNELS=off switches all C off.
"""

import ctypes
import os
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from ... import extensions
from ...arrays import Array
from ...compiled import build
from ...compiled.build import Code
from ...compiled.compiled_backend import DERIVATIVES, CompiledBackend
from ...compiled.open_numbers import OpenNumbers
from ...description.frames import JOINT_NAMES, MOTOR_NAMES
from ...dynamics.reference import Reference
from ...engine import Key
from ...errors import CompilationError
from ...model.closures import Closure
from ...model.mechanism import Mechanism
from ..topology import CUTS

FOLDER = Path(__file__).parent
#: The functions of pages, in JavaScript.
PAGE = FOLDER / "page.js"
#: C that goes into every library, and its folder.
PARTS, INCLUDE = ("real.h", "driver.h"), Path(build.__file__).with_name("c")
#: Kernels that the package contains compiled.
ENTRIES = (
    *(
        Key(quantity)
        for quantity in ("torques", "accelerations", "reduced_terms", "rates", "closing", "rollout")
    ),
    *(Key(quantity, loaded=True) for quantity in ("torques", "accelerations", "rollout")),
)
#: Kernels that are compiled at their first use, each from a file of its name.
AT_FIRST_USE = (*DERIVATIVES, *(key._replace(along=True) for key in DERIVATIVES))
#: Index of the body that bears the loads on the star; the three arcs are one body.
STAR = JOINT_NAMES.index("beta_1")


def backend(reference: Reference, off: str) -> CompiledBackend:
    """The kernels of one robot; the error says why it has none, `off` if that is not empty."""
    mechanism = reference.mechanism
    if why := off or _misfit(mechanism) or missing():
        raise CompilationError(why)
    return CompiledBackend(
        reference, parameters=open_numbers(mechanism), code=code, platform=JOINT_NAMES[STAR]
    )


def _misfit(mechanism: Mechanism) -> str:
    """What keeps a robot from the kernels, wherever they run; empty when nothing does."""
    if mechanism.space.joint_names != JOINT_NAMES:
        return "the joints of the model are in another order"
    cuts = [closure for closure in mechanism.closures if isinstance(closure, Closure)]
    frames = {(closure.frame_a, closure.frame_b) for closure in cuts}
    kinds = {closure.kind for closure in cuts}
    whole = len(cuts) == len(mechanism.closures) and kinds <= {"6d", "orientation"}
    if frames != CUTS or not whole:
        return "the cuts differ from those of the YAML in the package"
    springs = not (mechanism.springs.none and mechanism.lines.none)
    if springs or not mechanism.driven_one_to_one:
        return "the motors or springs differ from those of an SST"
    return ""


def page_functions(mechanism: Mechanism) -> tuple[str, Array] | None:
    """JavaScript of the functions of a page, and their open numbers; None where they do not fit."""
    # They divide by the masses of the bodies.
    if _misfit(mechanism) or not all(body.mass for body in list(mechanism.model.inertias)[1:]):
        return None
    numbers = open_numbers(mechanism).pack(mechanism, mechanism.friction)
    return PAGE.read_text(encoding="utf-8"), numbers


def open_numbers(mechanism: Mechanism) -> OpenNumbers:
    """Open numbers of the kernels: of all bodies and joints, and the geometry."""
    frames = sorted({frame for cut in CUTS for frame in cut})
    return OpenNumbers(mechanism, complete=True, rotated=[*MOTOR_NAMES, *frames])


def code(key: Key, target: str, clock: build.Clock | None = None) -> Code:
    """The code of one of `ENTRIES` or `AT_FIRST_USE` for an instruction set."""
    if key in AT_FIRST_USE:
        return Code(_from_cache(key.entry, target, clock), key.entry)
    if key not in ENTRIES:
        raise CompilationError("the shipped kernels have none")
    return Code(_installed(target), f"{key.entry}_{target}")


def missing() -> str:
    """Why there are no kernels; empty when there are."""
    if os.environ.get("SST_PIN_KERNELS") == "off":
        return "switched off by SST_PIN_KERNELS=off"
    try:
        _installed("plain")
    except CompilationError as error:
        return str(error)
    return ""


def source_file(entry: str) -> Path:
    """The C of a kernel that is compiled at its first use."""
    return FOLDER / f"{entry}.c"


def _from_cache(entry: str, target: str, clock: build.Clock | None) -> ctypes.CDLL:
    body = source_file(entry).read_text(encoding="utf-8")

    def source() -> str:
        lanes = f"#define LANES {build.TARGETS[target][0]}\n#define NAME(x) x\n"
        return lanes + "".join(f'#include "{part}"\n' for part in PARTS) + body

    options = *build.LONG, f"-I{INCLUDE}"
    return build.library("sst", entry, body.encode(), target, source, options, clock)


@cache
def _installed(target: str) -> ctypes.CDLL:
    found = find_spec(f"{__name__}._{target}")
    if found is None or found.origin is None:
        raise CompilationError(extensions.missing())
    own, shared = ("kernels.c", "target.h"), [INCLUDE / part for part in PARTS]
    sources = [*(FOLDER / name for name in own), *shared, FOLDER / f"{target}.c"]
    return extensions.require_current(found.origin, *sources)

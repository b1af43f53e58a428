# SPDX-License-Identifier: BSD-2-Clause
"""The kernels of the SST, shipped compiled: those of `compile()`, with the geometry left open.

`scripts/kernels/make_kernels.py` writes `kernels.c`; the files named after instruction sets compile
it for these. The environment variable SST_PIN_KERNELS=off switches them off.
"""

from __future__ import annotations

import ctypes
import os
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from ...chain.mechanism import Mechanism
from ...compiled import build
from ...compiled.backend import ALONG, DERIVATIVES
from ...compiled.code import Code
from ...compiled.parameters import Parameters
from ...description import MOTOR_NAMES
from ...errors import CompilationError
from ...extensions import require_current
from ..topology import CUTS

FOLDER = Path(__file__).parent
#: Names of the kernels for one sample and for many.
ENTRIES = (
    "torques",
    "accelerations",
    "reduced_terms",
    "rates",
    "closing",
    "rollout",
    "torques loaded",
    "accelerations loaded",
    "rollout loaded",
)
#: Names of those with several lanes only: of samples, or of directions of one sample.
OF_LANES = (*DERIVATIVES, *(f"{name} {ALONG}" for name in DERIVATIVES))


def open_numbers(mechanism: Mechanism) -> Parameters:
    """Parameters of the kernels: of all bodies and joints, and the geometry."""
    frames = sorted({frame for cut in CUTS for frame in cut})
    return Parameters(mechanism, complete=True, rotated=[*MOTOR_NAMES, *frames])


def code(name: str, target: str) -> Code:
    """The code of a kernel.

    Args:
        name: One of `ENTRIES` or `OF_LANES`.
        target: An instruction set.

    Raises:
        CompilationError: When there is none.
    """
    if name not in (*ENTRIES, *OF_LANES):
        raise CompilationError("the shipped kernels have none")
    return Code(_library(), f"{name.replace(' ', '_')}_{target}")


def missing() -> str:
    """Why there are no kernels; empty when there are."""
    if os.environ.get("SST_PIN_KERNELS") == "off":
        return "switched off by SST_PIN_KERNELS=off"
    try:
        _library()
    except CompilationError as error:
        return str(error)
    return ""


@cache
def _library() -> ctypes.CDLL:
    found = find_spec(f"{__name__}._library")
    if found is None or found.origin is None:
        raise CompilationError("the extension module is missing; install sst-pin with a C compiler")
    parts = Path(build.__file__).with_name("c")
    sources = FOLDER / "kernels.c", parts / "real.h", parts / "driver.h"
    return require_current(found.origin, *sources)

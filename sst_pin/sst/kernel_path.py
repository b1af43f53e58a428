# SPDX-License-Identifier: BSD-2-Clause
"""Which robots the shipped kernels fit."""

from __future__ import annotations

from ..chain.backend import Backend
from ..chain.closures import Closure, Constraint
from ..chain.reference import Reference, ReferenceBackend
from ..description import JOINT_NAMES
from ..errors import CompilationError
from .topology import CUTS

#: Index of the body that bears the loads on the star; the three arcs are one body.
STAR = JOINT_NAMES.index("beta_1")


def backend(reference: Reference, off: str) -> Backend:
    """The kernels of one robot, or the reference path with the reason, such as `off`."""
    from ..compiled.compiled_backend import CompiledBackend  # at its first use: it imports much
    from . import kernels

    mechanism = reference.mechanism
    why = off or misfit(mechanism.space.joint_names, mechanism.closures) or kernels.missing()
    if not why and not (mechanism.driven_one_to_one and mechanism.springs.none):
        why = "the motors or springs differ from those of an SST"
    if why:
        return ReferenceBackend(reference, why)
    numbers = kernels.open_numbers(mechanism)
    try:
        return CompiledBackend(reference, parameters=numbers, code=kernels.code, bearer=STAR)
    except CompilationError as error:
        return ReferenceBackend(reference, str(error))


def misfit(joint_names: tuple[str, ...], closures: tuple[Constraint, ...]) -> str:
    """What keeps a robot from the kernels, wherever they run; empty when nothing does."""
    if joint_names != JOINT_NAMES:
        return "the joints of the model are in another order"
    cuts = [closure for closure in closures if isinstance(closure, Closure)]
    frames = {(closure.frame_a, closure.frame_b) for closure in cuts}
    kinds = {closure.kind for closure in cuts}
    if len(cuts) < len(closures) or frames != CUTS or not kinds <= {"6d", "orientation"}:
        return "the cuts differ from those of the YAML in the package"
    return ""

# SPDX-License-Identifier: BSD-2-Clause
"""What a URDF cannot say: closures, motors, gravity, joints of several axes, from a YAML file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from ..chain.closures import Closure
from ..errors import DescriptionError
from .urdf import AXES

Array = NDArray[np.float64]


class Cuts(NamedTuple):
    """What a URDF cannot say: content of the YAML file.

    Attributes:
        closures: Pairs of frames to be closed.
        actuated: Names of the motors' joints.
        gravity: Acceleration of gravity in base axes, shape (3,), [m/s^2].
        joints: What joints are in truth, by name; see `parse_urdf`.
    """

    closures: tuple[Closure, ...]
    actuated: tuple[str, ...]
    gravity: Array
    joints: dict[str, str]


def parse_cuts(text: str, source: str) -> Cuts:
    """Closures, motors and gravity of a YAML file in the LAAS schema.

    Args:
        text: The YAML with the keys `closed_loop`, `type` and `name_mot`; `gravity` may be missing
            and is then (0, 0, -9.81), `joint_name` and `joint_type` may be missing.
        source: What error messages call it.

    Raises:
        DescriptionError: With every problem found.
    """
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise DescriptionError(source, [f"not YAML: {error}"]) from None
    if not isinstance(content, dict):
        raise DescriptionError(source, ["no keys; closed_loop, type and name_mot are needed"])
    problems: list[str] = []

    def names(key: str, default: list[Any] | None = None) -> list[Any]:
        value = content.get(key, default)
        if not isinstance(value, list):
            problems.append(f"{key}: a list is needed")
            return []
        return value

    pairs, kinds, motors = names("closed_loop"), names("type"), names("name_mot")
    if len(pairs) != len(kinds):
        problems.append(f"closed_loop has {len(pairs)} entries, type has {len(kinds)}")
    closures = []
    for pair, kind in zip(pairs, kinds, strict=False):
        if not (isinstance(pair, list) and len(pair) == 2):
            problems.append(f"closed_loop: {pair!r} is not a pair of frame names")
        elif str(kind).lower() not in Closure.KINDS:
            problems.append(f"type: {kind!r} unknown; known: {', '.join(Closure.KINDS)}")
        else:
            closures.append(Closure(str(pair[0]), str(pair[1]), str(kind).lower()))
    gravity = content.get("gravity", [0, 0, -9.81])
    if not _is_vector(gravity):
        problems.append(f"gravity: {gravity!r} is not a list of three numbers")
    named, types = names("joint_name", []), [str(kind) for kind in names("joint_type", [])]
    if len(named) != len(types):
        problems.append(f"joint_name has {len(named)} entries, joint_type has {len(types)}")
    unknown = sorted(set(types) - set(AXES))
    problems += [f"joint_type: {kind!r} unknown; known: {', '.join(AXES)}" for kind in unknown]
    if problems:
        raise DescriptionError(source, problems)
    return Cuts(
        tuple(closures),
        tuple(map(str, motors)),
        np.array(gravity, dtype=float),
        dict(zip(map(str, named), types, strict=True)),
    )


def _is_vector(value: Any) -> bool:
    return (
        isinstance(value, Sequence)
        and len(value) == 3
        and all(isinstance(x, int | float) and np.isfinite(x) for x in value)
    )

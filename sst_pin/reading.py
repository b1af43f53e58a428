# SPDX-License-Identifier: BSD-2-Clause
"""From description files to Pinocchio: URDF to model, YAML to cuts."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import yaml
from numpy.typing import NDArray

from .closures import Closure
from .errors import DescriptionError

Array = NDArray[np.float64]


class Cuts(NamedTuple):
    """What a URDF cannot say: content of the YAML file.

    Attributes:
        closures: Pairs of frames to be closed.
        actuated: Names of the motors' joints.
        gravity: Acceleration of gravity in base axes, shape (3,), [m/s^2].
    """

    closures: tuple[Closure, ...]
    actuated: tuple[str, ...]
    gravity: Array


def read_text(path: str | Path, what: str) -> str:
    """The content of a description file.

    Raises:
        DescriptionError: When it cannot be read.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DescriptionError(str(path), [f"the {what} cannot be read: {error}"]) from None


def parse_urdf(text: str, source: str) -> pin.Model:
    """A Pinocchio model of a URDF.

    Args:
        text: The XML.
        source: What error messages call it.

    Raises:
        DescriptionError: When it is no URDF.
    """
    try:
        ET.fromstring(text)  # says line and column, which urdfdom does not
        return pin.buildModelFromXML(text)
    except (ET.ParseError, ValueError, RuntimeError) as error:
        raise DescriptionError(source, [f"not a URDF: {error}"]) from None


def parse_cuts(text: str, source: str) -> Cuts:
    """Closures, motors and gravity of a YAML file in the LAAS schema.

    Args:
        text: The YAML; `gravity` may be missing and is then (0, 0, -9.81).
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

    def names(key: str) -> list[Any]:
        value = content.get(key)
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
    if problems:
        raise DescriptionError(source, problems)
    return Cuts(tuple(closures), tuple(map(str, motors)), np.array(gravity, dtype=float))


def _is_vector(value: Any) -> bool:
    return (
        isinstance(value, Sequence)
        and len(value) == 3
        and all(isinstance(x, int | float) and np.isfinite(x) for x in value)
    )

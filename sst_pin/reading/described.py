# SPDX-License-Identifier: BSD-2-Clause
"""What a file says of a closed chain."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..chain.closures import Constraint
from ..chain.draft import Motor
from ..chain.lines import LineForce
from ..errors import SSTError
from .srdf import Srdf

Array = NDArray[np.float64]


class Described(NamedTuple):
    """A robot as its files describe it; what a robot is made of.

    Attributes:
        source: The files, for messages.
        model: The tree, with gravity and the named configurations as `referenceConfigurations`.
        closures: What closes the loops.
        actuated: The motors: joints, lines, and fixed tendons as the share of each joint.
        shapes: Function from a tree to the shapes of its bodies.
        stiffness: Stiffness of the joints' springs, shape (nv,); None without springs.
        spring_reference: Where they are at rest, shape (nq,).
        srdf: What stands beside a URDF.
        forces: Forces along lines.
    """

    source: str
    model: pin.Model
    closures: tuple[Constraint, ...]
    actuated: Sequence[Motor]
    shapes: Callable[..., pin.GeometryModel]
    stiffness: Array | None = None
    spring_reference: Array | None = None
    srdf: Srdf | None = None
    forces: tuple[LineForce, ...] = ()

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of the constructor of `ClosedChain`."""
        names = ("model", "closures", "actuated", "stiffness", "spring_reference", "forces")
        return {name: getattr(self, name) for name in names}


@contextmanager
def naming(source: str) -> Iterator[None]:
    """Add the file of the robot to errors."""
    try:
        yield
    except SSTError as error:
        error.name_file(source)
        raise

# SPDX-License-Identifier: BSD-2-Clause
"""What a file says of a closed chain."""

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import pinocchio as pin

from ..arrays import Array
from ..chain.closures import Constraint
from ..chain.draft import Motor
from ..chain.lines import LineForce
from ..errors import DescriptionWarning, SSTError
from .srdf import Srdf


class Described(NamedTuple):
    """A robot as its files describe it; what a robot is made of.

    Attributes:
        source: The files, for messages.
        model: The tree, with gravity and the named configurations as `referenceConfigurations`.
        closures: What closes the loops.
        actuated: The motors: joints, lines, and fixed tendons as the share of each joint.
        shapes: Function from a tree to the shapes of its bodies.
        stiffness, spring_reference: Springs of the joints, shapes (nv,) and (nq,); None without.
        srdf: What stands beside a URDF.
        forces: Forces along lines.
        notes: What of the files is left out.
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
    notes: tuple[str, ...] = ()

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


def warned(robot: Described, notes: Iterable[str], source: str) -> Described:
    """A robot, after a warning for each note to the caller of its reader's caller."""
    for note in dict.fromkeys(notes):
        warnings.warn(f"{source}: {note}", DescriptionWarning, stacklevel=4)
    return robot

# SPDX-License-Identifier: BSD-2-Clause
"""The description of a closed chain in its files."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, NamedTuple

import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionWarning, SSTError, warn_caller
from ..loops.coordinates import with_chosen_coordinates
from ..loops.geometry_correction import correct_geometry
from ..model.checks import Motor, copied, mechanism_of, motors_of
from ..model.closures import Constraint
from ..model.contacts import Contact, Rope, contacts_of
from ..model.lines import LineForce
from ..model.mechanism import Mechanism
from .problems import Problem
from .srdf import Srdf


class RobotFile(NamedTuple):
    """The description of a robot in its files."""

    source: str  #: The files, for messages.
    model: pin.Model  #: The tree, with gravity, and with the configurations that the files name.
    closures: tuple[Constraint, ...]
    actuated: Sequence[Motor]  #: The motors, as in the argument of `ClosedChain`.
    shapes: Callable[..., pin.GeometryModel]  #: Makes the shapes of the bodies, from the tree.
    stiffness: Array | None = None  #: Of the joints' springs, shape (nv,).
    spring_reference: Array | None = None  #: Where these springs are relaxed, shape (nq,).
    srdf: Srdf | None = None  #: The SRDF beside a URDF.
    lines: tuple[LineForce, ...] = ()
    brakes: tuple[str, ...] = ()
    contacts: tuple[Contact | Rope, ...] = ()
    weight_shares: Mapping[str, Array] = MappingProxyType({})  #: As `checked_shares` returns them.
    notes: tuple[Problem, ...] = ()  #: Warnings and notes, such as of content that is ignored.
    open_tree: str = ""  #: A warning if the robot has no loops; else empty.

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of the constructor of `ClosedChain`."""
        return {
            "model": self.model,
            "closures": self.closures,
            "actuated": self.actuated,
            "stiffness": self.stiffness,
            "spring_reference": self.spring_reference,
            "lines": self.lines,
            "brakes": self.brakes,
            "contacts": self.contacts,
            "weight_shares": self.weight_shares,
        }

    def mechanism(self) -> Mechanism:
        """The mechanism of this robot, whose dynamics are computed."""
        return with_chosen_coordinates(correct_geometry(self.uncorrected_mechanism()))

    def uncorrected_mechanism(self) -> Mechanism:
        """The mechanism with the rounded placements of the files, and without coordinates."""
        return mechanism_of(
            copied(self.model),
            self.closures,
            motors_of(self.actuated),
            coordinates=None,
            numbers={
                "viscous_friction": None,  # friction is in the model
                "coulomb_friction": None,
                "stiffness": self.stiffness,
                "spring_reference": self.spring_reference,
            },
            lines=self.lines,
            brakes=self.brakes,
            contacts=contacts_of(self.contacts),
            weight_shares=self.weight_shares,
        )


@contextmanager
def naming(source: str) -> Iterator[None]:
    """Put the name of the robot's file before the messages of errors."""
    try:
        yield
    except SSTError as error:
        error.name_file(source)
        raise


def warn_of(notes: Iterable[str], source: str) -> None:
    """Issue a warning for each note on a file, pointing to the caller outside the package."""
    for note in dict.fromkeys(notes):
        warn_caller(f"{source}: {note}", DescriptionWarning)

# SPDX-License-Identifier: BSD-2-Clause
"""Referees: motor torques of an SST by other methods and by other people's engines.

None of them uses `noc`, `closures` or `dynamics`. Each is built from `Parameters`, has its own
rates and accelerations, and answers one question, `Referee.torques`; what else a referee can do
(direct dynamics, time stepping, any closed chain) stands in its module.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, Protocol, runtime_checkable

from numpy.typing import ArrayLike

from ...arrays import Array
from ...description.parameters import Parameters
from ...errors import MissingExtraError

#: Moment of the surroundings on the star, base axes, shape (3,), [N m]; None for none.
Moment = ArrayLike | None

#: Module and class of every referee.
_REFEREES = (
    ("..virtual_work", "VirtualWork"),
    (".lagrange", "LagrangeMultipliers"),
    (".symbolic", "SymbolicLagrange"),
    (".mujoco_engine", "MujocoInverse"),
    (".exudyn_engine", "ExudynInstant"),
)


class Referee(Protocol):
    """Inverse dynamics of one instant, constructed with `Parameters`.

    Attributes:
        name: What a table calls it.
        package: What pip has to install for it.
    """

    name: str
    package: str

    def torques(
        self, R: ArrayLike, omega: ArrayLike, alpha: ArrayLike, platform_moment: Moment = None
    ) -> Array:
        """Motor torques of a motion of the star, on the working branch of all legs.

        Args:
            R: {E} in the base, shape (3, 3).
            omega: Angular velocity of the star, base axes, shape (3,), [rad/s].
            alpha: Its angular acceleration, base axes, shape (3,), [rad/s^2].
            platform_moment: See `Moment`.

        Returns:
            tau, shape (3,), [N m].
        """
        ...


@runtime_checkable
class DirectReferee(Protocol):
    """A referee that has direct dynamics of one instant too."""

    def accelerations(
        self, R: ArrayLike, omega: ArrayLike, tau: ArrayLike, platform_moment: Moment = None
    ) -> Array:
        """Angular acceleration of the star under given motor torques, base axes, shape (3,)."""
        ...


def all_referees(parameters: Parameters) -> tuple[list[Referee], list[MissingExtraError]]:
    """All installed referees for one SST, and for each missing one how to install it."""
    available: list[Referee] = []
    missing: list[MissingExtraError] = []
    for module, kind in _REFEREES:
        try:
            available.append(getattr(import_module(module, __name__), kind)(parameters))
        except MissingExtraError as error:
            missing.append(error)
    return available, missing


def engine(package: str) -> Any:
    """An optional package, imported when it is needed.

    Raises:
        MissingExtraError: When it is not installed.
    """
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise  # it is there, but something it needs is not
        raise MissingExtraError(package, "verify") from None

# SPDX-License-Identifier: BSD-2-Clause
"""Referees: motor torques of an SST by other methods and by other people's engines.

None of them uses `noc`, `closures` or `dynamics`. Each is built from `Parameters`, has its own
rates and accelerations, and answers one question, `Referee.torques`; what else a referee can do
(direct dynamics, time stepping, any closed chain) stands in its module.
"""

from importlib import import_module
from typing import Any, Protocol

from numpy.typing import ArrayLike

from ...arrays import Array
from ...errors import MissingExtraError

#: Moment of the surroundings on the star, base axes, shape (3,), [N m]; None for none.
Moment = ArrayLike | None


class Referee(Protocol):
    """Inverse dynamics of one instant, constructed with `Parameters`."""

    #: What a table calls it.
    name: str
    #: What pip has to install for it.
    package: str

    def torques(
        self, R: ArrayLike, omega: ArrayLike, alpha: ArrayLike, platform_moment: Moment = None
    ) -> Array:
        """Motor torques of a motion of the star, on the working branch of all legs, (3,), [N m].

        R is {E} in the base, shape (3, 3); omega and alpha are the angular velocity [rad/s] and
        acceleration [rad/s^2] of the star, base axes, shape (3,).
        """
        ...


def engine(package: str) -> Any:
    """An optional package, imported when it is needed."""
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise  # it is there, but something it needs is not
        raise MissingExtraError(package, "verify") from None

# SPDX-License-Identifier: BSD-2-Clause
"""The fast path of an SST: its compiled kernels, made when dynamics is first asked for.

A kernel vouches for the samples whose loops are clearly closed, which are clearly regular and
whose results are finite. The others go to the reference path, one by one: it raises its own error,
or finds the answer. The errors of both paths are the same by construction.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import whole_number
from ..chain.dynamics import Friction
from ..description import JOINT_NAMES
from ..errors import ClosureError
from . import kernels
from .kernels.packing import pack
from .topology import CUTS

if TYPE_CHECKING:
    from .star_dynamics import StarDynamics

Array = NDArray[np.float64]
#: Fills results of shape (n, size) and returns the samples that it leaves to the reference path.
Fill = Callable[[list[Array | None], Array], NDArray[np.intp]]


class FastPath:
    """The kernels of one robot, or the reason why it has none.

    Args:
        robot: Whose dynamics it is.
        off: Why not to use kernels; empty to use them.

    Attributes:
        inverse_dynamics: The kernel, for arrays that need no care, or what answers None.
        direct_dynamics: Likewise.
    """

    inverse_dynamics: Callable[..., Any]
    direct_dynamics: Callable[..., Any]

    def __init__(self, robot: StarDynamics, off: str) -> None:
        self._robot, self._off = robot, off or kernels.missing or misfit(robot)
        self.forget()

    @property
    def on(self) -> bool:
        """Whether there are kernels to be used."""
        return not self._off

    def __str__(self) -> str:
        if self._off or kernels.binding is None:
            return f"the reference path: {self._off}"
        return f"compiled kernels: {kernels.binding.instructions}"

    def __getstate__(self) -> dict[str, Any]:
        return {"_robot": self._robot, "_off": self._off}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._off = self._off or kernels.missing  # it may come from another machine
        self.forget()

    def forget(self) -> None:
        """Read the model anew when the kernels are next needed."""
        self._kernels: Any = None
        self.inverse_dynamics = self.direct_dynamics = _nothing

    def kernels(self) -> Any:
        """The compiled kernels with the numbers of this robot, or None.

        Raises:
            ActuationError: When the motors do not match the degrees of freedom.
        """
        if self._kernels is None and not self._off:
            try:
                self._robot.require_motors_to_match()
            except ClosureError:
                return None  # nothing generic to judge by: the reference path asks at each q
            self._kernels = self.kernels_with(self._robot.friction)
            self.inverse_dynamics = self._kernels.inverse_dynamics
            self.direct_dynamics = self._kernels.direct_dynamics
        return self._kernels

    def kernels_with(self, friction: Friction) -> Any:
        """Kernels with another friction than the robot's; None without an extension."""
        if self._off or kernels.binding is None:
            return None
        robot = self._robot
        return kernels.binding.Kernels(pack(robot.model, robot.geometry, friction))

    def torques(self, threads: int) -> Fill | None:
        """Inverse dynamics of (q, va, aa, moment) by the kernels, None without them."""
        threads, own = whole_number("threads", threads, 1), self.kernels()
        if own is None:
            return None
        return lambda flat, tau: _left(own.inverse_dynamics(*flat, tau, threads))

    def accelerations(self, threads: int) -> Fill | None:
        """Direct dynamics of (q, va, tau, moment) by the kernels, None without them."""
        threads, own = whole_number("threads", threads, 1), self.kernels()
        if own is None:
            return None
        return lambda flat, aa: _left(own.direct_dynamics(*flat, aa, threads))

    def reduced_terms(self, threads: int) -> Fill | None:
        """All terms at (q, va), a row for each sample, by the kernels, None without them."""
        threads, own = whole_number("threads", threads, 1), self.kernels()
        if own is None:
            return None
        return lambda flat, rows: _left(own.reduced_terms(*flat, rows, threads))


def misfit(robot: StarDynamics) -> str:
    """What keeps a robot from the kernels, wherever they run; empty when nothing does."""
    if robot.joint_names != JOINT_NAMES:
        return "the joints of the model stand in another order"
    frames = {(closure.frame_a, closure.frame_b) for closure in robot.closures}
    kinds = {closure.kind for closure in robot.closures}
    if frames != CUTS or not kinds <= {"6d", "orientation"}:
        return "the cuts are others than those of the shipped YAML"
    return ""


def _nothing(*_: object) -> None:
    return None


def _left(answer: tuple[Any, ...]) -> NDArray[np.intp]:
    flags = answer[0]
    return np.flatnonzero(flags) if flags is not None else np.empty(0, dtype=np.intp)

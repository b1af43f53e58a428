# SPDX-License-Identifier: BSD-2-Clause
"""Moves a closed robot by hand, up to limits and singularities."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import in_one_turn
from ..chain.appearance import Sliders
from ..chain.closed_chain import ClosedChain
from ..errors import ClosureError, SSTError, WorkspaceError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Length of a step, [rad] or as a share of the robot's length. A joint that moves by more than
#: `_JUMP` in a step has changed its assembly.
_STEP, _JUMP = np.radians(1.0), 0.5
#: Limits that wide are none: two turns, or as much by the robot's length.
_WIDE = 4 * np.pi


class Pose(NamedTuple):
    """A pose that was reached.

    Attributes:
        q: Configuration, shape (nq,).
        stopped: Reason for stopping before the goal; empty if it was reached.
    """

    q: Array
    stopped: str = ""


class Jog:
    """Moves a robot by hand.

    Attributes:
        sliders: The robot's own sliders, then its coordinates, a group for each unit. A coordinate
            that is a joint by itself has the joint's position; one of several rates of a joint
            is the displacement from `start`, about or along its axis.

    Args:
        robot: Any closed chain.
        start: A configuration, shape (nq,).
        size: A length of the robot, [m].
    """

    def __init__(self, robot: ClosedChain, start: Array, size: float) -> None:
        self._robot, self._start, self._size = robot, start, size
        self._space = robot.mechanism.space
        self._scale = np.array([1.0 if u == "rad" else 1 / size for u in self._space.rate_units])
        self.sliders = [*robot.appearance.sliders, *self._coordinates()]

    def move(self, sliders: Sliders, q: Array, goal: ArrayLike) -> Pose:
        """Move the robot in small steps, as far as they lead within one assembly.

        Args:
            sliders: One of the groups.
            q: Where it stands, shape (nq,).
            goal: Values to go to, shape (n,).
        """
        start = sliders.read(q)
        way = np.asarray(goal, dtype=float) - start
        longest = float(np.abs(way).max()) / (1.0 if sliders.unit == "rad" else self._size)
        steps = max(1, int(np.ceil(longest / _STEP)))
        for share in np.arange(1, steps + 1) / steps:
            try:
                q = self._continued(q, sliders.solve(start + share * way, q))
            except SSTError as error:
                return Pose(q, str(error))
        return Pose(q)

    # --- inside -----------------------------------------------------------------------------

    def _coordinates(self) -> Iterator[Sliders]:
        robot, space, start = self._robot, self._space, self._start
        model = robot.mechanism.model
        title = "Motors" if robot.coordinates == robot.motor_names else "Coordinates"
        low, high, offset, endless = self._ranges()
        rates = space.rates_of(robot.coordinates)
        for unit in dict.fromkeys(space.rate_units[k] for k in rates):
            own = np.array([k for k in rates if space.rate_units[k] == unit])

            def read(q: Array, own: Indices = own) -> Array:
                values: Array = pin.difference(model, start, q) + offset
                values[endless] = in_one_turn(values[endless])
                return values[own]

            def solve(values: Array, q: Array, own: Indices = own) -> Array:
                way = pin.difference(model, start, q)
                way[own] = values - offset[own]
                try:
                    return robot.assemble(pin.integrate(model, start, way))
                except ClosureError:
                    raise WorkspaceError("the loops cannot be closed beyond this pose") from None

            names = tuple(space.rate_names[k] for k in own)
            yield Sliders(title, unit, names, low[own], high[own], read, solve)

    def _ranges(self) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """For each rate the least and largest value, that at the start, and whether it is endless.

        Without limits an angle has one turn, a length two of the robot's each way from the start.
        """
        model, start, units = self._robot.mechanism.model, self._start, self._space.rate_units
        offset, endless = np.zeros(model.nv), np.zeros(model.nv, dtype=bool)
        limits = np.full((2, model.nv), np.inf)
        for joint in list(model.joints)[1:]:
            i, k = joint.idx_q, joint.idx_v
            if (joint.nq, joint.nv) == (1, 1):
                offset[k] = start[i]
                limits[:, k] = model.lowerPositionLimit[i], model.upperPositionLimit[i]
            elif (joint.nq, joint.nv) == (2, 1):
                offset[k], endless[k] = np.arctan2(start[i + 1], start[i]), True
        way = np.array([np.pi if unit == "rad" else 2 * self._size for unit in units])
        middle = np.where([unit == "rad" for unit in units], 0.0, offset)
        wide = np.abs(limits).max(axis=0) >= _WIDE / 2 / self._scale
        low, high = np.where(wide, (middle - way, middle + way), limits)
        return np.minimum(low, offset), np.maximum(high, offset), offset, endless

    def _continued(self, before: Array, q: Array) -> Array:
        """The next configuration, if the way does not end there.

        Raises:
            WorkspaceError: When the way ends here.
        """
        robot = self._robot
        for finding in robot.check(q):
            if finding.singular:
                raise WorkspaceError(finding.problem)
        moved = pin.difference(robot.mechanism.model, before, q) * self._scale
        if np.abs(moved).max(initial=0.0) > _JUMP:
            raise WorkspaceError("end of this assembly")
        return q

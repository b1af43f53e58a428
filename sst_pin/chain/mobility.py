# SPDX-License-Identifier: BSD-2-Clause
"""How many ways a closed chain can move, and whether its motors hold all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from .noc import independent_rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mobility:
    """Degrees of freedom of a closed chain at one configuration.

    Attributes:
        joints: Names of the m joints.
        actuated: Names of the n actuated joints.
        rows: What each closure row holds, one name a row.
        independent_rows: Indices of rows that carry the rank.
        degrees_of_freedom: m minus the rank of Phi.
        held: Degrees of freedom that remain fixed when the motors are locked.
        loose_joints: Unactuated joints that still move with the motors locked.
        condition_number: Of Phi^u, infinite when the motors do not suffice.
    """

    joints: tuple[str, ...]
    actuated: tuple[str, ...]
    rows: tuple[str, ...]
    independent_rows: tuple[int, ...]
    degrees_of_freedom: int
    held: int
    loose_joints: tuple[str, ...]
    condition_number: float

    @property
    def rank(self) -> int:
        """Independent closure equations."""
        return len(self.independent_rows)

    @property
    def redundant_rows(self) -> int:
        """Closure equations that follow from the others."""
        return len(self.rows) - self.rank

    @property
    def sufficient(self) -> bool:
        """Whether the motors hold every degree of freedom."""
        return self.held == self.degrees_of_freedom

    @property
    def redundantly_actuated(self) -> bool:
        """Whether there are more motors than degrees of freedom."""
        return len(self.actuated) > self.degrees_of_freedom

    def __str__(self) -> str:
        n, dof = len(self.actuated), self.degrees_of_freedom
        if not self.sufficient:
            verdict = (
                f"INSUFFICIENT: {dof - self.held} degree(s) of freedom move with the motors "
                f"locked, through {', '.join(self.loose_joints)}"
            )
        elif self.redundantly_actuated:
            verdict = f"TOO MANY: {n - dof} of them must follow from the others"
        else:
            verdict = "sufficient, one motor for each degree of freedom"
        return "\n".join(
            [
                f"joints              {len(self.joints)}",
                f"closure equations   {len(self.rows)}, rank {self.rank}, "
                f"{self.redundant_rows} redundant",
                f"degrees of freedom  {dof}",
                f"actuated joints     {n} ({', '.join(self.actuated)})",
                f"actuation           {verdict}",
                f"condition number    {self.condition_number:.4g} (unactuated joints)",
            ]
        )


def analyse(
    Phi: Array,
    joints: Sequence[str],
    actuated: Sequence[int],
    unactuated: Sequence[int],
    rows: Sequence[str],
) -> Mobility:
    """Count the motions that a closures' Jacobian leaves.

    Args:
        Phi: Jacobian of the closures where they hold, shape (rows, m).
        joints: Names of the m joints.
        actuated: Indices of the actuated ones.
        unactuated: Indices of the others.
        rows: A name for each row.
    """
    independent = independent_rows(Phi)
    loose = null_space(Phi[:, unactuated], rcond=1e-8)  # motions with locked motors
    moving = np.abs(loose).max(axis=1, initial=0.0) > 1e-6
    degrees_of_freedom = Phi.shape[1] - len(independent)
    return Mobility(
        joints=tuple(joints),
        actuated=tuple(joints[i] for i in actuated),
        rows=tuple(rows),
        independent_rows=tuple(map(int, independent)),
        degrees_of_freedom=degrees_of_freedom,
        held=degrees_of_freedom - loose.shape[1],
        loose_joints=tuple(joints[i] for i, m in zip(unactuated, moving, strict=True) if m),
        condition_number=np.inf if loose.shape[1] else float(np.linalg.cond(Phi[:, unactuated])),
    )

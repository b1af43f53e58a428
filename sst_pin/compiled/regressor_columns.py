# SPDX-License-Identifier: BSD-2-Clause
"""The regressor on CasADi's symbols: derivatives of the forces by the open numbers."""

from __future__ import annotations

from typing import Any

import casadi as ca
from casadi import SX

from .equations import Equations
from .kernel_checks import Checks


def torque_regressor(e: Equations, checks: Checks) -> tuple[list[SX], SX, list[Any]]:
    """Y row by row; the equations have all open numbers, those of `with_springs` too."""
    nv, by_numbers = e.mechanism.model.nv, ca.jacobian(e.project(e.tree_forces), e.p)
    *blocks, lines = (by_numbers @ ca.sparsify(ca.DM(x)) for x in e.parameters.by_parameters())
    offsets = ca.horzcat(*(e.project({i: 1.0}) for i in range(nv)))
    columns = ca.horzcat(*blocks, offsets, lines, *map(e.project, e.motor_columns))
    own = checks.of_rates + checks.unsolved(e.dv, e.drift) + checks.of_complement
    return [e.q, e.va, e.aa], ca.vec(columns.T), own

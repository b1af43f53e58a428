# SPDX-License-Identifier: BSD-2-Clause
"""Shares of tolerances."""

from __future__ import annotations

import numpy as np

from ..arrays import require_instance
from ..design.tolerances import Tolerances
from .style import Axes


def tolerance_shares(ax: Axes, tolerances: Tolerances, most: int = 12) -> Axes:
    """Bars of the parts of the variance that the largest tolerances contribute, `most` of them."""
    require_instance("tolerances", tolerances, Tolerances)
    table = 100 * np.array(list(tolerances.shares.values()))
    order = np.argsort(-table.sum(axis=0), kind="stable")[:most]
    height = 0.8 / len(table)
    for k, (name, row) in enumerate(zip(tolerances.shares, table, strict=True)):
        ax.barh(np.arange(len(order)) + k * height, row[order], height, label=name, align="edge")
    ax.set_yticks(np.arange(len(order)) + 0.4, [tolerances.names[k] for k in order])
    ax.invert_yaxis()
    ax.set_xlabel("part of the variance (%)")
    ax.legend(loc="lower right")
    return ax

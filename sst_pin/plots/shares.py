# SPDX-License-Identifier: BSD-2-Clause
"""Bars of the parts that tolerances contribute to the variance of a robot's errors."""

from __future__ import annotations

import numpy as np

from ..arrays import require_instance
from ..design.tolerances import Tolerances
from .style import Axes


def tolerance_shares(ax: Axes, tolerances: Tolerances, most: int = 12) -> Axes:
    """Bars of the parts of the variance, in percent, for the tolerances with the largest parts.

    Args:
        ax: 2-D axes.
        tolerances: The result of a tolerance analysis.
        most: The most tolerances that are shown: the ones with the largest sums of parts.
    """
    require_instance("tolerances", tolerances, Tolerances)
    # A row for each subject, such as "position", and a column for each tolerance.
    percent = 100 * np.array(list(tolerances.shares.values()))
    order = np.argsort(-percent.sum(axis=0), kind="stable")[:most]
    height = 0.8 / len(percent)
    for k, (name, row) in enumerate(zip(tolerances.shares, percent, strict=True)):
        ax.barh(np.arange(len(order)) + k * height, row[order], height, label=name, align="edge")
    ax.set_yticks(np.arange(len(order)) + 0.4, [tolerances.names[k] for k in order])
    ax.invert_yaxis()
    ax.set_xlabel("part of the variance (%)")
    ax.legend(loc="lower right")
    return ax

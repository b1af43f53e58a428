# SPDX-License-Identifier: BSD-2-Clause
"""Results of nonsmooth steps of many robots on one device."""

from typing import Any, NamedTuple

#: Violations with which a step may start, relative to those of a motion's start: a step leaves an
#: error of second order.
FRESH, CONTINUED = 1.0, 10.0
#: The most series of sweeps and Newton's steps in a step, by default.
ITERATIONS = 12


class NonsmoothState(NamedTuple):
    """States of N robots after `step(..., nonsmooth=True)`, and the forces that led to them.

    Forces are means over the time `dt`. The arrays are those of Warp.

    Attributes:
        q: Configurations, shape (N, nq).
        va: Rates of the coordinates, shape (N, n).
        contact_forces: Forces on the bodies of the contacts' frames, in axes of their grounds,
            shape (N, contacts, 3), [N].
        tensions: Tensions of the ropes, then of lines with `pulls_only`, shape (N, ropes + cables),
            [N].
        joint_forces: Forces of stops and dry friction on the joints, shape (N, nv).
        line_friction: Dry friction of the lines that have it; positive where it pushes the ends
            apart, shape (N, lines with friction), [N].
        residual: The largest error of complementarity of the substeps, relative to the impulses,
            shape (N,).
        impulses: Of the last substep, for all rows, shape (N, m): where the solver of the next step
            starts.
    """

    q: Any
    va: Any
    contact_forces: Any
    tensions: Any
    joint_forces: Any
    line_friction: Any
    residual: Any
    impulses: Any

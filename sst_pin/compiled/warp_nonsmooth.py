# SPDX-License-Identifier: BSD-2-Clause
"""Results of nonsmooth steps of many robots on one device."""

from typing import Any, NamedTuple

# A step may start with a small violation of contacts, ropes and stops. The largest one is a
# multiple of `NonsmoothRows.least_gaps`, 1/1000 of the robot's length or of a radian, which is the
# largest violation at the start of `ClosedChain.rollout`.
#: The multiple for a step that begins a motion.
FRESH = 1.0
#: The multiple for a step that continues another one, because the other step leaves a violation. A
#: violation above 1/100 of the length or of a radian means that the steps are too long.
CONTINUED = 10.0
#: The most rounds of the solver in a substep, by default. Each round consists of Gauss-Seidel
#: sweeps and Newton's steps. There are fewer than the 30 of `rollout`, because neighbouring robots
#: on a GPU wait for the slowest one.
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
        impulses: Impulses of the last substep, from which the solver of the next step starts, shape
            (N, m). There is one for each of the m rows of the solver: contacts (three rows each),
            ropes, cables, stops, joints and lines with dry friction.
    """

    q: Any
    va: Any
    contact_forces: Any
    tensions: Any
    joint_forces: Any
    line_friction: Any
    residual: Any
    impulses: Any

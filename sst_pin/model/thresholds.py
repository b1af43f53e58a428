# SPDX-License-Identifier: BSD-2-Clause
"""Where both paths draw lines: when loops count as closed, ranks as full, joints as at rest."""

#: Loops further open than this are open, relative to their length or in [rad].
CLOSURE_TOLERANCE = 1e-6
#: Loops that stay open by less, relative to their length or in [rad], may do so because their
#: numbers have few digits. So small singular values of Phi may then come from the digits, too.
FEW_DIGITS = 3e-3
#: How far redundant rows of Phi may be off, in multiples of what their loops are open by. On
#: overconstrained linkages they are off by less than that; rates of too many coordinates break them
#: by about their own size.
INCONSISTENT = 10.0
#: A singular value or pivot this much smaller than the largest counts as zero: assembled closures
#: leave noise of 1e-12, a mechanism that still moves at 1e-8 is of no use.
RANK_TOLERANCE = 1e-8
#: A rate or a motor that moves less than this part of a motion rests: a tenth of what the largest
#: condition number allows.
RESTS = 1e-7
#: A rate of whose motion a smaller part is beside the rates already chosen moves with these.
INDEPENDENT = 1e-4
#: Where the constraints count as singular: half of the sixteen digits are lost by then.
MAX_CONDITION_NUMBER = 1e8
#: A force that the motors leave over counts as none below this part of the forces that meet in its
#: coordinate: as for ranks, half of the sixteen digits. No unit and no size of a robot changes it,
#: and the rest of a light part on a machine a million times heavier is fifty times as large.
UNSUPPLIED = 1e-8
#: What rounding leaves of forces that do not act along a coordinate, relative to their sizes.
ROUNDING = 1e-12
#: A coordinate whose inertia is a smaller part of that of all bodies, were they to move as fast as
#: the fastest joint, moves no mass: the square of what rounding leaves of the rates.
WITHOUT_MASS = 1e-20
#: A component of a reaction that inner stresses of size one change by less, free of units, is
#: unique: loops that are open by their tolerance change it by about that.
UNIQUE = 1e-5
#: A line that is shorter has no direction, relative to the length of the robot.
LEAST_LENGTH = 1e-9
#: Joints that are slower are at rest, [rad/s] or [m/s]: the sign of their rate is rounding.
AT_REST = 1e-12
#: Condition number of the dependent joints below which coordinates are kept or taken up again, and
#: the margin by which others must be better.
WELL_CONDITIONED, MARGIN = 20.0, 4.0
#: Part of the way of a rollout's step by which it may leave the loops open: a longer one misses a
#: bend.
BEND = 0.003

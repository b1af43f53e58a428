# SPDX-License-Identifier: BSD-2-Clause
"""Thresholds of both paths: when loops are closed, ranks full, and joints at rest.

All but `AT_REST` are free of units: lengths are divided by a length of the robot or of its loops.
The rounding of a number is 1e-16 of it. Where a number is called a choice, no theory gives it.
"""

# --- closed loops -----------------------------------------------------------------------------

#: Loops with a larger error are open. Errors in [m] are relative to the length of the loops, errors
#: of angles are in [rad]. A choice: files with six digits pass; assembled loops have 1e-12.
CLOSURE_TOLERANCE = 1e-6
#: Errors of loops up to this number, relative to their length or in [rad], may come from rounded
#: placements. So may singular values of Phi. A choice: six times the error of a number with three
#: digits after the point, because the errors of several placements add up in a loop.
ROUNDED_PLACEMENTS = 3e-3
#: Rounded placements explain the errors of loops if displacements that correct the errors are at
#: most this many times the rounding of the file's numbers. Measured: 1.1 times at most for robots
#: of the gallery with 3 to 6 digits, 1.9 times for a scissor lift of eight cells; 800 times for
#: axes that are tilted by 1e-3 on purpose.
EXPLAINED = 5.0
#: Redundant rows of Phi are consistent if the rates violate them by at most this many times the
#: errors of their loops. A choice: in overconstrained linkages the violation is about as large as
#: the errors. With too many coordinates it is about as large as the rows, which are of size one:
#: for loops at `CLOSURE_TOLERANCE` this is 1e5 times the bound.
INCONSISTENT = 10.0

# --- ranks and independent motions ------------------------------------------------------------

#: Singular values and pivots below this part of the largest are zero. The noise of assembled
#: closures is 1e-12.
RANK_TOLERANCE = 1e-8
#: Constraints with a larger condition number are singular: half of the sixteen digits are lost.
MAX_CONDITION_NUMBER = 1e8
#: Rates and motors that move less than this part of a motion are at rest. The error of a motion is
#: at most 1e-8: its rounding times the largest condition number. This is ten times as much.
RESTS = 1e-7
#: A rate depends on the rates already chosen if less than this part of its motion is independent of
#: them. Otherwise the condition number of these coordinates could be above 1e4. A choice.
INDEPENDENT = 1e-4

# --- forces and inertia -----------------------------------------------------------------------

#: An unsupplied force is ignored if it is below this fraction of the sum of all forces on its
#: coordinate: rounding times the largest condition number.
UNSUPPLIED = 1e-8
#: Pivots of the mass matrix below this part of their diagonal entries are rounding, and so are
#: negative eigenvalues smaller than this part of the largest. Sums over the bodies lose up to four
#: digits.
ROUNDING = 1e-12
#: Coordinate k moves no mass if its inertia is below this fraction of I |L e_k|^2. Here I is the
#: inertia of the whole robot, and L e_k are the rates of the joints, free of units, at the rate 1
#: of the coordinate. 1e-20 is the square of the rounding of a rate, 1e-10.
WITHOUT_MASS = 1e-20
#: A component of a reaction is unique if inner stresses of size one, free of units, change it by at
#: most this number. Loops that are open by `CLOSURE_TOLERANCE` change it by up to ten times that.
UNIQUE = 1e-5

# --- small lengths and rates ------------------------------------------------------------------

#: Lines that are shorter than this part of the robot's length have no direction: positions are
#: known to fifteen digits of this length, so that a direction would have less than six.
LEAST_LENGTH = 1e-9
#: A contact, rope or stop whose rate is smaller than this part of the coordinates' rates, free of
#: units, is held by the loops: its rate is rounding, which is at most 1e-12.
HELD_BY_LOOPS = 1e-10
#: Joints that are slower are at rest, [rad/s] or [m/s]: the sign of their rate is rounding, which
#: is at most 1e-12 for rates of size one.
AT_REST = 1e-12

# --- coordinates of a motion ------------------------------------------------------------------

#: Coordinates are kept, or used again, while the condition number of the dependent joints is below
#: this number. A choice: larger numbers cost digits, smaller ones cost changes of coordinates.
WELL_CONDITIONED = 20.0
#: Other coordinates replace them only if their condition number is smaller by this factor. A
#: choice: with 1, a motion would change to and fro between coordinates that are equally good.
MARGIN = 4.0

# --- steps of a rollout -----------------------------------------------------------------------

#: Largest correction that closes the loops after a step of a rollout, relative to the step. A
#: larger one means that the step is too long for the curvature of the motion. A choice: smaller
#: numbers refuse steps that are still exact, larger ones accept steps that are not.
BEND = 0.003

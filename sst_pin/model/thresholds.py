# SPDX-License-Identifier: BSD-2-Clause
"""Thresholds of both paths: when loops are closed, ranks full, and joints at rest."""

#: Loops with a larger error are open. Errors in [m] are relative to the length of the loops, errors
#: of angles are in [rad].
CLOSURE_TOLERANCE = 1e-6
#: Smaller errors of loops, relative to their length or in [rad], and smaller singular values of Phi
#: may come from rounded placements: a file with three digits after the point.
ROUNDED_PLACEMENTS = 3e-3
#: Displacements that correct rounded placements, in multiples of the rounding of their numbers. A
#: displacement is of the size of the rounding, unless many placements have to be in line.
EXPLAINED = 5.0
#: Largest violation of redundant rows of Phi, in multiples of the errors of their loops. That of
#: overconstrained linkages is smaller; with too many coordinates it is about the rows' size.
INCONSISTENT = 10.0
#: Singular values and pivots below this part of the largest are zero. Assembled closures have noise
#: of 1e-12.
RANK_TOLERANCE = 1e-8
#: Rates and motors that move less than this part of a motion are at rest. It is ten times the
#: inverse of the largest condition number.
RESTS = 1e-7
#: A rate depends on the rates already chosen if a smaller part of its motion is independent: as
#: coordinates they would have a condition number above 1e4.
INDEPENDENT = 1e-4
#: Constraints with a larger condition number are singular: half of the sixteen digits are lost.
MAX_CONDITION_NUMBER = 1e8
#: An unsupplied force is ignored if it is below this fraction of the sum of all forces on its
#: coordinate. This fraction does not depend on units or on the size of the robot.
UNSUPPLIED = 1e-8
#: Pivots of the mass matrix below this part of their diagonal entries are rounding, and so are
#: negative eigenvalues smaller than this part of the largest.
ROUNDING = 1e-12
#: A coordinate counts as massless if its inertia is below this fraction of the whole robot's
#: inertia, times the sum of the squares of the rates, free of units, that the rate 1 of the
#: coordinate causes. 1e-20 is the square of the rates' rounding error.
WITHOUT_MASS = 1e-20
#: A component of a reaction is unique if inner stresses of size one change it by less, free of
#: units. Loops that are open by their tolerance change it by about that.
UNIQUE = 1e-5
#: Lines that are shorter than this part of the robot's length have no direction: positions have
#: fifteen digits of this length, so that less than six are left.
LEAST_LENGTH = 1e-9
#: A contact, rope or stop whose rate is smaller than this part of the coordinates' rates, free of
#: units, is held by the loops: its rate is rounding, which is at most 1e-12.
HELD_BY_LOOPS = 1e-10
#: Joints that are slower are at rest, [rad/s] or [m/s]: the sign of their rate is rounding.
AT_REST = 1e-12
#: Coordinates are kept, or used again, while the condition number of the dependent joints is below
#: this number.
WELL_CONDITIONED = 20.0
#: Other coordinates must have a condition number that is smaller by this factor.
MARGIN = 4.0
#: Largest correction that closes the loops after a step of a rollout, relative to the step. A
#: larger one means that the step is too long for the curvature of the motion.
BEND = 0.003

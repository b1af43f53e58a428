# SPDX-License-Identifier: BSD-2-Clause
"""Thresholds of both paths: when loops are closed, ranks full, and joints at rest."""

#: Loops with a larger error are open, relative to their length or in [rad].
CLOSURE_TOLERANCE = 1e-6
#: Smaller errors of loops, relative to their length or in [rad], and smaller singular values of Phi
#: may come from numbers with few digits.
FEW_DIGITS = 3e-3
#: Largest violation of redundant rows of Phi, in multiples of the errors of their loops. That of
#: overconstrained linkages is smaller; with too many coordinates it is about the rows' size.
INCONSISTENT = 10.0
#: Singular values and pivots below this part of the largest are zero. Assembled closures have noise
#: of 1e-12.
RANK_TOLERANCE = 1e-8
#: Rates and motors that move less than this part of a motion are at rest: a tenth of what the
#: largest condition number allows.
RESTS = 1e-7
#: A rate depends on the rates already chosen if a smaller part of its motion is independent.
INDEPENDENT = 1e-4
#: Constraints with a larger condition number are singular: half of the sixteen digits are lost.
MAX_CONDITION_NUMBER = 1e8
#: Forces that no motor supplies are zero below this part of all forces in their coordinate. It does
#: not depend on units or on the size of the robot.
UNSUPPLIED = 1e-8
#: Rounding of forces that do not act along a coordinate, relative to their sizes.
ROUNDING = 1e-12
#: A coordinate moves no mass if its inertia is below this part of that of all bodies at the rate of
#: the fastest joint: the square of the rounding of the rates.
WITHOUT_MASS = 1e-20
#: A component of a reaction is unique if inner stresses of size one change it by less, free of
#: units. Loops that are open by their tolerance change it by about that.
UNIQUE = 1e-5
#: Lines that are shorter have no direction, relative to the length of the robot.
LEAST_LENGTH = 1e-9
#: Joints that are slower are at rest, [rad/s] or [m/s]: the sign of their rate is rounding.
AT_REST = 1e-12
#: Coordinates are kept or used again if the condition number of the dependent joints is smaller;
#: others must be better by the margin.
WELL_CONDITIONED, MARGIN = 20.0, 4.0
#: Part of a rollout's step by which it may leave the loops open: a larger part means that it missed
#: a bend.
BEND = 0.003

# SPDX-License-Identifier: BSD-2-Clause
"""Numbers on which several packages have to agree."""

#: Gravity on Earth, [m/s^2]. It gives the order of magnitude of forces and accelerations for robots
#: whose model has no gravity; results of the dynamics do not contain it.
EARTH_GRAVITY = 9.81
#: Limits of this size and larger ones mean "no limit", in [rad], [m], [N m], [N] and their rates.
#: Files use numbers from 1e9 to 1e16 for this; no limit of a real joint is so large.
NO_LIMIT = 1e9

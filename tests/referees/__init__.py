# SPDX-License-Identifier: BSD-2-Clause
"""Referees: motor torques of an SST by other methods and by other people's engines.

None of them uses `noc`, `closures` or `dynamics`. Each is built from `Parameters`, has its own
rates and accelerations, and answers one question, `torques(R, omega, alpha, platform_moment)`: the
motor torques of a motion of the star on the working branch of all legs, shape (3,), [N m]. R is {E}
in the base, omega [rad/s] and alpha [rad/s^2] are those of the star in base axes. What else a
referee can do (direct dynamics, time stepping) stands in its module.
"""

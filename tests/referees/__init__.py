# SPDX-License-Identifier: BSD-2-Clause
"""Referees: motor torques of an SST by other methods and by other people's engines.

None of them uses `noc`, `closures` or `dynamics`. Each is built from `Parameters`, has its own
rates and accelerations, and answers one question, `torques(R, omega, alpha, platform_moment)`: the
motor torques of a motion of the star on the working branch of all legs, shape (3,), [N m]. R is {E}
in the base, omega [rad/s] and alpha [rad/s^2] are those of the star in base axes. What else a
referee can do (direct dynamics, time stepping) stands in its module.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sst_pin.arrays import Array
from sst_pin.description.parameters import Parameters
from sst_pin.errors import ClosureError

#: Moment of the surroundings on the star, base axes, shape (3,), [N m]; None for none.
Moment = ArrayLike | None
#: Largest difference of a pose by an engine's own frames, [rad] or [rad/s].
_TOLERANCE = 1e-9


class LegAxes(NamedTuple):
    """Joint axes and angles of the three legs, a row for each, shape (3, 3)."""

    e: Array  #: Actuated axes e_k, base axes.
    u: Array  #: Axes e_{k+3} of mu_k, towards R_k.
    n: Array  #: Axes e_{k+6} of beta_k, normals of the arcs.
    angles: Array  #: gamma_k, mu_k, beta_k, [rad].


def legs(parameters: Parameters, R: ArrayLike) -> LegAxes:
    """The legs that carry the star at R, {E} in the base, with 0 < mu_k < pi.

    Only a start: each engine holds what it gets from here against its own frames.
    """
    R = np.asarray(R, dtype=float)
    v = parameters.base_directions
    e = _unit(np.cross(v, v[[1, 2, 0]]))
    # The arcs stand round s at the angles 0, alpha_2, alpha_2 + alpha_3.
    turn = np.cumsum([0.0, *parameters.arc_angles[1:]])
    n = -np.outer(np.sin(turn), R[:, 1]) + np.outer(np.cos(turn), R[:, 2])
    u = _unit(np.cross(e, n))  # in the planes of base arc and star arc
    angles = _angle(e, v, u), _angle(u, e, n), _angle(n, u, np.tile(R[:, 0], (3, 1)))
    return LegAxes(e, u, n, np.stack(angles, axis=-1))


def require_same(found: Array, wanted: Array, what: str) -> None:
    """Refuse a pose by an engine's own kinematics that differs from the wanted one."""
    error = float(np.abs(found - wanted).max())
    if not error <= _TOLERANCE:
        raise ClosureError(f"{what} of the engine is off by {error:.3g}", error)


def _unit(a: Array) -> Array:
    lengths: Array = np.linalg.norm(a, axis=-1, keepdims=True)
    return a / lengths


def _angle(axis: Array, start: Array, end: Array) -> Array:
    """Angles about unit axes that bring one direction to another, row by row."""
    return np.arctan2(np.vecdot(np.cross(axis, start), end), np.vecdot(start, end))

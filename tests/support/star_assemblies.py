# SPDX-License-Identifier: BSD-2-Clause
"""Direct kinematics of the SST by two conics, a referee for the package's by quaternions."""

import numpy as np
from numpy.typing import NDArray

from sst_pin import Parameters

Array = NDArray[np.float64]

#: Quantities of the size of one count as zero below this.
_ZERO = 1e-12


def orientations(parameters: Parameters, gamma: Array) -> Array:
    """Every real assembly for given motor angles, {E} in the base, shape (n, 3, 3), n <= 8.

    The legs' u_k . n_k = 0 hold the second and third column of R, six numbers, to a space of
    three dimensions. In it |w_2| = |w_3| and w_2 . w_3 = 0 are two conics, which meet in at
    most four points, each standing for two signs.
    """
    x_0 = parameters.base_directions
    e = np.cross(x_0, x_0[[1, 2, 0]])
    e /= np.linalg.norm(e, axis=1)[:, None]
    u = np.cos(gamma)[:, None] * x_0 + np.sin(gamma)[:, None] * np.cross(e, x_0)
    turn = np.cumsum([0.0, *parameters.arc_angles[1:]])  # from arc 1 to arc k about s
    legs = np.hstack([-np.sin(turn)[:, None] * u, np.cos(turn)[:, None] * u])
    _, size, axes = np.linalg.svd(legs)
    assert size[-1] > _ZERO  # otherwise the motor angles do not fix the star
    W_2, W_3 = np.sqrt(2) * axes[3:, :3].T, np.sqrt(2) * axes[3:, 3:].T
    conics = np.array([W_2.T @ W_2 - W_3.T @ W_3, W_2.T @ W_3 + W_3.T @ W_2])
    x = np.array(common_points(conics)).reshape(-1, 3)
    w_2, w_3 = (np.concatenate([x, -x]) @ W.T for W in (W_2, W_3))
    return np.stack([np.cross(w_2, w_3), w_2, w_3], axis=-1)


def common_points(conics: Array) -> list[Array]:
    """Real unit vectors x with x^T conics_i x = 0, one of x and -x.

    A member of the pencil that is a pair of lines meets another member in what solves a quadratic
    equation; Newton's method polishes. The conics, shape (2, 3, 3), are of the size of one and
    share at most four points.
    """
    angles = np.arange(4) * np.pi / 4
    pencil = np.tensordot(np.stack([np.cos(angles), np.sin(angles)], axis=-1), conics, axes=1)
    size = np.abs(np.linalg.det(pencil))  # a cubic in the pencil: zero at four, zero everywhere
    best = int(size.argmax())
    assert size[best] > _ZERO
    regular, other = pencil[best], pencil[(best + 2) % 4]
    roots = np.linalg.eigvals(np.linalg.solve(regular, other))
    singular = [other - t.real * regular for t in roots if abs(t.imag) < 1e-6]
    assert min(np.abs(member).max() for member in singular) > _ZERO
    # All conics of the pencil share the points. A member a v_0 v_0^T + c v_2 v_2^T with a < 0 < c
    # is a pair of lines; where they meet a regular member, a quadratic equation tells.
    (a, _, c), v = max(map(np.linalg.eigh, singular), key=lambda pair: min(-pair[0][0], pair[0][2]))
    found: list[Array] = []
    for sign in (1, -1) if a < 0 < c else ():
        along = np.sqrt(c) * v[:, 0] + sign * np.sqrt(-a) * v[:, 2]
        line = np.stack([v[:, 1], along / np.sqrt(c - a)], axis=-1)
        (low, high), z = np.linalg.eigh(line.T @ regular @ line)
        if low < 1e-8 and high > -1e-8:  # a double point is as inexact as the root of rounding
            ends = np.sqrt((max(high, 0), max(-low, 0)))
            for point in (line @ z @ ends, line @ z @ (ends * (1, -1))):
                x = _polished(conics, point)
                if x is not None and all(abs(x @ known) < 1 - _ZERO for known in found):
                    found.append(x)
    return found


def _polished(conics: Array, x: Array) -> Array | None:
    """Newton's method on the conics and |x| = 1; None where it finds no real point."""
    x = x / np.linalg.norm(x)
    for _ in range(30):
        rows = np.vstack([conics @ x, x])
        step = np.linalg.lstsq(2 * rows, rows @ x - (0, 0, 1), rcond=_ZERO)[0]
        x = x - step
        if np.abs(step).max() < 1e-15:
            break
    return x if np.abs(x @ conics @ x).max() < _ZERO else None

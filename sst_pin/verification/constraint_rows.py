# SPDX-License-Identifier: BSD-2-Clause
"""Rows of the closures, from the motion of the frames that they connect."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from ..arrays import Array
from ..model.closures import Brake, Closure, Coupling, Distance, Rolling, frames_of
from ..model.mechanism import Mechanism

_EYE = np.eye(3)


class FrameMotion(NamedTuple):
    """A frame in motion; vectors are [linear; angular] of its origin, in base axes."""

    placement: pin.SE3
    J: Array  #: Jacobian, shape (6, nv).
    twist: Array  #: J v, shape (6,).
    drift: Array  #: J_dot v, shape (6,).


def closure_rows(
    mechanism: Mechanism, frame: Callable[[str], FrameMotion], q: Array, v: Array
) -> tuple[Array, Array]:
    """Phi, shape (rows, nv), and Phi_dot v, shape (rows,), of all closures."""
    parts = [(np.empty((0, mechanism.model.nv)), np.empty(0))]
    for closure in mechanism.closures:
        if isinstance(closure, Coupling):
            parts.append(_coupling(mechanism.model, closure, q, v))
        elif isinstance(closure, Brake) and closure.frames is None:
            (rate,) = mechanism.space.rates_of([closure.name])
            parts.append((np.eye(mechanism.model.nv)[[rate]], np.zeros(1)))
        else:
            parts.append(_relative(closure, *map(frame, frames_of(closure))))
    Phi, drift = zip(*parts, strict=True)
    return np.vstack(Phi), np.concatenate(drift)


def _relative(
    closure: Closure | Distance | Rolling | Brake, A: FrameMotion, B: FrameMotion
) -> tuple[Array, Array]:
    """Rows G [r_dot; w] of the position r and the angular velocity w of B in the axes of A.

    G moves with r and with the axes of B, which w turns.
    """
    R_a = A.placement.rotation
    d = B.placement.translation - A.placement.translation
    r, R = R_a.T @ d, R_a.T @ B.placement.rotation
    J = B.J - A.J
    J[:3] += pin.skew(d) @ A.J[3:]
    J = np.vstack([R_a.T @ J[:3], R_a.T @ J[3:]])
    omega = A.twist[3:]
    relative = B.twist - A.twist
    drift = B.drift - A.drift
    slid = relative[:3] - np.cross(omega, d)
    drift[:3] -= np.cross(A.drift[3:], d) + np.cross(omega, np.cross(omega, d) + 2 * slid)
    drift[3:] -= np.cross(omega, relative[3:])
    r_dot, w = R_a.T @ slid, R_a.T @ relative[3:]
    drift = np.concatenate([R_a.T @ drift[:3], R_a.T @ drift[3:]])
    if isinstance(closure, (Distance, Brake)):
        G, G_dot = np.zeros((1, 6)), np.zeros((1, 6))
        G[0, :3], G_dot[0, :3] = r, r_dot
    elif isinstance(closure, Rolling):
        G, G_dot = _rolling(closure, R[:, 2], np.cross(w, R[:, 2]))
    else:
        fixed = np.array(closure.held)
        G = np.eye(6)[fixed]
        G_dot = np.zeros((fixed.sum(), 6))
        if fixed[3:].sum() == 1:  # one axis of A and one of B stay at a right angle
            k = int(np.flatnonzero(fixed[3:])[0])
            a = _EYE[(k + 1) % 3]
            b = R[:, (k + 2) % 3]
            G[-1, 3:], G_dot[-1, 3:] = np.cross(a, b), np.cross(a, np.cross(w, b))
    return G @ J, G @ drift + G_dot @ np.concatenate([r_dot, w])


def _rolling(closure: Rolling, axle: Array, axle_dot: Array) -> tuple[Array, Array]:
    """The velocity r_dot - radius w x up of the contact."""
    up = _EYE[2]
    up_dot = np.zeros(3)
    normal = _EYE[2]
    if not closure.ball:  # up is at a right angle to the axle
        g = normal - normal @ axle * axle
        g_dot = -(normal @ axle_dot) * axle - normal @ axle * axle_dot
        size = np.linalg.norm(g)
        up = g / size
        up_dot = (g_dot - up * (up @ g_dot)) / size
    of_turns = [closure.radius * pin.skew(u) for u in (up, up_dot)]
    return np.hstack([_EYE, of_turns[0]]), np.hstack([np.zeros((3, 3)), of_turns[1]])


def _coupling(model: pin.Model, closure: Coupling, q: Array, v: Array) -> tuple[Array, Array]:
    row = np.zeros((1, model.nv))
    drift = 0.0
    for name, polynomial in {closure.joint: (0.0, -1.0), **closure.polynomials}.items():
        joint = model.joints[model.getJointId(name)]
        P = Polynomial(polynomial or (0.0,))
        row[0, joint.idx_v] = P.deriv()(q[joint.idx_q])
        drift += P.deriv(2)(q[joint.idx_q]) * v[joint.idx_v] ** 2
    return row, np.array([drift])

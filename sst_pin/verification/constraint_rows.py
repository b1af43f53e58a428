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
    rows = [np.empty((0, mechanism.model.nv))]
    drifts = [np.empty(0)]
    for closure in mechanism.closures:
        if isinstance(closure, Coupling):
            row, drift = _coupling(mechanism.model, closure, q, v)
        elif isinstance(closure, Brake) and closure.frames is None:
            (rate,) = mechanism.space.rates_of([closure.name])
            row = np.eye(mechanism.model.nv)[[rate]]
            drift = np.zeros(1)
        else:
            frame_a, frame_b = frames_of(closure)
            row, drift = _relative(closure, frame(frame_a), frame(frame_b))
        rows.append(row)
        drifts.append(drift)
    return np.vstack(rows), np.concatenate(drifts)


def _relative(
    closure: Closure | Distance | Rolling | Brake, A: FrameMotion, B: FrameMotion
) -> tuple[Array, Array]:
    """Rows G [r_dot; w] of the position r and the angular velocity w of B in the axes of A.

    G moves with r and with the axes of B, which w turns. The second result is the part of the
    derivative of G [r_dot; w] that does not depend on the accelerations.
    """
    R_a = A.placement.rotation
    d = B.placement.translation - A.placement.translation  # in base axes, as the next ones
    omega_a = A.twist[3:]

    # Jacobian of [r_dot; w]: the motion of B minus the motion of A's body at the origin of B.
    J = B.J - A.J
    J[:3] += pin.skew(d) @ A.J[3:]
    velocity = B.twist[:3] - A.twist[:3] - np.cross(omega_a, d)
    spin = B.twist[3:] - omega_a

    # Accelerations relative to the moving axes of A: without Euler, centrifugal and Coriolis terms.
    acceleration = B.drift[:3] - A.drift[:3]
    acceleration -= np.cross(A.drift[3:], d)
    acceleration -= np.cross(omega_a, np.cross(omega_a, d) + 2 * velocity)
    angular_acceleration = B.drift[3:] - A.drift[3:] - np.cross(omega_a, spin)

    # All of these in the axes of A.
    r = R_a.T @ d
    R = R_a.T @ B.placement.rotation
    r_dot = R_a.T @ velocity
    w = R_a.T @ spin
    J = np.vstack([R_a.T @ J[:3], R_a.T @ J[3:]])
    drift = np.concatenate([R_a.T @ acceleration, R_a.T @ angular_acceleration])

    if isinstance(closure, (Distance, Brake)):
        G = np.concatenate([r, np.zeros(3)])[None]
        G_dot = np.concatenate([r_dot, np.zeros(3)])[None]
    elif isinstance(closure, Rolling):
        G, G_dot = _rolling(closure, R[:, 2], np.cross(w, R[:, 2]))
    else:
        G, G_dot = _fixed_directions(closure, R, w)
    return G @ J, G @ drift + G_dot @ np.concatenate([r_dot, w])


def _fixed_directions(closure: Closure, R: Array, w: Array) -> tuple[Array, Array]:
    """G and its rate of a closure that fixes some directions.

    R is the orientation of B in A, w its angular velocity in the axes of A.
    """
    fixed = np.array(closure.held)
    G = np.eye(6)[fixed]
    G_dot = np.zeros((fixed.sum(), 6))
    if fixed[3:].sum() == 1:  # one axis of A and one of B stay at a right angle
        k = int(np.flatnonzero(fixed[3:])[0])
        a = _EYE[(k + 1) % 3]
        b = R[:, (k + 2) % 3]
        G[-1, 3:] = np.cross(a, b)
        G_dot[-1, 3:] = np.cross(a, np.cross(w, b))
    return G, G_dot


def _rolling(closure: Rolling, axle: Array, axle_dot: Array) -> tuple[Array, Array]:
    """G and its rate for the velocity r_dot - radius w x up of the point of contact.

    `up` is the unit vector from this point to the centre of the wheel.
    """
    normal = _EYE[2]  # of the plane
    up = normal
    up_dot = np.zeros(3)
    if not closure.ball:  # up is the part of the normal at a right angle to the axle
        g = normal - normal @ axle * axle
        g_dot = -(normal @ axle_dot) * axle - normal @ axle * axle_dot
        size = np.linalg.norm(g)
        up = g / size
        up_dot = (g_dot - up * (up @ g_dot)) / size
    # -w x up = up x w
    G = np.hstack([_EYE, closure.radius * pin.skew(up)])
    G_dot = np.hstack([np.zeros((3, 3)), closure.radius * pin.skew(up_dot)])
    return G, G_dot


def _coupling(model: pin.Model, closure: Coupling, q: Array, v: Array) -> tuple[Array, Array]:
    """The row of a coupling, sum of polynomials of joints minus the joint, and its drift."""
    row = np.zeros((1, model.nv))
    drift = 0.0
    for name, polynomial in {closure.joint: (0.0, -1.0), **closure.polynomials}.items():
        joint = model.joints[model.getJointId(name)]
        P = Polynomial(polynomial or (0.0,))
        row[0, joint.idx_v] = P.deriv()(q[joint.idx_q])
        drift += P.deriv(2)(q[joint.idx_q]) * v[joint.idx_v] ** 2
    return row, np.array([drift])

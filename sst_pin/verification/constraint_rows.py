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
    """Phi, shape (rows, nv), and Phi_dot v, shape (rows,), of all closures.

    `frame` returns the motion of a frame of the model, by its name, at q with the rates v.
    """
    rows = [np.empty((0, mechanism.model.nv))]
    drifts = [np.empty(0)]
    for closure in mechanism.closures:
        if isinstance(closure, Coupling):
            row, drift = _coupling(mechanism.model, closure, q, v)
        elif isinstance(closure, Brake) and closure.frames is None:  # of a joint
            (rate,) = mechanism.space.rates_of([closure.name])
            row = np.eye(mechanism.model.nv)[[rate]]
            drift = np.zeros(1)
        else:
            frame_a, frame_b = frames_of(closure)
            motion = _relative_motion(frame(frame_a), frame(frame_b))
            row, drift = _rows_of_frames(closure, motion)
        rows.append(row)
        drifts.append(drift)
    return np.vstack(rows), np.concatenate(drifts)


class _RelativeMotion(NamedTuple):
    """The motion of a frame B as seen from the moving axes of a frame A, in these axes."""

    r: Array  #: Position of B's origin, shape (3,).
    R: Array  #: Orientation of B, shape (3, 3).
    r_dot: Array
    w: Array  #: Angular velocity of B.
    J: Array  #: Jacobian, shape (6, nv): [r_dot; w] = J v.
    drift: Array  #: J_dot v, shape (6,): [r_ddot; w_dot] without accelerations of the joints.


def _relative_motion(A: FrameMotion, B: FrameMotion) -> _RelativeMotion:
    """The motion of B as seen from A."""
    # In base axes: the velocity of B, minus the velocity of A's body at the origin of B.
    d = B.placement.translation - A.placement.translation
    omega_a = A.twist[3:]
    J = B.J - A.J
    J[:3] += pin.skew(d) @ A.J[3:]  # minus omega_a x d
    velocity = B.twist[:3] - A.twist[:3] - np.cross(omega_a, d)
    angular_velocity = B.twist[3:] - omega_a

    # Accelerations relative to the moving axes of A: without Euler, centrifugal and Coriolis terms.
    acceleration = B.drift[:3] - A.drift[:3]
    acceleration -= np.cross(A.drift[3:], d)
    acceleration -= np.cross(omega_a, np.cross(omega_a, d) + 2 * velocity)
    angular_acceleration = B.drift[3:] - A.drift[3:] - np.cross(omega_a, angular_velocity)

    # All of these in the axes of A.
    to_a = A.placement.rotation.T
    return _RelativeMotion(
        r=to_a @ d,
        R=to_a @ B.placement.rotation,
        r_dot=to_a @ velocity,
        w=to_a @ angular_velocity,
        J=np.vstack([to_a @ J[:3], to_a @ J[3:]]),
        drift=np.concatenate([to_a @ acceleration, to_a @ angular_acceleration]),
    )


def _rows_of_frames(
    closure: Closure | Distance | Rolling | Brake, motion: _RelativeMotion
) -> tuple[Array, Array]:
    """The rows G [r_dot; w] = 0 of a closure of two frames: Phi = G J, and Phi_dot v.

    G depends on r and R, so that Phi_dot v = G (J_dot v) + G_dot [r_dot; w].
    """
    if isinstance(closure, (Distance, Brake)):  # r . r_dot = 0
        G = np.concatenate([motion.r, np.zeros(3)])[None]
        G_dot = np.concatenate([motion.r_dot, np.zeros(3)])[None]
    elif isinstance(closure, Rolling):
        axle = motion.R[:, 2]
        G, G_dot = _rolling(closure, axle, np.cross(motion.w, axle))
    else:
        G, G_dot = _fixed_directions(closure, motion.R, motion.w)
    velocity = np.concatenate([motion.r_dot, motion.w])
    return G @ motion.J, G @ motion.drift + G_dot @ velocity


def _fixed_directions(closure: Closure, R: Array, w: Array) -> tuple[Array, Array]:
    """G and its rate of a closure that fixes some components of [r_dot; w].

    R is the orientation of B in A, w its angular velocity in the axes of A.
    """
    fixed = np.array(closure.held)
    G = np.eye(6)[fixed]
    G_dot = np.zeros((fixed.sum(), 6))
    if fixed[3:].sum() == 1:
        # Only the rotation about axis k is fixed: the axis a = k + 1 of A and the axis b = k + 2 of
        # B stay at a right angle, a . b = 0. (The component k of w is not zero while B turns about
        # the other axes.) The rate of a . b is a . (w x b) = (b x a) . w. The row is the negative,
        # (a x b) . w, because this is the component k of w where A and B coincide.
        k = int(np.flatnonzero(fixed[3:])[0])
        a = _EYE[(k + 1) % 3]
        b = R[:, (k + 2) % 3]
        G[-1, 3:] = np.cross(a, b)
        G_dot[-1, 3:] = np.cross(a, np.cross(w, b))
    return G, G_dot


def _rolling(closure: Rolling, axle: Array, axle_dot: Array) -> tuple[Array, Array]:
    """G and its rate of a wheel or a ball that rolls on a plane.

    The velocity of the point of contact is zero: r_dot - radius w x up = 0, with the unit vector
    `up` from this point to the centre of the wheel.
    """
    normal = _EYE[2]  # of the plane
    up = normal
    up_dot = np.zeros(3)
    if not closure.ball:
        # In a wheel, up is the part g of the normal at a right angle to the axle, normalised.
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
    """The row of a coupling and its drift.

    The sum of polynomials P_j(q_j) minus the position of the dependent joint is constant; this
    joint has the polynomial P(x) = -x here. So the row has the entries P_j'(q_j), and the drift is
    the sum of P_j''(q_j) v_j^2.
    """
    row = np.zeros((1, model.nv))
    drift = 0.0
    for name, polynomial in {closure.joint: (0.0, -1.0), **closure.polynomials}.items():
        joint = model.joints[model.getJointId(name)]
        P = Polynomial(polynomial or (0.0,))
        row[0, joint.idx_v] = P.deriv()(q[joint.idx_q])
        drift += P.deriv(2)(q[joint.idx_q]) * v[joint.idx_v] ** 2
    return row, np.array([drift])

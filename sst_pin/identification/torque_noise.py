# SPDX-License-Identifier: BSD-2-Clause
"""Noise of motor torques in the equations of identification, and in their solution.

The equations of a sample are Y theta = J^T tau, with the regressor Y of the base parameters theta
and the actuator Jacobian J. Let the noise of the torques have the covariance S = diag(noise^2).
Then the noise of the forces J^T tau has the covariance J^T S J = C C^T, with Cholesky's factor C.
The equations are whitened: both sides are multiplied by C^-1, so that in

    A theta = z,    A = C^-1 Y,    z = C^-1 J^T tau,

the noise of z has the covariance 1. With A = Q R for all samples together, the solution is theta =
R^-1 Q^T z, and the residuals are (1 - H) z with the hat matrix H = Q Q^T.

The matrix P = S^(1/2) J C^-T maps z back to torques: P z are torques in units of their noise, the
most likely ones of all torques with the same forces. P^T P = 1, and P P^T = 1 if there are as many
motors as coordinates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import InputError


class Whitened(NamedTuple):
    """The whitened equations A theta = z of N samples; see the module."""

    #: C^-1 Y, shape (N, n, b).
    A: Array
    #: C^-1 J^T tau, shape (N, n).
    z: Array
    #: P, shape (N, motors, n).
    P: Array


def whitened(J: Array, noise: Array, Y: Array, forces: Array) -> Whitened:
    """The equations Y theta = forces, whitened.

    Args:
        J: Actuator Jacobians, shape (N, motors, n).
        noise: Standard deviations of the motors' torques, shape (motors,).
        Y: Regressors, shape (N, n, b).
        forces: J^T tau, shape (N, n).
    """
    try:
        C_inverse = np.linalg.inv(np.linalg.cholesky((J.mT * noise**2) @ J))
    except np.linalg.LinAlgError:
        problem = "the motors do not act on all coordinates in all samples"
        raise InputError("q", problem) from None
    return Whitened(
        A=C_inverse @ Y,
        z=(C_inverse @ forces[..., None])[..., 0],
        P=noise[:, None] * (J @ C_inverse.mT),
    )


class NoiseSpread(NamedTuple):
    """The effect of the noise of the motors on the solution, in units of the noise."""

    #: Covariance of the solution theta, shape (b, b).
    covariance: Array
    #: Expected sum of the squared residuals of each motor's torques, shape (motors,). For more
    #: motors than coordinates only the sum over all motors is exact.
    freedom: Array


def noise_spread(A: Array, R_inverse: Array, P: Array, correlations: Array) -> NoiseSpread:
    """The effect of noise that is correlated between samples, but not between motors.

    Let e_m be the noise of motor m in all samples, in units of its standard deviation. Its
    covariance is the Toeplitz matrix C_t with the correlations of samples. The noise of z is the
    sum of P_m^T e_m, where P_m has row m of P in each sample. With Q_m = P_m Q, shape (N, b), and
    the sum W of Q_m^T C_t Q_m over all motors, the covariance of theta = R^-1 Q^T z is

        R^-1 W R^-T.

    The torques P_m (1 - H) z are the residuals of motor m. With the covariance V of z, which is the
    sum of P_m^T C_t P_m over all motors, their expected squares add up to

        tr(P_m (1 - H) V (1 - H) P_m^T) = |P_m|^2 - 2 tr(Q_m^T C_t Q_m) + tr(Q_m^T Q_m W).

    The first two terms need P P^T = 1, which gives V P_m^T = P_m^T C_t. So the first term is
    tr(P_m V P_m^T) = tr(C_t), and C_t has ones on its diagonal, as has P_m P_m^T. The second term
    is twice tr(P_m H V P_m^T) with H = Q Q^T. The third term follows from Q^T V Q = W. With more
    motors than coordinates, only the sums of the first two terms over all motors are right.

    Args:
        A: The whitened equations, shape (N, n, b).
        R_inverse: R^-1, shape (b, b).
        P: Torques in units of their noise, by z, shape (N, motors, n).
        correlations: c_1, c_2, ..., where c_k is the correlation of the noise in samples that are k
            apart; C_t has c_|i-j| in row i and column j, with c_0 = 1.
    """
    Q_of_motors = P @ (A @ R_inverse)  # shape (N, motors, b)
    motors, b = Q_of_motors.shape[1:]
    Q_Q = np.empty((motors, b, b))  # Q_m^T Q_m
    Q_C_Q = np.empty((motors, b, b))  # Q_m^T C_t Q_m
    for motor in range(motors):
        Q_m = Q_of_motors[:, motor]  # shape (N, b)
        Q_Q[motor] = Q_m.T @ Q_m
        Q_C_Q[motor] = Q_Q[motor]
        for lag, correlation in enumerate(correlations[: len(Q_m) - 1], 1):
            pairs = correlation * (Q_m[:-lag].T @ Q_m[lag:])
            Q_C_Q[motor] += pairs + pairs.T
    W = Q_C_Q.sum(axis=0)
    freedom = np.sum(P**2, axis=(0, 2))
    freedom -= 2 * np.trace(Q_C_Q, axis1=1, axis2=2)
    freedom += np.einsum("kij,ji->k", Q_Q, W)  # tr(Q_m^T Q_m W) of each motor
    return NoiseSpread(covariance=R_inverse @ W @ R_inverse.T, freedom=freedom)


def samples_per_independent_sample(correlations: Array) -> float:
    """Number of correlated samples that show the size of the noise as well as an independent one.

    The variance of a mean of squares is larger by this factor: the sum of the squares of all
    correlations, c_0 = 1 and those at both sides.
    """
    return 1 + 2 * float(np.sum(correlations**2))

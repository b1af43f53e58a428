# SPDX-License-Identifier: BSD-2-Clause
"""Noise of motor torques in the equations of identification, and in their solution.

The equations of a sample are Y theta = J^T tau, with the regressor Y of the base parameters theta
and the actuator Jacobian J. Noise of the torques with the covariance N = diag(noise^2) is noise of
the forces J^T tau with the covariance J^T N J = C C^T. So both sides are multiplied by C^-1: in

    A theta = z,    A = C^-1 Y,    z = C^-1 J^T tau,

the noise of z has the covariance 1. With A = Q R for all samples together, the solution is theta =
R^-1 Q^T z, and the residuals are (1 - H) z with the hat matrix H = Q Q^T.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import InputError


class Whitened(NamedTuple):
    """The equations A theta = z of N samples, in units of their noise."""

    #: C^-1 Y, shape (N, n, b).
    A: Array
    #: C^-1 J^T tau, shape (N, n).
    z: Array
    #: N J C^-T, shape (N, motors, n): torque errors for one unit of an error of z. Of the torque
    #: errors that give the same forces, these are the most likely ones.
    torques_of_z: Array


def whitened(J: Array, noise: Array, Y: Array, forces: Array) -> Whitened:
    """The equations Y theta = forces in units of their noise.

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
        torques_of_z=noise[:, None] ** 2 * (J @ C_inverse.mT),
    )


class NoiseSpread(NamedTuple):
    """The effect of the noise of the motors on values and residuals, in units of the noise."""

    #: Covariance of the values theta, shape (b, b).
    covariance: Array
    #: Expected sum of the squared residuals of each motor's torques, shape (motors,).
    freedom: Array


def noise_spread(
    A: Array, R_inverse: Array, torques_of_z: Array, correlations: Array
) -> NoiseSpread:
    """The effect of noise that is correlated between samples, but not between motors.

    Args:
        A: The equations in units of the noise, shape (N, n, b).
        R_inverse: R^-1, shape (b, b).
        torques_of_z: Torque errors for one unit of an error of z, each in units of its noise, shape
            (N, motors, n).
        correlations: c_1, c_2, ..., where c_k is the correlation of the noise in samples that are k
            apart. Together with c_0 = 1 they are the matrix C_t below.
    """
    # For each motor, Q in terms of its torque errors: theta = R^-1 sum over motors of Q^T noise.
    Q = torques_of_z @ (A @ R_inverse)
    motors, b = Q.shape[1:]
    Q_Q = np.empty((motors, b, b))  # Q^T Q of each motor
    Q_C_Q = np.empty((motors, b, b))  # Q^T C_t Q of each motor
    for motor in range(motors):
        rows = Q[:, motor]
        Q_Q[motor] = rows.T @ rows
        Q_C_Q[motor] = Q_Q[motor]
        for lag, correlation in enumerate(correlations[: len(rows) - 1], 1):
            pairs = correlation * (rows[:-lag].T @ rows[lag:])
            Q_C_Q[motor] += pairs + pairs.T
    sum_of_motors = Q_C_Q.sum(axis=0)
    covariance = R_inverse @ sum_of_motors @ R_inverse.T

    # The residuals (1 - H) z have the covariance (1 - H) C_t (1 - H), with the same trace as C_t -
    # 2 H C_t + H C_t H. The three lines are the parts of these terms for each motor.
    freedom = np.sum(torques_of_z**2, axis=(0, 2))
    freedom -= 2 * np.trace(Q_C_Q, axis1=1, axis2=2)
    freedom += np.einsum("kij,ji->k", Q_Q, sum_of_motors)
    return NoiseSpread(covariance, freedom)


def samples_per_independent_sample(correlations: Array) -> float:
    """Number of correlated samples with the same information on the noise as one independent one.

    The variance of a mean of squares is larger by the sum of all squared correlations.
    """
    return 1 + 2 * float(np.sum(correlations**2))

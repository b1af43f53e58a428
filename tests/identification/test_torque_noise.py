# SPDX-License-Identifier: BSD-2-Clause
"""Noise of torques in the equations of identification, by the covariances of all samples."""

import numpy as np
import pytest
from scipy.linalg import block_diag, toeplitz

from sst_pin.identification.torque_noise import noise_spread, whitened

#: Samples, coordinates and base parameters.
N, n, b = 12, 2, 4
#: Products of matrices with entries of about one.
ROUNDING = 1e-12


def equations(motors):
    """Random Jacobians, noise of the motors, and whitened equations."""
    random = np.random.default_rng(motors)
    J = random.normal(size=(N, motors, n))
    noise = np.array([0.5, 2.0, 1.3])[:motors]
    forces = random.normal(size=(N, n))
    return J, noise, whitened(J, noise, random.normal(size=(N, n, b)), forces), forces


@pytest.mark.parametrize("motors", [2, 3])
def test_torques_of_whitened_forces_are_the_most_likely_ones(motors):
    """Of all torques with the same forces, in units of their noise, they have the least squares."""
    J, noise, equations_in_noise, forces = equations(motors)
    torques = np.einsum("imj,ij->im", equations_in_noise.P, equations_in_noise.z)
    for k in range(N):
        shortest = np.linalg.lstsq((noise[:, None] * J[k]).T, forces[k], rcond=None)[0]
        np.testing.assert_allclose(torques[k], shortest, atol=ROUNDING)


@pytest.mark.parametrize("motors", [2, 3])
def test_the_effect_of_noise_is_that_of_the_covariance_of_all_samples(motors):
    """The noise of each motor has the covariance C_t over time. Of more motors than coordinates
    only the sum of the degrees of freedom is right."""
    _, _, whitened_equations, _ = equations(motors)
    A = whitened_equations.A.reshape(-1, b)
    R = np.linalg.qr(A, mode="r")
    correlations = np.array([0.4, 0.1])
    spread = noise_spread(
        whitened_equations.A, np.linalg.inv(R), whitened_equations.P, correlations
    )

    C_t = toeplitz([1.0, *correlations, *np.zeros(N - 3)])
    P = [block_diag(*whitened_equations.P[:, [m]]) for m in range(motors)]
    of_z = sum(P_m.T @ C_t @ P_m for P_m in P)
    solution = np.linalg.pinv(A)
    residuals = np.eye(len(A)) - A @ solution
    freedom = [np.trace(P_m @ residuals @ of_z @ residuals @ P_m.T) for P_m in P]
    np.testing.assert_allclose(spread.covariance, solution @ of_z @ solution.T, atol=ROUNDING)
    assert spread.freedom.sum() == pytest.approx(sum(freedom), abs=ROUNDING * N)
    if motors == n:
        np.testing.assert_allclose(spread.freedom, freedom, atol=ROUNDING * N)

# SPDX-License-Identifier: BSD-2-Clause
"""Parameters that bodies can have: positive definite, near the data, near the prior elsewhere."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sst_pin import InputError, robots
from sst_pin.identification import base_parameters, consistent_parameters, estimate, random_states
from sst_pin.identification.consistency import pseudo_inertias

NAMES = ["five_bar", pytest.param("delta", marks=pytest.mark.slow)]


@cache
def case(name, noise):
    """A robot of other masses than the prior has, and an estimate from noisy torques."""
    chain = getattr(robots, name)()
    theta = chain.dynamic_parameters
    random = np.random.default_rng(2)
    bodies = chain.mechanism.model.njoints - 1
    factors = np.ones(len(theta))
    factors[: 10 * bodies] = np.repeat(random.uniform(0.8, 1.3, bodies), 10)
    true = chain.with_parameters(np.asarray(theta) * factors)
    base = base_parameters(chain, ["*.m*", "*.i*", f"{chain.motor_names[0]}.viscous"])
    motion = random_states(chain, 400, 1)
    tau = true.compute_torques(*motion)
    tau += noise * np.abs(tau).max() * random.normal(size=tau.shape)
    return chain, true, base, estimate(chain, base, *motion, tau), motion


def bodies_of(chain, theta):
    return np.asarray(theta)[: 10 * (chain.mechanism.model.njoints - 1)].reshape(-1, 10)


@pytest.mark.parametrize("noise", [1e-4, pytest.param(0.05, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", NAMES)
def test_every_body_is_one_and_friction_is_not_negative(name, noise):
    chain, _, _, result, _ = case(name, noise)
    theta = consistent_parameters(chain, result)
    bodies = bodies_of(chain, theta)
    assert (np.linalg.eigvalsh(pseudo_inertias(bodies[bodies[:, 0] > 0])) > 0).all()
    assert theta[f"{chain.motor_names[0]}.viscous"] >= -1e-12
    chain.with_parameters(theta)


@pytest.mark.parametrize("name", NAMES)
def test_the_torques_of_other_motions_are_predicted(name):
    """Predictions differ by the noise of the estimate, not by that of single samples."""
    chain, true, _, result, _ = case(name, 1e-4)
    motion = random_states(chain, 50, 77)
    tau = true.compute_torques(*motion)
    predicted = chain.with_parameters(consistent_parameters(chain, result)).compute_torques(*motion)
    assert np.sqrt(np.mean((predicted - tau) ** 2)) < 1e-3 * np.abs(tau).max()


@pytest.mark.slow
def test_the_nearest_parameters_are_those_of_a_general_optimiser():
    """SciPy's trust region on Cholesky factors finds nothing that is nearer."""
    from scipy.optimize import minimize

    chain, _, base, result, _ = case("five_bar", 0.05)
    prior, length = 1e-2, chain.mechanism.length
    cad = bodies_of(chain, chain.dynamic_parameters)
    units = cad[:, :1] * length ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    weights = np.linalg.inv(result.covariance)

    def cost(bodies, friction):
        theta = np.asarray(chain.dynamic_parameters).copy()
        theta[: bodies.size] = bodies.ravel()
        theta[list(chain.dynamic_parameters.names).index("shoulder_1.viscous")] = friction
        e = base.matrix @ theta - result.values
        return e @ weights @ e + prior * (((bodies - cad) / units) ** 2).sum()

    def bodies(x):
        factors = np.zeros((len(cad), 4, 4))
        factors[(slice(None), *np.tril_indices(4))] = x[:-1].reshape(-1, 10)
        scale = np.diag([length, length, length, 1.0])
        P = scale @ factors @ factors.swapaxes(-1, -2) @ scale * cad[:, :1, None]
        xx, yy, zz = P[:, 0, 0], P[:, 1, 1], P[:, 2, 2]
        moments = [yy + zz, -P[:, 0, 1], xx + zz, -P[:, 0, 2], -P[:, 1, 2], xx + yy]
        return np.stack([P[:, 3, 3], P[:, 0, 3], P[:, 1, 3], P[:, 2, 3], *moments], axis=-1)

    theta = consistent_parameters(chain, result, prior=prior)
    ours = cost(bodies_of(chain, theta), theta["shoulder_1.viscous"])
    scaled = pseudo_inertias(bodies_of(chain, theta) / units)
    start = np.linalg.cholesky(scaled + 1e-12 * np.eye(4))
    start = start[(slice(None), *np.tril_indices(4))]
    x = np.append(start.ravel(), np.sqrt(max(theta["shoulder_1.viscous"], 1e-12)))
    theirs = minimize(lambda x: cost(bodies(x), x[-1] ** 2), x, method="BFGS").fun
    assert ours < theirs * (1 + 1e-5) + 1e-9


@pytest.mark.parametrize("seed", range(2))
def test_a_prior_that_explains_the_data_stands(seed):
    chain, _, base, _, motion = case("five_bar", 1e-4)
    tau = chain.compute_torques(*motion)
    tau += 1e-4 * np.random.default_rng(seed).normal(size=tau.shape)
    theta = consistent_parameters(chain, estimate(chain, base, *motion, tau))
    now = np.asarray(chain.dynamic_parameters)
    assert_allclose(np.asarray(theta), now, atol=2e-3 * np.abs(now).max())


def test_the_total_mass_is_held():
    chain, *_, result, _ = case("five_bar", 1e-4)
    theta = consistent_parameters(chain, result, total_mass=0.4)
    assert bodies_of(chain, theta)[:, 0].sum() == pytest.approx(0.4, rel=1e-7)


def test_a_total_mass_below_that_of_the_fixed_bodies_is_refused():
    """With friction alone to identify, no body's mass may change."""
    chain, _, _, _, motion = case("five_bar", 1e-4)
    base = base_parameters(chain, [f"{chain.motor_names[0]}.viscous"])
    friction = estimate(chain, base, *motion, chain.compute_torques(*motion))
    mass = bodies_of(chain, chain.dynamic_parameters)[:, 0].sum()
    with pytest.raises(InputError, match=f"0.01 kg; fixed masses have {mass:g} kg"):
        consistent_parameters(chain, friction, total_mass=0.01)


def test_combinations_that_cannot_be_distinguished_are_refused():
    chain, _, base, result, _ = case("five_bar", 1e-4)
    alike = replace(result, covariance=np.ones((len(base), len(base))))
    with pytest.raises(InputError, match="cannot be distinguished"):
        consistent_parameters(chain, alike)


def test_pseudo_inertias_are_those_of_points():
    """The sum of m [r; 1][r; 1]^T over the points of a body."""
    rng = np.random.default_rng(0)
    m, r = rng.uniform(0.1, 1, 5), rng.normal(size=(5, 3))
    inertia = sum(k * (p @ p * np.eye(3) - np.outer(p, p)) for k, p in zip(m, r, strict=True))
    six = inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    ten = np.concatenate([[m.sum()], m @ r, six])
    h = np.hstack([r, np.ones((5, 1))])
    assert_allclose(pseudo_inertias(ten), (h.T * m) @ h, atol=1e-14)


def test_parameters_that_are_seen_in_a_sum_alone_share_it():
    """A constant torque of a joint, and the offset of its motor: nothing tells them apart."""
    chain = robots.five_bar()
    names = ["shoulder_1.offset", "shoulder_1.torque_offset"]
    base = base_parameters(chain, ["*.m*", "*.i*", *names])
    motion = random_states(chain, 100, 1)
    tau = chain.compute_torques(*motion) + np.array([0.3, 0.0])
    tau += 1e-3 * np.random.default_rng(0).normal(size=tau.shape)
    theta = consistent_parameters(chain, estimate(chain, base, *motion, tau))
    assert_allclose(sum(abs(theta[name]) for name in names), 0.3, atol=2e-3)
    assert min(abs(theta[name]) for name in names) > 0.1

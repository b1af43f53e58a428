# SPDX-License-Identifier: BSD-2-Clause
"""The dynamics as functions of JAX."""

import numpy as np
import pytest

import any_chain
from commands import said_without
from derivative_cases import close, derivative
from sst_pin.errors import DescriptionError, InputError
from sst_pin.robots import five_bar, four_bar

jax = pytest.importorskip("jax", reason="JAX is not installed (extra `jax`)")


@pytest.fixture(autouse=True)
def double_precision():
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


@pytest.fixture(params=["four-bar", pytest.param("compiled five-bar", marks=pytest.mark.slow)])
def chain(request):
    if request.param == "four-bar":
        return four_bar()
    robot = five_bar()
    robot.compile(derivatives=True)
    return robot


def test_functions_give_what_the_chain_gives(chain):
    """Alone, under jit, under vmap with some arguments held, and in batches."""
    functions = chain.jax()
    q, va, aa = any_chain.states(chain, 5, 0)
    tau = chain.compute_torques(q, va, aa)
    close(functions.torques(q, va, aa), tau, 1e-13)
    close(jax.jit(functions.torques)(q[0], va[0], aa[0]), tau[0], 1e-12)
    close(jax.vmap(functions.torques)(q, va, aa), tau, 1e-13)
    held = jax.jit(jax.vmap(functions.accelerations, in_axes=(0, 0, None)))(q, va, tau[0])
    close(held, chain.compute_accelerations(q, va, tau[0]), 1e-12)


def test_jacobians_are_the_chains_derivatives(chain):
    """Forward and reverse; by q at the coordinates' entries, zero at those of dependent joints."""
    functions = chain.jax()
    q, va, aa = (x[0] for x in any_chain.states(chain, 1, 0))
    tau = chain.compute_torques(q, va, aa)
    ids = map(chain.model.getJointId, chain.coordinates)
    entries = [list(chain.model.joints)[i].idx_q for i in ids]
    for function, expected, x in (
        (functions.torques, chain.torque_derivatives(q, va, aa), aa),
        (functions.accelerations, chain.acceleration_derivatives(q, va, tau), tau),
    ):
        for mode in (jax.jacfwd, jax.jacrev):
            by_q, by_va, by_x = mode(function, argnums=(0, 1, 2))(q, va, x)
            close(by_q[:, entries], expected[0], 1e-12)
            assert not np.delete(by_q, entries, axis=1).any()
            close(by_va, expected[1], 1e-12)
            close(by_x, expected[2], 1e-12)


def test_the_gradient_of_a_loss_is_that_of_differences():
    """Of a batch's squared torques by one scale of all motions, through vmap, grad and jit."""
    chain = four_bar()
    torques = chain.jax().torques
    q, va, aa = any_chain.states(chain, 4, 0)

    @jax.jit
    @jax.grad
    def slope(s):
        return (jax.vmap(torques)(q, s * va, s * s * aa) ** 2).sum()

    def loss(s):
        return np.sum(chain.compute_torques(q, (1.3 + s) * va, (1.3 + s) ** 2 * aa) ** 2)

    close(slope(1.3), derivative(loss), 1e-9)


def test_a_sample_at_fault_is_nan():
    chain = four_bar()
    q = np.array([chain.home, np.add(chain.home, [0.1, 0, 0])])
    tau = chain.jax().torques(q, [1.0], [0.0])
    assert np.isnan(tau).ravel().tolist() == [False, True]


def test_what_it_cannot_do_is_said():
    with pytest.raises(DescriptionError, match="not a single entry of q"):
        any_chain.with_joint("free-flyer").jax()
    few = any_chain.chain(coordinates=["body"], actuated=["arm_1"])
    with pytest.raises(DescriptionError, match="generalized_forces"):
        few.jax().torques(few.generic_configuration(), [0.0], [0.0])
    q, va, aa = (x[0] for x in any_chain.states(four_bar(), 1, 0))
    with pytest.raises(InputError, match="derivatives are of first order"):
        jax.hessian(four_bar().jax().torques, argnums=2)(q, va, aa)
    with pytest.raises(InputError, match="sign_width"):
        four_bar().jax(sign_width=0)
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(InputError, match="jax_enable_x64"):
        four_bar().jax()


def test_without_jax_the_extra_is_named():
    assert "sst-pin[jax]" in said_without("jax", "sst_pin.robots.four_bar().jax()")

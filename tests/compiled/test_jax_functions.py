# SPDX-License-Identifier: BSD-2-Clause
"""The dynamics as functions of JAX: its transformations, bad input, what there is not.

`test_doors.py` holds values and derivatives to referees.
"""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import ClosedChain, UnknownNameError
from sst_pin.errors import ActuationError, DescriptionError, InputError, SingularConfigurationError
from sst_pin.robots import five_bar, four_bar
from tests.support import any_chain
from tests.support.command_line import said_without
from tests.support.derivative_cases import close, derivative

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


def squares(torques):
    def loss(q, va, aa):
        return (torques(q, va, aa) ** 2).sum()

    return loss


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
    close(functions.rates(q, va), chain.joint_rates(q, va), 1e-12)


def test_axes_are_those_of_vmap_whatever_axes_the_samples_have():
    """Some arguments without leading axes, others with two, mapped over their last one."""
    chain = four_bar()
    q, va, aa = any_chain.states(chain, 4, 0)
    many = np.broadcast_to(aa.T, (2, 1, 4))
    found = jax.vmap(chain.jax().torques, in_axes=(1, None, 2))(q.T, va[0], many)
    for k in range(4):
        close(found[k], chain.compute_torques(q[k], va[0], many[..., k]), 1e-13)
    empty = chain.jax()
    assert empty.torques(q[:0], va[:0], aa[:0]).shape == (0, 1)
    assert empty.tangent(q[:0]).shape == (0, 3, 1)


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
    """The derivative of a batch's squared torques by a scale, through vmap, grad and jit."""
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


def test_second_derivatives_are_the_same_in_every_mode():
    """Forward over reverse, reverse over reverse, forward over forward, one sample and mapped."""
    chain = four_bar()
    loss = squares(chain.jax().torques)
    q, va, aa = any_chain.states(chain, 3, 0)
    hessian = jax.jit(jax.vmap(jax.hessian(loss, argnums=(0, 1))))(q, va, aa)
    for outer, inner in ((jax.jacrev, jax.jacrev), (jax.jacfwd, jax.jacfwd)):
        mode = jax.jit(outer(inner(loss, argnums=(0, 1)), argnums=(0, 1)))
        once = mode(q[1], va[1], aa[1])
        for i in range(2):
            for k in range(2):
                close(once[i][k], hessian[i][k][1], 1e-12)


@pytest.mark.slow
def test_third_derivatives_are_those_of_differences():
    """By one number along which a four-bar goes round, through closed."""
    chain = four_bar()
    functions, q = chain.jax(), any_chain.states(chain, 1, 0)[0][0]

    def torque(s):
        at = functions.closed(q + functions.tangent(q)[:, 0] * s)
        return functions.torques(at, [1.0 + s], [0.5 * s])[0]

    second = jax.jit(jax.grad(jax.grad(torque)))
    close(jax.grad(jax.grad(jax.grad(torque)))(0.2), derivative(lambda s: second(0.2 + s)), 1e-8)


@pytest.mark.slow
def test_the_gradient_of_a_scanned_motion_is_that_of_differences_of_rollouts():
    """The gradient of a final state by the torques, steps computed again on the way back."""
    chain = four_bar()
    functions = chain.jax(chain.home, sign_width=0.1)
    placement = functions.frame_placement("platform")
    tau, way = np.random.default_rng(0).uniform(-0.2, 0.2, (2, 20, 1))

    def end(tau):
        def step(state, tau):
            return functions.step(*state, tau, 1e-3), None

        start = jax.numpy.asarray(chain.home), jax.numpy.ones(1)
        (q, va), _ = jax.lax.scan(jax.checkpoint(step), start, tau)
        return placement(q)[0].sum() + va[0]

    def rolled(s):
        motion = chain.rollout(tau + s * way, chain.home, [1.0], 1e-3, sign_width=0.1)
        data = chain.model.createData()
        pin.framesForwardKinematics(chain.model, data, motion.q[-1])
        p = data.oMf[chain.model.getFrameId("platform")].translation
        return p.sum() + motion.va[-1, 0]

    close(end(tau), rolled(0), 1e-8)
    slope = jax.jit(jax.grad(end))(tau)
    close((slope * way).sum(), derivative(rolled, 1e-3), 1e-7)


@pytest.mark.slow
def test_a_free_flyers_gradient_is_along_its_turns():
    """By the quaternion, too: along turns it is the chain's, along its length it is zero."""
    chain = any_chain.with_joint("free-flyer", kind="hinge")
    functions = chain.jax()
    q, va, aa = (x[0] for x in any_chain.states(chain, 1, 0))
    by_q = jax.jacrev(functions.generalized_forces)(q, va, aa)
    close(by_q @ functions.tangent(q), chain.torque_derivatives(q, va, aa).dq, 1e-12)
    assert np.abs(by_q[:, 3:7] @ q[3:7]).max() < 1e-12 * np.abs(by_q).max()
    longer = q.copy()
    longer[3:7] *= 1.5
    close(functions.closed(longer), q, 1e-14)


def test_smallest_torques_of_redundant_motors_have_derivatives():
    chain = any_chain.chain(coordinates=["body"], actuated=["body", "arm_1", "arm_2"])
    torques = chain.jax().torques
    q, va, aa = (x[0] for x in any_chain.states(chain, 1, 0))
    close(torques(q, va, aa), chain.compute_torques(q, va, aa), 1e-13)
    slope = derivative(lambda s: chain.compute_torques(q, va, aa + s))
    close(jax.jacrev(torques, argnums=2)(q, va, aa)[:, 0], slope, 1e-9)


def test_a_change_of_the_model_counts_after_refresh():
    chain = four_bar()
    torques = chain.jax().torques
    second = jax.jit(jax.hessian(torques, argnums=1))
    q, va, aa = (x[0] for x in any_chain.states(chain, 1, 0))
    light = second(q, va, aa)
    chain.model.inertias[2] = pin.Inertia(3, *chain.model.inertias[2].__getinitargs__()[1:])
    chain.refresh()
    heavy = four_bar()
    heavy.model.inertias[2] = chain.model.inertias[2]
    heavy.refresh()
    close(torques(q, va, aa), heavy.compute_torques(q, va, aa), 1e-13)
    close(second(q, va, aa), jax.hessian(heavy.jax().torques, argnums=1)(q, va, aa), 1e-12)
    assert np.abs(second(q, va, aa) - light).max() > 0.1 * np.abs(light).max()


def test_a_sample_at_fault_is_nan_with_its_derivatives():
    chain = four_bar()
    functions = chain.jax()
    q = np.array([chain.home, np.add(chain.home, [0.1, 0, 0]), chain.home])
    va = np.array([[1.0], [1.0], [np.nan]])
    at_fault = [False, True, True]
    for found in (
        functions.torques(q, va, [0.0]),
        functions.rates(q, va),
        jax.jit(functions.step)(q, va, [0.0], 1e-3)[1],
        jax.jit(jax.vmap(jax.grad(squares(functions.torques), 1)))(q, va, 0 * va),
        jax.jit(jax.vmap(jax.hessian(squares(functions.torques), 1)))(q, va, 0 * va)[:, 0],
    ):
        assert np.isnan(found).all(axis=-1).tolist() == at_fault
        assert np.isnan(found).any(axis=-1).tolist() == at_fault
    for found in (functions.tangent(q), functions.frame_placement("platform")(q)[1]):
        assert np.isnan(found).all(axis=(1, 2)).tolist() == [False, True, False]
    close(functions.closed(q)[1, 0], q[1, 0], 0)
    assert np.abs(chain.residual(functions.closed(q))).max() < 1e-12
    far = np.array([chain.home, np.full(3, np.nan)])
    assert np.isnan(functions.closed(far)).any(axis=-1).tolist() == [False, True]


@pytest.mark.parametrize("wrapped", [lambda f: f, jax.jit], ids=["plain", "jit"])
def test_bad_arguments_are_told_by_name(wrapped):
    functions, home = four_bar().jax(), four_bar().home
    torques, step = wrapped(functions.torques), wrapped(functions.step)
    for call, word in (
        (lambda: torques(home[:2], [1.0], [0.0]), r"q: shape \(2,\), expected \(\.\.\., 3\)"),
        (lambda: torques(home, 1.0, [0.0]), r"va: shape \(\), expected \(\.\.\., 1\)"),
        (lambda: torques(home + 0j, [1.0], [0.0]), "q: not an array of real numbers"),
        (lambda: torques(np.tile(home, (2, 1)), np.ones((3, 1)), [0.0]), "do not broadcast"),
        (lambda: step(home, [1.0], [0.0, 0.0], 1e-3), r"tau: shape \(2,\)"),
        (lambda: functions.torques("home", [1.0], [0.0]), "q: not an array of numbers"),
        (lambda: functions.torques(None, [1.0], [0.0]), "q: not an array of numbers"),
    ):
        with pytest.raises(InputError, match=word):
            call()


def test_single_precision_is_refused_whenever_it_is_on():
    chain = four_bar()
    torques = chain.jax().torques
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(InputError, match="jax_enable_x64"):
        chain.jax()
    for function in (torques, jax.jit(torques)):
        with pytest.raises(InputError, match="jax_enable_x64"):
            function(chain.home, [1.0], [0.0])


def test_what_there_is_not_has_its_error():
    with pytest.raises(DescriptionError, match=r"rolling contact .*; use casadi\(\)"):
        any_chain.rolling(False).jax()
    idle = any_chain.chain(coordinates=["body"], actuated=[])
    with pytest.raises(ActuationError, match="generalized_forces"):
        idle.jax().torques(idle.generic_configuration(), [0.0], [0.0])
    with pytest.raises(UnknownNameError, match="nowhere"):
        four_bar().jax().frame_placement("nowhere")
    with pytest.raises(InputError, match="sign_width"):
        four_bar().jax(sign_width=0)
    assert "nq=3, n=1, motors=1" in repr(four_bar().jax())


def test_other_coordinates_than_those_of_the_functions_are_told():
    chain = four_bar()
    functions = chain.jax()
    functions._mechanism = replace(functions._mechanism, coordinates=np.array([2]))
    with pytest.raises(jax.errors.JaxRuntimeError, match="call jax\\(\\) again, near this q"):
        functions.torques(chain.home, [1.0], [0.0]).block_until_ready()


@pytest.mark.parametrize("package", ["jax", "casadi"])
def test_without_jax_or_casadi_the_extra_is_named(package):
    said = said_without(package, "sst_pin.robots.four_bar().jax()")
    assert said.startswith(f"{package} is not installed")
    assert "sst-pin[jax]" in said


def test_direct_dynamics_without_mass_is_refused():
    given = four_bar()
    for body in given.model.inertias:
        body.mass, body.inertia = 0.0, np.zeros((3, 3))
    massless = ClosedChain(given.model, given.closures, ["crank"])
    functions, one = massless.jax(), np.zeros(1)
    with pytest.raises(SingularConfigurationError, match="move no mass"):
        functions.accelerations(massless.home, one, one)
    with pytest.raises(SingularConfigurationError, match="move no mass"):
        functions.step(massless.home, one, one, 1e-3)

# SPDX-License-Identifier: BSD-2-Clause
"""Bodies with a share of their weight: forces, energies, reactions, derivatives, files."""

import copy
import pickle

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin.compiled.equations import Equations
from sst_pin.compiled.generator_inputs import sample_configurations
from sst_pin.model.weight_shares import Link
from sst_pin.robots import four_bar, stewart
from sst_pin.verification.lagrange import LagrangeMultipliers
from sst_pin.verification.mujoco_tree import MujocoInverse

#: None, one with an offset, and more than one.
SHARES = {"platform": [0.4, 0.02, -0.01, 0.03], "universal_2": 0.0, "stroke_3": 1.5}


def with_shares(chain, shares, **options):
    return sst_pin.ClosedChain(
        chain.model, chain.closures, chain.motor_names, weight_shares=shares, **options
    )


@pytest.fixture(scope="module")
def hexapod():
    return with_shares(stewart(), SHARES)


@pytest.fixture
def state(hexapod):
    n = hexapod.degrees_of_freedom
    return hexapod.generic_configuration(), *np.random.default_rng(0).normal(size=(2, n))


def moved(chain, q, k, step):
    """The closed configuration a step along coordinate k further."""
    motion = chain.joint_rates(q, np.eye(chain.degrees_of_freedom)[k])
    return chain.assemble(pin.integrate(chain.model, q, step * motion))


def slopes(chain, function, q, step=1e-5):
    """Central differences along the coordinates; their error is about 1e-9 of the function."""
    columns = [
        (function(moved(chain, q, k, step)) - function(moved(chain, q, k, -step))) / (2 * step)
        for k in range(chain.degrees_of_freedom)
    ]
    return np.stack(columns, axis=-1)


def test_the_potential_energy_is_that_of_the_shares_of_all_masses(hexapod, state):
    """The placements are Pinocchio's."""
    q, _, _ = state
    model = hexapod.model
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    energy = 0.0
    for name, body, placement in zip(model.names, model.inertias, data.oMi, strict=True):
        share, *offset = np.append(SHARES.get(name, 1.0), np.zeros(3))[:4]
        moment = share * placement.act(body.lever) + placement.rotation @ offset
        energy -= body.mass * moment @ model.gravity.linear
    assert hexapod.potential_energy(q) == pytest.approx(energy, rel=1e-12)


def test_forces_at_rest_are_the_slopes_of_the_potential_energy(hexapod, state):
    q, _, _ = state
    zero = np.zeros(hexapod.degrees_of_freedom)
    expected = slopes(hexapod, hexapod.potential_energy, q)
    assert_allclose(hexapod.generalized_forces(q, zero, zero), expected, rtol=1e-6)


def test_derivatives_are_central_differences(hexapod, state):
    q, va, aa = state
    expected = slopes(hexapod, lambda x: hexapod.generalized_forces(x, va, aa), q)
    by_q = hexapod.torque_derivatives(q, va, aa).dq
    assert_allclose(by_q, expected, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("referee", [LagrangeMultipliers, MujocoInverse])
def test_referees_agree(hexapod, state, referee):
    """In MuJoCo an offset is that of a body of 1e-12 kg, so that it agrees to about 1e-12."""
    q, va, aa = state
    f = referee(hexapod).generalized_forces(q, va, aa)
    assert_allclose(f, hexapod.generalized_forces(q, va, aa), rtol=1e-9)


@pytest.mark.parametrize("share", [1.5, 2.5])
def test_mujoco_agrees_where_no_weight_is_compensated(share):
    """MuJoCo ignores a negative `gravcomp` without a positive one beside it."""
    chain = with_shares(four_bar(), {"coupler": share})
    q, va, aa = chain.home, np.array([0.7]), np.array([0.2])
    f = MujocoInverse(chain).generalized_forces(q, va, aa)
    assert_allclose(f, chain.generalized_forces(q, va, aa), rtol=1e-9)


def test_the_long_form_is_the_short_form(hexapod, state):
    q, va, aa = state
    terms = hexapod.noc(q, va)
    f = terms.inertia @ aa + terms.coriolis @ va - terms.gravity
    assert_allclose(f, hexapod.generalized_forces(q, va, aa), rtol=1e-10)


def test_the_ground_carries_the_shares_of_the_weights(hexapod, state):
    q, _, _ = state
    zero = np.zeros(hexapod.degrees_of_freedom)
    names, bodies = list(hexapod.model.names), list(hexapod.model.inertias)
    share_of = {name: np.ravel(share)[0] for name, share in SHARES.items()}
    mass = sum(
        share_of.get(name, 1.0) * body.mass for name, body in zip(names, bodies, strict=True)
    )
    ground = hexapod.reactions(q, zero, zero).ground
    assert_allclose(ground[:3], -mass * hexapod.model.gravity.linear, atol=1e-10)


def test_forces_are_the_regressor_times_the_parameters_also_of_other_masses(hexapod, state):
    """The shares stay as masses and mass centres change."""
    q, va, aa = state
    Y = hexapod.torque_regressor(q, va, aa)
    theta = hexapod.dynamic_parameters
    other = {"platform.mass": 3.0, "platform.mx": 0.2, "universal_2.mass": 7.0}
    other |= {"universal_2.mz": 0.4}
    for chain in (hexapod, hexapod.with_parameters(other)):
        theta = chain.dynamic_parameters
        assert_allclose(Y @ theta, chain.generalized_forces(q, va, aa), rtol=1e-10)


def test_edits_of_a_body_without_weight_take_effect_without_weight():
    chain = with_shares(four_bar(), {"coupler": 0.0})
    q, zero = chain.home, np.zeros(1)
    before = chain.compute_torques(q, zero, zero)
    chain.model.inertias[2].mass = 50.0
    chain.refresh()
    assert_allclose(chain.compute_torques(q, zero, zero), before, rtol=1e-12)


@pytest.mark.parametrize("name", ["coupler.x", "coupler.mx"])
def test_design_derivatives_are_differences_of_changed_designs(name):
    chain = with_shares(four_bar(), {"coupler": [0.3, 0.02, 0.01, 0.03], "rocker": 0.0})
    q, va, aa, step = chain.home, [0.5], [0.2], 1e-6
    derivative = chain.design_derivatives(q, va, aa, [name]).torques[..., 0]
    longer, shorter = (chain.with_design({name: x}) for x in (step, -step))
    difference = longer.compute_torques(longer.assemble(q), va, aa)
    difference -= shorter.compute_torques(shorter.assemble(q), va, aa)
    assert_allclose(derivative, difference / (2 * step), rtol=1e-6)


def test_a_locked_joint_keeps_the_weights_of_its_bodies(hexapod):
    """The referee is the same arm with the joint at rest in the same position."""
    model = pin.buildSampleModelManipulator()
    names = list(model.names)[1:]
    shares = {names[1]: 0.3, names[2]: [0.8, 0.1, 0.2, -0.3], names[3]: 0.0}
    arm = sst_pin.ClosedChain(model, [], names, weight_shares=shares)
    locked = {names[2]: 0.4, names[3]: -0.7}
    rest = sst_pin.ClosedChain(
        model, [], [x for x in names if x not in locked], locked=locked, weight_shares=shares
    )
    moving = [k for k, name in enumerate(names) if name not in locked]
    q, va, aa = np.random.default_rng(1).normal(size=(3, len(moving)))
    whole = np.zeros((3, len(names)))
    whole[:, moving] = q, va, aa
    whole[0, [2, 3]] = 0.4, -0.7
    expected = arm.compute_torques(*whole)[moving]
    assert_allclose(rest.compute_torques(q, va, aa), expected, atol=1e-12)


def test_symbols_are_the_reference_path(hexapod, state):
    """Forces and the energy; `test_compiled` has kernels of all quantities."""
    q, va, aa = state
    e = Equations(hexapod.mechanism, sample_configurations(hexapod.engine.reference))
    p = e.parameters.pack(hexapod.mechanism, hexapod.mechanism.friction)
    results = [e.generalized_forces, e.tree.potential_energy]
    function = ca.Function("f", [e.q, e.va, e.aa, e.p], results)
    f, energy = function(q, va, aa, p)
    assert_allclose(f.full().ravel(), hexapod.generalized_forces(q, va, aa), rtol=1e-9)
    assert float(energy) == pytest.approx(hexapod.potential_energy(q), rel=1e-12)


@pytest.mark.slow
def test_kernels_are_the_reference_path(cache_of_the_run):
    """Those that have their own expressions for weights; they sum up what the others compute."""
    chain = with_shares(four_bar(), {"coupler": [0.3, 0.02, 0.01, 0.03], "rocker": 0.0})
    compiled = copy.copy(chain)
    compiled.compile()
    q, va, tau = chain.home, [0.7], [0.2]
    derivatives = compiled.acceleration_derivatives(q, va, tau)
    expected = chain.acceleration_derivatives(q, va, tau)
    for x, y in zip(derivatives, expected, strict=True):
        assert_allclose(x, y, rtol=1e-9)
    joints = chain.reactions(q, va, tau=tau).joints
    assert_allclose(compiled.reactions(q, va, tau=tau).joints, joints, atol=1e-10)


def test_whole_shares_are_no_shares(hexapod):
    chain = with_shares(four_bar(), {"coupler": 1.0, "rocker": [1, 0, 0, 0]})
    assert chain.mechanism.weight_shares is None
    assert chain.weight_shares == {}
    assert hexapod.weight_shares == SHARES


def test_a_pickled_robot_has_its_shares_read_only(hexapod):
    again = pickle.loads(pickle.dumps(hexapod))
    assert again.weight_shares == SHARES
    assert not again.mechanism.weight_shares.shares.flags.writeable


def test_the_offset_that_links_share_is_read_only():
    assert not Link(joint=1, mass=2.0, center=np.zeros(3), share=0.5).offset.flags.writeable


@pytest.mark.parametrize(
    ("shares", "error", "words"),
    [
        ({"elbow": 0.5}, sst_pin.UnknownNameError, "elbow"),
        (["crank"], sst_pin.InputError, "a mapping of names to shares"),
        ({"crank": np.nan}, sst_pin.InputError, "weight_shares crank"),
        ({"crank": [0.5, 0.1]}, sst_pin.InputError, "weight_shares crank"),
        ({"crank": [0.5, [0.1, 0.2]]}, sst_pin.InputError, "weight_shares crank"),
    ],
)
def test_wrong_shares_are_refused(shares, error, words):
    with pytest.raises(error, match=words):
        with_shares(four_bar(), shares)


def test_an_mjcf_that_is_written_has_the_shares(hexapod, state, tmp_path):
    """The writer gives an offset to a body of 1e-12 kg, so the forces agree to about 1e-12."""
    q, va, aa = state
    path = tmp_path / "hexapod.xml"
    sst_pin.write_mjcf(hexapod, path)
    again = sst_pin.ClosedChain.from_mjcf(path)
    again = again.with_coordinates(hexapod.coordinates)
    f = again.generalized_forces(q, va, aa)
    assert_allclose(f, hexapod.generalized_forces(q, va, aa), rtol=1e-8)

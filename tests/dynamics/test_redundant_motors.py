# SPDX-License-Identifier: BSD-2-Clause
"""What motors cannot supply is refused, and torques are right where masses and weights differ."""

import warnings
from contextlib import suppress
from fractions import Fraction

import numpy as np
import pytest

import sst_pin
from sst_pin.errors import ActuationError, SSTError
from tests.support.motor_cases import elbows, five_bar, held_not, lift, telescope

AA = np.array([1.0, -1.0])


@pytest.mark.parametrize("loop", [False, True], ids=["tree", "with a loop"])
@pytest.mark.parametrize("masses", [(0.1, 1e3), (1e-3, 1e3), (0.1, 1e5), (0.1, 1e6)])
def test_a_light_freedom_is_refused_though_its_coordinates_move_a_heavy_body(masses, loop):
    chain = telescope(*masses, loop)
    n = chain.degrees_of_freedom
    aa = np.append(AA, np.zeros(n - 2))
    with pytest.raises(ActuationError, match="no motor supplies the forces lower") as caught:
        chain.compute_torques(chain.generic_configuration(), np.zeros(n), aa)
    needed = masses[0] * (1 + 9.81)  # what moves the lower stage alone
    missing = caught.value.missing
    assert missing["lower"] - missing["upper"] == pytest.approx(needed, rel=1e-5)


@pytest.mark.parametrize("loop", [False, True], ids=["tree", "with a loop"])
def test_a_light_freedom_that_falls_freely_needs_no_motor(loop):
    chain = telescope(0.1, 1e5, loop)
    n = chain.degrees_of_freedom
    aa = np.array([-9.81, 9.81, *np.zeros(n - 2)])
    q = chain.generic_configuration()
    tau = chain.compute_torques(q, np.zeros(n), aa)
    f = chain.generalized_forces(q, np.zeros(n), aa)
    assert np.allclose(chain.actuator_jacobian(q).T @ tau, f, rtol=1e-9, atol=1e-6)


#: Ways to ask for torques, from the smallest ones and the forces that are needed.
OPTIONS = {
    "plain": lambda tau, f: {},
    "limits": lambda tau, f: {"limits": [np.inf, abs(tau[1]) / 2, np.inf, np.inf, np.inf]},
    "preload": lambda tau, f: {"preload": 0.1 * f[0] * np.array([1.0, -2.0, 3.0])},
    "weights": lambda tau, f: {"weights": [1, 1e6, 1, 1, 1]},
    "other weights": lambda tau, f: {"weights": [1, 1, 1e12, 1e-6, 1]},
}
#: Masses of the lift and of its bars.
MASSES = [(1e2, 1e-3), (1e5, 1.0), (1e5, 1e-3)]


@pytest.mark.parametrize("compiled", [False, True], ids=["reference", "compiled"])
@pytest.mark.parametrize("masses", MASSES)
def test_torques_bring_about_the_forces_of_each_freedom_or_are_refused(masses, compiled):
    """Relative to the forces of the light freedom, not to torques that balance each other there."""
    chain = lift(*masses)
    if compiled:
        chain.compile()
    q, va = chain.generic_configuration(), np.array([0.2, 0.3])
    A, f = chain.noc(q, va).L.T @ chain.actuation, chain.generalized_forces(q, va, AA)
    least = np.linalg.pinv(A) @ f
    for option in OPTIONS.values():
        with suppress(ActuationError):
            tau = chain.compute_torques(q, va, AA, **option(least, f))
            assert (np.abs(A @ tau - f) < 2e-6 * np.abs(f)).all()


@pytest.mark.parametrize("option", ["weights", "other weights", "plain", "limits", "preload"])
def test_no_torques_are_refused_that_exist_to_rounding(option):
    """What a lift of 1e5 kg leaves over of the forces of its bars of a gram is small."""
    chain = lift(1e5, 1e-3)
    q, va = chain.generic_configuration(), np.array([0.2, 0.3])
    A, f = chain.noc(q, va).L.T @ chain.actuation, chain.generalized_forces(q, va, AA)
    tau = chain.compute_torques(q, va, AA, **OPTIONS[option](np.linalg.pinv(A) @ f, f))
    assert (np.abs(A @ tau - f) < 1e-7 * np.abs(f)).all()


def exact(A, f, weights):
    """The least torques W^-1 A^T (A W^-1 A^T)^-1 f of two freedoms, in fractions."""
    a = [[Fraction(x) for x in row] for row in A.tolist()]
    f = [Fraction(x) for x in f.tolist()]
    w = [1 / Fraction(x) for x in weights]
    gram = [[sum(x * y * z for x, y, z in zip(r, s, w, strict=True)) for s in a] for r in a]
    det = gram[0][0] * gram[1][1] - gram[0][1] * gram[1][0]
    x = [
        (gram[1][1] * f[0] - gram[0][1] * f[1]) / det,
        (gram[0][0] * f[1] - gram[1][0] * f[0]) / det,
    ]
    return [float(w[k] * (a[0][k] * x[0] + a[1][k] * x[1])) for k in range(len(w))]


@pytest.mark.parametrize("power", [0, 2, 4, 8])
@pytest.mark.parametrize("cheap", range(4))
def test_least_torques_are_exact_for_weights_that_differ_much(power, cheap):
    chain = five_bar(["a1", "a2", "b1", "b2"])
    q, va, aa = chain.generic_configuration(), np.array([0.3, 0.2]), np.array([1.0, 2.0])
    weights = [1.0 if k == cheap else 10.0**power for k in range(4)]
    A, f = chain.noc(q, va).L.T @ chain.actuation, chain.generalized_forces(q, va, aa)
    tau = chain.compute_torques(q, va, aa, weights=weights)
    assert tau == pytest.approx(exact(A, f, weights), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("power", [1, 100, 153, 160, 300])
def test_motions_too_large_to_square_are_refused_as_small_ones(power):
    chain = lift(1.0, 1.0, ["crank", "coupler", "rocker"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ActuationError, match="no motor supplies the forces lift"):
            chain.compute_torques(chain.generic_configuration(), [0, 0], [10.0**power, 0])


def test_limits_of_a_sample_do_not_depend_on_its_neighbours():
    chain = five_bar(["a1", "a2", "b1", "b2"])
    q, va, aa = chain.generic_configuration(), np.array([0.3, 0.2]), np.array([1.0, 2.0])
    least = chain.compute_torques(q, va, aa)
    limits = [0.9 * abs(least[0]), 1e30, 1e30, 1e30]
    alone = chain.compute_torques(q, va, aa, limits=limits)
    beside = chain.compute_torques(q, va, [aa, 1e15 * aa], limits=limits)
    assert np.array_equal(beside[0], alone)
    assert abs(alone[0]) <= limits[0] < abs(least[0])


@pytest.mark.parametrize("option", [{"limits": [1e6, 1e6]}, {"preload": []}])
def test_samples_that_the_motors_do_not_hold_are_nan_and_the_others_right(option):
    chain = elbows()
    bad, good = held_not(chain)
    q, va, aa = np.array([good, bad, good]), np.zeros(2), np.ones(2)
    tau = chain.compute_torques(q, va, aa, on_error="nan", **option)
    assert np.isnan(tau[1]).all()
    assert tau[[0, 2]] == pytest.approx(chain.compute_torques(q[[0, 2]], va, aa), rel=1e-12)
    with pytest.raises(SSTError, match="1 of 3 samples"):
        chain.compute_torques(q, va, aa, **option)


def test_samples_beyond_the_limits_are_nan_and_all_are_named():
    chain = five_bar(["a1", "a2", "b1", "b2"])
    q, va, aa = chain.generic_configuration(), np.zeros(2), np.ones((4, 2))
    aa[[1, 3]] *= 1e3
    limits = [50.0] * 4
    tau = chain.compute_torques(q, va, aa, limits=limits, on_error="nan")
    assert np.isnan(tau[[1, 3]]).all()
    assert np.isfinite(tau[[0, 2]]).all()
    with pytest.raises(ActuationError) as caught:
        chain.compute_torques(q, va, aa, limits=limits)
    assert caught.value.samples == ((1,), (3,))


def test_leading_axes_of_a_preload_broadcast():
    chain = five_bar(["a1", "a2", "b1", "b2"])
    q, va, aa = chain.generic_configuration(), np.zeros(2), np.ones(2)
    amounts = np.arange(10.0).reshape(5, 2)
    tau = chain.compute_torques(q, va, aa, preload=amounts)
    alone = [chain.compute_torques(q, va, aa, preload=row) for row in amounts]
    assert np.array_equal(tau, alone)
    assert chain.compute_torques([q] * 3, va, aa, preload=amounts[:, None]).shape == (5, 3, 4)
    with pytest.raises(sst_pin.InputError, match="do not broadcast"):
        chain.compute_torques([q] * 3, va, aa, preload=amounts)


def test_a_robot_without_motors_has_no_directions_of_preload():
    chain = five_bar([], coordinates=None)
    assert chain.preload_directions(chain.generic_configuration()).shape == (0, 0)
    assert chain.preload_directions([chain.generic_configuration()] * 3).shape == (3, 0, 0)


@pytest.mark.parametrize("compiled", [False, True], ids=["reference", "compiled"])
@pytest.mark.parametrize("size", [1e-6, 1.0, 1e3])
def test_a_preload_of_a_robot_without_weight_at_rest_is_no_motion(size, compiled):
    """No force is needed there, so that all that is left over is rounding of the preload."""
    chain = five_bar(["a1", "a2", "b1", "b2"])
    chain.model.gravity.linear = np.zeros(3)
    chain.refresh()
    if compiled:
        chain.compile()
    random = np.random.default_rng(0)
    q = chain.generic_configuration()
    for amounts in size * random.normal(size=(20, 2)):
        tau = chain.compute_torques(q, [0, 0], [0, 0], preload=amounts)
        assert np.linalg.norm(tau) == pytest.approx(np.linalg.norm(amounts), rel=1e-12)
        left = chain.actuator_jacobian(q).T @ tau
        assert np.abs(left).max() < 1e-14 * size

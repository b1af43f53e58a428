# SPDX-License-Identifier: BSD-2-Clause
"""Least torques, preload and limits of surplus motors; what motors cannot supply is refused."""

from contextlib import suppress

import numpy as np
import pytest
import qpsolvers

import sst_pin
from sst_pin import robots
from sst_pin.errors import ActuationError
from tests.support import any_chain
from tests.support.motor_cases import lift, motors_everywhere, telescope

CHAINS = {"one surplus motor": robots.planar_4rrr, "three": motors_everywhere}


@pytest.fixture(params=CHAINS)
def chain(request):
    return CHAINS[request.param]()


@pytest.fixture
def motion(chain):
    return any_chain.states(chain, 6, 1)


def test_preload_makes_no_motion(chain, motion):
    q, va, aa = motion
    basis, k = chain.preload_directions(q), len(chain.motor_names) - chain.degrees_of_freedom
    assert basis.shape == (6, len(chain.motor_names), k)
    assert f"torques of the motors that make no motion: {k}" in str(chain.mobility())
    assert np.swapaxes(basis, -1, -2) @ basis == pytest.approx(
        np.tile(np.eye(k), (6, 1, 1)), abs=1e-12
    )
    amounts = np.linspace(-3, 5, 6 * k).reshape(6, k)
    tau = chain.compute_torques(q, va, aa, preload=amounts)
    least = chain.compute_torques(q, va, aa)
    assert np.einsum("imk,im->ik", basis, tau - least) == pytest.approx(amounts, abs=1e-12)
    moved = chain.compute_accelerations(q, va, tau) - chain.compute_accelerations(q, va, least)
    assert np.abs(moved).max() < 1e-10


def least_peak(chain, *state):
    """The smallest peak torque with which a motion can be made, from the error that names it."""
    with pytest.raises(sst_pin.ActuationError) as caught:
        chain.compute_torques(*state, limits=np.full(len(chain.motor_names), 1e-9))
    return max(caught.value.missing.values())


@pytest.mark.parametrize("weighted", [False, True])
def test_least_torques_solve_a_quadratic_programme(chain, motion, weighted):
    """Another solver for min tau^T W tau with J^T tau = f.

    Without limits, and with limits between the peak of these torques and the least peak.
    """
    n = len(chain.motor_names)
    weights = np.random.default_rng(0).uniform(0.1, 10, n) if weighted else None
    W = np.eye(n) if weights is None else np.diag(weights)
    for state in zip(*motion, strict=True):
        free = chain.compute_torques(*state, weights=weights)
        size = (np.abs(free).max() + least_peak(chain, *state)) / 2
        limited = chain.compute_torques(*state, weights=weights, limits=np.full(n, size))
        assert np.abs(limited - free).max() > 1e-3 * size
        assert (np.abs(limited) <= size).all()
        A, b = chain.actuator_jacobian(state[0]).T, chain.generalized_forces(*state) / size
        for tau, most in ((free, np.inf), (limited, 1.0)):
            ends = {"lb": np.full(n, -most), "ub": np.full(n, most)}
            wanted = qpsolvers.solve_qp(W, np.zeros(n), A=A, b=b, **ends, solver="quadprog")
            assert tau / size == pytest.approx(wanted, abs=1e-9)


def test_limits_that_cannot_be_respected_are_named_with_the_excess(chain, motion):
    state = [x[0] for x in motion]
    peak, weak = least_peak(chain, *state), np.ones(len(chain.motor_names))
    chain.compute_torques(*state, limits=1.001 * peak * weak)
    with pytest.raises(sst_pin.ActuationError, match="exceed the limits") as caught:
        chain.compute_torques(*state, limits=0.999 * peak * weak)
    assert set(caught.value.missing) <= set(chain.motor_names)
    strong = np.full(len(weak), 10 * np.abs(chain.compute_torques(*motion)).max())
    motion[2][3] *= 1e4
    with pytest.raises(sst_pin.ActuationError, match="1 of 6 samples"):
        chain.compute_torques(*motion, limits=strong)


def test_a_robot_without_surplus_motors_is_only_checked():
    chain = robots.five_bar()
    q, va, aa = any_chain.states(chain, 3, 1)
    least = chain.compute_torques(q, va, aa)
    peaks = np.abs(least).max(axis=0)
    assert np.array_equal(chain.compute_torques(q, va, aa, limits=peaks), least)
    with pytest.raises(sst_pin.ActuationError, match="exceed the limits"):
        chain.compute_torques(q, va, aa, limits=0.99 * peaks)
    assert chain.preload_directions(q).shape == (3, 2, 0)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"limits": [-1.0] * 4}, "must be below"),
        ({"preload": [1.0, 2.0]}, "preload: shape"),
        ({"preload": [np.nan]}, "preload: entry .0. is nan"),
    ],
)
def test_bad_limits_and_preloads_are_refused(arguments, problem):
    arm = robots.planar_4rrr()
    with pytest.raises(sst_pin.InputError, match=problem):
        arm.compute_torques(arm.home, np.zeros(3), np.zeros(3), **arguments)


def test_samples_at_fault_stay_out_of_the_others():
    arm = robots.planar_4rrr()
    q, va, aa = any_chain.states(arm, 3, 1)
    q[1] += 0.1
    tau = arm.compute_torques(q, va, aa, preload=[1.0], limits=[50.0] * 4, on_error="nan")
    assert np.isnan(tau[1]).all()
    assert tau[0] == pytest.approx(
        arm.compute_torques(q[0], va[0], aa[0], preload=[1.0], limits=[50.0] * 4), abs=1e-10
    )


AA = np.array([1.0, -1.0])


@pytest.mark.parametrize("loop", [False, True], ids=["tree", "with a loop"])
@pytest.mark.parametrize("masses", [(1e-3, 1e3), (0.1, 1e6)])
def test_a_light_freedom_is_refused_though_its_coordinates_move_a_heavy_body(masses, loop):
    chain = telescope(*masses, loop)
    n = chain.degrees_of_freedom
    aa = np.append(AA, np.zeros(n - 2))
    with pytest.raises(ActuationError, match="no motor supplies the forces lower") as caught:
        chain.compute_torques(chain.generic_configuration(), np.zeros(n), aa)
    needed = masses[0] * (1 + 9.81)  # what moves the lower stage alone
    missing = caught.value.missing
    assert missing["lower"] - missing["upper"] == pytest.approx(needed, rel=1e-5)


#: Ways to ask for torques, from the smallest ones and the forces that are needed.
OPTIONS = {
    "plain": lambda tau, f: {},
    "limits": lambda tau, f: {"limits": [np.inf, abs(tau[1]) / 2, np.inf, np.inf, np.inf]},
    "preload": lambda tau, f: {"preload": 0.1 * f[0] * np.array([1.0, -2.0, 3.0])},
    "weights": lambda tau, f: {"weights": [1, 1e6, 1, 1, 1]},
    "other weights": lambda tau, f: {"weights": [1, 1, 1e12, 1e-6, 1]},
}
#: Masses of the lift and of its bars.
MASSES = [(1e2, 1e-3), (1e5, 1e-3)]


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

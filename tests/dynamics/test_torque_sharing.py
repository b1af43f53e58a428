# SPDX-License-Identifier: BSD-2-Clause
"""Least torques, preload and limits of surplus motors; what motors cannot supply is refused."""

from contextlib import suppress

import numpy as np
import pytest
import qpsolvers

import sst_pin
from sst_pin import robots
from sst_pin.errors import ActuationError, SSTError
from tests.support import any_chain
from tests.support.motor_cases import elbows, five_bar, held_not, lift, telescope


def motors_everywhere():
    """A planar 3-RRR with a motor in each joint of its legs: three more than freedoms."""
    plain = robots.planar_3rrr()
    names = [name for name in plain.joint_names if not name.startswith("wrist")][:6]
    return sst_pin.ClosedChain(plain.model, plain.closures, names)


CHAINS = {"one surplus motor": robots.planar_4rrr, "three": motors_everywhere}


@pytest.fixture(params=CHAINS)
def chain(request):
    return CHAINS[request.param]()


@pytest.fixture
def motion(chain):
    return any_chain.states(chain, 6, 1)


def swing(chain, count=100):
    """A path on which the coordinates swing, with its rates and accelerations."""
    n = chain.degrees_of_freedom
    start = any_chain.states(chain, 1, 1)[0][0]
    index = [chain.joint_names.index(name) for name in chain.coordinates]
    phases = np.linspace(0, 2 * np.pi, count)[:, None] + np.arange(n)
    amplitude, q = np.linspace(0.03, 0.04, n), [start]
    for way in amplitude * (np.sin(phases) - np.sin(phases[0])):
        guess = q[-1].copy()
        guess[index] = start[index] + way
        q.append(chain.assemble(guess))
    return np.array(q[1:]), amplitude * np.cos(phases), -amplitude * np.sin(phases)


def test_there_are_as_many_directions_as_motors_too_many(chain):
    stresses = chain.mobility().inner_stresses
    assert stresses == len(chain.motor_names) - chain.degrees_of_freedom
    assert chain.preload_directions(chain.home).shape == (len(chain.motor_names), stresses)
    assert f"torques of the motors that make no motion: {stresses}" in str(chain.mobility())


def test_preload_makes_no_motion(chain, motion):
    q, va, aa = motion
    basis = chain.preload_directions(q)
    k = basis.shape[-1]
    assert np.swapaxes(basis, -1, -2) @ basis == pytest.approx(
        np.tile(np.eye(k), (6, 1, 1)), abs=1e-12
    )
    amounts = np.linspace(-3, 5, 6 * k).reshape(6, k)
    tau = chain.compute_torques(q, va, aa, preload=amounts)
    least = chain.compute_torques(q, va, aa)
    assert np.einsum("imk,im->ik", basis, tau - least) == pytest.approx(amounts, abs=1e-12)
    moved = chain.compute_accelerations(q, va, tau) - chain.compute_accelerations(q, va, least)
    assert np.abs(moved).max() < 1e-10


def test_directions_are_continuous_along_a_path(chain):
    """Each step changes them by no more than a step of the subspace does; no signs, no order."""
    q, _, _ = swing(chain)
    basis = chain.preload_directions(q)
    projectors = basis @ np.swapaxes(basis, -1, -2)
    steps = np.linalg.norm(np.diff(basis, axis=0), axis=(1, 2))
    of_subspace = np.linalg.norm(np.diff(projectors, axis=0), axis=(1, 2))
    assert (steps < 1.1 * of_subspace + 1e-12).all()


def least_peak(chain, *state):
    """The smallest peak torque with which a motion can be made, from the error that names it."""
    with pytest.raises(sst_pin.ActuationError) as caught:
        chain.compute_torques(*state, limits=np.full(len(chain.motor_names), 1e-9))
    return max(caught.value.missing.values())


def test_least_torques_within_limits_solve_a_quadratic_programme(chain, motion):
    """Another solver for min |tau|^2 with J^T tau = f and limits between the least and this."""
    for state in zip(*motion, strict=True):
        least = chain.compute_torques(*state)
        size = (np.abs(least).max() + least_peak(chain, *state)) / 2
        tau = chain.compute_torques(*state, limits=np.full(len(least), size))
        assert np.abs(tau - least).max() > 1e-3 * size
        A, b = chain.actuator_jacobian(state[0]).T, chain.generalized_forces(*state) / size
        n, one = len(least), np.ones(len(least))
        wanted = qpsolvers.solve_qp(
            np.eye(n), 0 * one, A=A, b=b, lb=-one, ub=one, solver="quadprog"
        )
        assert tau / size == pytest.approx(wanted, abs=1e-9)
        assert (np.abs(tau) <= size).all()


def test_limits_that_cannot_be_respected_are_named_with_the_excess(chain, motion):
    q, va, aa = (x[0] for x in motion)
    weak = np.full(len(chain.motor_names), 1e-3)
    with pytest.raises(sst_pin.ActuationError, match="more than the limits") as caught:
        chain.compute_torques(q, va, aa, limits=weak)
    excess = max(caught.value.missing.values())
    assert set(caught.value.missing) <= set(chain.motor_names)
    chain.compute_torques(q, va, aa, limits=weak + 1.001 * excess)
    with pytest.raises(sst_pin.ActuationError):
        chain.compute_torques(q, va, aa, limits=weak + 0.999 * excess)
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
    with pytest.raises(sst_pin.ActuationError, match="more than the limits"):
        chain.compute_torques(q, va, aa, limits=0.99 * peaks)
    assert chain.preload_directions(q).shape == (3, 2, 0)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"limits": [1.0]}, "limits: shape"),
        ({"limits": [-1.0] * 4}, "must be below"),
        ({"preload": [1.0, 2.0]}, "preload: shape"),
        ({"preload": [np.nan]}, "preload: entry .0. is nan"),
        ({"limits": "much"}, "limits"),
    ],
)
def test_bad_limits_and_preloads_are_refused(arguments, problem):
    arm = robots.planar_4rrr()
    with pytest.raises(sst_pin.InputError, match=problem):
        arm.compute_torques(arm.home, np.zeros(3), np.zeros(3), **arguments)


def test_least_torques_apply_to_a_robot_that_needs_none():
    """Without weight all torques are zero; limits as those of cables ask for more."""
    for chain, answer in ((robots.planar_4rrr(), True), (robots.five_bar(), False)):
        chain.model.gravity.linear = np.zeros(3)
        chain.refresh()
        rest, motors = np.zeros(chain.degrees_of_freedom), len(chain.motor_names)
        limits = np.tile([-5.0, 5.0], (motors, 1))
        limits[0] = 0.1, 5.0
        if answer:
            tau = chain.compute_torques(chain.home, rest, rest, limits=limits)
            B = chain.preload_directions(chain.home)[:, 0]
            assert tau == pytest.approx(0.1 * B / B[0], abs=1e-12)
        else:
            with pytest.raises(sst_pin.ActuationError, match=f"{chain.motor_names[0]} by 0.1 "):
                chain.compute_torques(chain.home, rest, rest, limits=limits)


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

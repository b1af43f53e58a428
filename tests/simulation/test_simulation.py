# SPDX-License-Identifier: BSD-2-Clause
import warnings

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import sst_pin
from sst_pin.simulation.energy import energy_balance
from sst_pin.simulation.state_equations import StateEquations
from sst_pin.simulation.step_control import StepControl
from sst_pin.sst import paper
from sst_pin.states import StateSpace
from tests.gallery import EVERY_ROBOT, governor, n_four_bar
from tests.support import link_tables
from tests.support.by_hand import add, at


def test_example_2_returns_to_the_circle(compiled_robot):
    """From the exact start within 1e-9, from the printed one within 5e-5 (measured 2e-12, 2e-5)."""
    robot = compiled_robot
    circle = paper.example_1(robot, np.linspace(0, paper.PERIOD, 301))
    exact = paper.compare(robot, circle, paper.example_2(robot, circle))
    assert exact.path_error < 1e-9
    assert exact.closure < 1e-11
    assert exact.energy < 1e-8  # integral of the power by a spline through 301 samples
    rounded = paper.compare(robot, circle, paper.example_2(robot, circle, rounded=True))
    assert 1e-6 < rounded.path_error < 5e-5


@pytest.mark.slow
def test_a_hundred_seconds_of_swinging_keep_energy_and_closures():
    """Home tilted by 0.3 rad about the hanging pose and let go, without friction."""
    robot = sst_pin.SST(sst_pin.Parameters(gravity=9.81 * np.ones(3) / np.sqrt(3)))
    robot.compile(robot.home)
    t = np.linspace(0, 100, 101)
    tilt = Rotation.from_rotvec((0.1, -0.2, 0.2)).as_matrix()
    start = robot.inverse_kinematics(tilt @ robot.platform_orientation(robot.home))
    motion = robot.simulate(np.zeros(3), start, np.zeros(3), t)
    energy = robot.kinetic_energy(motion.q, motion.va) + robot.potential_energy(motion.q)
    assert np.abs(energy - energy[0]).max() < 1e-9
    assert np.abs(robot.residual(motion.q)).max() < 1e-11
    assert np.abs(motion.va).max() > 0.1  # it does swing


def test_motors_work_against_their_own_rates_whatever_the_coordinates():
    """A four-bar told by its rocker gains what the motor at its crank gives, less friction."""
    table = link_tables.four_bar()
    chain = table.chain(coordinates=["rocker"]).with_parameters({"crank.viscous": 0.2})
    q, t = table.joints(table.x).real, np.linspace(0, 0.2, 41)
    motion = chain.simulate([3.0], q, [0.2], t)
    balance = energy_balance(chain.engine, motion)
    assert np.abs(balance.motors).max() > 0.01  # J
    assert balance.friction[-1] < -0.01
    assert np.abs(sst_pin.energy_error(chain, motion)).max() < 1e-6  # the spline's, 0.005 s apart


def test_a_load_on_the_star_drives_it(robot):
    """A callable wrench and a constant one are one and the same when they are equal."""
    w = np.zeros((9, 6))
    w[2, 3:] = (0.5, -0.2, 0.1)
    t = np.linspace(0, 0.1, 3)
    hold = robot.compute_torques(robot.home, np.zeros(3), np.zeros(3), external_wrenches=w)
    moment = w[2, 3:]
    for loads in (
        {"external_wrenches": w},
        {"platform_moment": moment},  # the same load by its other name
        {"platform_moment": lambda t, q, va: 3 * moment, "external_wrenches": -2 * w},
    ):
        still = robot.simulate(hold, robot.home, np.zeros(3), t, **loads)
        assert np.abs(still.q - robot.home).max() < 1e-12
    loads = {"external_wrenches": lambda t, q, va: 2 * w}
    moved = robot.simulate(lambda t, q, va: hold, robot.home, np.zeros(3), t, **loads)
    assert np.abs(moved.q[-1] - robot.home).max() > 1e-3


def test_steps_lead_across_singularities_of_the_coordinates(compiled_robot):
    """The symmetric fall from home comes through one fast; each tolerance finds one motion."""
    robot = compiled_robot
    ends = [
        robot.simulate(
            np.zeros(3), robot.home, np.zeros(3), [0, 0.6], rtol=tolerance, atol=tolerance
        ).q[-1]
        for tolerance in (1e-13, 1e-9, 1e-3)
    ]
    assert np.abs(ends[1] - ends[0]).max() < 1e-7
    assert np.abs(ends[2] - ends[0]).max() < 1e-1


def test_a_start_in_a_singularity_is_refused(robot):
    with pytest.raises(sst_pin.InputError, match="closer to a singularity"):
        robot.simulate(np.zeros(3), robot.home, np.zeros(3), [0, 1], max_condition_number=2)


def test_a_motion_with_too_short_steps_says_so_and_not_that_a_singularity_is_near(monkeypatch):
    """A four-bar falls flat; its first irregular step counts as too short."""
    monkeypatch.setattr(StepControl, "stuck", True)
    chain = n_four_bar(1)
    with pytest.warns(sst_pin.SingularityWarning, match="because the steps become too short: cond"):
        chain.simulate([0], chain.home, [-8.0], [0, 0.3], rtol=1e-3, atol=1e-3)


@pytest.mark.slow
def test_an_integrator_that_gives_up_says_when():
    """A runaway, va' ~ va^3, ends in SimulationError, not in a truncated motion."""
    weightless = sst_pin.SST(sst_pin.Parameters(gravity=(0, 0, 0)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # overflow in trial steps, its own
        with pytest.raises(sst_pin.SimulationError) as caught:
            weightless.simulate(
                lambda t, q, va: 50 * va**3 * (1, 0, 0),
                weightless.home,
                np.array((5.0, 0, 0)),
                [0, 1],
                max_condition_number=1e300,
            )
    assert 0 < caught.value.time < 0.1


def two_bodies(first):
    """An arm on a joint on the ground."""
    model = pin.Model()
    inertia = pin.Inertia(2.0, np.array([0.1, 0.2, 0.3]), np.diag([0.4, 0.5, 0.6]))
    joint = add(model, 0, first, "first", at(), inertia)
    add(model, joint, pin.JointModelRX(), "arm", at(1, 1, 1), inertia)
    home = pin.integrate(model, pin.neutral(model), np.linspace(-0.6, 0.7, model.nv))
    model.referenceConfigurations["home"] = home
    return sst_pin.ClosedChain(model, [], ["first", "arm"])


DIFFERENTIATED = {name: EVERY_ROBOT[name] for name in ("governor", "bricard", "delta")}
DIFFERENTIATED["a quaternion"] = lambda: two_bodies(pin.JointModelFreeFlyer())
DIFFERENTIATED["a circle"] = lambda: two_bodies(pin.JointModelRUBZ())


@pytest.mark.parametrize("name", DIFFERENTIATED)
def test_derivatives_of_states_are_those_of_their_rates(name):
    """Central differences; relative to the largest derivative, the governor's 1.5e5 /s^2.

    Rates of positions by the length of a quaternion or circle, which integrators do not keep, are
    no part of the dynamics: positions are compared along motions.
    """
    chain = DIFFERENTIATED[name]()
    state_space = chain.engine.state_space(0.1)
    random = np.random.default_rng(1)
    n, motors = chain.degrees_of_freedom, chain.actuation.shape[1]
    state, tau = np.concatenate([chain.home, random.normal(size=n) / 2]), random.normal(size=motors)
    by_state, by_tau = state_space.derivatives(state, tau, None)

    def differences(function, size, h):
        return np.transpose([(function(h * e) - function(-h * e)) / (2 * h) for e in np.eye(size)])

    expected = differences(lambda d: state_space.rate(state + d, tau, None), len(state), 1e-6)
    space, (nq, nv) = chain.mechanism.space, (chain.model.nq, chain.model.nv)
    turns = np.array([space.q_dot(chain.home, e) for e in np.eye(nv)]).T
    error, most = by_state - expected, 1e-8 * (1 + np.abs(expected).max())
    assert np.abs(error[:, :nq] @ turns).max() < most
    assert np.abs(error[:, nq:]).max() < most
    expected = differences(lambda d: state_space.rate(state, tau + d, None), motors, 1.0)  # linear
    assert np.abs(by_tau - expected).max() < 1e-8 * (1 + np.abs(expected).max())


def test_implicit_methods_take_exact_derivatives_of_stiff_motions(monkeypatch):
    chain, exact, calls = governor(), StateSpace.derivatives, []

    def counted(self, *arguments):
        calls.append(arguments)
        return exact(self, *arguments)

    monkeypatch.setattr(StateSpace, "derivatives", counted)
    ends = []
    for method in ("Radau", "BDF"):
        ends.append(
            chain.simulate(
                lambda t, q, va: -np.array([0.1, 0, 0, 0]) * va,
                chain.home,
                2 * np.pi * np.eye(4)[0],
                [0, 0.1],
                method=method,
                rtol=1e-7,
                atol=1e-7,
            ).q[-1]
        )
        assert calls, method
        calls.clear()
    # Errors of a step add up: a hundred steps of 1e-7.
    assert np.ptp(ends, axis=0).max() < 1e-5


def test_after_a_million_turns_a_robot_moves_as_it_did_before(monkeypatch):
    """The error tolerance is not finer than rounding of the angles, which no step would meet."""
    chain, calls, rate = sst_pin.robots.four_bar(), [], StateEquations.rate
    monkeypatch.setattr(StateEquations, "rate", lambda *x: calls.append(x) or rate(*x))
    way, t, motions, counts = 2 * np.pi * np.array([1e6, -1e6, 0]), np.linspace(0, 0.3, 4), [], []
    for q0 in (chain.home, chain.home + way):
        calls.clear()
        motions.append(chain.simulate([0.0], q0, [3.0], t))
        counts.append(len(calls))
    # rtol of angles of 6e6 rad is 6e-6 rad in each step.
    assert np.abs(motions[1].q - way - motions[0].q).max() < 1e-6
    assert counts[1] < 2 * counts[0]


@pytest.fixture
def five_bar():
    """At rest without weights, so that the motors hold it by no torque."""
    chain = sst_pin.robots.five_bar()
    model = chain.model.copy()
    model.gravity.linear = np.zeros(3)
    return sst_pin.ClosedChain(model, chain.closures, ["shoulder_1", "shoulder_2"])


#: Times of results, a push of a tenth of a second between them, and loose tolerances.
T, PUSH, LOOSE = np.linspace(0, 1, 101), np.array([0.05, 0.0]), {"rtol": 1e-6, "atol": 1e-6}


def pushed(t):
    return np.where((t > 0.7) & (t < 0.8), 1.0, 0.0)


@pytest.mark.parametrize(
    ("torque", "load", "method"),
    [
        pytest.param(lambda t, q, va: pushed(t) * PUSH, None, "DOP853", marks=pytest.mark.slow),
        (pushed(T)[:, None] * PUSH, None, "RK45"),
        ([0, 0], lambda t, q, va: pushed(t) * np.tile(np.eye(6)[5] * 0.05, (4, 1)), "Radau"),
    ],
    ids=["function", "samples", "load"],
)
def test_a_push_of_a_tenth_of_a_second_moves_a_robot_at_rest(five_bar, torque, load, method):
    """The step of the integrator has grown to the rest of the interval by then."""
    options = {"external_wrenches": load, "method": method} | LOOSE
    motion = five_bar.simulate(torque, five_bar.home, [0, 0], T, **options)
    assert np.abs(motion.va[-1]).max() > 0.1
    gained = (np.diff(T)[:, None] * (motion.aa[1:] + motion.aa[:-1]) / 2).sum(axis=0)
    # Each jump may count for one of ten samples.
    assert np.abs(motion.va[-1] - gained).max() < 0.2 * np.abs(motion.va[-1]).max()


@pytest.mark.slow
def test_a_push_of_a_motion_is_seen_though_results_are_wanted_at_three_times(five_bar):
    t = np.linspace(0, 1, 201)
    rest = np.zeros((201, 2))
    tau = pushed(t)[:, None] * PUSH
    push = five_bar.trajectory(t, np.tile(five_bar.home, (201, 1)), rest, rest, tau)
    motion = five_bar.simulate(push, five_bar.home, [0, 0], [0, 0.5, 1], **LOOSE)
    assert np.abs(motion.va[-1]).max() > 0.1


def _pushed_exactly(chain, start, end):
    """The end of the same motion at 0.4 s, in three parts of constant torque."""
    q, va = chain.home, [0.0, 0.0]
    for tau, part in ([0, 0], [0, start]), (9 * PUSH, [start, end]), ([0, 0], [end, 0.4]):
        motion = chain.simulate(tau, q, va, part)
        q, va = motion.q[-1], motion.va[-1]
    return q


@pytest.mark.parametrize(
    ("method", "max_step"),
    [
        ("RK45", np.inf),
        ("DOP853", None),
        pytest.param("DOP853", np.inf, marks=pytest.mark.slow),
        pytest.param("RK45", None, marks=pytest.mark.slow),
        pytest.param("Radau", None, marks=pytest.mark.slow),
    ],
)
def test_a_push_shorter_than_the_spacing_of_the_times_moves_a_robot_at_rest(
    five_bar, method, max_step
):
    """Pushes of a seventh to nine tenths of the spacing, at any time between two results."""
    five_bar.compile()
    random = np.random.default_rng(5)
    for _ in range(3):
        length, start = random.uniform(0.15, 0.9) * 0.1, random.uniform(0.1, 0.2)
        motion = five_bar.simulate(
            lambda t, q, va, a=start, b=start + length: 9 * PUSH if a < t < b else 0 * PUSH,
            five_bar.home,
            [0, 0],
            np.linspace(0, 0.4, 5),
            method=method,
            max_step=max_step,
            rtol=1e-8,
            atol=1e-8,
        )
        end = _pushed_exactly(five_bar, start, start + length)
        assert np.abs(end - five_bar.home).max() > 0.1
        # Two jumps of the torque, each within a few steps of rtol.
        assert np.abs(motion.q[-1] - end).max() < 1e-5


def test_a_push_that_is_too_short_for_any_step_is_told(five_bar):
    """One of the times, at which torques are evaluated, is the only time of the push."""
    with pytest.warns(RuntimeWarning, match=r"changes too fast at t = 0\.062"):
        five_bar.simulate(
            lambda t, q, va: (abs(t - 1 / 16) < 1e-12) * 1e9 * PUSH, five_bar.home, [0, 0], [0, 1]
        )

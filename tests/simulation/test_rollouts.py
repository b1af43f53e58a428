# SPDX-License-Identifier: BSD-2-Clause
import re

import numpy as np
import pytest

import sst_pin
from sst_pin import robots
from sst_pin.dynamics.rollout_arrays import RolloutArrays
from sst_pin.sst import paper
from tests.gallery import governor, n_four_bar
from tests.support.sampling import random_parameters, random_states


def test_a_step_is_of_fourth_order_and_example_2_comes_back_to_a_billionth(compiled_robot):
    """Halving the step divides the error by 16 (15 to 17 measured); 1000 steps bring 1e-9."""
    robot, errors = compiled_robot, []
    circle = paper.example_1(robot, np.linspace(0, paper.PERIOD, 301))
    for steps in (250, 500, 1000):
        # The torques of example 2 at the ends and in the middles of the steps.
        h = circle.t[-1] / steps
        tau = circle.torque()(h / 2 * np.arange(2 * steps + 1))
        motion = robot.rollout(tau, circle.q[0], circle.va[0], h, steps=steps)
        errors.append(np.abs(motion.q[-1] - circle.q[-1]).max())
        assert max(np.abs(robot.residual(q)).max() for q in motion.q[::50]) < 1e-13
    assert errors[0] / errors[1] == pytest.approx(16, abs=2)
    assert errors[1] / errors[2] == pytest.approx(16, abs=2)
    assert errors[2] < 1e-9


@pytest.mark.slow
def test_kernels_step_as_the_reference_path_does():
    """Odd robots, held torques, a moment, friction: off the closures by h^2 both differ by h^5."""
    rng = np.random.default_rng(0)
    parameters = random_parameters(rng)
    fast, slow = sst_pin.SST(parameters), sst_pin.SST(parameters)
    fast.compile(fast.home)
    q, va, _ = fast.joint_motion(*random_states(fast, rng, 3))
    tau, moment = rng.normal(size=(3, 5, 3)), rng.normal(size=3)
    options = {"platform_moment": moment, "sign_width": 0.5}
    a, b = (r.rollout(tau, q, va, 1e-4, **options) for r in (fast, slow))
    assert a.q.shape == (3, 6, 9)
    assert np.abs(a.q - b.q).max() < 1e-11
    assert np.abs(a.va - b.va).max() < 1e-8
    assert np.abs(a.q[:, -1] - q).max() > 1e-4  # it did move


def test_coarse_steps_leave_the_loops_closed_to_rounding():
    """One step of Newton's method would leave 1e-9; each motion takes the steps that it needs."""
    robot = sst_pin.SST()
    q, va, _ = robot.joint_motion(*random_states(robot, np.random.default_rng(3), 3))
    tau = np.zeros((8, 3))
    motion = robot.rollout(tau, q, va, 0.03)
    assert np.abs(robot.residual(motion.q)).max() < 1e-13
    for i in range(3):
        assert np.array_equal(robot.rollout(tau, q[i], va[i], 0.03).q, motion.q[i])


def test_rollouts_end_where_simulate_ends():
    """Friction smoothed alike, torques constant: an adaptive method of eighth order as referee."""
    rng = np.random.default_rng(1)
    odd = sst_pin.SST(random_parameters(rng))
    q, va, _ = odd.joint_motion(*random_states(odd, rng, 1))
    tau = rng.normal(size=3)
    t = np.linspace(0, 0.01, 3)
    wanted = odd.simulate(tau, q[0], va[0], t, sign_width=0.5)
    motion = odd.rollout(np.tile(tau, (200, 1)), q[0], va[0], 0.01 / 200, sign_width=0.5)
    # Fourth order at steps of 5e-5 s, next to tanh(rate / 0.5 rad/s).
    assert np.abs(motion.q[[0, 100, 200]] - wanted.q).max() < 1e-9


@pytest.mark.parametrize("which", ["compiled_robot", pytest.param("robot", marks=pytest.mark.slow)])
def test_leading_axes_broadcast_and_threads_change_nothing(which, request):
    """Torques for each start, starts for each torque; 70 samples fill two blocks and a bit."""
    robot, rng = request.getfixturevalue(which), np.random.default_rng(2)
    q, va, _ = robot.joint_motion(*random_states(robot, rng, 70))
    tau = rng.normal(size=(2, 1, 5, 3))
    motion = robot.rollout(tau, q, va, 1e-4)
    assert motion.q.shape == (2, 70, 6, 9)
    assert motion.va.shape == (2, 70, 6, 3)
    shared = robot.rollout(tau, q, va, 1e-4, threads=3)
    assert all(np.array_equal(a, b) for a, b in zip(motion, shared, strict=True))
    alone = robot.rollout(tau[1, 0], q[69], va[69], 1e-4)
    assert np.array_equal(alone.q, motion.q[1, 69])
    there = robot.rollout(tau[0, 0], q[0], va[0], 1e-4)
    back = robot.rollout(tau[0, 0, ::-1], there.q[-1], there.va[-1], -1e-4)
    assert np.abs(back.q[-1] - q[0]).max() < 1e-12  # fourth order there and back


@pytest.mark.parametrize("fast", [True, False])
def test_motions_that_stop_are_named_or_end_in_nan(fast):
    """Before a singularity of the mechanism, from a bad start: no number in silence."""
    row = n_four_bar(1)
    if fast:
        row.compile()
    q, va = np.tile(row.home, (3, 1)), np.zeros((3, 1))
    q[:], va[1] = q + 0.1 * np.array([1, -1, 1]), -8.0  # this one falls flat
    tau = np.zeros((60, 1))
    with pytest.raises(sst_pin.SimulationError, match=r"1 of 3 samples \(index 1\)") as caught:
        row.rollout(tau, q, va, 5e-3)
    assert 0 < caught.value.time < 0.3
    motion = row.rollout(tau, q, va, 5e-3, on_error="nan")
    stopped = np.isnan(motion.q).any(axis=-1)
    first = int(stopped[1].argmax())
    assert caught.value.time == pytest.approx(first * 5e-3)
    assert stopped[1, first:].all()
    assert not stopped[[0, 2]].any()
    distance = row.condition_number(motion.q[1, :first])
    assert distance[-1] > 3 * distance[0]
    robot = sst_pin.SST()
    if fast:
        robot.compile(robot.home)
    q, tau = np.tile(robot.home, (3, 1)), np.zeros((2, 3))
    q[2, 4] += 1e-3
    with pytest.raises(sst_pin.ClosureError, match=r"index 2"):
        robot.rollout(tau, q, np.zeros(3), 1e-3)
    with pytest.raises(sst_pin.InputError, match="tau: entry"):
        robot.rollout(tau * np.nan, robot.home, np.zeros(3), 1e-3)


@pytest.mark.slow
def test_a_rollout_goes_through_dead_points_as_simulate_does():
    """Torques at the ends and middles of the steps, in the user's coordinates: fourth order."""
    four_bar = robots.four_bar()
    by = four_bar.joint_names[-1]  # the rocker, which turns round at the dead points of the crank
    chain = sst_pin.ClosedChain(four_bar.model, four_bar.closures, [by], coordinates=[by])
    start, seconds, errors = four_bar.joint_rates(four_bar.home, [9.0])[-1:], 0.8, []
    chain.compile()
    t = np.linspace(0, seconds, 201)
    wanted = chain.simulate(lambda t, q, va: [0.02 * np.sin(9 * t)], chain.home, start, t)
    dead = chain.condition_number(wanted.q) > 20
    assert np.count_nonzero(np.diff(dead)) >= 4  # it comes to some dead points and leaves them
    for steps in (200, 400):
        tau = 0.02 * np.sin(9 * seconds / steps / 2 * np.arange(2 * steps + 1))[:, None]
        motion = chain.rollout(tau, chain.home, start, seconds / steps, steps=steps)
        assert np.abs(chain.residual(motion.q)).max() < 1e-12
        errors.append(np.abs(motion.q[:: steps // 200] - wanted.q).max())
        assert np.abs(motion.va[:: steps // 200] - wanted.va).max() < 100 * errors[-1]
    assert errors[1] < 1e-4
    assert errors[0] / errors[1] > 10  # 16, apart from where the coordinates change


@pytest.mark.parametrize(
    ("nonsmooth", "fast"),
    [
        (False, False),
        (True, False),
        pytest.param(False, True, marks=pytest.mark.slow),
        pytest.param(True, True, marks=pytest.mark.slow),
    ],
)
def test_a_rollout_starts_from_rest_where_its_coordinates_are_dependent(nonsmooth, fast):
    """At a dead point of the rocker; the same motion in the coordinate of the crank is referee."""
    by_crank = robots.four_bar()
    dead_point = by_crank.assemble({"crank": -np.pi / 2})  # the coupler is folded over the crank
    assert abs(by_crank.joint_rates(dead_point, [1.0])[-1]) < 1e-12
    by_rocker = by_crank.with_coordinates([by_crank.joint_names[-1]])
    if fast:
        by_rocker.compile()
    tau = np.full((100, 1), 0.2)
    wanted = by_crank.rollout(tau, dead_point, [0.0], 1e-3, nonsmooth=nonsmooth)
    motion = by_rocker.rollout(tau, dead_point, [0.0], 1e-3, nonsmooth=nonsmooth)
    assert np.abs(wanted.q[-1] - dead_point).max() > 0.1
    # Steps of the same length in two coordinates: of fourth order, or of first order.
    assert np.abs(motion.q - wanted.q).max() < (1e-2 if nonsmooth else 1e-9)
    with pytest.raises(sst_pin.SSTError, match="do not determine the rates"):
        by_rocker.rollout(tau, dead_point, [0.1], 1e-3, nonsmooth=nonsmooth)


@pytest.mark.parametrize("fast", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_motion_that_diverges_within_a_step_ends_with_a_reason(fast):
    """Steps a hundred times too long for a stiff governor: numbers overflow between two steps."""
    chain = governor()
    if fast:
        chain.compile()
    tau, va = np.ones((20, 4)), np.ones(4)
    with pytest.raises(sst_pin.SimulationError, match="not finite; a shorter step") as caught:
        chain.rollout(tau, chain.home, va, 0.05)
    q = chain.rollout(tau, chain.home, va, 0.05, on_error="nan").q
    valid = np.isfinite(q).all(axis=1)
    assert valid.sum() == round(caught.value.time / 0.05)
    assert np.isnan(q[~valid]).all()


def test_a_first_step_whose_length_overflows_ends_with_a_reason():
    """The start is finite, but va times dt is not."""
    chain = robots.five_bar()
    tau, va = np.zeros((2, 2)), [1e307, 0.0]
    with pytest.raises(sst_pin.SimulationError, match="not finite; a shorter step"):
        chain.rollout(tau, chain.home, va, 1e3)
    q = chain.rollout(tau, chain.home, va, 1e3, on_error="nan").q
    assert np.array_equal(q[0], chain.home)
    assert np.isnan(q[1:]).all()


def test_asking_why_a_rollout_ended_changes_no_states():
    """The states behind the start count as not valid; a new try computes them, for itself."""
    chain = robots.five_bar()
    start = chain.home[None]
    rates = np.zeros((1, 2))
    q, va = chain.rollout(np.zeros((3, 2)), start, rates, 1e-3)
    arrays = RolloutArrays(1e-3, start, rates, np.zeros((1, 3, 2)), None, q.copy(), va.copy())
    arrays.q[:, 1:] = np.nan
    arrays.va[:, 1:] = np.nan
    before = arrays.q.copy(), arrays.va.copy()
    chain.engine.state_space(1e-3).why_ended(arrays, 0, 1, None)
    assert np.array_equal(arrays.q, before[0], equal_nan=True)
    assert np.array_equal(arrays.va, before[1], equal_nan=True)


@pytest.mark.parametrize("fast", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_wrenches_at_frames_turn_their_arms_in_rollouts_as_in_simulate(fast):
    """A batch of two wrenches; an adaptive method of eighth order is the referee."""
    chain = robots.four_bar()
    if fast:
        chain.compile()
    frame, steps, dt = "platform", 25, 4e-3
    wrench = np.array([[0.0, 2.0, 0.0, 0.0, 0.0, 0.1], [1.0, -1.0, 0.0, 0.0, 0.0, 0.0]])
    tau = np.full((steps, 1), 0.05)
    motions = chain.rollout(tau, chain.home, [1.0], dt, external_wrenches={frame: wrench})
    assert motions.q.shape == (2, steps + 1, 3)
    for i in range(2):
        wanted = chain.simulate(
            tau[0],
            chain.home,
            [1.0],
            [0, steps * dt],
            external_wrenches={frame: wrench[i]},
            rtol=1e-9,
            atol=1e-9,
        )
        assert np.abs(motions.q[i, -1] - wanted.q[-1]).max() < 1e-7
    assert np.abs(motions.q[0, -1] - motions.q[1, -1]).max() > 1e-2


@pytest.mark.parametrize("nonsmooth", [False, True])
@pytest.mark.parametrize("which", ["robot", pytest.param("compiled_robot", marks=pytest.mark.slow)])
def test_a_wrench_at_a_frame_adds_to_a_moment_and_is_held(which, nonsmooth, request):
    """Torques of statics hold the robot, to the rounding of 20 steps."""
    robot = request.getfixturevalue(which)
    loads = {
        "platform_moment": [0.3, -0.2, 0.1],
        "external_wrenches": {"star_1": [5.0, -3.0, 2.0, 0.1, 0.2, -0.3]},
    }
    zero = np.zeros(3)
    hold = robot.compute_torques(robot.home, zero, zero, **loads)
    motion = robot.rollout(
        np.tile(hold, (20, 1)), robot.home, zero, 1e-3, nonsmooth=nonsmooth, **loads
    )
    assert np.abs(motion.q[-1] - robot.home).max() < 1e-10
    without = robot.compute_torques(robot.home, zero, zero)
    assert np.abs(hold - without).max() > 0.1
    with pytest.raises(sst_pin.UnknownNameError):
        robot.rollout([hold], robot.home, zero, 1e-3, external_wrenches={"nothing": np.zeros(6)})


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_steps_that_are_too_long_are_named_with_their_length_and_shorter_ones_pass(compiled):
    """A crank at 900 rad/s: 0.9 rad in a step of 1 ms. The shorter rollout agrees with simulate."""
    chain = robots.four_bar()
    if compiled:
        chain.compile()
    with pytest.raises(sst_pin.SimulationError, match="too long for the curvature") as caught:
        chain.rollout(np.zeros((20, 1)), chain.home, [900.0], dt=1e-3)
    assert "use simulate, which adapts its steps" in str(caught.value)
    moved = float(re.search(r"moves by (\S+) rad", str(caught.value)).group(1))
    assert 0.5 < moved < 2
    short = chain.rollout(np.zeros((100, 1)), chain.home, [900.0], dt=4e-5)
    t = np.array([0.0, 4e-3])
    motion = chain.simulate([0.0], chain.home, [900.0], t, rtol=1e-10, atol=1e-12)
    assert short.q[-1] == pytest.approx(motion.q[-1], abs=1e-4)

# SPDX-License-Identifier: BSD-2-Clause
"""Controllers: the errors that their models promise, limits, a machine, a loop at 1 kHz."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import solve_discrete_are

import sst_pin
from sst_pin.errors import ActuationError, InputError
from tests.support.files import ROOT, load
from tests.support.link_tables import ROBOTS

adaptive = load("examples/adaptive.py")
control_bench = load("examples/control_bench.py")
control_loop = load("examples/control_loop.py")
read_table = load("scripts/pages/markdown_tables.py").read_table

T = np.linspace(0, 0.3, 61)


@pytest.fixture(scope="module")
def five_bar():
    return sst_pin.robots.five_bar()


@pytest.fixture(scope="module")
def sway(five_bar):
    """A smooth motion of a five-bar."""
    x = five_bar.home[[0, 2]] + 0.2 * np.stack([np.sin(5 * T), np.cos(4 * T) - 1], axis=-1)
    return sst_pin.coordinate_motion(five_bar, T, x)


def held(chain, q, steps=9):
    """A motion that stays, a hundred samples a second."""
    rest = np.zeros((steps, chain.degrees_of_freedom))
    return chain.trajectory(np.arange(steps) / 100, np.tile(q, (steps, 1)), rest, rest)


@pytest.mark.slow
def test_errors_of_computed_torque_obey_their_linear_equation(five_bar, sway):
    """e'' + kd e' + kp e = 0, critically damped: e = (1 + 20 t) exp(-20 t) e0, for each motor."""
    control = sst_pin.ComputedTorque(five_bar, sway, kp=400, kd=40)
    off = np.array([0.05, -0.03])
    start = dict(zip(five_bar.coordinates, sway.q[0, [0, 2]] - off, strict=True))
    result = five_bar.simulate(control.torque, five_bar.assemble(start), sway.va[0], T, rtol=1e-10)
    error = sway.q[:, [0, 2]] - result.q[:, [0, 2]]
    expected = ((1 + 20 * T) * np.exp(-20 * T))[:, None] * off
    assert_allclose(error, expected, rtol=0, atol=1e-7)  # what the spline errs by


def test_gravity_pd_is_a_spring_at_the_motors(five_bar):
    """At rest it gives the weight and kp times the error; by the power of a small motion."""
    up = sst_pin.robots.knee()
    control = sst_pin.GravityPD(up, held(up, up.home), kp=30, kd=3)
    q = up.assemble({"motor_knee": up.home[0] - 0.1})
    weight = up.compute_torques(q, [0], [0])
    assert_allclose(control.torque(0.0, q, np.zeros(1)), weight + 30 * 0.1, rtol=1e-12)
    assert_allclose(control.torque(0.0, q, np.ones(1)), weight + 30 * 0.1 - 3, rtol=1e-12)
    many = sst_pin.robots.planar_4rrr()  # four motors share three forces
    control = sst_pin.GravityPD(many, held(many, many.home), kp=30, kd=3)
    moved = many.assemble(many.home + 0.01)
    tau = control.torque(0.0, moved, np.zeros(3))
    rest = many.compute_torques(moved, np.zeros(3), np.zeros(3))
    x = [many.position_names.index(name) for name in many.coordinates]
    forces = many.actuator_jacobian(moved).T @ (tau - rest)
    assert_allclose(forces, 30 * (many.home - moved)[x], atol=1e-12)


def test_the_regulator_of_a_held_pose_is_the_stationary_one(robot):
    """Riccati's equation backward from its solution stays: SciPy's gain at every sample."""
    motion = held(robot, robot.home)
    control = sst_pin.TrackingLQR(robot, motion, Q=[100] * 3 + [1] * 3, R=[0.1] * 3)
    A, B = robot.linearize(robot.home, np.zeros(3), motion.tau[0], dt=0.01)
    R = 0.1 * np.eye(3)
    P = solve_discrete_are(A, B, np.diag([100.0] * 3 + [1.0] * 3), R)
    expected = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    assert_allclose(control.gains, np.broadcast_to(expected, (9, 3, 6)), rtol=1e-7)


@pytest.mark.slow
def test_the_regulator_brings_the_robot_back_to_its_motion():
    """By kernels, as in a loop at 1 kHz; a four-bar whose coupler is aligned and pinned."""
    table = ROBOTS["four-bar, coupler aligned and pinned"]
    robot, q = table.chain(), table.joints(table.x).real
    robot.compile(q)
    motion = sst_pin.coordinate_motion(robot, T, table.x + 0.2 * np.sin(5 * T)[:, None], start=q)
    control = sst_pin.TrackingLQR(robot, motion, Q=[1000, 0.1], R=[1e-3])
    state = robot.assemble(motion.q[0] + 0.03), motion.va[0]
    result = robot.simulate(control.torque, *state, T, rtol=1e-7, atol=1e-9)
    error = np.abs(result.q - motion.q)[:, robot.motor_indices].max(axis=1)
    assert error[0] == pytest.approx(0.03)
    assert error[-1] < 1e-5


def test_the_coriolis_matrix_of_the_adaptive_controller_is_skew_with_the_inertia(five_bar, sway):
    """s (M_dot - 2 C) s = 0 for every s, M_dot by differences; and C va is the robot's own."""
    control = adaptive.Adaptive(five_bar, sway, stiffness=20, damping=1, learning=1)
    random, none = np.random.default_rng(0), np.zeros(2)
    for k in (3, 20, 40):
        q, va, aa = sway.q[k], random.standard_normal(2), random.standard_normal(2)
        forces = five_bar.generalized_forces(q, va, aa)
        assert_allclose(control._regressor(q, va, va, aa) @ control.theta, forces, atol=1e-12)
        s, step = random.standard_normal(2), 1e-5
        moved = [q + sign * step * five_bar.joint_rates(q, va) for sign in (1, -1)]
        ahead, behind = (five_bar.reduced_terms(five_bar.assemble(x), none).inertia for x in moved)
        rest, of_s = (control._regressor(q, va, x, none) @ control.theta for x in (none, s))
        power = s @ ((ahead - behind) / (2 * step) @ s - 2 * (of_s - rest))
        assert abs(power) < 1e-8 * np.abs(ahead).max() / step**0.5


def test_simulate_takes_a_controller_and_refuses_one_that_depends_on_its_calls(five_bar, sway):
    """An adaptive controller learns from call to call; as sampled torques it is simulated."""
    gains = {"kp": 400, "kd": 40}
    control = sst_pin.ComputedTorque(five_bar, sway, **gains)
    start = sway.q[0], sway.va[0], sway.t[:3]
    by_object, by_method = (five_bar.simulate(x, *start) for x in (control, control.torque))
    assert by_object == by_method

    def learner():
        return adaptive.Adaptive(five_bar, sway, stiffness=20, damping=1, learning=1)

    for torque in (learner(), learner().torque):
        with pytest.raises(InputError, match=r"Adaptive depends on the calls.*SampledTorque"):
            five_bar.simulate(torque, *start)
    sampled = [sst_pin.SampledTorque(x, 0.01) for x in (learner(), learner().torque)]
    assert five_bar.simulate(sampled[0], *start) == five_bar.simulate(sampled[1], *start)


def test_a_motor_without_ends_has_no_error_of_full_turns():
    """A crank that turns for ever is taken at the nearest turn."""
    bar = sst_pin.robots.four_bar()
    control = sst_pin.ComputedTorque(bar, held(bar, bar.home), kp=100, kd=20)
    turned = bar.home + np.array([2 * np.pi, 0, 0])
    expected = control.torque(0.0, bar.home, np.zeros(1))
    assert_allclose(control.torque(0.0, turned, np.zeros(1)), expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["ComputedTorque", "GravityPD", "TrackingLQR"])
def test_torques_stay_within_limits_and_ends_are_held(kind, five_bar, sway):
    gains = {"Q": [1e4] * 4, "R": [1e-4] * 2} if kind == "TrackingLQR" else {"kp": 900, "kd": 60}
    control = getattr(sst_pin, kind)(five_bar, sway, limits=[0.05, 0.02], **gains)
    far = five_bar.assemble(sway.q[0] + 0.3)
    for va in (np.zeros(2), np.array([5.0, -5.0])):
        tau = control.torque(0.1, far, va)
        assert (np.abs(tau) <= [0.05, 0.02]).all()
        assert (np.abs(tau) == [0.05, 0.02]).any()
    rest = np.zeros(2)
    for t, q in ((9.0, sway.q[-1]), (-1.0, sway.q[0])):
        holding = five_bar.compute_torques(q, rest, rest)
        assert_allclose(control.torque(t, q, rest), holding, atol=1e-12)


def test_motions_that_cannot_be_followed_are_refused(robot, five_bar, sway):
    def follow(chain, motion):
        return sst_pin.ComputedTorque(chain, motion, kp=1, kd=1)

    with pytest.raises(InputError, match="motion"):
        follow(robot, sway)
    with pytest.raises(InputError, match="equal steps"):
        sst_pin.TrackingLQR(five_bar, sway[[0, 1, 2, 3, 4, 6, 9]], Q=[1] * 4, R=[1] * 2)
    parts, x = (five_bar.model, five_bar.closures), five_bar.coordinates
    idle = sst_pin.ClosedChain(*parts, ["shoulder_1"], coordinates=x)
    with pytest.raises(ActuationError, match="hold"):
        follow(idle, held(idle, idle.home))
    free = sst_pin.robots.stewart().with_coordinates(["platform"])
    with pytest.raises(InputError, match="platform: this joint neither turns about one axis nor"):
        follow(free, held(free, free.home))


@pytest.mark.tools
@pytest.mark.slow
@pytest.mark.parametrize("name", ["SST", "delta"])
def test_the_table_of_the_bench_is_current(name):
    """On a machine with friction and other masses the model's torques are worth their trouble."""
    page = (ROOT / "docs" / "control.md").read_text(encoding="utf-8")
    rows = {called: cells for called, *cells in read_table(page, f"bench_{name}")[1:]}
    only = () if name == "SST" else ("PD + gravity", "computed torque")
    result = control_bench.table(name, only)
    assert list(result) == [called for called in rows if not only or called in only]
    for called, values in result.items():
        printed = [float(cell.split()[0]) for cell in rows[called]]
        assert_allclose(printed, values, rtol=0.1, atol=0.5)  # engines of other versions
    of_pd = result["PD + gravity"][0]
    assert result["computed torque"][0] < of_pd / 4
    assert float(rows["adaptive"][0].split()[0]) < of_pd / 10


def test_the_loop_computes_the_torques_of_the_motion():
    robot = sst_pin.robots.five_bar()
    motion = control_loop.swing(robot, 0.1)
    step, count = control_loop.steps(robot, 0.1)
    torques = np.array([step(k) for k in range(count)])
    # Rates are differences of encoders over a period, half a period late.
    wanted = np.array([np.interp(1e-3 * np.arange(count), motion.t, tau) for tau in motion.tau.T]).T
    assert np.abs(torques - wanted)[10:].max() < 0.05 * np.abs(motion.tau).max()


def test_every_period_is_run_once():
    done = []
    began, took = control_loop.run(done.append, 20)
    assert done == list(range(20))
    assert (began >= np.arange(20) * 1e-3 - 1e-9).all()
    assert (took >= 0).all()
    assert began[0] == pytest.approx(0, abs=0.1)

# SPDX-License-Identifier: BSD-2-Clause
"""Time-optimal motions: known solutions of one body, laws of any chain, limits everywhere."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

import sst_pin
from sst_pin.simulation.coordinate_motions import coordinate_positions

pytest.importorskip("toppra", reason="toppra is not installed (extra 'timing')")

#: The margin of the limits, 1e-4, and the grid cost less of the duration.
CLOSE = 1e-3
WAY = np.linspace(0, 1, 41)[:, None]


def one_body(joint, center=(0, 0, 0), mass=1.0, gravity=9.81):
    """A joint and its body, of 1 kg m^2 about each axis."""
    model = pin.Model()
    model.gravity.linear = np.array([0, 0, -gravity])
    model.addJoint(0, joint, pin.SE3.Identity(), "joint")
    body = pin.Inertia(mass, np.array(center, float), np.eye(3))
    model.appendBodyToJoint(1, body, pin.SE3.Identity())
    return model


def cart(mass=2.0, gravity=0.0, viscous=0.0, coulomb=0.0, rubbing=0.0):
    """One body that slides along z; a cylinder along z may rub too."""
    model = one_body(pin.JointModelPZ(), mass=mass, gravity=gravity)
    for name, joint, z in (("foot", 0, -1.0), ("eye", 1, 0.0)):
        place = pin.SE3(np.eye(3), np.array([0, 0, z]))
        model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    cylinder = sst_pin.LineForce("foot", "eye", coulomb_friction=rubbing)
    friction = {"viscous_friction": [viscous], "coulomb_friction": [coulomb]}
    return sst_pin.ClosedChain(model, [], ["joint"], lines=[cylinder], **friction)


@pytest.fixture(scope="module")
def circle(robot):
    """Configurations along the circle of the paper's example 1."""
    return robot.inverse_kinematics(sst_pin.paper_circle(np.linspace(0, np.pi / 6, 201)).R)


@pytest.mark.parametrize(
    ("gravity", "coulomb", "rubbing", "limits"),
    [(9.81, 3.0, 0, 40.0), (9.81, 0, 3.0, 40.0), (0, 0, 0, [[-10.0, 40.0]])],
)
def test_a_cart_speeds_up_and_brakes_at_its_limit(gravity, coulomb, rubbing, limits):
    """m a = F - m g - F_c, then m b = F' + m g + F_c: T^2 = 2 L (1 / a + 1 / b)."""
    m, F, L = 2.0, 40.0, 1.5
    motion = sst_pin.time_optimal(cart(m, gravity, 0, coulomb, rubbing), L * WAY, torques=limits)
    brake = F if np.ndim(limits) == 0 else -limits[0][0]
    dry = coulomb + rubbing
    a, b = (F - m * gravity - dry) / m, (brake + m * gravity + dry) / m
    assert motion.t[-1] == pytest.approx(np.sqrt(2 * L * (1 / a + 1 / b)), rel=CLOSE)
    assert motion.q[-1, 0] == pytest.approx(L, rel=1e-9)
    assert np.abs(motion.va[[0, -1]]).max() < 1e-6


def test_viscous_friction_slows_a_cart_as_its_equation_says():
    """m v' = F - D v, then m v' = -F - D v: the way to a rate, and from it to rest."""
    m, F, D, L = 2.0, 40.0, 10.0, 1.5
    chain = cart(m, viscous=D)
    motion = sst_pin.time_optimal(chain, L * WAY, torques=F)

    def way(v):
        return -m * F / D**2 * (np.log(1 - D * v / F) + np.log(1 + D * v / F))

    peak = brentq(lambda v: way(v) - L, 0, F / D * (1 - 1e-9))
    duration = -m / D * np.log(1 - D * peak / F) + m / D * np.log(1 + D * peak / F)
    assert motion.t[-1] == pytest.approx(duration, rel=CLOSE)


def test_a_taut_cable_with_a_damper_counts_as_a_line_that_may_push():
    times = []
    for pulls_only in (True, False):
        plain = cart()
        cable = sst_pin.LineForce("foot", "eye", preload=2.0, damping=1.5, pulls_only=pulls_only)
        chain = sst_pin.ClosedChain(plain.model, [], ["joint"], lines=[cable])
        times.append(sst_pin.time_optimal(chain, WAY, torques=10.0).t[-1])
    assert times[0] == pytest.approx(times[1], rel=1e-4)


def test_rates_and_accelerations_make_a_trapezoid():
    """T = L / v + v / a."""
    L, v, a = 1.5, 0.5, 2.0
    motion = sst_pin.time_optimal(cart(), L * WAY, rates=v, accelerations=a)
    assert motion.t[-1] == pytest.approx(L / v + v / a, rel=CLOSE)
    assert np.abs(motion.va).max() <= v
    assert np.abs(motion.aa).max() <= a


@pytest.mark.slow
def test_the_circle_of_example_1_with_30_N_m(robot, circle):
    """A motor at its limit 95 % of the time, in half a second; none beyond it.

    Not between coarse samples either: path accelerations are constant from sample to sample.
    """
    motion = sst_pin.time_optimal(robot, circle, torques=30.0)
    peaks = np.abs(robot.compute_torques(motion.q, motion.va, motion.aa)).max(axis=1)
    assert max(peaks.max(), np.abs(motion.tau).max()) <= 30.0
    assert (peaks > 0.999 * 30).mean() > 0.95
    assert motion.t[-1] == pytest.approx(0.4994, abs=2e-4)
    assert np.diff(motion.t).max() <= 1e-3
    assert sst_pin.time_optimal(robot, circle, torques=30.0, dt=0.01).t[-1] == motion.t[-1]


@pytest.mark.slow
def test_friction_of_all_kinds_counts(circle):
    """That of mu_1 counts too, which this circle leaves at rest: it may act either way."""
    slow = sst_pin.SST(sst_pin.Parameters(viscous_friction=0.3, coulomb_friction=0.4))
    motion = sst_pin.time_optimal(slow, circle[::4], torques=30.0)
    assert np.abs(motion.tau).max() <= 30.0
    assert np.abs(motion.tau).max() > 0.99 * 30
    assert motion.t[-1] > 0.502


def wave(chain, size=0.15):
    """Configurations along a curved path of the coordinates that does not turn back."""
    first = coordinate_positions(chain.mechanism, chain.home[None])[0]
    k = np.arange(len(first))
    x = first + size * (np.sin((k + 1) * WAY + k) - np.sin(k))
    return sst_pin.coordinate_motion(chain, WAY[:, 0], x, chain.home).q


@pytest.mark.slow
def test_a_path_takes_as_long_backwards():
    """Without friction a film of the motion, shown backwards, needs the same torques.

    With more motors than freedoms, of any chain.
    """
    chain = sst_pin.robots.planar_4rrr()
    path = wave(chain)
    rest = np.zeros(chain.degrees_of_freedom)
    limit = 2 * np.abs(chain.compute_torques(path[0], rest, rest)).max() + 5
    there, back = (sst_pin.time_optimal(chain, q, torques=limit) for q in (path, path[::-1]))
    assert there.t[-1] == pytest.approx(back.t[-1], rel=1e-4)
    assert 0.995 * limit < np.abs(there.tau).max() <= limit


@pytest.mark.slow
def test_steps_of_more_than_half_a_turn_are_refused():
    """They look like shorter ones the other way."""
    step = 5.9
    wheel = sst_pin.ClosedChain(one_body(pin.JointModelRZ()), [], ["joint"])
    with pytest.raises(sst_pin.InputError, match="half a turn between samples"):
        sst_pin.time_optimal(wheel, step * np.arange(11)[:, None], torques=5.0)
    dense = sst_pin.time_optimal(wheel, np.linspace(0, 10 * step, 60)[:, None], torques=5.0)
    assert dense.t[-1] == pytest.approx(2 * np.sqrt(10 * step / 5), rel=1e-3)


def test_a_limit_that_the_path_passes_halfway_says_where():
    """A pendulum that must stand still level with its axis."""
    arm = sst_pin.ClosedChain(one_body(pin.JointModelRY(), (0, 0, -1)), [], ["joint"])
    with pytest.raises(sst_pin.ActuationError, match="no motion from rest to rest along"):
        sst_pin.time_optimal(arm, np.pi * WAY, torques=5.0)
    assert sst_pin.time_optimal(arm, np.pi * WAY, torques=10.0).t[-1] > 0


def test_too_few_motors_are_refused_by_name():
    lift = sst_pin.robots.five_bar()
    poor = sst_pin.ClosedChain(lift.model, lift.closures, lift.motor_names[:1])
    with pytest.raises(sst_pin.ActuationError, match="cannot produce"):
        sst_pin.time_optimal(poor, wave(lift), torques=5.0)


@pytest.mark.parametrize("torques", [None, 1e6])
def test_a_limit_of_accelerations_that_is_almost_zero_is_refused_by_name(torques):
    limits = [[-1e-5, 1.0]]
    with pytest.raises(sst_pin.InputError, match="joint: one limit is less"):
        sst_pin.time_optimal(cart(), WAY, torques=torques, accelerations=limits)


@pytest.mark.slow
def test_accelerations_of_motors_on_lines_are_refused_by_name():
    model = one_body(pin.JointModelRY(), (1, 0, 0))
    for name, joint, at in (("base", 0, (0, 0, -1)), ("tip", 1, (1, 0, 1))):
        place = pin.SE3(np.eye(3), np.array(at, float))
        model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    ram = sst_pin.LineForce("base", "tip", name="ram")
    arm = sst_pin.ClosedChain(model, [], ["ram"], lines=[ram])
    motion = sst_pin.time_optimal(arm, 0.3 * WAY, torques=60.0, rates=0.3)
    assert np.abs(arm.motor_rates(motion.q, motion.va)).max() <= 0.3
    with pytest.raises(sst_pin.InputError, match="not for motors on lines"):
        sst_pin.time_optimal(arm, 0.3 * WAY, accelerations=1.0)

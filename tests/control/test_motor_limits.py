# SPDX-License-Identifier: BSD-2-Clause
"""One rule for surplus motors and limits everywhere, judged by linear programmes."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog

import sst_pin
from sst_pin import robots
from sst_pin.control.path_limits import MotorLimits
from tests.control.test_timing import wave
from tests.support import any_chain
from tests.support.files import load
from tests.support.motor_cases import motors_everywhere

cables = load("examples/cable_robot.py")


def two_on_one(mass=2.0):
    """A cart without weight that two motors push, the second through a gear of 2."""
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "cart")
    model.appendBodyToJoint(1, pin.Inertia(mass, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    return sst_pin.ClosedChain(model, [], ["cart", {"cart": 2.0}])


CHAINS = {
    "four legs": robots.planar_4rrr,
    "six motors": motors_everywhere,
    "cables": cables.cable_robot,
}
LIMITS = {
    "four legs": [[-1.0, 2.0], [-2.0, 2.0], [-3.0, 1.0], [-2.0, 2.5]],
    "six motors": [[-1.0, 2.0], [-3.0, 4.0]] * 3,
    "cables": cables.TENSIONS,
}


def least_of_largest(A, f, limits):
    """The least largest part of a limit with A tau = f: a linear programme in tau and the part."""
    low, high = np.transpose(limits)
    motors, middle, half = len(low), (high + low) / 2, (high - low) / 2
    above = np.block([[np.eye(motors), -half[:, None]], [-np.eye(motors), -half[:, None]]])
    result = linprog(
        np.eye(motors + 1)[-1],
        A_ub=above,
        b_ub=np.concatenate([middle, -middle]),
        A_eq=np.hstack([A, np.zeros((len(A), 1))]),
        b_eq=f,
        bounds=[(None, None)] * motors + [(0, None)],
    )
    return result.x[-1]


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_limits_that_do_not_bind_leave_the_parts_of_other_limits_as_they_are(unit):
    """Three of six motors are surplus: the factors of torques vary as 1 / unit^3."""
    chain = motors_everywhere()
    q = chain.generic_configuration()[None]
    rest = np.zeros((1, chain.degrees_of_freedom))
    aa = unit * np.ones_like(rest)
    torques, accelerations = 10 * unit, 10 * unit
    by_torques = MotorLimits(chain, torques, None, None).used(q, rest, aa)
    by_accelerations = MotorLimits(chain, None, None, accelerations).used(q, rest, aa)
    of_both = MotorLimits(chain, torques, None, 1e4 * unit).used(q, rest, aa)
    assert of_both == pytest.approx(by_torques, rel=1e-9)
    of_both = MotorLimits(chain, 1e4 * unit, None, accelerations).used(q, rest, aa)
    assert of_both == pytest.approx(by_accelerations, rel=1e-9)


@pytest.mark.parametrize("name", CHAINS)
def test_torques_exist_within_limits_where_a_linear_programme_finds_some(name):
    """Motions of growing size, some beyond the limits."""
    chain, limits, verdicts = CHAINS[name](), LIMITS[name], []
    for size in (1.0, 10.0, 100.0):
        for q, va, aa in zip(*any_chain.states(chain, 5, 0), strict=True):
            A, f = chain.actuator_jacobian(q).T, chain.generalized_forces(q, va, size * aa)
            part = least_of_largest(A, f, limits)
            verdicts.append(part <= 1)
            if part <= 1:
                tau = chain.compute_torques(q, va, size * aa, limits=limits)
                assert A @ tau == pytest.approx(f, abs=1e-9 * np.abs(limits).max())
            else:
                with pytest.raises(sst_pin.ActuationError, match="exceed the limits"):
                    chain.compute_torques(q, va, size * aa, limits=limits)
    assert 0 < sum(verdicts) < len(verdicts)


def test_cables_hold_a_platform_where_a_linear_programme_finds_tensions():
    """With a weight and a moment on it; in the middle of the posts, not at their feet."""
    robot, load = cables.cable_robot(), np.array([0, 0, -5.0, 0, 0.5, 0])
    x, z = np.linspace(-0.8, 0.8, 5), np.linspace(-0.5, 0.6, 5)
    result = sst_pin.reach_map(robot, "platform", cables.TENSIONS, x=x, z=z, pitch=0.0, wrench=load)
    assert result.reached.all()
    rest = np.zeros(robot.degrees_of_freedom)
    for place in np.ndindex(result.why.shape):
        q = result.q[place]
        f = robot.generalized_forces(q, rest, rest) - load @ robot.frame_jacobian(q, "platform")
        wanted = least_of_largest(robot.actuator_jacobian(q).T, f, cables.TENSIONS)
        assert result.used[place] == pytest.approx(wanted, abs=1e-9)
    holds = result.used <= 1
    assert 0 < holds.sum() < holds.size
    low, high = np.transpose(cables.TENSIONS)
    within = (low <= result.torque) & (result.torque <= high)
    assert np.array_equal(within.all(axis=-1), holds)


def test_surplus_motors_speed_a_cart_up_with_all_they_have():
    """10 N and twice 20 N on 2 kg: T^2 = 4 L m / F; the least torques would end at 10 + 40 N."""
    pytest.importorskip("toppra", reason="toppra is not installed (extra 'timing')")
    L, limits, path = 1.5, [10.0, 5.0], np.linspace(0, 1, 41)[:, None]
    motion = sst_pin.time_optimal(two_on_one(), L * path, torques=limits)
    assert motion.t[-1] == pytest.approx(np.sqrt(4 * L * 2.0 / (10 + 2 * 5)), rel=1e-3)
    assert (np.abs(motion.tau) <= limits).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["four legs", "cables"])
def test_the_fastest_motion_takes_a_linear_programme_to_its_limit(name):
    """At each sample the least largest part is at most 1, and 1 nearly all of the time."""
    pytest.importorskip("toppra", reason="toppra is not installed (extra 'timing')")
    chain, limits = CHAINS[name](), LIMITS[name]
    motion = sst_pin.time_optimal(chain, wave(chain), torques=limits)
    parts = [
        least_of_largest(chain.actuator_jacobian(q).T, chain.generalized_forces(q, va, aa), limits)
        for q, va, aa in zip(motion.q[::7], motion.va[::7], motion.aa[::7], strict=True)
    ]
    low, high = np.transpose(limits)
    assert ((low - 1e-9 <= motion.tau) & (motion.tau <= high + 1e-9)).all()
    assert max(parts) <= 1
    assert np.mean(np.array(parts) > 0.99) > 0.9


@pytest.mark.parametrize(
    ("wanted", "tau"),
    [(10.0, [2.0, 4.0]), (25.0, [5.0, 10.0]), (29.0, [9.0, 10.0]), (40.0, [12.0, 10.0])],
)
def test_a_controller_takes_from_one_motor_what_the_other_cannot_give(wanted, tau):
    """Force = tau_1 + 2 tau_2 with the least squares within 12 N and 10 N; beyond, all there is."""
    chain = two_on_one()
    rest = np.zeros((3, 1))
    motion = chain.trajectory([0, 0.5, 1], rest, rest, rest)
    for make, gain in ((sst_pin.ComputedTorque, wanted / 2), (sst_pin.GravityPD, wanted)):
        control = make(chain, motion, kp=gain, kd=0, limits=[12.0, 10.0])
        assert control.torque(0.0, np.array([-1.0]), np.zeros(1)) == pytest.approx(tau)

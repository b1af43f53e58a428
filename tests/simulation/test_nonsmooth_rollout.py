# SPDX-License-Identifier: BSD-2-Clause
"""Laws of stops, friction, ropes and impacts that can be written by hand."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import Contact, LineForce, Rope, robots
from tests.gallery.touching import (
    PLANAR,
    G,
    block_on_slope,
    flat_bar,
    frame,
    ladder,
    planar,
    tree,
)


def _free(chain, q0, va0, dt, steps, **options):
    """A motion without torques, all of whose steps are solved."""
    tau = np.zeros((steps, len(chain.motor_names)))
    motion = chain.rollout(tau, q0, va0, dt, nonsmooth=True, **options)
    assert motion.status.max() == 0
    return motion


# --- contacts ---------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [1 + 1e-6, 1 - 1e-6, 0.5])
def test_a_block_on_a_slope_sticks_or_slides_as_coulomb_says(factor):
    """tan(angle) is the limit; the four corners together carry the weight."""
    angle, h, steps = 0.5, 0.01, 20
    friction = factor * np.tan(angle)
    chain, q0 = block_on_slope(angle, friction)
    motion = _free(chain, q0, np.zeros(6), h, steps)
    acceleration = max(0.0, G * (np.sin(angle) - friction * np.cos(angle)))
    # The impulses of a step are worth 0.1 m/s, and solved to 1e-9 of that.
    rates = np.outer(acceleration * h * np.arange(steps + 1), np.eye(6)[0])
    assert np.abs(motion.va - rates).max() < 1e-9
    along = min(np.sin(angle), friction * np.cos(angle))
    total = motion.contact_forces.sum(axis=1)
    assert np.abs(total - 2 * G * np.array([-along, 0, np.cos(angle)])).max() < 1e-7


def test_a_ball_bounces_with_its_restitution_and_comes_to_rest():
    """Rates after an impact are those before times -e, to rounding; tops fall by e^2, to O(h)."""
    model, restitution, height, h = tree(("z", pin.JointModelPZ(), 1.0, 0.0)), 0.7, 0.2, 5e-4
    frame(model, "ball", "z", (0, 0, 0))
    ball = Contact("ball", radius=0.1, restitution=restitution)
    chain = sst_pin.ClosedChain(model, [], [], contacts=[ball])
    motion = _free(chain, [height + 0.1], [0], h, 1650)
    v, z = motion.va[:, 0], motion.q[:, 0] - 0.1
    impacts = np.flatnonzero((v[1:] > 0) & (v[:-1] < 0))[:4]
    assert np.abs(v[impacts + 1] + restitution * v[impacts]).max() < 1e-12
    tops = [z[a:b].max() for a, b in pairwise(impacts)]
    # The time of an impact is missed by up to h, at the rate at the bottom.
    error = 3 * h * np.sqrt(2 * G * height)
    assert tops == pytest.approx([height * restitution ** (2 * k) for k in (1, 2, 3)], abs=error)
    resting = _free(chain, [0.1], [0], h, 100)
    assert np.abs(resting.q - 0.1).max() < 1e-15
    assert resting.contact_forces[-1, 0, 2] == pytest.approx(G, rel=1e-12)


def test_a_sliding_wheel_begins_to_roll_at_two_thirds_of_its_rate():
    """Angular momentum about the point of contact is kept: 2/3 v_0 after v_0 / (3 mu g)."""
    radius, friction, rate, h = 0.2, 0.3, 3.0, 1e-3
    model = planar(1.5, 1.5 * radius**2 / 2)
    frame(model, "hub", "turn", (0, 0, 0))
    hub = Contact("hub", radius=radius, friction=friction)
    chain = sst_pin.ClosedChain(model, [], [], coordinates=PLANAR, contacts=[hub])
    motion = _free(chain, [0, radius, 0], [rate, 0, 0], h, 500)
    assert motion.va[-1] == pytest.approx([2 / 3 * rate, 0, 2 / 3 * rate / radius], rel=1e-12)
    slips = np.abs(motion.va[:, 0] - radius * motion.va[:, 2]) > 1e-9
    assert h * slips.sum() == pytest.approx(rate / (3 * friction * G), abs=2 * h)
    forces = motion.contact_forces[:, 0]
    assert np.abs(forces[:, 1]).max() < 1e-12
    assert forces[0] == pytest.approx([-friction * 1.5 * G, 0, 1.5 * G], rel=1e-9)


@pytest.mark.parametrize("factor", [1 + 1e-6, 1 - 1e-3])
def test_a_ladder_slips_below_half_the_cotangent_of_its_angle(factor):
    """On a floor with mu, against a smooth wall, at an angle a: it stands for mu > 1/(2 tan a)."""
    length, angle = 2.0, 1.0
    chain = ladder(length, factor / (2 * np.tan(angle)))
    q0 = [-length / 2 * np.cos(angle), length / 2 * np.sin(angle), -angle]
    motion = _free(chain, q0, np.zeros(3), 0.01, 20)
    moved = np.abs(motion.q[-1] - q0).max()
    if factor > 1:
        assert moved < 1e-13
        push = G / (2 * np.tan(angle))
        assert motion.contact_forces[-1] == pytest.approx(
            np.array([[push, 0, G], [0, 0, push]]), rel=1e-9, abs=1e-9
        )
    else:
        assert moved > 1e-5


def test_a_rocking_block_loses_what_housner_says():
    """Each impact leaves 1 - 3/2 sin(a)^2 of the rate of turning, a the slenderness, to O(h)."""
    width, height, h = 0.2, 0.8, 1e-3
    model = planar(1.0, (width**2 + height**2) / 12)
    for name, x in (("left", -width / 2), ("right", width / 2)):
        frame(model, name, "turn", (x, 0, -height / 2))
    contacts = [Contact(name, friction=2.0) for name in ("left", "right")]
    chain = sst_pin.ClosedChain(model, [], [], coordinates=PLANAR, contacts=contacts)
    tilt, slender = 0.1, np.arctan(width / height)
    half, to_corner = np.array([width, height]) / 2, np.array([np.cos(tilt), np.sin(tilt)])
    x = -half[0] * to_corner[0] + half[1] * to_corner[1] + half[0]
    z = half[0] * to_corner[1] + half[1] * to_corner[0]
    motion = _free(chain, [x, z, tilt], np.zeros(3), h, 320)
    turn, rate = motion.q[:, 2], motion.va[:, 2]
    (impact, *_) = np.flatnonzero((turn[1:] < 0) & (turn[:-1] >= 0))
    before, after = rate[impact - 2], rate[impact + 3]
    assert after / before == pytest.approx(1 - 1.5 * np.sin(slender) ** 2, rel=0.01)


def test_bodies_that_collide_keep_their_momentum():
    """The ground of a contact is another body: equal and opposite impulses, and restitution."""
    model, masses = pin.Model(), (2.0, 3.0)
    model.gravity.linear = np.zeros(3)
    for name, mass in zip("ab", masses, strict=True):
        joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(
            joint, pin.Inertia(mass, np.zeros(3), np.eye(3)), pin.SE3.Identity()
        )
    frame(model, "ball", "a", (0, 0, 0))
    frame(model, "face", "b", (0, 0, 0), pin.utils.rotate("y", -np.pi / 2))  # z is -x
    contact = Contact("ball", radius=0.1, restitution=0.4, ground="face")
    chain = sst_pin.ClosedChain(model, [], [], coordinates=["a", "b"], contacts=[contact])
    motion = _free(chain, [0, 0.5], [2.0, -1.0], 0.01, 30)
    momentum = motion.va @ masses
    assert np.abs(momentum - momentum[0]).max() < 1e-13
    assert motion.va[-1, 1] - motion.va[-1, 0] == pytest.approx(0.4 * 3.0, rel=1e-12)


def test_a_contact_that_the_loops_hold_changes_nothing():
    """The rate of its gap is rounding, on which an impulse of 1e20 N s would act."""
    touches = flat_bar(touches=True)
    motion = _free(touches, touches.home, [1.0], 1e-3, 40)
    alone = _free(flat_bar(touches=False), touches.home, [1.0], 1e-3, 40)
    assert not motion.contact_forces.any()
    assert np.array_equal(motion.va, alone.va)


def test_energy_does_not_grow_while_a_block_tumbles_to_rest():
    """A free fall with steps h has an energy that oscillates by O(h); impacts only take."""
    chain, _ = block_on_slope(0.0, 0.5)
    q0 = pin.SE3ToXYZQUAT(pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.4, 0.1), np.array([0, 0, 0.5])))
    motion = _free(chain, q0, [0.5, 0, 0, 1, 2, 0], 2e-3, 400)
    energy = chain.kinetic_energy(motion.q, motion.va) + chain.potential_energy(motion.q)
    assert np.diff(energy).max() < 2e-3 * energy[0]
    assert energy.max() < 1.01 * energy[0]
    assert np.abs(motion.va[-1]).max() < 1e-6
    assert motion.contact_forces[-1].sum(axis=0) == pytest.approx([0, 0, 2 * G], abs=1e-6)
    depths = [chain.frame_placement(motion.q, f"corner_{k}")[0][:, 2].min() for k in range(4)]
    assert min(depths) > -1e-4  # the square of a step's turn


# --- stops and dry friction ---------------------------------------------------------------------


def test_a_crank_comes_to_rest_under_dry_friction_and_stays():
    """Inertia I, friction F: it turns by I w^2 / (2 F), and then does not move at all."""
    model = tree(("crank", pin.JointModelRZ(), 1.0, 0.02), gravity=False)
    chain = sst_pin.ClosedChain(model, [], [], coulomb_friction=[0.5])
    h, rate = 1e-3, 4.0
    motion = _free(chain, [0], [rate], h, 400)
    assert motion.q[-1, 0] == pytest.approx(0.02 * rate**2 / (2 * 0.5), abs=2 * h * rate)
    assert (motion.q[200:] == motion.q[-1]).all()
    assert (motion.va[200:] == 0).all()


def test_a_four_bar_ends_at_its_stop_and_dry_friction_holds_it_where_it_is():
    bar = robots.four_bar()
    hold = abs(bar.compute_torques(bar.home, [0], [0])[0])
    (k,) = bar.mechanism.coordinates
    for factor, moves in ((1.001, False), (0.5, True)):
        friction = np.zeros(3)
        friction[k] = factor * hold
        dry = sst_pin.ClosedChain(bar.model, bar.closures, [], coulomb_friction=friction)
        motion = _free(dry, bar.home, [0], 1e-3, 100)
        assert (np.abs(motion.q - bar.home).max() > 1e-3) == moves
        if not moves:
            assert np.array_equal(motion.q[-1], bar.home)
    model = bar.model.copy()
    model.lowerPositionLimit[k] = bar.home[k] - 0.2
    stopped = sst_pin.ClosedChain(model, bar.closures, [])
    motion = _free(stopped, bar.home, [0], 2e-3, 300)
    assert abs(motion.q[-1, k] - model.lowerPositionLimit[k]) < 1e-15
    assert motion.q[:, k].min() > model.lowerPositionLimit[k] - 1e-15
    needed = bar.generalized_forces(motion.q[-1], [0], [0])
    assert motion.joint_forces[-1, k] == pytest.approx(needed[0], rel=1e-9)
    assert np.abs(stopped.residual(motion.q)).max() < 1e-14


@pytest.mark.parametrize("factor", [1.001, 0.999])
def test_cylinders_hold_an_excavator_exactly_up_to_their_dry_friction(factor):
    """The motors are off: each cylinder, a sliding joint, carries what its motor would hold."""
    chain = robots.excavator()
    zero = np.zeros(chain.degrees_of_freedom)
    hold = chain.compute_torques(chain.home, zero, zero)
    names = chain.motor_names
    sticking = chain.with_parameters(
        {f"{name}.coulomb": factor * abs(force) for name, force in zip(names, hold, strict=True)}
    )
    motion = _free(sticking, chain.home, zero, 0.01, 50)
    displacement = np.abs(motion.q[-1] - chain.home).max()
    if factor > 1:
        assert displacement < 1e-12
    else:
        assert displacement > 1e-5  # a thousandth of g moves the boom for half a second


@pytest.mark.parametrize("factor", [1.001, 0.999])
def test_a_ram_holds_its_load_exactly_up_to_its_dry_friction(factor):
    """A load on a vertical rail: the ram is inclined by 3:4, so it carries m g / 0.8."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "rail")
    model.appendBodyToJoint(joint, pin.Inertia(2.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    frame(model, "load", "rail", (0, 0, 0))
    frame(model, "foot", "universe", (0.3, 0, 0))
    needed = 2 * 9.81 / 0.8
    ram = sst_pin.LineForce("foot", "load", name="ram", coulomb_friction=factor * needed)
    chain = sst_pin.ClosedChain(model, [], [], lines=[ram])
    motion = _free(chain, [0.4], [0], 1e-3, 100)
    if factor > 1:
        assert np.abs(motion.q - 0.4).max() < 1e-15
        assert motion.line_friction == pytest.approx(needed * np.ones((100, 1)), rel=1e-12)
    else:
        acceleration = -9.81 + factor * needed * 0.8 / 2
        assert motion.va[1, 0] == pytest.approx(1e-3 * acceleration, rel=1e-9)
        assert motion.line_friction[0] == pytest.approx(factor * needed, rel=1e-12)
    # A smooth motion has the friction of a sliding ram: upwards it pulls.
    assert chain.compute_accelerations([0.4], [0.1], []) == pytest.approx(-9.81 * (1 + factor))


def test_a_screw_holds_its_load_for_100_seconds():
    """A nut that a screw lifts: friction above load x lead / 2 pi holds it to the last digit."""
    lead, load = 0.005, 50.0
    model = pin.Model()
    for name, joint, body in (
        ("screw", pin.JointModelRZ(), pin.Inertia(1.0, np.zeros(3), 1e-4 * np.eye(3))),
        ("nut", pin.JointModelPZ(), pin.Inertia(load, np.zeros(3), np.eye(3))),
    ):
        joint_id = model.addJoint(0, joint, pin.SE3.Identity(), name)
        model.appendBodyToJoint(joint_id, body, pin.SE3.Identity())
    closures = [sst_pin.Coupling("nut", {"screw": (0, lead / (2 * np.pi))})]
    limit = load * G * lead / (2 * np.pi)
    for factor, moves in ((1.01, False), (0.99, True)):
        chain = sst_pin.ClosedChain(
            model, closures, [], coordinates=["screw"], coulomb_friction=[factor * limit, 0]
        )
        motion = _free(chain, [0, 0], [0], 0.5, 200)
        assert (np.abs(motion.q).max() > 0) == moves


def test_a_stiff_controller_of_a_light_joint_is_stable_with_long_steps():
    """Gains are implicit: explicitly, steps of 10 ms would allow 2 I / h = 2e-3 N m s/rad only."""
    model = tree(("ankle", pin.JointModelRY(), 0.0, 1e-5))
    chain = sst_pin.ClosedChain(model, [], ["ankle"])
    held = {"motor_stiffness": [200.0], "motor_damping": [2.0]}
    motion = _free(chain, [0.3], [0], 0.01, 300, motor_positions=[0.5], **held)
    assert motion.q[-1, 0] == pytest.approx(0.5, abs=1e-12)
    assert np.diff(motion.q[:, 0]).min() > -1e-12


# --- ropes and cables ---------------------------------------------------------------------------


def test_a_rope_hangs_taut_with_the_weight_and_carries_nothing_when_slack():
    model = planar(2.0, 0.01)
    frame(model, "bob", "turn", (0, 0, 0))
    rope = Rope("universe", "bob", 1.0)
    chain = sst_pin.ClosedChain(model, [], [], coordinates=PLANAR, contacts=[rope])
    hanging = _free(chain, [0, -1, 0], np.zeros(3), 0.01, 50)
    assert hanging.tensions[-1] == pytest.approx([2 * G], rel=1e-9)
    falling = _free(chain, [0.1, -0.5, 0], np.zeros(3), 1e-3, 600)
    lengths = np.linalg.norm(falling.q[:, :2], axis=1)
    slack = lengths[1:] < 1 - 1e-4
    assert lengths.max() < 1 + 1e-5  # the square of a step, as the curvature of the way
    assert (falling.tensions[:300][slack[:300]] == 0).all()
    assert falling.tensions.min() >= 0
    assert falling.tensions.max() > 10 * G  # the jerk


def test_a_cable_that_is_slack_has_no_force_and_smooth_motions_agree():
    """A mass between two elastic cables: simulate is the referee, with error control."""
    model = planar(1.0, 0.01, gravity=False)
    frame(model, "mass", "turn", (0, 0, 0))
    cables = []
    for name, x in (("left", -1.0), ("right", 1.0)):
        frame(model, name, "universe", (x, 0, 0))
        numbers = {"stiffness": 50.0, "rest_length": 1.0, "damping": 0.2, "pulls_only": True}
        cables.append(LineForce(name, "mass", **numbers))
    chain = sst_pin.ClosedChain(model, [], [], coordinates=PLANAR, lines=cables)
    q0, va0 = np.array([0.3, 0.1, 0]), np.array([0, 0.2, 0])
    assert chain.generalized_forces(q0, va0, np.zeros(3))[0] > 0  # only the left one pulls back
    t = np.linspace(0, 0.5, 6)
    referee = chain.simulate([], q0, va0, t, rtol=1e-9, atol=1e-9)
    errors = []
    for h in (5e-3, 2.5e-3):
        motion = _free(chain, q0, va0, h, round(0.5 / h))
        errors.append(np.abs(motion.q[:: round(0.1 / h)] - referee.q).max())
        assert motion.tensions.min() == 0
        assert (motion.tensions == 0).any(axis=0).all()
    assert errors[1] < 0.6 * errors[0] < 0.03


def test_steps_without_these_elements_approach_the_smooth_motion():
    """The error of a loop under gravity, springs and a motor is of first order."""
    bar = robots.four_bar()
    chain = sst_pin.ClosedChain(
        bar.model, bar.closures, bar.motor_names, stiffness=[0.5, 0, 0], viscous_friction=[0.1] * 3
    )
    tau = np.full((400, 1), 0.3)
    referee = chain.rollout(tau[:50], chain.home, [0.5], 0.01).q[-1]
    errors = []
    for steps in (100, 200, 400):
        motion = chain.rollout(tau[:steps], chain.home, [0.5], 0.5 / steps, nonsmooth=True)
        errors.append(np.abs(motion.q[-1] - referee).max())
    assert errors[0] / errors[1] == pytest.approx(2, abs=0.2)
    assert errors[1] / errors[2] == pytest.approx(2, abs=0.2)


# --- calls --------------------------------------------------------------------------------------


def test_batches_are_their_motions_side_by_side():
    chain, q0 = block_on_slope(0.4, 0.3)
    va0 = np.random.default_rng(0).normal(size=(3, 6)) * 0.1
    batch = _free(chain, q0, va0, 0.01, 10)
    for i in range(3):
        one = _free(chain, q0, va0[i], 0.01, 10)
        assert all(map(np.array_equal, batch.single(i), one))
    for motion, index in ((batch, (3,)), (batch, ()), (batch, (0, 0)), (batch, (-1,)), (one, (0,))):
        with pytest.raises(sst_pin.errors.InputError, match="index"):
            motion.single(*index)
    assert np.array_equal(one.single().q, one.q)


def test_smooth_motions_refuse_contacts_and_say_what_to_call():
    chain, q0 = block_on_slope(0.4, 0.3)
    for call in (
        lambda: chain.simulate([], q0, np.zeros(6), [0, 1]),
        lambda: chain.rollout(np.zeros((5, 0)), q0, np.zeros(6), 0.01),
    ):
        with pytest.raises(sst_pin.errors.InputError, match=r"rollout\(..., nonsmooth=True\)"):
            call()


def test_a_start_below_the_ground_is_refused_and_named():
    chain, q0 = block_on_slope(0.0, 0.3)
    q0[2] -= 0.01
    with pytest.raises(sst_pin.errors.InputError, match=r"contact corner_0 .* by 0.01"):
        chain.rollout(np.zeros((5, 0)), q0, np.zeros(6), 0.01, nonsmooth=True)


def test_a_motion_that_cannot_start_has_no_valid_state():
    """As in smooth rollouts: beside a motion that can, on open loops and with NaN."""
    chain = robots.four_bar()
    q0 = chain.home + np.array([[0.0], [0.3], [np.nan]])
    motion = chain.rollout(np.zeros((2, 1)), q0, [0.0], 1e-3, nonsmooth=True, on_error="nan")
    smooth = chain.rollout(np.zeros((2, 1)), q0, [0.0], 1e-3, on_error="nan")
    for states in (motion.q, motion.va, smooth.q, smooth.va):
        assert np.isnan(states).all(axis=(1, 2)).tolist() == [False, True, True]
    assert np.isfinite(motion.q[0]).all()


def test_stops_that_contradict_each_other_are_not_solved_in_silence():
    model = tree(("z", pin.JointModelPZ(), 1.0, 0.0))
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = 1e-4, -1e-4
    chain = sst_pin.ClosedChain(model, [], [])
    with pytest.warns(RuntimeWarning, match="not solved"):
        motion = chain.rollout(np.zeros((3, 0)), [0], [0], 0.01, nonsmooth=True)
    assert (motion.status == 1).all()
    assert motion.residual.min() > 1e-9


@pytest.mark.parametrize("fast", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_batch_without_motions_or_steps_has_the_shapes_of_a_smooth_one(fast):
    chain = robots.four_bar()
    if fast:
        chain.compile()
    for tau, q0 in (
        (np.zeros((0, 1)), chain.home),
        (np.zeros((3, 0, 1)), chain.home),
        (np.zeros((0, 5, 1)), chain.home),
        (np.zeros((5, 1)), np.zeros((0, 3))),
    ):
        smooth = chain.rollout(tau, q0, [0.0], 1e-3)
        motion = chain.rollout(tau, q0, [0.0], 1e-3, nonsmooth=True)
        assert motion.q.shape == smooth.q.shape
        assert motion.va.shape == smooth.va.shape
        assert motion.residual.shape == (*smooth.q.shape[:-2], smooth.q.shape[-2] - 1)


def test_positions_that_motors_hold_are_finite():
    bar, gains = robots.four_bar(), {"motor_stiffness": [1.0], "motor_positions": [np.inf]}
    with pytest.raises(sst_pin.InputError, match=r"motor_positions: entry .* is inf"):
        bar.rollout(np.zeros((1, 1)), bar.home, [0.0], 1e-3, nonsmooth=True, **gains)

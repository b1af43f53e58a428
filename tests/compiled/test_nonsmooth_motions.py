# SPDX-License-Identifier: BSD-2-Clause
"""Compiled steps with stops, dry friction, ropes, cables and contacts; the referee is NumPy."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import Contact, LineForce, Rope, robots
from tests.gallery.on_feet import biped
from tests.gallery.touching import block_on_slope, flat_bar, frame
from tests.support.biped_in_mujoco import mujoco_biped, start_of

pytestmark = pytest.mark.usefixtures("kernels_at_their_first_use")


def _compiled(chain):
    fast = sst_pin.ClosedChain.__copy__(chain)
    fast.compile()
    return fast


def _bar_with_everything():
    """A four-bar on a slide, with a stop, dry friction, springs, a rope, a cable and contacts."""
    bar = robots.four_bar()
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "lift")
    model.appendBodyToJoint(base, pin.Inertia(2.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    hook = model.addFrame(pin.Frame("hook", base, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    part = pin.Model(bar.mechanism.model)
    model = pin.appendModel(model, part, hook, pin.SE3.Identity())
    model.gravity.linear = np.array([0.3, 0, -9.81])
    frame(model, "ceiling", "universe", (0.1, 0, 1.0))
    frame(model, "tip", "coupler", (0.1, 0, 0.05))
    frame(model, "knob", "crank", (0.05, 0, 0.02))
    q = np.append(0.3, bar.home)
    model.referenceConfigurations["home"] = q
    k = model.joints[model.getJointId("crank")].idx_q
    model.lowerPositionLimit[k], model.upperPositionLimit[k] = q[k] - 0.01, q[k] + 2.0
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    height = {x: data.oMf[model.getFrameId(x)].translation[2] for x in ("tip", "knob")}
    apart = np.linalg.norm(data.oMf[model.getFrameId("knob")].translation - [0.1, 0, 1.0])
    frame(model, "table", "universe", (0, 0, height["tip"] - 0.0105))
    frame(model, "desk", "universe", (0, 0, height["knob"] - 0.001))
    contacts = [
        Contact("tip", radius=0.01, friction=0.5, ground="table"),
        Contact("knob", restitution=0.4, friction=0.1, ground="desk"),
        Rope("ceiling", "knob", apart + 5e-4),
    ]
    lines = [
        LineForce("ceiling", "tip", stiffness=90, rest_length=0.55, damping=1, pulls_only=True),
        LineForce(
            "universe",
            "hook",
            stiffness=40,
            rest_length=0.4,
            damping=3,
            name="strut",
            coulomb_friction=1.5,
        ),
        LineForce("ceiling", "knob", name="winch", pulls_only=True),
    ]
    return sst_pin.ClosedChain(
        model,
        bar.closures,
        ["crank", "strut", "winch"],
        coordinates=["lift", "crank"],
        lines=lines,
        contacts=contacts,
        coulomb_friction=[0.5, 0.05, 0, 0],
        viscous_friction=[0.2, 0.01, 0, 0.02],
        stiffness=[0, 0, 0.3, 0],
    )


def _same(a, b, tolerance):
    assert np.array_equal(a.status, b.status)
    assert np.nanmax(np.abs(a.q - b.q)) < tolerance
    assert np.nanmax(np.abs(a.va - b.va)) < 1e3 * tolerance


_GAINS = {"motor_stiffness": [5.0, 30.0, 20.0], "motor_damping": [0.1, 1.0, 0.5]}


def test_kernels_step_as_the_reference_path_does():
    """Nine motions; each kind of row acts in some step. Redundant rows may share forces freely."""
    slow = _bar_with_everything()
    fast, rng = _compiled(slow), np.random.default_rng(0)
    tau = rng.normal(size=(9, 60, 3)) * [0.2, 1, 3]
    va0 = rng.normal(size=(9, 2)) * [0.5, 4]
    a = slow.rollout(tau, slow.home, va0, 2e-3, nonsmooth=True, **_GAINS)
    b = fast.rollout(tau, slow.home, va0, 2e-3, threads=2, nonsmooth=True, **_GAINS)
    _same(a, b, 1e-11)
    for motion in (a, b):
        assert motion.status.max() == 0
        assert (motion.contact_forces[..., 2].max(axis=(0, 1)) > 0).all()
        assert (motion.tensions.max(axis=(0, 1)) > 0).all()
        assert (motion.tensions.min(axis=(0, 1)) == 0).all()
        assert motion.joint_forces[..., 1].max() > 1  # the stop
        assert np.abs(motion.line_friction).max() == pytest.approx(1.5)  # the strut slips
        assert np.abs(motion.line_friction).min() < 1.4  # and sticks


@pytest.mark.slow
def test_kernels_of_one_motion_step_with_a_load_as_the_reference_path_does():
    slow = _bar_with_everything()
    fast, load = _compiled(slow), np.zeros((4, 6))
    load[1, 2] = -3.0
    for wrenches in (None, load):
        a, b = (
            chain.rollout(
                np.full((60, 3), 0.1),
                slow.home,
                [0, 1],
                2e-3,
                nonsmooth=True,
                external_wrenches=wrenches,
                **_GAINS,
            )
            for chain in (slow, fast)
        )
        _same(a, b, 1e-11)


@pytest.mark.slow
def test_kernels_leave_a_contact_to_the_loops_that_hold_it():
    slow, tau = flat_bar(touches=True), np.zeros((9, 40, 1))
    a, b = (
        chain.rollout(tau, slow.home, [1.0], 1e-3, nonsmooth=True)
        for chain in (slow, _compiled(slow))
    )
    _same(a, b, 1e-11)
    assert not b.contact_forces.any()


@pytest.mark.slow
def test_both_paths_pass_dead_points_with_an_error_of_first_order():
    """A rocker as coordinate turns back; the referee is the smooth rollout, of fourth order.

    The reference path makes the steps near the dead point in other coordinates, so the two paths
    differ by the error of their steps.
    """
    bar = robots.four_bar()
    slow = sst_pin.ClosedChain(bar.model, bar.closures, [], coordinates=["rocker"])
    rocker = list(bar.joint_names).index("rocker")
    q0, va0 = bar.home, bar.joint_rates(bar.home, [25.0])[[rocker]]
    referee = slow.rollout(np.zeros((500, 0)), q0, va0, 5e-4)
    assert (np.diff(np.sign(referee.va[:, 0])) != 0).any()
    for chain in (slow, _compiled(slow)):
        errors = []
        for steps in (300, 600):
            motion = chain.rollout(np.zeros((steps, 0)), q0, va0, 0.25 / steps, nonsmooth=True)
            errors.append(np.abs(motion.q[-1] - referee.q[-1]).max())
        assert errors[1] < 0.6 * errors[0] < 0.06


@pytest.mark.slow
def test_both_paths_refuse_the_same_starts_and_mark_the_same_steps():
    slow, q0 = block_on_slope(0.0, 0.3)
    fast = _compiled(slow)
    low = q0 - [0, 0, 0.01, 0, 0, 0, 0]
    for chain in (slow, fast):
        with pytest.raises(sst_pin.errors.InputError, match=r"contact corner_0 .* by 0.01"):
            chain.rollout(
                np.zeros((2, 3, 0)), np.array([q0, low]), np.zeros(6), 1e-2, nonsmooth=True
            )
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "z")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = 1e-4, -1e-4
    squeezed = _compiled(sst_pin.ClosedChain(model, [], []))
    with pytest.warns(RuntimeWarning, match="not solved"):
        motion = squeezed.rollout(np.zeros((3, 0)), [0], [0], 0.01, nonsmooth=True)
    assert (motion.status == 1).all()


@pytest.mark.slow
def test_a_biped_with_six_loops_stands_on_eight_points():
    """Loops closed to rounding, no point below the floor by more than the square of a step."""
    chain = _compiled(biped())
    n, motors, steps = chain.degrees_of_freedom, len(chain.motor_names), 600
    assert (n, motors, len(chain.contacts)) == (18, 12, 8)
    gains = {"motor_stiffness": np.full(motors, 150.0), "motor_damping": np.full(motors, 1.0)}
    motion = chain.rollout(
        np.zeros((steps, motors)), chain.home, np.zeros(n), 5e-4, nonsmooth=True, **gains
    )
    assert motion.status.max() == 0
    assert np.abs(chain.residual(motion.q)).max() < 1e-14
    heights = [chain.frame_placement(motion.q, x.frame)[0][:, 2] for x in chain.contacts]
    assert np.min(heights) - 0.01 > -1e-6
    forces = motion.contact_forces
    assert (np.linalg.norm(forces[..., :2], axis=-1) <= 0.8 * forces[..., 2] + 1e-6).all()


@pytest.mark.slow
def test_a_biped_stands_up_as_in_mujoco_with_stiff_contacts():
    """0.3 s with a fall of 10 mm; halving MuJoCo's steps moves its pelvis by 0.07 mm."""
    chain, step, steps = _compiled(biped()), 2.5e-4, 1200
    n, motors = chain.degrees_of_freedom, len(chain.motor_names)
    gains = {"motor_stiffness": np.full(motors, 150.0), "motor_damping": np.full(motors, 1.0)}
    motion = chain.rollout(
        np.zeros((steps, motors)), chain.home, np.zeros(n), step, nonsmooth=True, **gains
    )
    model = mujoco_biped(step, 150.0, 1.0, 0.8)
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = start_of(chain, model)
    for _ in range(steps):
        mujoco.mj_step(model, data)
    assert np.abs(motion.q[-1, :3] - data.qpos[:3]).max() < 1e-4
    assert np.abs(motion.q[-1, :3] - chain.home[:3]).max() > 0.01

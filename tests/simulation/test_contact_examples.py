# SPDX-License-Identifier: BSD-2-Clause
"""The examples with contacts: two legs that walk in place, a gripper that holds a ball."""

import numpy as np
import pytest

from tests.support.files import load

walking = load("examples/walking_in_place.py")
gripper = load("examples/gripper.py")


@pytest.mark.slow
def test_two_legs_stand_up_from_a_stop_and_lift_their_feet_in_turn():
    chain, t, heights, motion = walking.walk()
    assert motion.status.max() == 0
    assert np.abs(chain.residual(motion.q)).max() < 1e-14
    weight = 9.81 * sum(body.mass for body in chain.model.inertias)
    soles = motion.contact_forces[..., 2].reshape(len(t), 2, 4).sum(axis=2)
    stop = motion.joint_forces[:, 0]
    assert stop[0] + soles[0].sum() == pytest.approx(weight, rel=1e-9)  # at rest
    assert stop[t > walking.RISE].max() == 0
    hip = motion.q[1:, 0]
    assert hip.min() > walking.CROUCHED - 1e-12
    assert np.abs(hip - heights.max(axis=1)).max() < 0.02  # of motors that are no stiffer
    for k, side in enumerate(walking.SIDES):
        height = chain.frame_placement(motion.q[1:], f"{side}_sole_0")[0][:, 2]
        lifted = heights[:, k] < heights.max(axis=1) - 0.5 * walking.LIFT
        assert lifted.any()
        assert height[lifted].min() > 0.01
        assert (soles[lifted, k] == 0).all()
        assert (soles[lifted, 1 - k] > 0).all()


@pytest.mark.slow
def test_a_ball_slips_in_a_gripper_where_coulomb_says():
    """Its acceleration is 2 mu N / m - g while it slips, with N of the motor and dry joints."""
    _, t, motion = gripper.hold()
    assert motion.status.max() == 0
    slip, rests = gripper.slips(motion), t < gripper.SQUEEZE + gripper.MOVE + gripper.REST
    assert np.ptp(slip[rests]) < 1e-12
    moves = ~rests & (t < t[-1] - gripper.FALL)
    assert np.ptp(slip[moves]) > 0.01
    pads = motion.contact_forces[:, :2]
    normal, side = pads[..., 2], np.linalg.norm(pads[..., :2], axis=-1)
    assert (side <= gripper.FRICTION * normal + 1e-9).all()
    held = t < t[-1] - gripper.FALL
    bounds = [(gripper.GRIP + x) / (2 * gripper.CRANK) for x in (-2 * gripper.DRY, 2 * gripper.DRY)]
    assert bounds[0] - 1e-9 < normal[held].min() <= normal[held].max() < bounds[1] + 1e-9
    # The ball's own law, m a = 2 F - m g, while it slides down in the pads.
    ball_rate = np.diff(motion.q[1:, motion.q.shape[-1] - 5]) / gripper.STEP
    slides = np.flatnonzero(moves[1:-1] & (np.diff(slip)[1:] < -1e-6))
    a = np.diff(ball_rate)[slides] / gripper.STEP
    law = 2 * gripper.FRICTION * normal[slides + 2, 0] / gripper.MASS - 9.81
    assert a == pytest.approx(law, abs=0.05)
    assert motion.contact_forces[-1, 2, 2] == pytest.approx(gripper.MASS * 9.81, rel=1e-9)

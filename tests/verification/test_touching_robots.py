# SPDX-License-Identifier: BSD-2-Clause
"""Robots of the gallery that fall onto a floor or onto stops, against MuJoCo."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import Contact, robots
from tests.support.stiff_mujoco import falls_in_mujoco


def _above_a_floor(robot, **more):
    """A sphere at the platform, 20 mm above a floor with friction; `more` as in `_damped`."""
    model, place = robot.model.copy(), robot.frame_placement(robot.home, "platform")[0]
    floor = pin.SE3(np.eye(3), np.array([0, 0, place[2] - 0.03]))
    model.addFrame(pin.Frame("floor", 0, floor, pin.FrameType.OP_FRAME))
    sphere = Contact("platform", radius=0.01, friction=0.3, ground="floor")
    return _damped(robot, model, contacts=[sphere], **more)


def _excavator():
    """An excavator whose bucket falls onto the floor, with oil in its cylinders.

    Without this damping the bucket rebounds in MuJoCo. How far depends on the time of the impact
    within a step, so that halving the steps does not estimate the error.
    """
    robot = robots.excavator()
    viscous = np.zeros(robot.model.nv)
    for k, name in enumerate(robot.rate_names):
        if name.endswith("stroke"):
            viscous[k] = 5e4
    return _above_a_floor(robot, viscous_friction=viscous)


def _above_stops(robot, falls):
    """Joints, by name, that end at a stop after they have fallen so far."""
    model = robot.model.copy()
    for name, fall in falls.items():
        place = robot.position_names.index(name)
        model.lowerPositionLimit[place] = robot.home[place] - fall
    return _damped(robot, model)


def _damped(robot, model, **more):
    viscous = 0.02 * np.ones(model.nv)
    numbers = {"coordinates": robot.coordinates, "viscous_friction": viscous, **more}
    return sst_pin.ClosedChain(model, robot.closures, robot.motor_names, **numbers)


CASES = {
    "four_bar": lambda: _above_stops(robots.four_bar(), {"crank": 0.1}),
    "delta": lambda: _above_a_floor(robots.delta()),
    "stewart": lambda: _above_stops(
        robots.stewart(), {f"stroke_{k + 1}": 0.005 + 0.001 * k for k in range(6)}
    ),
    "scissor_lift": lambda: _above_a_floor(robots.scissor_lift()),
    "excavator": _excavator,
}


@pytest.mark.slow
@pytest.mark.usefixtures("kernels_at_their_first_use")
@pytest.mark.parametrize("name", CASES)
def test_robots_that_fall_onto_floors_and_stops_move_as_in_mujoco(name):
    """Both methods are of first order: their errors are what halving the steps changes.

    MuJoCo's contacts, stops and loops are springs with the shortest time constants that it allows,
    two steps, so that they become rigid as the steps become short.
    """
    chain, duration = CASES[name](), 0.2
    ours, theirs = [], []
    for step in (5e-4, 2.5e-4):
        steps = round(duration / step)
        tau, rest = np.zeros((steps, len(chain.motor_names))), np.zeros(chain.degrees_of_freedom)
        chain.compile()
        motion = chain.rollout(tau, chain.home, rest, step, nonsmooth=True)
        assert motion.status.max() == 0
        assert np.abs(chain.residual(motion.q)).max() < 1e-10  # Newton ends there
        names, positions = falls_in_mujoco(chain, step, steps)
        assert len(names) > len(chain.coordinates) or len(names) == chain.model.nq
        ours.append(motion.q[:, [chain.position_names.index(x) for x in names]])
        theirs.append(positions)
    acting = np.abs(motion.contact_forces).sum() + np.abs(motion.joint_forces).sum()
    assert acting > 0  # it has fallen onto something
    errors = [np.abs(x[0] - x[1][::2]).max() for x in (ours, theirs)]
    difference = np.abs(ours[1] - theirs[1]).max()
    assert difference < sum(errors)
    assert difference < 0.1 * np.abs(ours[1] - ours[1][0]).max()  # the referee is sharp

# SPDX-License-Identifier: BSD-2-Clause
"""Tensions of cables as published, and the lengths that winches set."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import ClosedChain, LineForce, robots
from sst_pin.control import unstretched_lengths
from sst_pin.errors import ActuationError, InputError

#: Anchors of a printer that hangs on four cables, [m]; the load has 2 kg, a cable at most 70 N.
ANCHORS = {"A": (0, -2, -0.1), "B": (2, 1, -0.1), "C": (-2, 1, -0.1), "D": (0, 0, 3)}
REST = np.zeros(3)


def printer(stiffness: np.ndarray | None = None, lengths: np.ndarray | None = None) -> ClosedChain:
    """The load on its cables; with stiffnesses [N/m] and lengths without tension, on springs."""
    model, load = pin.Model(), 0
    slides = {"x": pin.JointModelPX(), "y": pin.JointModelPY(), "z": pin.JointModelPZ()}
    for name, joint in slides.items():
        load = model.addJoint(load, joint, pin.SE3.Identity(), name)
    body = pin.Inertia(2.0, np.zeros(3), 0.01 * np.eye(3))
    model.appendBodyToJoint(load, body, pin.SE3.Identity())
    model.addFrame(pin.Frame("load", load, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    lines = []
    for name, place in ANCHORS.items():
        at = pin.SE3(np.eye(3), np.array(place, dtype=float))
        model.addFrame(pin.Frame(name, 0, at, pin.FrameType.OP_FRAME))
        lines.append(LineForce(name, "load", name=f"cable_{name}"))
    model.referenceConfigurations["home"] = np.zeros(3)
    if stiffness is not None and lengths is not None:
        numbers = zip(lines, stiffness, lengths, strict=True)
        lines = [replace(x, stiffness=k, rest_length=length) for x, k, length in numbers]
    return ClosedChain(model, [], [{x.name[-1]: {x.name: -1.0}} for x in lines], lines=lines)


def test_least_tensions_are_the_published_ones():
    tensions = printer().compute_torques(REST, REST, REST, limits=[[20, 70]] * 4)
    np.testing.assert_allclose(tensions, [20, 22.355103, 22.355103, 22.616257], atol=5e-7)


def test_where_a_firmware_clamps_a_cable_that_would_push_no_tensions_are_in_balance():
    """With 70 N in D, A would have -0.67 N, which the firmware sets to zero."""
    robot, place = printer(), np.array([-0.7, 0.4, 1.5])
    least = robot.compute_torques(place, REST, REST)
    along = robot.preload_directions(place)[:, 0]
    at_limit = least + along * (70 - least[3]) / along[3]
    assert round(at_limit[0], 2) == -0.67
    with pytest.raises(ActuationError, match="exceed the limits, at least A by"):
        robot.compute_torques(place, REST, REST, limits=[[0, 70]] * 4)
    stronger = robot.compute_torques(place, REST, REST, limits=[[0, 80]] * 4)
    assert stronger.min() >= 0
    pull = robot.actuator_jacobian(place).T @ stronger
    np.testing.assert_allclose(pull, [0, 0, 2 * 9.81], atol=1e-10)


def test_springs_of_the_unstretched_lengths_carry_the_load():
    """Springs are the referee: k / l0 is the stiffness of a cable with the length l0."""
    robot, section = printer(), np.array([4e3, 5e3, 6e3, 7e3])
    for place in ([0, 0, 0], [0.3, -0.2, 0.6]):
        tensions = robot.compute_torques(place, REST, REST, limits=[[20, 200]] * 4)
        lengths = unstretched_lengths(robot, place, tensions, section)
        sprung = printer(section / lengths, lengths)
        np.testing.assert_allclose(sprung.generalized_forces(place, REST, REST), 0, atol=1e-10)
        assert (lengths < robot.line_lengths(place)).all()


def test_a_batch_is_its_samples_and_a_stiff_cable_has_its_length():
    robot, places = printer(), np.array([[0, 0, 0], [0.1, 0.2, 0.3]])
    tensions = robot.compute_torques(places, REST, REST, limits=[[20, 200]] * 4)
    lengths = unstretched_lengths(robot, places, tensions, 1e3)
    alone = [unstretched_lengths(robot, *x, 1e3) for x in zip(places, tensions, strict=True)]
    np.testing.assert_array_equal(lengths, alone)
    stiff = unstretched_lengths(robot, places, tensions, 1e15)
    np.testing.assert_allclose(stiff, robot.line_lengths(places), rtol=1e-12)


def test_cables_that_push_and_motors_that_are_no_cables_are_refused():
    robot = printer()
    with pytest.raises(InputError, match=r"A, B, C would push with up to 0\.933 N"):
        unstretched_lengths(robot, REST, robot.compute_torques(REST, REST, REST), 1e3)
    bar = robots.four_bar()
    with pytest.raises(InputError, match="crank are no cables"):
        unstretched_lengths(bar, bar.home, [1.0], 1e3)
    with pytest.raises(InputError, match="stiffness_times_length"):
        unstretched_lengths(robot, REST, np.ones(4), -1.0)

# SPDX-License-Identifier: BSD-2-Clause
"""Tensions of cables as published, and the lengths that winches set."""

import numpy as np
import pytest

from sst_pin import robots
from sst_pin.control import unstretched_lengths
from sst_pin.errors import ActuationError, InputError
from tests.gallery.cable_printer import cable_printer

REST = np.zeros(3)


def test_least_tensions_are_the_published_ones():
    tensions = cable_printer().compute_torques(REST, REST, REST, limits=[[20, 70]] * 4)
    np.testing.assert_allclose(tensions, [20, 22.355103, 22.355103, 22.616257], atol=5e-7)


def test_where_a_firmware_clamps_a_cable_that_would_push_no_tensions_are_in_balance():
    """With 70 N in D, A would have -0.67 N, which the firmware sets to zero."""
    robot, place = cable_printer(), np.array([-0.7, 0.4, 1.5])
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
    robot, section = cable_printer(), np.array([4e3, 5e3, 6e3, 7e3])
    for place in ([0, 0, 0], [0.3, -0.2, 0.6]):
        tensions = robot.compute_torques(place, REST, REST, limits=[[20, 200]] * 4)
        lengths = unstretched_lengths(robot, place, tensions, section)
        sprung = cable_printer(section / lengths, lengths)
        np.testing.assert_allclose(sprung.generalized_forces(place, REST, REST), 0, atol=1e-10)
        assert (lengths < robot.line_lengths(place)).all()


def test_a_batch_is_its_samples_and_a_stiff_cable_has_its_length():
    robot, places = cable_printer(), np.array([[0, 0, 0], [0.1, 0.2, 0.3]])
    tensions = robot.compute_torques(places, REST, REST, limits=[[20, 200]] * 4)
    lengths = unstretched_lengths(robot, places, tensions, 1e3)
    alone = [unstretched_lengths(robot, *x, 1e3) for x in zip(places, tensions, strict=True)]
    np.testing.assert_array_equal(lengths, alone)
    stiff = unstretched_lengths(robot, places, tensions, 1e15)
    np.testing.assert_allclose(stiff, robot.line_lengths(places), rtol=1e-12)


def test_cables_that_push_and_motors_that_are_no_cables_are_refused():
    robot = cable_printer()
    with pytest.raises(InputError, match=r"A, B, C would push with up to 0\.933 N"):
        unstretched_lengths(robot, REST, robot.compute_torques(REST, REST, REST), 1e3)
    bar = robots.four_bar()
    with pytest.raises(InputError, match="crank are no cables"):
        unstretched_lengths(bar, bar.home, [1.0], 1e3)
    with pytest.raises(InputError, match="stiffness_times_length"):
        unstretched_lengths(robot, REST, np.ones(4), -1.0)
    with pytest.raises(InputError, match="do not broadcast"):
        unstretched_lengths(robot, np.zeros((2, 3)), np.ones((3, 4)), 1e3)

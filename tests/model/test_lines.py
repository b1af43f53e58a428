# SPDX-License-Identifier: BSD-2-Clause
"""Forces along lines between two frames, and motors on lines."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin import ClosedChain, LineForce
from tests.support.any_chain import chain as arm
from tests.support.any_chain import mimicking, states, with_joint
from tests.support.derivative_cases import (
    assert_derivatives_are_those_of_differences,
    case,
    close,
)

#: Ends of lines: from the world, between two links of one branch, over two branches.
ENDS = [("universe", "point_arm_5"), ("point_arm_1", "point_arm_4"), ("point_body", "point_arm_3")]
#: The second one has no mass, and the third one has dry friction.
STRUTS = [
    LineForce(
        *ends,
        stiffness=30 + 20 * k,
        rest_length=0.2 * k,
        damping=3 + k,
        preload=7 - 9 * k,
        mass=2 * (k - 1) ** 2,
        coulomb_friction=3 if k == 2 else 0,
    )
    for k, ends in enumerate(ENDS)
]


def with_lines(robot, motors=("body",)):
    """The robot with lines, and without."""
    how = {"coordinates": robot.coordinates}
    lined = ClosedChain(robot.model, robot.closures, motors, lines=STRUTS, **how)
    return lined, ClosedChain(robot.model, robot.closures, ["body"], **how)


def tension_and_row(chain, line, q, va, aa):
    """From positions, Jacobians and accelerations of its two frames alone."""
    a, b = (chain.frame_placement(q, name)[0] for name in (line.frame_a, line.frame_b))
    d = b - a
    length = np.linalg.norm(d)
    J_a, J_b = (chain.frame_jacobian(q, name)[:3] for name in (line.frame_a, line.frame_b))
    row = d / length @ (J_b - J_a)
    tension = line.preload + line.stiffness * (length - line.rest_length)
    d_dot = (J_b - J_a) @ va
    drift_a, drift_b = (chain.frame_drift(q, va, x)[:3] for x in (line.frame_a, line.frame_b))
    d_ddot = (J_b - J_a) @ aa + drift_b - drift_a
    speed = d @ d_dot / length
    inertial = line.mass * ((d_dot @ d_dot + d @ d_ddot) - speed**2) / length
    friction = line.damping * speed + line.coulomb_friction * np.sign(speed)
    return length, tension + friction + inertial, row


def random_states(chain, count=3):
    return zip(*states(chain, count, seed=0), strict=True)


@pytest.mark.parametrize("name", ["revolute", "spherical", "composite", "free-flyer"])
def test_a_line_does_the_work_of_two_opposed_forces(name):
    """f without lines less f with them is the sum of minus tension times the row of the length.

    Masses that move with the length are part of the tension.

    A motor on a line pushes along the same row.
    """
    chain, bare = with_lines(with_joint(name), [STRUTS[1].name])
    for q, va, aa in random_states(chain):
        f = bare.generalized_forces(q, va, aa) - chain.generalized_forces(q, va, aa)
        expected = [tension_and_row(chain, line, q, va, aa) for line in STRUTS]
        pulls = -sum(tension * row for _, tension, row in expected)
        close(f, pulls, 1e-12 * np.abs(bare.generalized_forces(q, va, aa)).max())
        assert_allclose(chain.line_lengths(q), [length for length, *_ in expected], rtol=1e-13)
        close(chain.actuator_jacobian(q)[0], expected[1][2], 1e-13)
        close(chain.motor_rates(q, va), [expected[1][2] @ va], 1e-12)


def test_terms_hold_springs_and_dampers_of_lines():
    chain, bare = with_lines(with_joint("universal"))
    for q, va, aa in random_states(chain):
        f = chain.generalized_forces(q, va, aa)
        terms, reduced = chain.noc(q, va), chain.reduced_terms(q, va)
        applied = terms.gravity + terms.friction + terms.springs
        close(terms.inertia @ aa + terms.coriolis @ va - applied, f, 1e-11)
        close(terms.springs + terms.gravity, reduced.gravity, 1e-13)
        close(terms.friction, reduced.friction, 1e-13)
        rates = [tension_and_row(chain, line, q, va, aa)[2] @ va for line in STRUTS]
        damped = sum(
            line.damping * rate**2 + line.coulomb_friction * abs(rate)
            for line, rate in zip(STRUTS, rates, strict=True)
        )
        close(chain.friction_power(q, va), terms.friction @ va, 1e-12)
        close((bare.noc(q, va).friction - terms.friction) @ va, damped, 1e-12)


LINES_AND_MOTORS = {
    "universal": lambda: (with_joint("universal"), ["body", STRUTS[1].name], STRUTS),
    "mimic": lambda: (mimicking("hinge"), ["body"], STRUTS),
    "rods": lambda: (arm(kind="3d"), ["body", STRUTS[0].name], STRUTS),
}


@pytest.mark.parametrize("name", LINES_AND_MOTORS)
def test_derivatives_are_those_of_differences(name):
    robot, motors, forces = LINES_AND_MOTORS[name]()
    some = case(robot.model, robot.closures, motors, lines=forces)
    random = np.random.default_rng(1)
    for state in some.states(2):
        assert_derivatives_are_those_of_differences(some, *state, random)


def test_both_ends_in_one_place_have_no_direction():
    bar = sst_pin.robots.four_bar()
    gas = LineForce("rocker_pin", "coupler_pin", stiffness=1, name="gas")
    chain = ClosedChain(bar.model, bar.closures, ["crank"], lines=[gas])
    for quantity in (chain.compute_torques, chain.compute_accelerations):
        with pytest.raises(sst_pin.SingularConfigurationError, match="line gas is not determined"):
            quantity(bar.home, [0], [0])
    assert chain.line_lengths(bar.home) < 1e-12


def test_lines_that_do_not_fit_the_robot_are_refused():
    bar = sst_pin.robots.four_bar()

    def chain(forces, motors=("crank",)):
        return ClosedChain(bar.model, bar.closures, motors, lines=forces)

    line = LineForce("universe", "platform")
    with pytest.raises(sst_pin.UnknownNameError, match="platfrom"):
        chain([LineForce("universe", "platfrom")])
    with pytest.raises(sst_pin.InputError, match="two different frames"):
        LineForce("platform", "platform")
    with pytest.raises(sst_pin.InputError, match="several lines have the name universe-platform"):
        chain([line, line])
    with pytest.raises(sst_pin.InputError, match="line crank has the name of a joint"):
        chain([LineForce("universe", "platform", name="crank")])
    with pytest.raises(sst_pin.InputError, match="appears twice"):
        chain([line], [line.name, line.name])


def test_lengths_of_micrometres_keep_all_their_digits():
    """The lengths of a robot in another unit are those numbers in this unit."""
    robot = arm(lines=STRUTS)
    model = pin.Model(robot.model)
    unit = 2.0**-20  # a power of two, so that nothing is rounded
    for number in range(1, model.njoints):
        model.jointPlacements[number].translation *= unit
    for place in model.frames:
        place.placement.translation *= unit
    small = ClosedChain(model, robot.closures, ["body"], lines=STRUTS)
    q = robot.generic_configuration()
    assert_allclose(small.line_lengths(q), unit * robot.line_lengths(q), rtol=1e-15)

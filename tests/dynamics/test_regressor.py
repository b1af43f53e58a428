# SPDX-License-Identifier: BSD-2-Clause
"""f = Y theta: the regressor, the parameters, and robots with other parameters."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin import InputError, UnknownNameError, robots
from tests.gallery import governor
from tests.support import any_chain
from tests.support.any_chain import states

KINDS = {
    "cart": any_chain.cart,
    "composite": lambda: any_chain.with_joint("composite"),
    "mimic": lambda: any_chain.mimicking("3d"),
    "rods": any_chain.rods,
    "coupled": any_chain.coupled,
    "rolling": lambda: any_chain.rolling(ball=True),
    "sprung ball": lambda: any_chain.sprung("spherical"),
    "free-flyer": lambda: any_chain.with_joint("free-flyer"),
    "SST": sst_pin.SST,
    "surplus motors": robots.planar_4rrr,
    "damped lines": governor,
}


def drawn(chain, seed=0):
    """The chain with random masses, inertias, friction, rotors, springs and lines."""
    random, theta = np.random.default_rng(seed), chain.dynamic_parameters
    values = np.asarray(theta)
    for k, name in enumerate(theta.names):
        word = name.rpartition(".")[2]
        if word in ("viscous", "coulomb", "armature", "stiffness", "damping", "preload"):
            values[k] = random.uniform(0.1, 1)
        elif not word.endswith("offset"):
            values[k] += random.uniform(0.1, 0.2)
    for joint in list(chain.model.joints)[1:]:
        if joint.shortname() == "JointModelSpherical":  # alike in all directions
            name = chain.rate_names
            here = [theta.names.index(f"{name[joint.idx_v + i]}.stiffness") for i in range(3)]
            values[here] = values[here[0]]
    return chain.with_parameters(values), values


@pytest.mark.parametrize("kind", KINDS)
def test_forces_are_linear_in_the_parameters_for_every_kind_of_joint_and_closure(kind):
    """Y theta is what the chain computes, to 1e-11 of the largest force."""
    chain, theta = drawn(KINDS[kind]())
    assert_allclose(chain.dynamic_parameters, theta, rtol=1e-12, atol=1e-13)
    motions = states(chain, 2, 1)
    f, Y = chain.generalized_forces(*motions), chain.torque_regressor(*motions)
    assert Y.shape == (*f.shape, len(theta))
    assert_allclose(Y @ theta, f, rtol=0, atol=1e-11 * np.abs(f).max())


@pytest.mark.filterwarnings("ignore:.*the first moment and the inertia of the body stay")
def test_columns_are_what_a_change_of_one_parameter_does():
    chain, theta = drawn(any_chain.lines())
    motions = states(chain, 2, 1)
    f, Y = chain.generalized_forces(*motions), chain.torque_regressor(*motions)
    for k, name in enumerate(chain.dynamic_parameters.names):
        if not name.endswith("torque_offset"):
            other = chain.with_parameters({name: theta[k] + 1.0})
            # The forces are some hundred newtons, their differences lose as much.
            assert_allclose(other.generalized_forces(*motions) - f, Y[..., k], atol=1e-11)
    assert_allclose(Y[..., -2:], chain.actuator_jacobian(motions[0]).swapaxes(-1, -2), atol=1e-14)


def test_the_offset_in_a_ball_is_refused():
    """The logarithm of a turn is not linear: no other reference gives a constant moment."""
    with pytest.raises(InputError, match="offset of body_wy: in a ball"):
        any_chain.sprung("spherical").with_parameters({"body_wy.offset": 0.1})


@pytest.mark.filterwarnings("ignore:.*the first moment and the inertia of the body stay")
def test_a_robot_with_other_parameters_leaves_the_first_as_it_was():
    robot = sst_pin.SST()
    before = np.array(robot.dynamic_parameters)
    heavier = robot.with_parameters({"beta_1.mass": 2.0, "mu_1.viscous": 0.3})
    assert isinstance(heavier, sst_pin.SST)
    assert heavier.backend == robot.backend
    assert_allclose(robot.dynamic_parameters, before, rtol=0)
    assert heavier.dynamic_parameters["beta_1.mass"] == 2.0
    assert heavier.friction.viscous[list(heavier.joint_names).index("mu_1")] == 0.3
    heavier.refresh()
    assert heavier.dynamic_parameters["mu_1.viscous"] == 0.3


@pytest.mark.parametrize(
    ("theta", "error", "words"),
    [
        ({"crank.weight": 1.0}, UnknownNameError, "crank.weight"),
        ({"crank.mass": np.inf}, InputError, "crank.mass"),
        ({"crank.torque_offset": 1.0}, InputError, "torque offsets"),
        ({"crank.offset": 1.0}, InputError, "springs with stiffness"),
        ({"crank.mass": 0.0, "crank.mx": 1.0}, InputError, "no mass"),
    ],
)
def test_parameters_that_no_chain_has_are_refused(theta, error, words):
    with pytest.raises(error, match=words):
        robots.four_bar().with_parameters(theta)


def test_a_mass_alone_is_told_and_its_cure_scales_the_body():
    """The cure is the body with another density; the mass alone changes no torque of a hinge."""
    chain = robots.four_bar()
    mass = 0.9 * chain.dynamic_parameters["rocker.mass"]
    with pytest.warns(sst_pin.DescriptionWarning, match=r"rocker\.mass: the first m") as records:
        alone = chain.with_parameters({"rocker.mass": mass})
    cure = re.search(r"with_parameters\(.*?\)\)", str(records[0].message))[0]
    lighter = eval(f"chain.{cure}", {"chain": chain})  # as a user would copy it
    expected = np.array(chain.dynamic_parameters)
    expected[20:30] *= 0.9
    assert_allclose(lighter.dynamic_parameters, expected, rtol=1e-12, atol=1e-15)
    motion = chain.home, [1.0], [2.0]
    assert_allclose(alone.compute_torques(*motion), chain.compute_torques(*motion), rtol=1e-12)
    with pytest.raises(sst_pin.errors.UnknownNameError, match="body 'roker'"):
        chain.dynamic_parameters.scale_mass("roker", 2.0)

# SPDX-License-Identifier: BSD-2-Clause
"""Examples of Modelica's library and pendulums of Chrono's tests against what these print."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from tests.gallery import published_motions
from tests.gallery import standard_referees as referees

modelica = cache(published_motions.modelica)
chrono = cache(published_motions.chrono)
MODELICA = ("Revolute", "Prismatic", "Spherical", "Universal", "Engine1a", "Fourbar2")
CHRONO = tuple(published_motions.PUBLISHED["chrono"])
#: Modelica's results have a tolerance of 1e-6 for each step: 1e-5 after the first second.
FIRST_SECOND = 2e-5
#: ADAMS' tables of one pendulum (Revolute 1, Spherical 1) differ by 2e-5 m and 3e-4 N at 1 s, by
#: 6e-4 m and 1.5e-3 N later.
ADAMS_AT_FIRST, ADAMS = (3e-5, 6e-4), (7e-4, 2e-3)


@pytest.mark.parametrize("name", [*MODELICA, "GearConstraint"])
def test_the_first_second_of_modelicas_examples(name):
    """All joints that the examples test are closures here."""
    motion = modelica()[name]
    result = motion.simulate(end=1.0)
    assert_allclose(result, motion.values[: len(result)], rtol=0, atol=FIRST_SECOND)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELICA)
def test_the_end_of_modelicas_examples(name):
    """Dymola's steps of 1e-6 add up; its Fourbar2 is off by 8e-4 rad, as the next test shows."""
    motion = modelica()[name]
    assert_allclose(motion.simulate(), motion.values, rtol=0, atol=2e-3)


@pytest.mark.slow
def test_the_energy_of_fourbar2_gives_its_angle():
    motion = modelica()["Fourbar2"]
    angle = referees.modelica_four_bar(np.array([0, *motion.times]), rod=False)[1:]
    assert_allclose(motion.simulate()[:, 0], angle, rtol=0, atol=1e-8)


def test_the_gear_turns_as_its_integral_says():
    """Two cylinders of m r^2 / 2 on a torque 2 sin(2 pi t): 20 / I (t / w - sin(w t) / w^2)."""
    fast, slow = (7700 * np.pi * r**2 * 0.4 * r**2 / 2 for r in (0.05, 0.1))
    w, inertia = 2 * np.pi, 100 * fast + slow
    motion = modelica()["GearConstraint"]
    t = np.array(motion.times)
    angle = 20 / inertia * (t / w - np.sin(w * t) / w**2)
    assert_allclose(motion.simulate()[:, 0], angle, rtol=0, atol=1e-9)


def test_the_torque_of_modelicas_planar_loops_is_that_of_their_energy():
    """The reference results of this example hold only the angle that is driven, 0.7 sin(2 pi t)."""
    chain = published_motions.planar_loops()
    t = np.linspace(0, 1, 9)
    angle, w = 0.7 * np.sin(2 * np.pi * t), 2 * np.pi
    rate, acceleration = 0.7 * w * np.cos(w * t), -(w**2) * angle
    q = [chain.assemble({"rev": x}) for x in angle]
    result = chain.compute_torques(q, rate[:, None], acceleration[:, None])[:, 0]
    by_hand = referees.planar_loops(angle, rate, acceleration)
    # Differences of eighth order with steps of 0.01.
    assert_allclose(result, by_hand, rtol=0, atol=1e-9 * np.abs(by_hand).max())


@pytest.mark.parametrize("name", ["Distance 1", "Universal 3", "Prismatic 3"])
def test_pendulums_and_their_forces_are_where_adams_has_them_at_first(name):
    motion = chrono()[name]
    result = motion.simulate(end=1.1)
    place, force = ADAMS_AT_FIRST
    assert_allclose(result[0, :3], motion.values[0, :3], rtol=0, atol=place)
    assert_allclose(result[0, 3:], motion.values[0, 3:], rtol=0, atol=force)


@pytest.mark.slow
@pytest.mark.parametrize("name", CHRONO)
def test_pendulums_and_their_forces_are_where_adams_has_them(name):
    motion = chrono()[name]
    result = motion.simulate()
    place, force = ADAMS
    assert_allclose(result[:, :3], motion.values[:, :3], rtol=0, atol=place)
    assert_allclose(result[:, 3:], motion.values[:, 3:], rtol=0, atol=force)


@pytest.mark.parametrize("name", ["Revolute 1", "Cylindrical 2", "Spherical 1"])
def test_four_joints_make_one_pendulum(name):
    """Its equation: (I + m l^2) x'' = -m g l cos x, from the horizontal."""

    def slope(_, x):
        return [x[1], -published_motions.GRAVITY * 2 * np.cos(x[0]) / (0.1 + 4)]

    exact = solve_ivp(slope, (0, 1), [0.0, 0.0], "DOP853", rtol=1e-13, atol=1e-13).y[0, -1]
    motion = chrono()[name]
    x, _, z = motion.simulate(end=1.0)[0, :3]
    assert_allclose([x, z], [2 * np.cos(exact), 2 * np.sin(exact)], rtol=0, atol=1e-8)

# SPDX-License-Identifier: BSD-2-Clause
"""Kernels, CasADi and exported C judge motors and masses as the reference path does."""

from itertools import product

import numpy as np
import pytest

from sst_pin.errors import SingularConfigurationError
from tests.support.exported_c import Exported
from tests.support.motor_cases import (
    at_angle,
    elbows,
    held_not,
    in_mode,
    lift,
    slider_crank,
    two_modes,
)

SINGULAR = 2


@pytest.fixture
def exported(tmp_path):
    """Functions of a chain by exported C."""
    return lambda chain: Exported(chain, tmp_path, "double")


def test_a_motor_that_acts_in_one_assembly_mode_only_acts_there_on_every_path(exported):
    """The kernels are made in the mode of the parallelogram, where the disc does not turn."""
    chain, compiled = two_modes(), two_modes()
    compiled.compile()
    functions, in_c = chain.casadi(), exported(chain)
    va, aa = np.array([0.3, 0.4]), np.array([1.0, 2.0])
    for crank, crossed in product((0.3, 0.8, 1.3), (False, True)):
        q = in_mode(crank, crossed=crossed)
        A, f = chain.actuator_jacobian(q).T, chain.generalized_forces(q, va, aa)
        assert (abs(A[1, 0]) > 0.01) == crossed
        code, tau = in_c("torques", 2, q, va, aa)
        assert code == 0
        result = [tau, functions.torques(q, va, aa).full().ravel()]
        result += [robot.compute_torques(q, va, aa) for robot in (chain, compiled)]
        for each in result:
            assert A @ each == pytest.approx(f, rel=1e-10)


def test_small_shares_of_motors_that_pull_at_heavy_and_light_joints_count(exported):
    """On a lift of 1e5 kg with bars of a gram, where motors pull at both by unlike shares."""
    share = 1e-7
    both = [{"lift": 1e3, "crank": share}, {"lift": 1e3, "rocker": -share}, "coupler", "lift"]
    chain, compiled = lift(1e5, 1e-3, both), lift(1e5, 1e-3, both)
    compiled.compile()
    q, rest = chain.generic_configuration(), np.zeros(2)
    A, f = chain.actuator_jacobian(q).T, chain.generalized_forces(q, rest, rest)
    code, in_c = exported(chain)("torques", 4, q, rest, rest)
    assert code == 0
    result = [in_c, chain.casadi().torques(q, rest, rest).full().ravel()]
    result += [robot.compute_torques(q, rest, rest) for robot in (chain, compiled)]
    for tau in result:
        assert A @ tau == pytest.approx(f, rel=1e-12)


def test_casadi_tells_where_the_motors_do_not_hold_the_robot(exported):
    """And not where torques balance each other, with bars of a gram on a lift of 1e5 kg."""
    chain = elbows()
    bad, good = held_not(chain)
    va, aa = np.array([0.3, -0.2]), np.array([1.0, -2.0])
    functions = chain.casadi()
    for q, sound in ((good, True), (bad, False)):
        assert (float(functions.check(q)) <= 1) == sound
        assert (float(functions.torques_check(q, va, aa)) <= 1) == sound
    assert exported(chain)("torques", 2, bad, va, aa)[0] == SINGULAR
    chain = lift(1e5, 1e-3)
    assert float(chain.casadi().torques_check(chain.generic_configuration(), va, aa)) <= 1


def test_a_pose_in_which_a_coordinate_moves_no_mass_is_refused(exported):
    reference, compiled = slider_crank(), slider_crank()
    compiled.compile(derivatives=True)
    in_c = exported(reference)
    for angle in (0.0, 1e-200, 1e-15, 1e-12, np.pi):
        q = at_angle(angle)
        for chain in (reference, compiled):
            with pytest.raises(SingularConfigurationError, match="moves no mass"):
                chain.compute_accelerations(q, [0.3], [0.1])
            with pytest.raises(SingularConfigurationError, match="moves no mass"):
                chain.acceleration_derivatives(q, [0.3], [0.1])
        assert in_c("accelerations", 1, q, [0.3], [0.1])[0] == SINGULAR
    q = at_angle(1e-6)
    for chain in (reference, compiled):
        aa = chain.compute_accelerations(q, [0.3], [0.1])
        assert in_c("accelerations", 1, q, [0.3], [0.1])[1] == pytest.approx(aa, rel=1e-9)
        assert chain.generalized_forces(q, [0.3], aa) == pytest.approx([0.1], rel=1e-6)

# SPDX-License-Identifier: BSD-2-Clause
"""The natural orthogonal complement against virtual work, which shares no formula with it."""

import numpy as np
import pytest
from numpy.typing import NDArray

import sst_pin
from tests.referees.virtual_work import VirtualWork
from tests.support.sampling import random_parameters, random_states

Array = NDArray[np.float64]

#: Two ways to the same numbers differ by rounding times the square of the condition number, which
#: random_state keeps below 30; the worst of 4500 motions of 150 robots was 2e-12.
ROUNDING = 2e-11


def relative_error(values: Array, reference: Array) -> float:
    """The largest error of any sample, by the size of that sample."""
    error = np.linalg.norm(values - reference, axis=-1)
    return float((error / np.linalg.norm(reference, axis=-1)).max())


@pytest.mark.parametrize("seed", range(8))
def test_torques_and_accelerations_of_any_robot_agree(seed: int) -> None:
    """Odd geometry, nine different bodies, tilted gravity, friction in all joints, loads.

    On every branch: the antipodal choice of R_k moves the links to the other side.
    """
    rng, branch = np.random.default_rng(100 + seed), sst_pin.BRANCHES[seed]
    parameters = random_parameters(rng, friction=seed % 2 == 0)
    robot, referee = sst_pin.SST(parameters), VirtualWork(parameters, branch)
    R, omega, alpha = random_states(robot, rng, 10)
    moment, torques = rng.normal(scale=5, size=(10, 3)), rng.normal(scale=20, size=(10, 3))
    motion = robot.joint_motion(R, omega, alpha, branch=branch)
    tau = robot.compute_torques(*motion, platform_moment=moment)
    assert relative_error(tau, referee.torques(R, omega, alpha, moment)) < ROUNDING
    alpha = referee.accelerations(R, omega, torques, moment)
    q, va, aa = robot.joint_motion(R, omega, alpha, branch=branch)
    wanted = robot.compute_accelerations(q, va, torques, platform_moment=moment)
    assert relative_error(aa, wanted) < ROUNDING

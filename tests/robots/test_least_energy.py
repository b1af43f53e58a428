# SPDX-License-Identifier: BSD-2-Clause
"""The example of the delta's pick and place of least energy."""

import numpy as np
import pytest

from collocation import DEGREE
from least_energy import PICK, PLACE, energy, energy_of_held, ground, least, plain, robot, simulated


@pytest.mark.slow
def test_least_energy_is_less_than_the_plain_motions_and_its_work_is_potential_energy():
    """Rest to rest without friction: the mechanical work is the change of potential energy."""
    chain = robot()
    solution = least(chain, 8)
    motion = simulated(chain, solution, 10)
    total, copper = energy_of_held(chain, solution)
    before, lost = energy(plain(chain, np.linspace(0, 1, 201)))
    assert total < 0.5 * before
    ends = chain.potential_energy(solution.q[[0, -1]])
    # To what the collocation, or Simpson's rule, makes of some 0.3 J that go to and fro.
    assert total - copper == pytest.approx(ends[1] - ends[0], abs=1e-5)
    assert before - lost == pytest.approx(ends[1] - ends[0], abs=1e-5)
    assert np.abs(motion.q[10::10] - solution.q[DEGREE::DEGREE]).max() < 1e-3
    assert np.abs([chain.residual(q) for q in solution.q]).max() < 1e-7


def test_the_plain_motion_clears_the_ground_and_comes_to_rest():
    """Its accelerations are those of its rates, by differences of second order."""
    chain = robot()
    motion = plain(chain, np.linspace(0, 1, 41))
    p = chain.platform_pose(motion.q)[:, :3, 3]
    np.testing.assert_allclose(p[[0, -1]], [PICK, PLACE], atol=1e-12)
    assert (p[:, 2] - PICK[2] - ground(p[:, 0])).min() > -1e-9
    np.testing.assert_allclose(motion.va[[0, -1]], 0, atol=1e-12)
    slopes = np.gradient(motion.va, motion.t, axis=0)[1:-1]
    assert np.abs(slopes - motion.aa[1:-1]).max() < 0.05 * np.abs(motion.aa).max()

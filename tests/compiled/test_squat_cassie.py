# SPDX-License-Identifier: BSD-2-Clause
"""The example in which Cassie squats, with contact forces among the controls."""

import numpy as np
import pytest

from tests.support.files import load

crocoddyl = pytest.importorskip("crocoddyl", reason="crocoddyl is not installed (extra 'optimal')")
pytest.importorskip("qpsolvers", reason="qpsolvers is not installed")
example = load("examples/squat_cassie.py")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*its friction acts about each axis")
def test_crocoddyl_differentiates_the_squat_as_we_do():
    """Its forward differences along its moves of our state, contact forces among the controls."""
    chain = example.robot()
    q = example.standing(chain)
    torques, forces = example.stance(chain, q)
    state, controls = example.FloatingState(chain, q), np.append(torques, forces)
    model = example.Squat(state, state.zero(), 1.0, controls, chain)
    random = np.random.default_rng(0)
    x = state.integrate(state.zero(), 0.05 * random.normal(size=2 * state.n))
    u = controls + random.normal(size=len(controls))
    data, differences = model.createData(), crocoddyl.DifferentialActionModelNumDiff(model)
    numbers = differences.createData()
    for side, computed in ((model, data), (differences, numbers)):
        side.calc(computed, x, u)
        side.calcDiff(computed, x, u)
    # One-sided, with steps of 1e-8 or so.
    np.testing.assert_allclose(data.Fx, numbers.Fx, atol=1e-6 * np.abs(data.Fx).max())
    np.testing.assert_allclose(data.Fu, numbers.Fu, atol=1e-6 * np.abs(data.Fu).max())
    np.testing.assert_allclose(data.Lx, numbers.Lx, atol=1e-5 * np.abs(data.Lx).max())

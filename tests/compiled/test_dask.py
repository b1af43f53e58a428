# SPDX-License-Identifier: BSD-2-Clause
"""Torques of any robot over Dask's blocks, in threads and in processes."""

from pathlib import Path

import numpy as np
import pytest

import sst_pin
from tests.support.files import load

da = pytest.importorskip("dask.array", reason="dask is not installed (extra 'dev')")
EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.slow
def test_a_sweep_over_a_hundred_million_samples_is_lazy_and_its_blocks_are_right(robot):
    """Defined at once, computed block by block: two of four hundred blocks against NumPy."""
    example = load("examples/dask_sweep.py")

    samples = 100_000_000
    tau = example.sweep(robot, example.circle(robot, samples), samples, 250_000)
    assert isinstance(tau, da.Array)
    assert tau.shape == (100_000_000, 3)
    assert tau.numblocks == (400, 1)
    some = tau.blocks[[0, 399]][::50_000].compute(scheduler="threads")
    for row, i in ((0, 0), (9, 99_950_000)):
        R, omega, alpha = sst_pin.paper_circle(i / samples * np.pi / 6)
        speed = 0.5 + 0.01 * (i % 100)
        expected = robot.compute_torques(*robot.joint_motion(R, omega * speed, alpha * speed**2))
        assert np.abs(some[row] - expected).max() < 1e-12


def test_chunked_states_give_the_torques_of_whole_arrays(robot):
    """apply_gufunc over two leading axes, chunks that do not fit vectors."""
    t = np.linspace(0, 0.5, 60).reshape(4, 15)
    q, va, aa = robot.joint_motion(*sst_pin.paper_circle(t))
    lazy = [da.from_array(np.ascontiguousarray(x), chunks=(3, 7, -1)) for x in (q, va, aa)]
    tau = da.apply_gufunc(robot.compute_torques, "(q),(m),(m)->(m)", *lazy, output_dtypes=float)
    assert np.array_equal(tau.compute(), robot.compute_torques(q, va, aa))

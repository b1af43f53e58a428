# SPDX-License-Identifier: BSD-2-Clause
"""Torques of any robot over Dask's blocks, in threads and in processes."""

import numpy as np
import pytest

import sst_pin

da = pytest.importorskip("dask.array", reason="dask is not installed (extra 'dev')")


def test_chunked_states_give_the_torques_of_whole_arrays(robot):
    """apply_gufunc over two leading axes, chunks that do not fit vectors."""
    t = np.linspace(0, 0.5, 60).reshape(4, 15)
    q, va, aa = robot.joint_motion(*sst_pin.paper_circle(t))
    lazy = [da.from_array(np.ascontiguousarray(x), chunks=(3, 7, -1)) for x in (q, va, aa)]
    tau = da.apply_gufunc(robot.compute_torques, "(q),(m),(m)->(m)", *lazy, output_dtypes=float)
    assert np.array_equal(tau.compute(), robot.compute_torques(q, va, aa))

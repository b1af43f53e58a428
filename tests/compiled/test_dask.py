# SPDX-License-Identifier: BSD-2-Clause
"""Torques of any robot over Dask's blocks, in threads and in processes."""

import os
from pathlib import Path

import numpy as np
import pytest

import sst_pin
from sst_pin.compiled import libraries
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


@pytest.mark.slow
def test_worker_processes_load_the_kernels_of_a_compiled_robot(monkeypatch, tmp_path):
    """Two of them: the hexapod goes there pickled, its kernels come from the cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # other tests write to the user's own
    distributed = pytest.importorskip("dask.distributed", reason="needs distributed, extra 'dev'")
    example = load("examples/dask_sweep.py")

    robot, samples = sst_pin.robots.stewart(), 1000
    robot.compile()
    states = example.grid(robot, samples)
    lazy = example.sweep(robot, states, samples, 250)
    expected = robot.compute_torques(*states(np.arange(samples)))
    before = kept()
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(EXAMPLES), str(EXAMPLES.parent)]))
    with (
        distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        tau = lazy.compute(scheduler=client)
        said = client.run(_path, robot)
    assert np.array_equal(tau, expected)
    assert len(said) == 2
    assert all(path.startswith("compiled kernels") for path in said.values())
    assert kept() == before


def kept():
    """Files in the cache, each once: one made again would be another."""
    return {entry.path.name: entry.path.stat().st_ino for entry in libraries.cached()}


def _path(robot):
    """What computes in a worker."""
    robot.compute_torques(robot.home, *np.zeros((2, robot.degrees_of_freedom)))
    return robot.path

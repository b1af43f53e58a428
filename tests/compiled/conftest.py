# SPDX-License-Identifier: BSD-2-Clause
"""Devices of NVIDIA Warp."""

import pytest


@pytest.fixture
def quickly_compiled(monkeypatch):
    """Warp does not optimise: the results are the same, and code compiles in half the time."""
    wp = pytest.importorskip("warp", reason="needs the extra 'gpu'")
    monkeypatch.setattr(wp.config, "optimization_level", 0)


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def device(request):
    """Each device; without a GPU its tests are skipped."""
    wp = pytest.importorskip("warp", reason="needs the extra 'gpu'")
    if request.param == "cpu":
        request.getfixturevalue("quickly_compiled")
    elif not wp.get_cuda_device_count():
        pytest.skip("no CUDA device")
    return request.param

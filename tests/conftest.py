# SPDX-License-Identifier: BSD-2-Clause
"""Fixtures of many tests."""

import numpy as np
import pytest

import sst_pin
from tests.support.sampling import random_parameters


@pytest.fixture(scope="session")
def robot():
    """The paper's robot."""
    return sst_pin.SST()


@pytest.fixture(scope="session")
def compiled_robot(cache_of_the_run):
    """The paper's robot by kernels."""
    robot = sst_pin.SST()
    robot.compile(robot.home)
    return robot


@pytest.fixture
def kernels_at_their_first_use(monkeypatch):
    """`compile` makes no kernels ahead: a test compiles only those that it uses."""
    monkeypatch.setattr("sst_pin.compiled.compiled_backend.FIRST", ())


@pytest.fixture(scope="session", params=range(2))
def odd(request):
    """An SST far from the paper's, friction in all joints."""
    return sst_pin.SST(random_parameters(np.random.default_rng(request.param)))


@pytest.fixture(scope="module")
def chromium():
    """A Chromium, started once for a module; without one its tests are skipped."""
    from sst_pin.viewer import pictures
    from tests.support.browser import MISSING

    if MISSING:
        pytest.skip(MISSING)
    with pictures.browser() as browser:
        yield browser


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder, the working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path

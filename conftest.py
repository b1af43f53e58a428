# SPDX-License-Identifier: BSD-2-Clause
"""What the tests and the examples of docstrings share."""

import os

# Each worker has a core: matrices as small as these only wait for threads. Before NumPy's import.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

#: Modules whose examples draw, or take seconds.
SLOW = (
    "sst_pin.plots",
    "sst_pin.viewer",
    "sst_pin.identification",
    "sst_pin.control.force_observer",
    "sst_pin.control.timing",
    "sst_pin.simulation.energy",
)


def pytest_collection_modifyitems(items):
    for item in items:
        if isinstance(item, pytest.DoctestItem):
            warnings = "default::sst_pin.errors.SingularityWarning"
            item.add_marker(pytest.mark.filterwarnings(warnings))
            if item.name.startswith(SLOW):
                item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session", autouse=True)
def cache_of_the_run(tmp_path_factory):
    """Compiled kernels are in a folder of their own, shared by the workers of one run."""
    base = tmp_path_factory.getbasetemp()
    folder = base.parent if base.name.startswith("popen-") else base
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        yield folder / "cache"


@pytest.fixture(autouse=True)
def names_of_examples(request):
    """What an example of a docstring may use; the pages of the reference say so."""
    if not isinstance(request.node, pytest.DoctestItem):
        return
    import pinocchio as pin

    import sst_pin

    request.getfixturevalue("monkeypatch").chdir(request.getfixturevalue("tmp_path"))
    names = {"np": np, "pin": pin, "sst_pin": sst_pin}
    names |= {"robot": sst_pin.SST(), "chain": (chain := sst_pin.robots.four_bar())}
    if request.node.name.startswith(("sst_pin.plots", "sst_pin.viewer")):
        from matplotlib.figure import Figure

        from sst_pin import plots
        from sst_pin.viewer import Viewer

        motion = chain.simulate([0], chain.home, [0], np.linspace(0, 0.1, 11))
        names |= {"Figure": Figure, "Viewer": Viewer, "plots": plots, "motion": motion}
        names |= {"ax": Figure().add_subplot(), "viewer": Viewer(chain)}
    request.getfixturevalue("doctest_namespace").update(names)

# SPDX-License-Identifier: BSD-2-Clause
"""Controllers, abilities of poses and views of linkages refuse bad arguments."""

import inspect

import numpy as np
import pytest

import sst_pin
from tests.support.bad_calls import faults

CHAIN = sst_pin.robots.five_bar()
VIEW = sst_pin.SerialView(sst_pin.robots.knee(), ["knee"])
T, TWO = np.linspace(0, 0.1, 6), np.ones(2)
MOTION = sst_pin.coordinate_motion(CHAIN, T, CHAIN.home[[0, 2]] + 0.1 * T[:, None], CHAIN.home)
GOOD = dict.fromkeys(("kp", "kd", "R", "stiffness", "damping", "limits", "va"), TWO)
GOOD |= {"chain": CHAIN, "motion": MOTION, "Q": np.ones(4), "learning": 1.0, "q": CHAIN.home}
GOOD |= {"frame": CHAIN.model.frames[-1].name, "torques": 60 * TWO, "x": [0.1, 0.2]}
GOOD |= {"wrench": np.ones(6), "start": CHAIN.home, "path": MOTION.q, "rates": 50 * TWO}
GOOD |= {"accelerations": 500 * TWO, "dt": 0.01}
OF_VIEW = dict.fromkeys(("positions", "rates", "tau", "torques", "gains", "limits"), np.ones(1))
OF_VIEW |= {"q": VIEW.chain.home, "start": VIEW.chain.home, "chain": VIEW.chain, "joints": ["knee"]}
NAMES = "ComputedTorque GravityPD TrackingLQR force_ellipsoid force_polytope "
NAMES += "acceleration_ellipsoid acceleration_polytope reach_map time_optimal"
CALLS = {name: (getattr(sst_pin, name), GOOD) for name in NAMES.split()}
CALLS["ForceObserver"] = sst_pin.control.ForceObserver, GOOD | {"gain": 20.0}
CALLS["SerialView"] = sst_pin.SerialView, OF_VIEW
CALLS |= {
    name: (method, OF_VIEW)
    for name, method in inspect.getmembers(VIEW, inspect.ismethod)
    if not name.startswith("_") and name != "compile"
}


@pytest.mark.parametrize("name", CALLS)
def test_functions_refuse_bad_arguments(name):
    assert faults(*CALLS[name]) == []

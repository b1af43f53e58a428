# SPDX-License-Identifier: BSD-2-Clause
"""Functions of identification refuse bad arguments."""

from functools import cache

import numpy as np
import pytest

import sst_pin
from sst_pin import identification
from tests.support.bad_calls import faults


@cache
def good_arguments():
    chain, t = sst_pin.robots.four_bar(), np.linspace(0, 1, 60)
    motion = sst_pin.coordinate_motion(chain, t, chain.home[0] + 0.3 * np.sin(t)[:, None])
    q, va, aa = identification.random_states(chain, 30)
    good = {"chain": chain, "base": identification.base_parameters(chain), "q": q, "va": va}
    good |= {"aa": aa, "tau": chain.compute_torques(q, va, aa), "motion": motion, "t": t}
    good |= {"x": motion.q[:, :1], "theta": chain.dynamic_parameters, "cutoff": 5.0, "count": 5}
    good["found"] = identification.estimate(chain, good["base"], q, va, aa, good["tau"])
    good |= {"unseen": motion, "measurements": []}
    return good | {"duration": 2.0, "frame": "coupler", "poses": np.zeros((60, 3))}


NAMES = "base_parameters calibrate condition_number estimate excitation measured_motion "
NAMES += "predicted_torques random_states consistent_parameters report calibrate_with"


@pytest.mark.parametrize("name", NAMES.split())
def test_functions_refuse_bad_arguments(name):
    # A motion for base parameters is a tuple of arrays there.
    free = {"motion"} if name == "base_parameters" else ()
    assert faults(getattr(identification, name), good_arguments(), free) == []


@pytest.mark.parametrize("name", ["unknown_base", "unknown_target"])
@pytest.mark.parametrize("value", [None, "no", np.zeros(2)])
def test_what_is_unknown_of_a_measuring_system_is_true_or_false(name, value):
    with pytest.raises(sst_pin.InputError, match=f"^{name}: .* True or False"):
        identification.Heights("coupler", np.zeros((3, 1)), heights=np.zeros(3), **{name: value})

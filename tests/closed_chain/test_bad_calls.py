# SPDX-License-Identifier: BSD-2-Clause
"""Methods of robots refuse bad arguments by an error of ours, on both paths."""

import inspect
from functools import cache

import numpy as np
import pytest

import sst_pin
from sst_pin import ClosedChain
from tests.support.bad_calls import faults

#: Methods that compile, show, read files, or take nothing.
OTHERS = {"from_description", "casadi", "compile", "from_mjcf", "from_urdf"}
OTHERS |= {"generic_configuration", "refresh", "show"}
#: Methods whose own tests refuse what is no name of a parameter or a joint, and no device.
OTHERS |= {"assembly_modes", "design_derivatives", "warp", "with_design"}
#: Texts that may be anything.
FREE = {"stopped"}


#: What kernels of quantities, of derivatives, of reactions and of motions are called by.
COMPILED = ["compute_torques", "torque_derivatives", "reactions", "rollout", "simulate"]
COMPILED += ["singularity_measures"]  # which an SST has in its own way


@cache
def robot(name):
    if name == "SST":
        return sst_pin.SST()
    chain = sst_pin.robots.four_bar()
    chain.compile()
    return chain


@cache
def good_arguments(name):
    chain = robot(name)
    q, t = chain.home, np.linspace(0, 0.002, 3)
    x, motors = np.full(chain.degrees_of_freedom, 0.1), np.full(len(chain.motor_names), 0.1)
    m = chain.simulate(motors, q, x, t)
    good = {"q": q, "va": x, "aa": x, "tau": motors, "torque": motors, "q0": q, "va0": x, "t": t}
    good |= {"dt": 1e-3, "frame": chain.model.frames[-1].name, "motion": m, "weights": motors}
    good |= {"external_wrenches": np.zeros((chain.model.njoints - 1, 6)), "q_dot": 0 * q}
    good |= {"coordinates": chain.coordinates, "theta": chain.dynamic_parameters, "limits": motors}
    good |= {"near": q, "gamma": motors, "branch": np.ones(3), "pose": np.eye(3), "R": np.eye(3)}
    good |= {"omega": x, "alpha": x, "platform_moment": x, "start": q, "rotation": np.eye(3)}
    good |= {"position": np.zeros(3), "positions": dict.fromkeys(chain.coordinates, 0.1)}
    good |= {"names": chain.design_parameters[:1], "changes": {chain.design_parameters[0]: 1e-3}}
    good |= {"position": chain.frame_placement(q, good["frame"])[0]}
    good |= {"model": chain.model}
    special = {"rollout": {"tau": m.tau}}
    special["trajectory"] = {name: getattr(m, name) for name in ("t", "q", "va", "aa", "tau")}
    return good, special


METHODS = [("compiled four-bar", method) for method in COMPILED] + [
    ("SST", method)
    for method, _ in inspect.getmembers(sst_pin.SST, callable)
    if not method.startswith("_") and method not in OTHERS
]


@pytest.mark.parametrize(("name", "method"), METHODS)
def test_methods_refuse_bad_arguments(name, method):
    good, special = good_arguments(name)
    assert faults(getattr(robot(name), method), good | special.get(method, {}), FREE) == []


def test_the_constructor_refuses_bad_arguments():
    chain = sst_pin.robots.four_bar()
    good = {"model": chain.model, "closures": chain.closures, "actuated": ["crank"]}
    arrays = ("viscous_friction", "coulomb_friction", "stiffness", "spring_reference")
    assert faults(ClosedChain, good | dict.fromkeys(arrays, np.ones(3))) == []

# SPDX-License-Identifier: BSD-2-Clause
"""Frames of a closed chain move as their Jacobian and their drift say; motions keep in files."""

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import ClosedChain, Closure
from tests.support.any_chain import tree
from tests.support.differences import derivative

TREES = {
    "floating": ("free-flyer", ["RY", "revolute", "RY"], ["RY", "revolute", "spherical"]),
    "composite": ("", ["composite"], ["translation", "universal", "spherical"]),
    "Euler angles": ("planar", ["universal", "RY"], ["ZYX", "PX", "RUBX"]),
}


def chain_and_state(name):
    model = tree(*TREES[name], seed=3)
    chain = ClosedChain(model, [Closure("A", "B", "3d")], [])
    q = model.referenceConfigurations["closed"]
    random = np.random.default_rng(0)
    va, aa = random.normal(size=(2, chain.mobility(q).degrees_of_freedom))
    chain.joint_rates(q, va)
    return chain, q, va, aa


@pytest.mark.parametrize("name", TREES)
def test_the_frame_jacobian_is_the_rate_of_the_frames_pose(name):
    """Along a motion of the closed loops; its own rate: test_derivatives.py."""
    chain, q, va, _ = chain_and_state(name)
    model, data = chain.model, chain.model.createData()
    tip = model.frames[-1].name
    v = chain.joint_rates(q, va)

    def pose(t):
        pin.framesForwardKinematics(model, data, pin.integrate(model, q, v * t))
        return data.oMf[model.getFrameId(tip)].homogeneous

    twist = chain.frame_jacobian(q, tip) @ va
    rate, R = derivative(pose, 0.003), pose(0)[:3, :3]
    assert np.abs(twist[:3] - rate[:3, 3]).max() < 1e-9
    spin = rate[:3, :3] @ R.T
    assert np.abs(pin.skew(twist[3:]) - spin).max() < 1e-9

# SPDX-License-Identifier: BSD-2-Clause
"""Frames of a closed chain move as their Jacobian and their drift say; motions keep in files."""

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import ClosedChain, Closure
from sst_pin.simulation.trajectories import Trajectory
from tests.support.trees import derivative, tree

TREES = {
    "floating": ("free", ["RX", "revolute", "RZ"], ["RZ", "revolute", "ball"]),
    "composite": ("", ["composite"], ["translation", "universal", "ball"]),
    "Euler angles": ("plane", ["universal", "RX"], ["ZYX", "PX", "RUBY"]),
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


@pytest.mark.parametrize("ending", ["csv", "npz"])
@pytest.mark.parametrize("name", TREES)
def test_motions_with_quaternions_come_back_to_the_last_bit(name, ending, tmp_path):
    chain, q, va, aa = chain_and_state(name)
    near = [
        chain.assemble(pin.integrate(chain.model, q, 0.01 * k * chain.joint_rates(q, va)))
        for k in range(3)
    ]
    names = list(chain.model.names)[-1:]
    driven = ClosedChain(chain.model, chain.closures, names, coordinates=chain.coordinates)
    tau = np.random.default_rng(1).normal(size=(3, len(driven.motor_names)))
    motion = driven.trajectory([0, 0.1, 0.3], near, [va] * 3, [aa] * 3, tau)
    path = tmp_path / f"motion.{ending}"
    motion.save(path)
    back = Trajectory.load(path)
    for field in ("t", "q", "va", "aa", "tau"):
        assert np.array_equal(getattr(back, field), getattr(motion, field))
    for field in ("joint_names", "units", "coordinates", "rate_units"):
        assert getattr(back, field) == getattr(motion, field)
    if ending == "npz":
        assert back == motion

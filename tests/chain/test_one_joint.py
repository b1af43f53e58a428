# SPDX-License-Identifier: BSD-2-Clause
"""The smallest closed chain: a hinge that a redundant closure holds in two places."""

import numpy as np
import pinocchio as pin
from numpy.testing import assert_allclose

from sst_pin import ClosedChain, Closure


def test_one_hinge_held_twice_moves_as_its_tree_does():
    """Every quantity has one column; the closure adds nothing. Bound: rounding."""
    model = pin.Model()
    hinge = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "hinge")
    body = pin.Inertia(2.0, np.array([0.3, 0.1, -0.2]), np.diag([0.1, 0.2, 0.15]))
    model.appendBodyToJoint(hinge, body, pin.SE3.Identity())
    on_axis = pin.SE3(np.eye(3), np.array([0, 0.5, 0]))
    for name, joint in (("A", 0), ("B", hinge)):
        model.addFrame(pin.Frame(name, joint, on_axis, pin.FrameType.OP_FRAME))
    chain = ClosedChain(model, [Closure("A", "B", "3d")], ["hinge"])

    q, va, aa = chain.assemble([0.4]), np.array([1.5]), np.array([-2.0])
    tau = chain.compute_torques(q, va, aa)
    data = model.createData()
    assert_allclose(tau, pin.rnea(model, data, q, va, aa), rtol=1e-14)
    assert_allclose(chain.compute_accelerations(q, va, tau), aa, rtol=1e-13)
    assert_allclose(chain.frame_jacobian(q, "B").ravel(), [0, 0, 0, 0, 1, 0], atol=1e-15)
    by_q, by_v, inertia = pin.computeRNEADerivatives(model, data, q, va, aa)
    d = chain.torque_derivatives(q, va, aa)
    assert_allclose(np.stack([d.dq, d.dva, d.daa]).ravel(), np.ravel([by_q, by_v, inertia]), 1e-13)
    assert chain.noc(q, va).T.shape == (6, 1)

# SPDX-License-Identifier: BSD-2-Clause
"""A spherical 3-RRR whose torques MSC ADAMS 2017.2 computed.

The numbers in `tests/data/adams_spherical_3rrr.npz` are those of SPRs_Dynamic_Model by aras-labs on
GitHub (MIT licence): A. Hassani, A. Bataleblu, S. A. Khalilpour, H. D. Taghirad, P. Cardou, 2021.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin

import sst_pin

DATA = np.load(Path(__file__).parents[1] / "data" / "adams_spherical_3rrr.npz")
BETA = np.arccos(np.sqrt(3) / 3)
LINKS = (
    (0.5012423762, (0, -0.117465246575864, 0.139983998075476),
     (3.3906023479e-3, 3.2718954694e-3, 1.7101532875e-4)),
    (0.3891400595, (0, -0.093540986885397, 0.133590695351393),
     (1.628011789e-3, 1.5834981056e-3, 8.5149842496e-5)),
    (0.6045042773, (0, 0, 0.084583480323),
     (3.7203038672e-3, 1.879213797e-3, 1.8787528739e-3)),
)  # fmt: skip
PROXIMAL, DISTAL, PLATFORM = (
    pin.Inertia(mass, np.array(centre, dtype=float), np.diag(moments))
    for mass, centre, moments in LINKS
)


def turned(x=0.0, y=0.0, z=0.0):
    return pin.SE3(pin.rpy.rpyToMatrix(x, y, z), np.zeros(3))


def spherical_3rrr():
    """Leg 1 carries the platform; hinges close the other legs."""
    model, closures = pin.Model(), []
    model.gravity.linear = np.array([0, 0, -9.80665])
    ends = [turned(z=2 * np.pi / 3 * k) * turned(x=-BETA) for k in range(3)]
    for k in range(3):
        at = turned(z=2 * np.pi / 3 * k) * turned(x=BETA - np.pi)
        motor = model.addJoint(0, pin.JointModelRZ(), at, f"motor_{k}")
        model.appendBodyToJoint(motor, PROXIMAL, pin.SE3.Identity())
        bend = turned(x=np.radians(80))
        elbow = model.addJoint(motor, pin.JointModelRZ(), bend, f"elbow_{k}")
        model.appendBodyToJoint(elbow, DISTAL, pin.SE3.Identity())
        last = turned(x=np.radians(70))
        if k == 0:
            wrist = model.addJoint(elbow, pin.JointModelRZ(), last, "wrist")
            to_platform = ends[0].inverse()
            model.appendBodyToJoint(wrist, PLATFORM, to_platform)
            model.addFrame(pin.Frame("platform", wrist, to_platform, pin.FrameType.OP_FRAME))
        else:
            model.addFrame(pin.Frame(f"end_{k}", elbow, last, pin.FrameType.OP_FRAME))
            eye = to_platform * ends[k]
            model.addFrame(pin.Frame(f"eye_{k}", wrist, eye, pin.FrameType.OP_FRAME))
            closures.append(sst_pin.Closure(f"eye_{k}", f"end_{k}", "hinge"))
    return sst_pin.ClosedChain(model, closures, [f"motor_{k}" for k in range(3)])


def configuration(t):
    """q for the motion of the platform, Rz(x_1) Ry(x_2) Rx(x_3); all psi are positive."""
    x_1, x_2, x_3 = np.radians([10, 30, 20]) * (3 * t**2 - 2 * t**3)
    R = pin.rpy.rpyToMatrix(x_3, x_2, x_1)
    (c_1, s_1), (c_2, s_2) = ((np.cos(a), np.sin(a)) for a in np.radians([80, 70]))
    q = []
    for k in range(3):
        at = turned(z=2 * np.pi / 3 * k)
        motor = (at * turned(x=BETA - np.pi)).rotation
        end = R @ (at * turned(x=-BETA)).rotation
        u = motor.T @ end[:, 2]
        psi = np.arccos((c_1 * c_2 - u[2]) / (s_1 * s_2))
        theta = np.arctan2(u[1], u[0])
        theta -= np.arctan2(-c_1 * s_2 * np.cos(psi) - s_1 * c_2, s_2 * np.sin(psi))
        q += [theta, psi]
        if k == 0:
            bent = turned(z=theta) * turned(x=np.radians(80)) * turned(z=psi)
            last = (bent * turned(x=np.radians(70))).rotation
            turn = last.T @ motor.T @ end
            q.append(np.arctan2(turn[1, 0], turn[0, 0]))
    return np.array(q)


def torques():
    """Motor torques at the times of the data, shape (N, 3), rates by differences."""
    chain, motors, h, tau = spherical_3rrr(), [0, 3, 5], 1e-3, []
    for t in DATA["t"]:
        before, q, after = (configuration(t + step) for step in (-h, 0, h))
        va = (after - before)[motors] / (2 * h)
        aa = (after - 2 * q + before)[motors] / h**2
        tau.append(chain.compute_torques(q, va, aa))
    return np.array(tau)

# SPDX-License-Identifier: BSD-2-Clause
"""The head of a desk robot on six cranks of 40 mm and six rods of 85 mm (6-RSS), at its zero pose.

Points and masses are those of the published model of Reachy Mini.
"""

import numpy as np
import pinocchio as pin
from pinocchio.rpy import rpyToMatrix

import sst_pin

MOTORS = [f"crank_{k}" for k in range(1, 7)]
#: Points of the fourth leg in the base: hinge and end of the crank, end of the rod, [m].
HINGE = np.array([-0.043661, -0.01, 0.076633])
CRANK_END = np.array([-0.036661, -0.05, 0.076633])
ROD_END = np.array([-0.029172, -0.007, 0.149571])
#: Masses [kg] and mass centres [m]; the rod's is in its middle.
CRANK_MASS, CRANK_CENTRE = 0.00366675, np.array([-0.040303, -0.033751, 0.076633])
ROD_MASS = 0.00503424
HEAD_MASS = 0.280444
HEAD_CENTRE = np.array([0.0000245, -0.0008951, 0.2053195])


def desk_head(locked: bool = True) -> sst_pin.ClosedChain:
    """The head on its six legs.

    Each rod has a ball at both ends, so it can spin about itself. `locked` removes these spins. The
    head hangs on the sixth rod, and five closures connect it with the other ones.
    """
    model = pin.Model()
    model.name = "desk_head"
    rod_ends = []
    rod = 0
    for k, motor in enumerate(MOTORS):
        # Legs 4, 6, 2 are turned by 0, 120, -120 degrees; 3, 5, 1 are their mirror images.
        leg = rpyToMatrix(0.0, 0.0, (k // 2 - 1) * 2 * np.pi / 3)
        if k % 2 == 0:
            leg = leg @ np.diag([1.0, -1, 1])
        hinge = _frame(leg @ [1.0, 0, 0], leg @ HINGE)
        ball = _frame(leg @ (ROD_END - CRANK_END), leg @ CRANK_END)
        crank = model.addJoint(0, pin.JointModelRZ(), hinge, motor)
        _add_mass(model, crank, CRANK_MASS, hinge.actInv(leg @ CRANK_CENTRE), 1e-6)
        rod = model.addJoint(crank, pin.JointModelSpherical(), hinge.actInv(ball), f"rod_{k + 1}")
        length = float(np.linalg.norm(ROD_END - CRANK_END))
        _add_mass(model, rod, ROD_MASS, np.array([0, 0, length / 2]), ROD_MASS * length**2 / 12)
        end = pin.SE3(np.eye(3), np.array([0, 0, length]))
        model.addFrame(pin.Frame(f"rod_end_{k + 1}", rod, end, pin.FrameType.OP_FRAME))
        rod_ends.append(leg @ ROD_END)
    on_rod = pin.SE3(ball.rotation.T, np.array([0, 0, length]))  # its axes are those of the base
    head = model.addJoint(rod, pin.JointModelSpherical(), on_rod, "head")
    _add_mass(model, head, HEAD_MASS, HEAD_CENTRE - rod_ends[-1], 3e-4)
    closures = []
    for k, point in enumerate(rod_ends[:-1], start=1):
        place = pin.SE3(np.eye(3), point - rod_ends[-1])
        model.addFrame(pin.Frame(f"head_{k}", head, place, pin.FrameType.OP_FRAME))
        closures.append(sst_pin.Closure(f"rod_end_{k}", f"head_{k}", "3d"))
    model.referenceConfigurations["home"] = pin.neutral(model)
    spins = [f"rod_{k}_wz" for k in range(1, 7)] if locked else []
    return sst_pin.ClosedChain(model, closures, MOTORS, locked=spins)


def _frame(z_axis: np.ndarray, origin: np.ndarray) -> pin.SE3:
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0, 1]), z_axis)
    return pin.SE3(turn.matrix(), origin)


def _add_mass(model: pin.Model, joint: int, mass: float, centre: np.ndarray, moment: float) -> None:
    inertia = pin.Inertia(mass, centre, moment * np.eye(3))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())

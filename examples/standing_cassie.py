# SPDX-License-Identifier: BSD-2-Clause
"""Cassie stands: contact forces of toes and heels with the least torques, by a quadratic programme.

The pelvis floats, so the motors alone cannot bring about a motion: what the robot needs along its
coordinates is f = L^T B tau + sum J_i^T F_i, with f from `generalized_forces`, L from `noc` and J_i
from `frame_jacobian`, all through its closed loops.

pip install 'sst-pin[mjcf]' 'qpsolvers[quadprog]' example-robot-data
python examples/standing_cassie.py
"""

import tempfile
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from qpsolvers import solve_qp
from scipy.optimize import fsolve

import cassie
from sst_pin import ClosedChain

Array = NDArray[np.float64]

CONTACTS = [f"{side}-{end}" for side, end in product(("left", "right"), cassie.FOOT)]
FRICTION = 0.6
#: Weight of squared contact forces beside squared torques, [m^2]: makes them unique.
OF_FORCES = 1e-4


class Stance(NamedTuple):
    """How it stands.

    Attributes:
        torques: Torques of the motors, shape (10,), [N m].
        forces: Forces of the ground on toes and heels, base axes, shape (4, 3), [N].
    """

    torques: Array
    forces: Array


def robot() -> ClosedChain:
    """Cassie with a floating pelvis, its springs stiff, its rods without spin."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cassie.xml"
        path.write_text(cassie.mjcf())
        held = [name for name in cassie.HELD if name != "pelvis"]
        return ClosedChain.from_mjcf(path, locked=held)


def standing(chain: ClosedChain) -> Array:
    """A configuration with level soles under the mass centre, shape (nq,)."""
    model, data = chain.model, chain.model.createData()
    moved = [f"{side}-{joint}-op" for side in ("left", "right") for joint in ("pitch", "foot")]
    at = [model.joints[model.getJointId(name)].idx_q for name in moved]
    start = chain.assemble(pin.neutral(model))

    def closed(angles: Array) -> Array:
        q = start.copy()
        q[at] = angles
        return chain.assemble(q, fixed=chain.motor_names)

    def off(angles: Array) -> Array:
        q = closed(angles)
        centre = pin.centerOfMass(model, data, q)
        pin.framesForwardKinematics(model, data, q)
        soles = np.array([data.oMf[model.getFrameId(name)].translation for name in CONTACTS])
        toes, heels = soles[::2], soles[1::2]
        return np.concatenate([(toes + heels)[:, 0] / 2 - centre[0], (toes - heels)[:, 2]])

    return closed(fsolve(off, start[at]))


def stance(chain: ClosedChain, q: Array) -> Stance:
    """Least squared torques, and contact forces within their cones of friction."""
    n = chain.degrees_of_freedom
    motors = len(chain.motor_names)
    rest = np.zeros(n)
    of_motors = chain.noc(q, rest).L[list(chain.motor_indices)].T
    of_contacts = [chain.frame_jacobian(q, name)[:3].T for name in CONTACTS]
    x, y, z = np.eye(3)
    sides = FRICTION / np.sqrt(2) * z  # four planes inside the cone
    cone = np.array([x - sides, -x - sides, y - sides, -y - sides])
    weights = np.concatenate([np.ones(motors), np.full(3 * len(CONTACTS), OF_FORCES)])
    found = solve_qp(
        np.diag(weights),
        np.zeros(len(weights)),
        G=np.hstack([np.zeros((16, motors)), np.kron(np.eye(len(CONTACTS)), cone)]),
        h=np.zeros(16),
        A=np.hstack([of_motors, *of_contacts]),
        b=chain.generalized_forces(q, rest, rest),
        solver="quadprog",
    )
    if found is None:
        raise ValueError("no contact forces within the cones hold the robot: move its feet")
    return Stance(found[:motors], found[motors:].reshape(-1, 3))


def contact_wrenches(chain: ClosedChain, q: Array, forces: Array) -> Array:
    """On each body at its mass centre, [force; moment], base axes, shape (bodies, 6)."""
    model, data = chain.model, chain.model.createData()
    pin.framesForwardKinematics(model, data, q)
    wrenches = np.zeros((model.njoints - 1, 6))
    for name, force in zip(CONTACTS, forces, strict=True):
        frame = model.getFrameId(name)
        joint = model.frames[frame].parentJoint
        centre = data.oMi[joint].act(model.inertias[joint].lever)
        arm = data.oMf[frame].translation - centre
        wrenches[joint - 1] += np.concatenate([force, np.cross(arm, force)])
    return wrenches


if __name__ == "__main__":
    chain = robot()
    q = standing(chain)
    torques, forces = stance(chain, q)
    for name, torque in zip(chain.motor_names, torques, strict=True):
        print(f"{name:16} {torque:8.2f} N m")
    for name, force in zip(CONTACTS, forces, strict=True):
        print(f"{name:16} {force[0]:8.2f} {force[1]:8.2f} {force[2]:8.2f} N")

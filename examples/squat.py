# SPDX-License-Identifier: BSD-2-Clause
"""What a serial model of a leg with a parallel ankle and a four-bar knee gets wrong.

The leg squats in the air. The exact motor torques come from all loops. The serial models know the
four hinges hip, knee, ankle pitch and ankle roll, and map their torques to the motors.

    python examples/squat.py
"""

import numpy as np

import sst_pin

JOINTS = ("hip", "knee", "ankle_pitch", "ankle_roll")
#: Rotors of the four motors as seen at their cranks, [kg m^2].
ROTORS = 0.06, 0.08, 0.03, 0.03
#: Squats per second, and how far the foot rises, [m].
RATE, DEPTH = 1.0, 0.3


def leg_with_rotors():
    """The leg of the gallery with rotors."""
    leg = sst_pin.robots.leg()
    armature = np.zeros(leg.model.nv)
    armature[leg.motor_indices] = ROTORS
    leg.model.armature = armature
    leg.refresh()
    return leg


def serial_tree(leg):
    """The four hinges alone: cranks and rods are parts of the bodies that carry them."""
    frozen = [name for name in leg.joint_names if name not in JOINTS]
    return sst_pin.ClosedChain(leg.model, [], JOINTS, locked=frozen)


def squat(leg, view, samples=400):
    """One squat of the joints: positions, rates and accelerations, shape (samples, 4) each."""
    t = np.linspace(0, 1 / RATE, samples)
    height = -0.95 * 0.8 + DEPTH * (1 - np.cos(2 * np.pi * RATE * t)) / 2
    poses = np.tile(np.eye(4), (samples, 1, 1))
    poses[:, 2, 3] = height
    q = leg.inverse_kinematics(poses)
    return sst_pin.coordinate_motion(view.chain, t, view.joint_positions(q), q[0])


def errors():
    """For each shortcut the RMS error of the motors' torques over the RMS of the exact ones."""
    leg = leg_with_rotors()
    view = sst_pin.SerialView(leg, JOINTS)
    motion = squat(leg, view)
    exact = motion.tau
    tree = serial_tree(leg)
    x = view.joint_positions(motion.q)
    of_tree = tree.generalized_forces(x, motion.va, motion.aa)
    lacking = view.inertia(motion.q) - tree.reduced_terms(x, motion.va).inertia
    armature = np.einsum("ii->i", lacking[0])
    there = np.repeat(motion.q[:1], len(x), axis=0)  # the Jacobian of the first pose throughout
    with_matrix = of_tree + np.einsum("bij,bj->bi", lacking, motion.aa)
    whole = view.chain.generalized_forces(motion.q, motion.va, motion.aa)
    models = {
        "constant Jacobian": view.motor_torques(there, of_tree),
        "Jacobian": view.motor_torques(motion.q, of_tree),
        "Jacobian, constant armature": view.motor_torques(motion.q, of_tree + armature * motion.aa),
        "Jacobian, full matrix": view.motor_torques(motion.q, with_matrix),
        "all terms": view.motor_torques(motion.q, whole),
    }
    size = np.sqrt((exact[:, :3] ** 2).mean(axis=0))
    return {
        name: np.sqrt(((tau - exact)[:, :3] ** 2).mean(axis=0)) / size
        for name, tau in models.items()
    }


if __name__ == "__main__":
    print(f"{'serial model':30}{'hip':>9}{'knee':>9}{'ankle':>9}")
    for name, relative in errors().items():
        print(f"{name:30}" + "".join(f"{100 * x:8.1f}%" for x in relative))

# SPDX-License-Identifier: BSD-2-Clause
"""A gripper of two parallelograms holds a ball by dry friction.

One motor turns both fingers by gears. The pads are planes that stay parallel and touch the ball.
By hand, the ball stays where it is in the pads while its upward acceleration is below

    2 mu N / m - g,    N = (tau +- 2 F) / (2 l)

with the motor's torque tau, the dry friction F of each crank and the cranks' length l. The wrist
lifts the ball gently, then so fast that the ball slips, and then the gripper opens.

    python examples/gripper.py gripper.png gripper.html
"""

import sys

import numpy as np
import pinocchio as pin

import sst_pin
from sst_pin import Closure, Contact, Coupling

#: Radius and mass of the ball, its friction on the pads, [m], [kg].
RADIUS, MASS, FRICTION = 0.03, 0.2, 0.5
#: Crank, distance of the two cranks of a finger, and of the fingers' first cranks, [m].
CRANK, APART, PALM = 0.08, 0.04, 0.12
#: Torque of the motor, and dry friction of each first crank, [N m].
GRIP, DRY = 0.8, 0.05
#: The cranks turn up to a stop, [rad].
STOP = 0.5
#: Step, [s]; times of squeezing, of a lift, and of resting after it, [s]; heights of lifts, [m].
STEP, SQUEEZE, MOVE, REST, HEIGHTS = 5e-4, 0.1, 0.2, 0.15, (0.05, 0.2)
#: Time for the ball's fall after the gripper has opened, [s].
FALL = 0.35
#: Gains of the wrist's motor, [N/m], [N s/m].
STIFFNESS, DAMPING = 2e4, 400.0


def gripper():
    """The gripper, and the configuration with the ball between the pads, on a table."""
    model = pin.Model()
    model.name = "gripper"
    wrist = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "wrist")
    model.appendBodyToJoint(wrist, pin.Inertia.FromBox(0.5, PALM, 0.04, 0.02), pin.SE3.Identity())
    closures = []
    q = [0.0]
    for side, sign in (("left", -1), ("right", 1)):
        joints = {}
        for name, parent, at, length in (
            ("inner", wrist, (sign * (PALM - APART) / 2, 0, 0), CRANK),
            ("finger", "inner", (0, 0, -CRANK), CRANK),
            ("outer", wrist, (sign * (PALM + APART) / 2, 0, 0), CRANK),
        ):
            place = pin.SE3(np.eye(3), np.array(at, dtype=float))
            joint = model.addJoint(
                joints.get(parent, parent), pin.JointModelRY(), place, f"{side}_{name}"
            )
            body = pin.Inertia.FromBox(0.05, 0.01, 0.01, length)
            centre = pin.SE3(np.eye(3), np.array([0, 0, -length / 2]))
            model.appendBodyToJoint(joint, body, centre)
            joints[name] = joint
        _frame(model, f"{side}_pin", joints["finger"], (sign * APART, 0, 0))
        _frame(model, f"{side}_end", joints["outer"], (0, 0, -CRANK))
        closures.append(Closure(f"{side}_pin", f"{side}_end", "3d"))
        # z of the pad points to the ball.
        pad = (sign * (RADIUS - (PALM - APART) / 2), 0, -CRANK / 2)
        _frame(model, f"{side}_pad", joints["finger"], pad, _turn_y(-sign * np.pi / 2))
        q += [0.0, 0.0, 0.0]
    closures.append(Coupling("right_inner", {"left_inner": (0, -1)}))
    ball = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(ball, pin.Inertia.FromSphere(MASS, RADIUS), pin.SE3.Identity())
    _frame(model, "ball_centre", ball, (0, 0, 0))
    _frame(model, "table", 0, (0, 0, -1.5 * CRANK - RADIUS))
    contacts = [
        Contact("ball_centre", radius=RADIUS, friction=FRICTION, ground=ground, name=ground)
        for ground in ("left_pad", "right_pad", "table")
    ]
    for side in ("left", "right"):
        place = model.joints[model.getJointId(f"{side}_inner")].idx_q
        model.lowerPositionLimit[place], model.upperPositionLimit[place] = -STOP, STOP
    dry = np.zeros(model.nv)
    for side in ("left", "right"):
        dry[model.joints[model.getJointId(f"{side}_inner")].idx_v] = DRY
    chain = sst_pin.ClosedChain(
        model, closures, ["wrist", "left_inner"], contacts=contacts, coulomb_friction=dry
    )
    return chain, np.array([*q, 0, 0, -1.5 * CRANK, 0, 0, 0, 1])


def _frame(model, name, joint, p, R=None):
    place = pin.SE3(np.eye(3) if R is None else R, np.array(p, dtype=float))
    model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))


def _turn_y(angle):
    return pin.utils.rotate("y", angle)


def lifts():
    """Times, and the wanted height and acceleration of the wrist."""
    duration = SQUEEZE + len(HEIGHTS) * (MOVE + REST) + FALL
    t = STEP * np.arange(1, round(duration / STEP) + 1)
    height, acceleration = np.zeros(len(t)), np.zeros(len(t))
    for k, rise in enumerate(HEIGHTS):
        s = (t - SQUEEZE - k * (MOVE + REST)) / MOVE
        inside = (s > 0) & (s < 1)
        s = np.clip(s, 0, 1)
        height += rise * (3 * s**2 - 2 * s**3)
        acceleration += np.where(inside, rise * (6 - 12 * s) / MOVE**2, 0)
    return t, height, acceleration


def hold():
    """The gripper, times, and the motion."""
    chain, q0 = gripper()
    t, height, acceleration = lifts()
    carried = sum(body.mass for body in chain.model.inertias) - np.where(t < t[-1] - FALL, 0, MASS)
    opens = t > t[-1] - FALL
    tau = np.column_stack([carried * (9.81 + acceleration), np.where(opens, GRIP / 4, -GRIP)])
    chain.compile()
    motion = chain.rollout(
        tau,
        q0,
        np.zeros(chain.degrees_of_freedom),
        STEP,
        nonsmooth=True,
        motor_stiffness=[STIFFNESS, 0],
        motor_damping=[DAMPING, 0],
        motor_positions=np.column_stack([height, np.zeros(len(t))]),
    )
    return chain, t, motion


def main():
    """Simulate, print, draw."""
    chain, t, motion = hold()
    slip = slips(motion)
    first = (t > SQUEEZE) & (t < SQUEEZE + MOVE + REST)
    second = (t > SQUEEZE + MOVE + REST) & (t < t[-1] - FALL)
    print(f"slip in the gentle lift {np.ptp(slip[first]):.1e} m, in the fast one", end=" ")
    print(f"{1000 * np.ptp(slip[second]):.1f} mm")
    low, high = (2 * FRICTION * (GRIP + x) / (2 * CRANK) / MASS - 9.81 for x in (-2 * DRY, 2 * DRY))
    print(f"the ball slips above {low:.1f} to {high:.1f} m/s^2, by hand")
    for path in sys.argv[1:]:
        if path.endswith(".html"):
            chain.show(motion, open_browser=False, speed=0.2).save(path, force=True)
        else:
            draw(path, t, motion)


def slips(motion):
    """Height of the ball in the gripper, shape (N,)."""
    ball = motion.q.shape[-1] - 5  # x, y, z, and a quaternion
    return motion.q[1:, ball] - motion.q[1:, 0]


def draw(path, t, motion):
    """Height of the ball in the gripper, and the forces on the ball."""
    from matplotlib import pyplot as plt

    figure, (above, below) = plt.subplots(2, sharex=True, figsize=(7, 5), layout="constrained")
    above.plot(t, 1000 * motion.q[1:, 0], color="black", label="wrist")
    ball = motion.q.shape[-1] - 5
    above.plot(t, 1000 * (motion.q[1:, ball] - motion.q[0, ball]), label="ball")
    left, _, table = motion.contact_forces.swapaxes(0, 1)
    below.plot(t, left[:, 2], label="pad, normal")
    below.plot(t, np.linalg.norm(left[:, :2], axis=1), label="pad, friction")
    below.plot(t, FRICTION * left[:, 2], ":", color="black", label="limit of friction")
    below.plot(t, table[:, 2], label="table")
    below.set_ylim(0, 10)
    above.set_ylabel("height [mm]")
    below.set_ylabel("force [N]")
    below.set_xlabel("t [s]")
    for axes in (above, below):
        axes.legend(loc="upper left")
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: BSD-2-Clause
"""Two legs with rods in their knees and ankles stand up from a stop, and walk in place.

The hip slides along a vertical rail, at first on the lower stop of the rail. Motors hold positions
by stiffness and damping, which are part of the steps: light ankles stay stable at 1 ms.

    python examples/walking_in_place.py walking_in_place.png walking_in_place.html

The picture shows heights and forces; the page plays the motion with the forces on the soles.
"""

import sys
from dataclasses import replace

import numpy as np
import pinocchio as pin

import sst_pin
from sst_pin import Contact

#: Step of the simulation, [s], and gains of the motors, [N m/rad] and [N m s/rad].
STEP, STIFFNESS, DAMPING = 1e-3, 1500.0, 20.0
#: Heights of the hip above the soles: on the stop, and standing; how far a foot is lifted, [m].
CROUCHED, STANDING, LIFT = 0.66, 0.75, 0.06
#: Times of standing up and of a step, [s], and the number of steps.
RISE, STRIDE, STRIDES = 0.6, 0.5, 4
#: Height of the ankle above the sole, and corners of a sole, [m].
ANKLE, CORNERS = 0.05, ((0.15, 0.04), (0.15, -0.04), (-0.06, 0.04), (-0.06, -0.04))
SIDES = ("left", "right")


def legs():
    """A hip on a rail with a stop, and two legs of the gallery on it; and one of these legs."""
    leg = sst_pin.robots.leg()
    model = pin.Model()
    model.name = "walking_in_place"
    rail = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "rail")
    model.appendBodyToJoint(rail, pin.Inertia.FromBox(8.0, 0.1, 0.25, 0.1), pin.SE3.Identity())
    closures, motors, contacts = [], [], []
    for side, y in zip(SIDES, (0.1, -0.1), strict=True):
        part = leg.model.copy()
        for j in range(1, part.njoints):
            part.names[j] = f"{side}_{part.names[j]}"
        for frame in part.frames:
            if frame.name != "universe":
                frame.name = f"{side}_{frame.name}"
        place = pin.SE3(np.eye(3), np.array([0, y, 0]))
        hip = model.addFrame(pin.Frame(f"{side}_socket", rail, place, pin.FrameType.OP_FRAME))
        model = pin.appendModel(model, part, hip, pin.SE3.Identity())
        for closure in leg.closures:
            ends = {x: f"{side}_{getattr(closure, x)}" for x in ("frame_a", "frame_b")}
            closures.append(replace(closure, **ends))
        motors += [f"{side}_{name}" for name in leg.motor_names]
        foot = model.getJointId(f"{side}_ankle_roll")
        for k, (x, y_sole) in enumerate(CORNERS):
            place = pin.SE3(np.eye(3), np.array([x, y_sole, -ANKLE]))
            name = f"{side}_sole_{k}"
            model.addFrame(pin.Frame(name, foot, place, pin.FrameType.OP_FRAME))
            contacts.append(Contact(name, friction=0.8))
    place = model.joints[model.getJointId("rail")].idx_q
    model.lowerPositionLimit[place] = CROUCHED
    chain = sst_pin.ClosedChain(model, closures, motors, contacts=contacts)
    return chain, leg


def heights_of_hips():
    """Times, and the height of the hip above each sole that the motors shall hold, (N, 2)."""
    count = round((RISE + 0.2 + STRIDE * STRIDES) / STEP)
    t = STEP * np.arange(1, count + 1)
    heights = CROUCHED + (STANDING - CROUCHED) * _smooth((t - 0.1) / RISE)
    heights = np.column_stack([heights, heights])
    for k in range(STRIDES):
        phase = np.clip((t - 0.2 - RISE - k * STRIDE) / STRIDE, 0, 1)
        heights[:, k % 2] -= LIFT * np.sin(np.pi * phase) ** 2
    return t, heights


def _smooth(s):
    s = np.clip(s, 0, 1)
    return 3 * s**2 - 2 * s**3


def leg_positions(leg, height):
    """Positions of the joints of a leg whose sole is level, below the hip by this height."""
    return leg.inverse_kinematics(pin.SE3(np.eye(3), np.array([0.0, 0.0, ANKLE - height])))


def walk():
    """The robot, times, wanted heights, and the motion."""
    chain, leg = legs()
    t, heights = heights_of_hips()
    levels = np.linspace(heights.min(), heights.max(), 200)
    tabled = np.array([leg_positions(leg, level)[leg.motor_indices] for level in levels])
    positions = np.hstack(
        [np.column_stack([np.interp(h, levels, x) for x in tabled.T]) for h in heights.T]
    )
    q0 = np.concatenate([[CROUCHED], *2 * [leg_positions(leg, CROUCHED)]])
    chain.compile()
    n = chain.degrees_of_freedom
    motors = len(chain.motor_names)
    motion = chain.rollout(
        np.zeros((len(t), motors)),
        q0,
        np.zeros(n),
        STEP,
        nonsmooth=True,
        motor_stiffness=np.full(motors, STIFFNESS),
        motor_damping=np.full(motors, DAMPING),
        motor_positions=positions,
    )
    return chain, t, heights, motion


def main():
    """Simulate, print, draw."""
    chain, t, heights, motion = walk()
    weight = 9.81 * sum(body.mass for body in chain.model.inertias)
    soles = motion.contact_forces[..., 2].reshape(len(t), 2, 4).sum(axis=2)
    stop = motion.joint_forces[:, 0]
    standing = (t > 0.1 + RISE) & (t < 0.2 + RISE)
    print(f"weight {weight:.1f} N, on the soles while it stands {soles[standing][-1].sum():.1f} N")
    print(f"on the stop at the start {stop[0]:.1f} N, while it walks {stop[t > RISE].max():.1f} N")
    print(f"loops open by at most {np.abs(chain.residual(motion.q)).max():.1e}")
    print(f"steps that are not solved: {int(np.count_nonzero(motion.status))}")
    for path in sys.argv[1:]:
        if path.endswith(".html"):
            chain.show(motion, open_browser=False, speed=0.5).save(path, force=True)
        else:
            draw(path, chain, t, heights, motion)


def draw(path, chain, t, heights, motion):
    """Heights of the hip and the soles, and the forces of the stop and on the soles."""
    from matplotlib import pyplot as plt

    figure, (above, below) = plt.subplots(2, sharex=True, figsize=(7, 5), layout="constrained")
    above.plot(t, motion.q[1:, 0], color="black", label="hip")
    above.plot(t, heights.max(axis=1), ":", color="black", label="hip, wanted")
    soles = motion.contact_forces[..., 2].reshape(len(t), 2, 4).sum(axis=2)
    for side, force in zip(SIDES, soles.T, strict=True):
        height = chain.frame_placement(motion.q[1:], f"{side}_sole_0")[0][:, 2]
        (line,) = above.plot(t, height, label=f"{side} sole")
        below.plot(t, force, color=line.get_color(), label=f"{side} sole")
    below.plot(t, motion.joint_forces[:, 0], color="black", label="stop of the rail")
    above.set_ylabel("height [m]")
    below.set_ylabel("vertical force [N]")
    below.set_ylim(0, 1.5 * np.median(soles.sum(axis=1)))
    below.set_xlabel("t [s]")
    above.legend(loc="center right")
    below.legend(loc="upper left")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()

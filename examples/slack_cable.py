# SPDX-License-Identifier: BSD-2-Clause
"""A load on three elastic cables that is braked so hard that a cable goes slack.

Winches hold the cables at lengths that change with time. The gains of the winches are those of the
cables: a cable stretches where it is longer than its winch has paid out, and is slack where it is
shorter.

    python examples/slack_cable.py slack_cable.png
"""

import sys

import numpy as np
import pinocchio as pin

import sst_pin
from sst_pin import LineForce

#: Anchors in the plane x, z, and what the load and the cables are, [m], [kg], [N/m], [N s/m].
ANCHORS = {"left": (-1.5, 2.0), "right": (1.5, 2.0), "below": (0.0, -0.5)}
MASS = 5.0
STIFFNESS = 4000.0
DAMPING = 20.0
TIGHT = 0.02
#: Step and duration of the simulation, [s]; the load moves by STROKE along x in MOVE seconds.
STEP, DURATION, MOVE, STROKE = 1e-3, 1.5, 0.35, 0.8


def cable_robot():
    """A point mass that slides along x and z, with a winch at each anchor."""
    model = pin.Model()
    parent = 0
    joints = ("x", pin.JointModelPX(), 0.0), ("z", pin.JointModelPZ(), MASS)
    for name, joint, mass in joints:
        parent = model.addJoint(parent, joint, pin.SE3.Identity(), name)
        body = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    frames = [("load", parent, (0, 0))] + [(name, 0, place) for name, place in ANCHORS.items()]
    for name, joint, (x, z) in frames:
        place = pin.SE3(np.eye(3), np.array([x, 0, z], dtype=float))
        model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    cables = [LineForce(name, "load", pulls_only=True, name=name) for name in ANCHORS]
    return sst_pin.ClosedChain(model, [], list(ANCHORS), coordinates=["x", "z"], lines=cables)


def paid_out(chain):
    """Times, and the lengths that the winches pay out: those of a smooth way, less TIGHT."""
    t = STEP * np.arange(round(DURATION / STEP))
    s = np.clip((t - 0.2) / MOVE, 0, 1)
    way = STROKE * (3 * s**2 - 2 * s**3)
    places = np.column_stack([way - STROKE / 2, np.full(len(t), 0.6)])
    return t, chain.line_lengths(places) - TIGHT


def main():
    """Simulate and draw the tensions."""
    chain = cable_robot()
    t, lengths = paid_out(chain)
    chain.compile()
    motion = chain.rollout(
        np.zeros((len(t), 3)),
        [-STROKE / 2, 0.6],
        [0, 0],
        STEP,
        nonsmooth=True,
        motor_stiffness=[STIFFNESS] * 3,
        motor_damping=[DAMPING] * 3,
        motor_positions=lengths,
    )
    for name, tension in zip(ANCHORS, motion.tensions.T, strict=True):
        slack = STEP * (tension == 0).sum()
        print(f"{name:6} slack for {slack:.3f} s, at most {tension.max():.0f} N")
    if len(sys.argv) > 1:
        draw(t, motion, sys.argv[1])


def draw(t, motion, path):
    """The tensions, and where the load is."""
    from matplotlib import pyplot as plt

    figure, (above, below) = plt.subplots(2, sharex=True, figsize=(7, 4.5), layout="constrained")
    for name, tension in zip(ANCHORS, motion.tensions.T, strict=True):
        above.plot(t, tension, label=name)
    above.set_ylabel("tension [N]")
    above.legend(loc="upper right")
    below.plot(t, motion.q[1:, 0], color="black")
    below.set_ylabel("x of the load [m]")
    below.set_xlabel("t [s]")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()

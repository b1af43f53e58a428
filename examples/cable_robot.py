# SPDX-License-Identifier: BSD-2-Clause
"""A planar robot on four cables: a platform of 4 kg, tensions between 5 and 80 N.

pip install 'sst-pin[plot,timing]'
python examples/cable_robot.py            # writes cables.png
"""

from pathlib import Path

import numpy as np
import pinocchio as pin

import sst_pin
from sst_pin import plots

TENSIONS = [[5.0, 80.0]] * 4  # least and largest of each cable [N]
POSTS = [(-1, -0.7), (1, -0.7), (1, 0.7), (-1, 0.7)]  # x, z in the base [m]
HOOKS = [(-0.15, 0.1), (0.15, 0.1), (0.15, -0.1), (-0.15, -0.1)]  # on the platform [m]


def cable_robot() -> sst_pin.ClosedChain:
    """The platform moves along x and z and tilts; each cable pulls it to a post."""
    model = pin.Model()
    platform = 0
    model.name = "cable_robot"
    joints = {"x": pin.JointModelPX(), "z": pin.JointModelPZ(), "tilt": pin.JointModelRY()}
    for name, joint in joints.items():
        platform = model.addJoint(platform, joint, pin.SE3.Identity(), name)
    model.referenceConfigurations["home"] = np.zeros(3)
    body = pin.Inertia.FromBox(4.0, 0.3, 0.1, 0.2)
    model.appendBodyToJoint(platform, body, pin.SE3.Identity())

    def mark(name: str, joint: int, x: float, z: float) -> None:
        place = pin.SE3(np.eye(3), np.array([x, 0.0, z]))
        model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))

    mark("platform", platform, 0, 0)
    cables = []
    for k, (post, hook) in enumerate(zip(POSTS, HOOKS, strict=True)):
        mark(f"post_{k}", 0, *post)
        mark(f"hook_{k}", platform, *hook)
        cables.append(sst_pin.LineForce(f"post_{k}", f"hook_{k}", name=f"cable_{k}"))
    # A positive force of a line pushes; -1 makes a positive torque a tension.
    motors = [{f"tension_{k}": {cable.name: -1.0}} for k, cable in enumerate(cables)]
    return sst_pin.ClosedChain(model, [], motors, lines=cables)


def main() -> None:
    """Map where the cables hold the platform, and cross the map as fast as they can."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib.figure import Figure

    robot = cable_robot()
    x = np.linspace(-0.9, 0.9, 61)
    z = np.linspace(-0.6, 0.6, 41)
    poses = sst_pin.reach_map(robot, "platform", TENSIONS, x=x, z=z, pitch=0.0)
    s = np.linspace(0, 1, 101)
    path = np.stack([0 * s, 0.8 * s - 0.4, 0.25 * np.sin(np.pi * s) - 0.2], axis=-1)
    order = [("tilt", "x", "z").index(name) for name in robot.joint_names]
    motion = sst_pin.time_optimal(robot, path[:, order], torques=TENSIONS)
    with plots.style():
        figure = Figure(figsize=(8, 3.2), layout="constrained")
        left, right = figure.subplots(1, 2)
        plots.reach_map(left, poses, "used")
        left.plot(path[:, 1], path[:, 2], color="white")
        plots.motor_torques(right, motion)
        right.set_ylabel("tension (N)")
        figure.savefig(Path("cables.png"), dpi=150)


if __name__ == "__main__":
    main()

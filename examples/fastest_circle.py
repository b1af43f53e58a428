# SPDX-License-Identifier: BSD-2-Clause
"""The circle of the paper's example 1 as fast as motors of 30 N m allow, from rest to rest.

pip install 'sst-pin[plot,timing]'
python examples/fastest_circle.py            # writes fastest_circle.png
"""

import time
from pathlib import Path

import numpy as np

import sst_pin
from sst_pin import plots

LIMIT = 30.0  # of each motor [N m]


def main() -> None:
    """Compute the motion, without and with friction, and draw the torques."""
    R = sst_pin.paper_circle(np.linspace(0, np.pi / 6, 201)).R
    robots = {
        "without friction": sst_pin.SST(),
        "0.3 N m s/rad in each joint": sst_pin.SST(sst_pin.Parameters(viscous_friction=0.3)),
    }
    motions = {}
    for name, robot in robots.items():
        path = robot.inverse_kinematics(R)
        sst_pin.time_optimal(robot, path, torques=LIMIT)  # imports toppra
        begin = time.perf_counter()
        motions[name] = motion = sst_pin.time_optimal(robot, path, torques=LIMIT)
        spent = time.perf_counter() - begin
        peaks = np.abs(motion.tau).max(axis=1)
        print(f"{name}: {motion.t[-1]:.4f} s, computed in {spent:.2f} s, at most {peaks.max():.3f}")
        print(
            f"  a motor within 0.1 % of its limit {(peaks > 0.999 * LIMIT).mean():.0%} of the time"
        )
    print(draw(motions))


def draw(motions: dict[str, sst_pin.Trajectory]) -> Path:
    """Torques of the motors over time."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, rows = plt.subplots(len(motions), sharex=True, figsize=(7, 4.4), layout="constrained")
    for axes, (name, motion) in zip(rows, motions.items(), strict=True):
        for k, motor in enumerate(motion.motor_names):
            axes.plot(motion.t, motion.tau[:, k], color=f"C{k}", label=rf"$\{motor}$")
        for side in (-1, 1):
            axes.axhline(side * LIMIT, color="0.6", linestyle="--", linewidth=1)
        axes.set(ylabel="torque (N m)", ylim=(-1.2 * LIMIT, 1.2 * LIMIT), title=name)
    figure.legend(*rows[0].get_legend_handles_labels(), ncols=3, loc="outside upper right")
    rows[-1].set_xlabel("time (s)")
    path = Path("fastest_circle.png")
    figure.savefig(path, dpi=150)
    return path


if __name__ == "__main__":
    with plots.style():
        main()

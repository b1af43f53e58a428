# SPDX-License-Identifier: BSD-2-Clause
"""Forces and accelerations of a five-bar's tip along a path, with motors of 2 N m.

pip install 'sst-pin[plot]'
python examples/what_a_pose_can_do.py            # writes what_a_pose_can_do.png
"""

from pathlib import Path

import numpy as np

import sst_pin
from sst_pin import plots

LIMIT = 2.0  # of each motor [N m]


def main() -> None:
    """Follow a line with the tip, and draw what it can do at some of its points."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    lift = sst_pin.robots.five_bar()
    first = lift.platform_pose(lift.home)[:3, 3] - [0, 0.02, 0]
    t = np.linspace(0, 1, 41)
    points = first + np.column_stack([0.09 * (t - 0.5), 0.01 * np.sin(2 * np.pi * t), 0 * t])
    motion = sst_pin.frame_motion(lift, t, "platform", points)
    figure, (forces, accelerations) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    sets = (
        (forces, sst_pin.force_polytope, sst_pin.force_ellipsoid, 2e-4),
        (accelerations, sst_pin.acceleration_polytope, sst_pin.acceleration_ellipsoid, 2e-5),
    )
    for axes, polytope, ellipsoid, scale in sets:
        axes.plot(points[:, 0], points[:, 1], color="0.3")
        for q, at in zip(motion.q[::10], points[::10], strict=True):
            corners = polytope(lift, q, "platform", LIMIT)
            inner = ellipsoid(lift, q, "platform", LIMIT)
            view = {"at": at, "scale": scale}
            plots.convex_set(axes, corners, **view, facecolor="C0", edgecolor="C0")
            plots.convex_set(axes, inner, **view, facecolor="C1", edgecolor="C1")
        axes.set(xlabel="$x_0$ (m)", ylabel="$y_0$ (m)")
    forces.set_title(f"forces, 1 cm for {0.01 / 2e-4:.3g} N")
    accelerations.set_title(f"accelerations, 1 cm for {0.01 / 2e-5:.3g} m/s$^2$")
    path = Path("what_a_pose_can_do.png")
    figure.savefig(path, dpi=150)
    print(path)


if __name__ == "__main__":
    with plots.style():
        main()

# SPDX-License-Identifier: BSD-2-Clause
"""Observe a push and weigh a load without a force sensor.

```bash
python examples/external_forces.py            # writes external_forces.png
```

A delta moves up and down under computed torque. Besides the motion, only the torques of its motors
are measured, 1000 times a second. From 0.2 s to 0.35 s 3 N push at the platform.
"""

from pathlib import Path

import numpy as np

import sst_pin
from sst_pin import plots

GAINS = (30.0, 150.0)  # 1/s
PUSH = np.array([3.0, 0.0, 0.0])  # N
FRICTION = 0.01  # N m s/rad in the motors, unknown to the model


def pushed(delta: sst_pin.ClosedChain) -> sst_pin.Trajectory:
    """A motion under computed torque with a push."""
    t = np.arange(0, 0.6 + 5e-4, 1e-3)
    at = [delta.position_names.index(name) for name in delta.motor_names]
    angles = delta.home[at] + 0.15 * (1 - np.cos(2 * np.pi * t / 0.6))[:, None]
    control = sst_pin.ComputedTorque(
        delta, sst_pin.coordinate_motion(delta, t, angles), kp=2500, kd=100
    )
    body = delta.model.frames[delta.model.getFrameId("platform")].parentJoint - 1
    load = np.zeros((delta.model.njoints - 1, 6))
    load[body, :3] = PUSH

    def push(time: float, q: np.ndarray, va: np.ndarray) -> np.ndarray:
        return load if 0.2 <= time < 0.35 else 0 * load

    start = control.motion.q[0], control.motion.va[0]
    return delta.simulate(
        control, *start, t, external_wrenches=push, rtol=1e-7, atol=1e-9, max_step=1e-3
    )


def main() -> None:
    """Draw the estimates for two gains, and their bias by unknown friction."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib.figure import Figure

    model = sst_pin.robots.delta()
    model.compile()
    rubbing = model.with_parameters({f"{name}.viscous": FRICTION for name in model.motor_names})
    names = "without friction", f"with friction of {FRICTION:g} N m s/rad, unknown to the model"
    with plots.style():
        figure = Figure(figsize=(8, 3.2), layout="constrained")
        axes = figure.subplots(1, 2, sharey=True)
        for ax, robot, title in zip(axes, (model, rubbing), names, strict=True):
            motion = pushed(robot)
            ax.step(motion.t, 3.0 * ((motion.t >= 0.2) & (motion.t < 0.35)), color="0.7")
            for gain in GAINS:
                observer = sst_pin.control.ForceObserver(model, gain)
                f = observer.forces(motion.t, motion.q, motion.va, motion.tau)
                wrenches = np.array(
                    [
                        observer.wrench(q, r, "platform", ["fx", "fy", "fz"])
                        for q, r in zip(motion.q, f, strict=True)
                    ]
                )
                (line,) = ax.plot(motion.t, wrenches[:, 0], label=f"along x, gain {gain:g}/s")
                ax.plot(motion.t, wrenches[:, 2], "--", color=line.get_color())
            ax.set_title(title, fontsize="small")
            ax.set_xlabel("time (s)")
        axes[0].set_ylabel("force at the platform (N)")
        axes[0].plot([], [], "--", color="0.3", label="along z")
        axes[0].legend(fontsize="small")
        figure.savefig(Path("external_forces.png"), dpi=150)


if __name__ == "__main__":
    main()

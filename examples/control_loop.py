# SPDX-License-Identifier: BSD-2-Clause
"""A control loop at 1 kHz in Python, and how well it keeps time.

Each period reads the motors' encoders, computes the pose and the torques of computed torque, and
notes when it began and how long it computed. The encoders are played from the motion itself.

    python examples/control_loop.py [--robot delta] [--seconds 10]

Python's collector of cycles rests meanwhile, and periods are waited for without sleep: the loop has
a core of its own. What a loop that computes nothing keeps says how quiet the machine is.
"""

import argparse
import gc
import time

import numpy as np
import pinocchio as pin
from scipy.interpolate import make_interp_spline

import sst_pin

PERIOD = 1e-3
#: A period counts as kept that begins this near to its time after the one before, [s].
KEPT = 2e-4


def swing(robot, seconds):
    """The motors to and fro by 0.1 rad or 20 mm about home."""
    t = np.linspace(0, seconds, int(200 * seconds) + 1)
    home = [robot.home[robot.position_names.index(name)] for name in robot.motor_names]
    sizes = [0.1 if unit == "rad" else 0.02 for unit in robot.motor_units]
    return sst_pin.coordinate_motion(robot, t, home + np.outer(np.sin(2 * np.pi * t), sizes))


def steps(robot, seconds):
    """What the controller does in a period, by the period's number."""
    motion = swing(robot, seconds)
    control = sst_pin.ComputedTorque(robot, motion, kp=400, kd=40)
    motors = [robot.position_names.index(name) for name in robot.motor_names]
    count = round(seconds / PERIOD)
    path = make_interp_spline(motion.t, motion.q[:, motors], 5)
    encoders = path(PERIOD * np.arange(count))
    q = motion.q[0].copy()
    before = encoders[0]

    def step(k):
        nonlocal q, before
        va = (encoders[k] - before) / PERIOD
        guess = pin.integrate(robot.model, q, robot.joint_rates(q, va) * PERIOD)
        guess[motors] = before = encoders[k]
        q = robot.assemble(guess)
        return control.torque(k * PERIOD, q, va)

    return step, count


def run(step, count):
    """When each period began and how long it computed, [s], shape (2, count)."""
    began, took = np.empty((2, count))
    gc.collect()
    gc.disable()
    start = time.perf_counter() + PERIOD
    for k in range(count):
        while (now := time.perf_counter()) < start + k * PERIOD:
            pass
        step(k)
        began[k], took[k] = now - start, time.perf_counter() - now
    gc.enable()
    return began, took


def report(began, took):
    """What a person wants to know of the periods."""
    off = np.abs(np.diff(began) - PERIOD)
    return (
        f"{len(began)} periods of {1e3 * PERIOD:g} ms: {100 * np.mean(off <= KEPT):.2f} % within "
        f"{1e3 * KEPT:g} ms, jitter {1e6 * np.median(off):.0f} us (median), "
        f"{1e6 * np.quantile(off, 0.999):.0f} us (99.9 %), {1e6 * off.max():.0f} us (largest); "
        f"computed for {1e6 * np.median(took):.0f} us (median), {1e6 * took.max():.0f} us (longest)"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="A control loop at 1 kHz.")
    parser.add_argument("--robot", help="a robot of the gallery; the SST by default")
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    robot = getattr(sst_pin.robots, options.robot)() if options.robot else sst_pin.SST()
    robot.compile()
    step, count = steps(robot, options.seconds)
    run(step, min(count, 200))  # kernels are compiled and caches filled at the first calls
    print(report(*run(step, count)))
    print("Empty loop:", report(*run(lambda k: None, count)))

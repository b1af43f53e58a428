# SPDX-License-Identifier: BSD-2-Clause
"""What the SST in MuJoCo weighs: a closed machine with friction, encoder steps and noisy torques.

The robot as drawn has masses that are 20 % too small and no friction; the machine has friction in
all nine joints. It follows a motion that shows the parameters well, and another one for validation;
encoder steps and noise are drawn anew in each repetition.

    python examples/sst_identification.py
"""

import argparse
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import decimate

import sst_pin
from control_bench import COUNTS, DAMPING, DRY, PERIOD, Machine, poor_model
from sst_pin.identification import (
    BaseParameters,
    Estimate,
    base_parameters,
    consistent_parameters,
    estimate,
    excitation,
    measured_motion,
    predicted_torques,
)

Array = NDArray[np.float64]

#: Noise of the torques each millisecond, [N m]; up to where logs are kept, [Hz], and decimation.
NOISE, CUTOFF, EVERY = 0.3, 40.0, 4
WHICH = ["*.m*", "*.i*", "*.viscous", "*.coulomb"]


class Log(NamedTuple):
    """What a machine did, in the middle of each millisecond."""

    t: Array
    x: Array
    tau: Array


class Result(NamedTuple):
    """What repetitions have shown.

    Attributes:
        missed: Errors over their standard deviations, shape (repetitions, b).
        noise: Standard deviations of the torques from the model, shape (3,), [N m].
        unseen: The same in the motion for validation, by physically consistent parameters from
            four runs of the first motion.
        least: The same by the machine's own parameters.
    """

    missed: Array
    noise: Array
    unseen: Array
    least: Array


def followed(motion: sst_pin.Trajectory) -> Log:
    """The machine follows a motion by computed torques."""
    machine = Machine()
    robot = sst_pin.SST()
    control = sst_pin.ComputedTorque(robot, motion, kp=1.5e4, kd=240)
    machine.start(motion.q[0], robot.joint_rates(motion.q[0], motion.va[0]))
    times = PERIOD * np.arange(round(motion.t[-1] / PERIOD))
    motors = list(robot.motor_indices)
    q = [motion.q[0]]
    torques = []
    for t in times:
        torques.append(control.torque(t, q[-1], machine.data.qvel[motors].copy()))
        q.append(machine.step(torques[-1], push=0.0))
    x = np.array(q)[:, motors]
    return Log(times + PERIOD / 2, (x[1:] + x[:-1]) / 2, np.array(torques))


def measured(
    robot: sst_pin.ClosedChain, log: Log, random: np.random.Generator
) -> sst_pin.Trajectory:
    """What sensors tell of it: encoders with steps, noisy torques."""
    step = 2 * np.pi / COUNTS
    within = step * random.uniform(size=log.x.shape[1])
    x = step * np.round((log.x + within) / step) - within
    tau = log.tau + NOISE * random.normal(size=log.tau.shape)
    return measured_motion(robot, log.t, x, tau, cutoff=CUTOFF)


def estimated(
    robot: sst_pin.ClosedChain, base: BaseParameters, motions: Sequence[sst_pin.Trajectory]
) -> Estimate:
    """From a motion, or from repeated ones, which begin and end at rest at one place."""
    logged = zip(*[(m.q, m.va, m.aa, m.tau) for m in motions], strict=True)
    return estimate(robot, base, *map(np.concatenate, logged), decimate=EVERY)


def identified(repetitions: int, duration: float = 5.0, tries: int = 8) -> Result:
    """Estimates against the parameters of the machine."""
    drawn = poor_model()
    machine = sst_pin.SST()
    friction = {f"{name}.viscous": DAMPING for name in machine.joint_names}
    friction |= {f"{name}.coulomb": DRY for name in machine.joint_names}
    base = base_parameters(drawn, WHICH)
    own = machine.with_parameters(friction).dynamic_parameters
    true = base.matrix @ own
    limits = {"rates": 6.0, "torques": 30.0, "tries": tries, "dt": 0.005}
    shown = base_parameters(drawn)
    logs = [followed(excitation(drawn, shown, duration, seed=k, **limits)) for k in (0, 1)]
    random = np.random.default_rng(0)
    missed = []
    noise = []
    for _ in range(repetitions):
        found = estimated(drawn, base, [measured(drawn, logs[0], random)])
        missed.append((found.values - true) / found.deviations)
        noise.append(found.noise)
    found = estimated(drawn, base, [measured(drawn, logs[0], random) for _ in range(4)])
    theta = consistent_parameters(drawn, found)
    test = measured(drawn, logs[1], random)
    errors = [predicted_torques(drawn, each, test) - test.tau for each in (theta, own)]
    off = np.sqrt(np.mean(decimate(errors, EVERY, axis=1) ** 2, axis=1))
    return Result(np.array(missed), np.mean(noise, axis=0), *off)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=200)
    result = identified(parser.parse_args().repetitions)
    inside = np.abs(result.missed) < 3
    print(f"{inside.shape[1]} combinations in {len(inside)} repetitions:")
    print(f"within three of their standard deviations: {100 * inside.mean():.1f} % of all values,")
    print(f"of each combination at least {100 * inside.mean(axis=0).min():.1f} %")
    print("noise of the estimate", result.noise.round(4), "N m")
    print("errors of an unseen motion", result.unseen.round(4), "N m")
    print("by the machine's own parameters", result.least.round(4), "N m")

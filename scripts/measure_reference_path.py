# SPDX-License-Identifier: BSD-2-Clause
"""Cost of both paths as multiples of a bare pin.rnea call on the same tree, in one run."""

import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin

from sst_pin import SST, paper_circle

ROUNDS, CALLS = 200, 50


def main() -> None:
    robot, fast = SST(kernels=False), SST()
    print(f"fast: {fast.path}")
    q, va, aa = robot.joint_motion(*paper_circle(0.1))
    tau = robot.compute_torques(q, va, aa)
    v = robot.joint_rates(q, va)
    data = robot.model.createData()
    calls: dict[str, Callable[[], object]] = {
        "pin.rnea": lambda: pin.rnea(robot.model, data, q, v, v),
        "compute_torques": lambda: robot.compute_torques(q, va, aa),
        "compute_accelerations": lambda: robot.compute_accelerations(q, va, tau),
        "noc": lambda: robot.noc(q, va),
        "fast compute_torques": lambda: fast.compute_torques(q, va, aa),
        "fast compute_accelerations": lambda: fast.compute_accelerations(q, va, tau),
    }
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(ROUNDS):  # in turn, so that a slow moment of the machine hits all alike
        for name, call in calls.items():
            start = time.perf_counter()
            for _ in range(CALLS):
                call()
            seconds[name].append((time.perf_counter() - start) / CALLS)
    medians = {name: np.median(values) for name, values in seconds.items()}
    for name, median in medians.items():
        print(f"{name:26} {median * 1e6:8.2f} us  {median / medians['pin.rnea']:7.1f} x pin.rnea")


if __name__ == "__main__":
    main()

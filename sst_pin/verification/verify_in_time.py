# SPDX-License-Identifier: BSD-2-Clause
"""Referees that step in time: virtual work, Exudyn and MuJoCo, each by its own integrator."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ..description.parameters import Parameters
from ..errors import MissingExtraError
from ..sst import paper
from ..sst.platform_motion import paper_circle
from ..sst.robot import SST
from . import referees
from .comparisons import Comparison, Judge
from .virtual_work import VirtualWork

#: Integrators must show the order that they claim to this.
ORDER = 0.2


def verify_in_time() -> Iterator[Comparison]:
    """Example 2 by virtual work, Exudyn and MuJoCo, each by its own integrator."""
    robot = SST()
    R, omega, _ = paper_circle(0.0)
    example = paper.example_1(robot, np.linspace(0, paper.PERIOD, 1001))
    torque = example.torque()

    judge = Judge("virtual work", "path, example 2")
    t = np.linspace(0, paper.PERIOD, 21)
    wanted = paper_circle(t).R
    other = VirtualWork(Parameters())
    judge.hold(lambda: other.simulate(lambda t, R, omega: torque(t), R, omega, t)[0], wanted)
    yield judge.verdict()

    try:
        from .referees import exudyn_engine

        referees.engine("exudyn")
    except MissingExtraError:
        pass
    else:
        quarter, run_in = paper.PERIOD / 4, 30
        expected = paper.example_1(robot, np.linspace(0, quarter, 61)).tau

        def torque_error(steps: int) -> float:
            _, tau = exudyn_engine.stepped_torques(Parameters(), paper_circle, quarter, steps)
            every = steps // 60
            late = slice(run_in, None)  # its first torques miss the motors' accelerations
            return float(np.abs(tau[::every] - expected)[late].max())

        yield _order("Exudyn, time-stepped", "torques, example 1", torque_error, (120, 240, 480))

        def path_error(steps: int) -> float:
            t, path = exudyn_engine.stepped_motion(
                Parameters(), R, omega, torque, paper.PERIOD, steps
            )
            return float(np.abs(path - paper_circle(t).R).max())

        yield _order("Exudyn, time-stepped", "path, example 2", path_error, (250, 500, 1000))

    try:
        from .referees import mujoco_engine

        referees.engine("mujoco")
    except MissingExtraError:
        return

    def compliance(stiffness: float) -> float:
        t, path = mujoco_engine.welded_motion(
            Parameters(), R, omega, torque, paper.PERIOD / 8, stiffness=stiffness
        )
        return float(np.abs(path - paper_circle(t).R).max())

    yield _compliant("MuJoCo, welded", "path, 1/8 of example 2", compliance, (1e4, 1e5, 1e6))


def _order(
    referee: str, compared: str, error: Callable[[int], float], steps: Sequence[int]
) -> Comparison:
    """Second order: half the step, a quarter of the error."""
    began = time.perf_counter()
    errors = [error(n) for n in steps]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    return Comparison(
        referee,
        compared,
        steps[-1],
        errors[-1],
        errors[-1] / errors[0],
        None,
        time.perf_counter() - began,
        bool(np.abs(orders - 2).max() < ORDER),
        f"order {orders[-1]:.2f}, 2 claimed",
    )


def _compliant(
    referee: str, compared: str, error: Callable[[float], float], stiffness: Sequence[float]
) -> Comparison:
    """Ten times the stiffness leaves a tenth of the error, give or take a half."""
    began = time.perf_counter()
    errors = [error(k) for k in stiffness]
    shrink = np.array(errors[:-1]) / errors[1:]
    return Comparison(
        referee,
        compared,
        len(stiffness),
        errors[-1],
        errors[-1] / errors[0],
        None,
        time.perf_counter() - began,
        bool((shrink > 5).all()),
        f"{shrink[-1]:.1f} times less at 10 times the stiffness",
    )

# SPDX-License-Identifier: BSD-2-Clause
"""Referees that step in time: virtual work, Exudyn and MuJoCo, each by its own integrator."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress

import numpy as np

from ..arrays import Array
from ..description.parameters import Parameters
from ..errors import MissingExtraError
from ..sst import paper
from ..sst.platform_motion import paper_circle
from ..sst.robot import SST
from . import referees
from .comparisons import Comparison, Judge
from .virtual_work import VirtualWork

#: Largest error of an integrator's order.
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

    for row in (_exudyn(robot, torque), _mujoco(torque)):
        with suppress(MissingExtraError):
            yield from row


def _exudyn(robot: SST, torque: Callable[[float], Array]) -> Iterator[Comparison]:
    referees.engine("exudyn")
    from .referees import exudyn_engine

    (R, omega, _), quarter, run_in = paper_circle(0.0), paper.PERIOD / 4, 30
    expected = paper.example_1(robot, np.linspace(0, quarter, 61)).tau

    def torque_error(steps: float) -> float:
        _, tau = exudyn_engine.stepped_torques(Parameters(), paper_circle, quarter, int(steps))
        every = int(steps) // 60
        late = slice(run_in, None)  # its first torques miss the motors' accelerations
        return float(np.abs(tau[::every] - expected)[late].max())

    def path_error(steps: float) -> float:
        t, path = exudyn_engine.stepped_motion(
            Parameters(), R, omega, torque, paper.PERIOD, int(steps)
        )
        return float(np.abs(path - paper_circle(t).R).max())

    def second_order(shrink: Array) -> tuple[bool, str]:
        orders = np.log2(shrink)
        return bool(np.abs(orders - 2).max() < ORDER), f"order {orders[-1]:.2f}, 2 claimed"

    name, by = "Exudyn, time-stepped", (120, 240, 480)
    yield _converging(name, "torques, example 1", torque_error, by, by[-1], second_order)
    by = (250, 500, 1000)
    yield _converging(name, "path, example 2", path_error, by, by[-1], second_order)


def _mujoco(torque: Callable[[float], Array]) -> Iterator[Comparison]:
    referees.engine("mujoco")
    from .referees import mujoco_engine

    R, omega, _ = paper_circle(0.0)

    def path_error(stiffness: float) -> float:
        t, path = mujoco_engine.welded_motion(
            Parameters(), R, omega, torque, paper.PERIOD / 8, stiffness=stiffness
        )
        return float(np.abs(path - paper_circle(t).R).max())

    def stiffer(shrink: Array) -> tuple[bool, str]:
        """Ten times the stiffness leaves a tenth of the error, give or take a half."""
        return bool((shrink > 5).all()), f"{shrink[-1]:.1f} times less at 10 times the stiffness"

    name, by = "path, 1/8 of example 2", (1e4, 1e5, 1e6)
    yield _converging("MuJoCo, welded", name, path_error, by, len(by), stiffer)


def _converging(
    referee: str,
    compared: str,
    error: Callable[[float], float],
    by: Sequence[float],
    cases: int,
    judged: Callable[[Array], tuple[bool, str]],
) -> Comparison:
    """A referee whose error must shrink as its steps, or what it is stiff by, are refined."""
    began = time.perf_counter()
    errors = np.array([error(value) for value in by])
    passed, note = judged(errors[:-1] / errors[1:])
    first, last = float(errors[0]), float(errors[-1])
    seconds = time.perf_counter() - began
    return Comparison(referee, compared, cases, last, last / first, None, seconds, passed, note)

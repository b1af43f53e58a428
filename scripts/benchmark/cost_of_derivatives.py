# SPDX-License-Identifier: BSD-2-Clause
"""What derivatives cost: one call from Python, beside Pinocchio's of the open tree.

Prints the table of docs/derivatives.md; what compiles is in no cache then. Run with
`PYTHONPATH=examples python scripts/benchmark/cost_of_derivatives.py`.
"""

import os
import time
from functools import partial

import numpy as np
import pinocchio as pin

import cassie
import sst_pin
from benchmark import in_turn
from benchmark_robots import cassie_of_mujoco, empty_cache
from pinocchio_peers import Constrained


def sst() -> sst_pin.ClosedChain:
    """The SST computed as any other robot."""
    robot = sst_pin.SST()
    return sst_pin.ClosedChain(robot.model, robot.closures, robot.motor_names)


ROBOTS = {
    "SST": sst,
    "delta": sst_pin.robots.delta,
    "stewart": sst_pin.robots.stewart,
    "Cassie, held": partial(cassie_of_mujoco, cassie.HELD),
}
HEADER = (
    "| robot | n, nv | compile: wall, processor time | torque derivatives | / RNEA derivatives "
    "| acceleration derivatives | / constraint dynamics and derivatives | in batches |"
)


def processor_seconds() -> float:
    """Processor time of this process and of the compilers that it has called."""
    return sum(os.times()[:4])


def measured(name: str, chain: sst_pin.ClosedChain) -> str:
    """A row of the table."""
    q, n, model = chain.generic_configuration(), chain.degrees_of_freedom, chain.model
    chain.compile()
    started, wall = processor_seconds(), time.perf_counter()
    chain.compile(derivatives=True)
    took, wall = processor_seconds() - started, time.perf_counter() - wall
    va, aa = np.random.default_rng(0).normal(size=(2, n))
    tau, still, data = np.ones(len(chain.motor_names)), np.zeros(model.nv), model.createData()
    v, a = chain.joint_rates(q, va), chain.joint_accelerations(q, va, aa)
    many = [np.tile(x, (4096, 1)) for x in (q, va, aa)]
    closed = Constrained(chain, mu=1e-10, accuracy=1e-12)
    calls = {
        "ours": (lambda: chain.torque_derivatives(q, va, aa), 1),
        "RNEA": (lambda: pin.computeRNEADerivatives(model, data, q, v, a), 1),
        "our accelerations": (lambda: chain.acceleration_derivatives(q, va, tau), 1),
        "constrained": (lambda: (closed.accelerations(q, v, still), closed.derivatives()), 1),
        "batch": (lambda: chain.torque_derivatives(*many), 4096),
    }
    least = [1e6 * fastest for _, fastest in in_turn(calls, 15, 5e-3).values()]
    torques, rnea, accelerations, constrained, batch = least
    return (
        f"| {name} | {n}, {model.nv} | {wall:.1f} s, {took:.1f} s | {torques:.1f} us "
        f"| {torques / rnea:.2f} | {accelerations:.1f} us | {accelerations / constrained:.2f} "
        f"| {batch:.2f} us |"
    )


if __name__ == "__main__":
    print(HEADER, "|---" * 8 + "|", sep="\n")
    with empty_cache():
        for name, make in ROBOTS.items():
            print(measured(name, make()), flush=True)

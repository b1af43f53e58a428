# SPDX-License-Identifier: BSD-2-Clause
"""What derivatives cost: one call from Python, beside Pinocchio's of the open tree.

Prints the table of docs/derivatives.md; what compiles is in no cache then. Run with
`PYTHONPATH=examples python scripts/benchmark/cost_of_derivatives.py`.
"""

import os
import tempfile
import time
import timeit
from pathlib import Path

import numpy as np
import pinocchio as pin

import cassie
import sst_pin

KINDS = {"3d": pin.ContactType.CONTACT_3D, "6d": pin.ContactType.CONTACT_6D}
KINDS["orientation"] = pin.ContactType.CONTACT_6D


def cassie_on_a_stand() -> sst_pin.ClosedChain:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "cassie.xml")
        path.write_text(cassie.mjcf(), encoding="utf-8")
        return sst_pin.ClosedChain.from_mjcf(path, locked=cassie.HELD)


ROBOTS = {
    "SST": lambda: plain(sst_pin.SST()),
    "delta": sst_pin.robots.delta,
    "stewart": sst_pin.robots.stewart,
    "Cassie, held": cassie_on_a_stand,
}


def plain(robot: sst_pin.ClosedChain) -> sst_pin.ClosedChain:
    """A robot that computes as any other."""
    return sst_pin.ClosedChain(robot.model, robot.closures, robot.motor_names)


def peers(chain: sst_pin.ClosedChain, q, v, a) -> dict:
    """Pinocchio's calls on the open tree, and with its own closures."""
    model, data = chain.model, chain.model.createData()
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for closure in chain.closures:
        A, B = (model.frames[model.getFrameId(f)] for f in (closure.frame_a, closure.frame_b))
        ends = (A.parentJoint, A.placement, B.parentJoint, B.placement)
        models.append(pin.RigidConstraintModel(KINDS[closure.kind], model, *ends, pin.LOCAL))
        datas.append(models[-1].createData())
    pin.initConstraintDynamics(model, data, models, datas)
    settings, tau = pin.ProximalSettings(1e-12, 1e-10, 10), np.zeros(model.nv)

    def constrained():
        pin.constraintDynamics(model, data, q, v, tau, models, datas, settings)
        pin.computeConstraintDynamicsDerivatives(model, data, models, datas, settings)

    return {
        "RNEA derivatives": lambda: pin.computeRNEADerivatives(model, data, q, v, a),
        "constraint dynamics and derivatives": constrained,
    }


def least(functions: dict) -> dict[str, float]:
    """Least microseconds a call, all in turns, so that a busy machine is busy for all."""
    best = dict.fromkeys(functions, np.inf)
    for _ in range(15):
        for name, function in functions.items():
            best[name] = min(best[name], timeit.timeit(function, number=200) / 200 * 1e6)
    return best


def processor_seconds() -> float:
    """Processor time of this process and of the compilers that it has called."""
    return sum(os.times()[:4])


def measured(name: str, chain: sst_pin.ClosedChain) -> str:
    """A row of the table."""
    q, n = chain.generic_configuration(), chain.degrees_of_freedom
    chain.compile()
    started, wall = processor_seconds(), time.perf_counter()
    chain.compile(derivatives=True)
    took, wall = processor_seconds() - started, time.perf_counter() - wall
    va, aa = np.random.default_rng(0).normal(size=(2, n))
    tau = np.ones(len(chain.motor_names))
    many = [np.tile(x, (4096, 1)) for x in (q, va, aa)]
    arguments = (q, chain.joint_rates(q, va), chain.joint_accelerations(q, va, aa))
    us = least(
        {
            "torques": lambda: chain.torque_derivatives(q, va, aa),
            "accelerations": lambda: chain.acceleration_derivatives(q, va, tau),
            **peers(chain, *arguments),
        }
    )
    batch = min(timeit.repeat(lambda: chain.torque_derivatives(*many), number=1, repeat=5))
    torques, accelerations = us["torques"], us["accelerations"]
    return (
        f"| {name} | {n}, {chain.model.nv} | {wall:.1f} s, {took:.1f} s "
        f"| {torques:.1f} us | {torques / us['RNEA derivatives']:.2f} "
        f"| {accelerations:.1f} us "
        f"| {accelerations / us['constraint dynamics and derivatives']:.2f} "
        f"| {batch / 4096 * 1e6:.2f} us |"
    )


def main() -> None:
    folder = tempfile.TemporaryDirectory()
    os.environ["XDG_CACHE_HOME"] = folder.name
    print("| robot | n, nv | compile: wall, processor time | torque derivatives |", end="")
    print(" / RNEA derivatives | acceleration derivatives |", end="")
    print(" / constraint dynamics and derivatives | in batches |")
    print("|---|---|---|---|---|---|---|---|")
    for name, make in ROBOTS.items():
        print(measured(name, make()), flush=True)


if __name__ == "__main__":
    main()

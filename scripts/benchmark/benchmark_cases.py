# SPDX-License-Identifier: BSD-2-Clause
"""What benchmark.py measures: each case as a call, with the units of work that it does."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Iterable, Sequence
from multiprocessing.connection import Connection

import mujoco
import mujoco.rollout
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pinocchio_peers import Constrained, Kkt
from sst_pin import SST, Parameters, paper_circle
from sst_pin.sst import paper
from sst_pin.verification.referees import mujoco_engine

Array = NDArray[np.float64]
Calls = dict[str, tuple[Callable[[], object], float]]


def _welded(step: float, stiffness: float = 1e6) -> mujoco.MjModel:
    model: mujoco.MjModel = mujoco_engine.welded(mujoco, Parameters(), step, stiffness)
    model.opt.tolerance = 1e-8  # of the solver; MuJoCo's default
    return model


def single_calls(robot: SST) -> Calls:
    q, va, aa = (np.ascontiguousarray(x) for x in robot.joint_motion(*paper_circle(0.1)))
    tau, v = robot.compute_torques(q, va, aa), robot.joint_rates(q, va)
    force = np.zeros(9)
    force[::3] = tau
    kkt, constrained, data = Kkt(robot, q), Constrained(robot), robot.model.createData()
    assert np.allclose(kkt.forces(q, va, aa), tau)
    assert np.allclose(constrained.accelerations(q, v, force)[::3], aa, rtol=1e-5)
    welded = _welded(1e-4)
    welded.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER  # MuJoCo's default, one evaluation
    state = mujoco.MjData(welded)
    state.qpos[:], state.qvel[:] = q, v
    reference = SST(kernels=False)
    return {
        "pin.rnea, open tree": (lambda: pin.rnea(robot.model, data, q, v, v), 1),
        "compute_torques": (lambda: robot.compute_torques(q, va, aa), 1),
        "compute_accelerations": (lambda: robot.compute_accelerations(q, va, tau), 1),
        "KKT, hand-assembled on Pinocchio": (lambda: kkt.forces(q, va, aa), 1),
        "pin.constraintDynamics": (lambda: constrained.accelerations(q, v, force), 1),
        "mj_step": (lambda: mujoco.mj_step(welded, state), 1),
        "reference path, torques": (lambda: reference.compute_torques(q, va, aa), 1),
        "reference path, accelerations": (lambda: reference.compute_accelerations(q, va, tau), 1),
    }


def _batch(robot: SST, n: int) -> tuple[Array, Array, Array]:
    """Random samples of the paper's circle."""
    t = np.random.default_rng(0).uniform(0, paper.PERIOD, n)
    q, va, aa = (np.ascontiguousarray(x) for x in robot.joint_motion(*paper_circle(t)))
    return q, va, aa


def batches(robot: SST, n: int) -> Calls:
    q, va, aa = _batch(robot, n)
    ours, theirs = np.empty((n, 3)), np.empty((9, n), order="F")
    pool, columns = pin.ModelPool(robot.model, 1), [np.asfortranarray(q.T)] * 3

    return {
        "compute_torques, batch": (lambda: robot.compute_torques(q, va, aa, out=ours), n),
        "compute_accelerations, batch": (
            lambda: robot.compute_accelerations(q, va, aa, out=ours),
            n,
        ),
        "pin.rneaInParallel, 1 thread": (lambda: pin.rneaInParallel(1, pool, *columns, theirs), n),
    }


def threads(robot: SST, n: int, numbers: Iterable[int]) -> Calls:
    q, va, aa = _batch(robot, n)
    tau = np.empty((n, 3))

    def by(number: int) -> Callable[[], object]:
        return lambda: robot.compute_torques(q, va, aa, out=tau, threads=number)

    return {
        "1 thread" if k == 1 else f"compute_torques, batch, {k} threads": (by(k), n)
        for k in numbers
    } | {"two processes at once": (_processes(2, n), 2 * n)}


def _processes(count: int, n: int) -> Callable[[], object]:
    """Batches in processes that share nothing: what the machine itself gains by its cores."""
    pipes = [multiprocessing.Pipe() for _ in range(count)]
    for _, end in pipes:
        multiprocessing.Process(target=_answer, args=(end, n), daemon=True).start()

    def call() -> None:
        for pipe, _ in pipes:
            pipe.send(None)
        for pipe, _ in pipes:
            pipe.recv()

    return call


def _answer(pipe: Connection, n: int) -> None:
    robot = SST()
    batch, tau = _batch(robot, n), np.empty((n, 3))
    while True:
        pipe.recv()
        robot.compute_torques(*batch, out=tau)
        pipe.send(None)


def rollouts(robot: SST) -> Calls:
    """256 motions of 100 steps, one thread, both by the classical Runge-Kutta method."""
    starts, steps, dt = 256, 100, 1e-4
    q = np.tile(robot.home, (starts, 1))
    zero, tau = np.zeros((starts, 3)), np.zeros((starts, steps, 3))
    model = _welded(dt)
    data = mujoco.MjData(model)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    state = np.zeros(size)
    data.qpos[:] = robot.home
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states = np.tile(state, (starts, 1))
    runner = mujoco.rollout.Rollout(nthread=0)  # 0: in the calling thread
    return {
        "rollout": (lambda: robot.rollout(tau, q, zero, dt), starts * steps),
        "mujoco.rollout": (
            lambda: runner.rollout(model, data, states, nstep=steps),
            starts * steps,
        ),
    }


def examples(robot: SST) -> Calls:
    reference = SST(kernels=False)
    t = np.linspace(0, paper.PERIOD, 1001)
    example = paper.example_1(robot, t)
    rolled = rolled_example(robot, example, 500)
    assert np.abs(rolled - example.q[-1]).max() < 1e-9
    return {
        "example 1, 1001 samples": (lambda: paper.example_1(robot, t), 1),
        "example 1, reference path": (lambda: paper.example_1(reference, t), 1),
        "example 2, simulate": (lambda: paper.example_2(robot, example), 1),
        "example 2, reference path": (lambda: paper.example_2(reference, example), 1),
        "example 2, rollout to 1e-9 rad": (lambda: rolled_example(robot, example, 500), 1),
    }


def rolled_example(robot: SST, example: paper.Trajectory, steps: int) -> Array:
    """q at the end of example 2, from torques at the ends and in the middles of the steps."""
    dt = paper.PERIOD / steps
    tau = example.torque()(dt / 2 * np.arange(2 * steps + 1))
    return robot.rollout(tau, example.q[0], example.va[0], dt, steps=steps).q[-1]


def work_and_precision(robot: SST, repeats: int) -> dict[str, list[tuple[float, float]]]:
    """(fewest seconds, error of q) of example 2 by each integrator, at steps or tolerances."""
    example = paper.example_1(robot, np.linspace(0, paper.PERIOD, 1001))
    smooth = example.torque()

    def simulated(which: SST) -> Callable[[float], Array]:
        start = example.q[0], example.va[0], example.t[[0, -1]]
        return lambda e: which.simulate(example, *start, rtol=e, atol=e).q[-1]

    def constrained(steps: int) -> Array:
        pinocchio, dt = Constrained(robot), paper.PERIOD / steps
        q, v = example.q[0], robot.joint_rates(example.q[0], example.va[0])
        force = np.zeros((2 * steps + 1, 9))
        force[:, ::3] = smooth(dt / 2 * np.arange(2 * steps + 1))
        for s in range(steps):
            rates, stage = [], (q, v)
            for when, ahead in ((0, dt / 2), (1, dt / 2), (1, dt), (2, 0)):
                a = pinocchio.accelerations(*stage, force[2 * s + when])
                rates.append((stage[1], a))
                stage = q + ahead * stage[1], v + ahead * a
            mean = [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(*rates, strict=True)]
            q, v = q + dt * mean[0], v + dt * mean[1]
        return q

    def welded(stiffness: float) -> Array:
        dt = 0.5 / np.sqrt(stiffness)
        steps = int(np.ceil(paper.PERIOD / dt))
        model = _welded(paper.PERIOD / steps, stiffness)
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = example.q[0], robot.joint_rates(example.q[0], example.va[0])

        def control(_: object, state: mujoco.MjData) -> None:
            state.qfrc_applied[::3] = smooth(state.time)

        mujoco.set_mjcb_control(control)
        try:
            for _ in range(steps):
                mujoco.mj_step(model, data)
        finally:
            mujoco.set_mjcb_control(None)
        return data.qpos.copy()

    def points(run: Callable[..., Array], choices: Sequence[float]) -> list[tuple[float, float]]:
        found = []
        for choice in choices:
            taken = []
            for _ in range(repeats):
                start = time.perf_counter()
                q = run(choice)
                taken.append(time.perf_counter() - start)
            found.append((min(taken), float(np.abs(q - example.q[-1]).max())))
        return found

    steps, tolerances = (125, 250, 500, 1000), (1e-6, 1e-8, 1e-10, 1e-12)
    return {
        "rollout, RK4": points(lambda n: rolled_example(robot, example, n), steps),
        "simulate, DOP853": points(simulated(robot), tolerances),
        "simulate, reference path": points(simulated(SST(kernels=False)), tolerances),
        "pin.constraintDynamics, RK4": points(constrained, steps),
        "MuJoCo, welds, RK4": points(welded, (1e4, 1e5, 1e6)),
    }

# SPDX-License-Identifier: BSD-2-Clause
"""What benchmark.py measures: each case as a call, with the units of work that it does."""

from collections.abc import Callable

import mujoco
import mujoco.rollout
import numpy as np
import pinocchio as pin

from pinocchio_peers import Constrained, Kkt
from sst_pin import SST, ClosedChain, paper_circle
from sst_pin.arrays import Array
from sst_pin.dynamics import reactions
from sst_pin.sst import paper
from sst_pin.verification.mujoco_tree import MujocoTree

Calls = dict[str, tuple[Callable[[], object], float]]
Motion = tuple[Array, Array, Array]  # q, va, aa
Closed = tuple[mujoco.MjModel, mujoco.MjData]

#: Names of the calls of any robot, for the SST.
OF_THE_SST = {
    "torques": "compute_torques",
    "accelerations": "compute_accelerations",
    "KKT, by hand": "KKT, hand-assembled on Pinocchio",
    "torques, batch": "compute_torques, batch",
    "accelerations, batch": "compute_accelerations, batch",
}


def of_the_sst(calls: Calls) -> Calls:
    return {OF_THE_SST.get(name, name): call for name, call in calls.items()}


def in_mujoco(
    chain: ClosedChain, q: Array, va: Array | None = None, *, step: float, stiffness: float = 1e6
) -> Closed:
    """The robot in MuJoCo by the classical Runge-Kutta method, at q and va, at rest by default."""
    tree = MujocoTree(chain.mechanism, closure_stiffness=stiffness)
    tree.mj.opt.timestep = step
    tree.mj.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    tree.mj.opt.tolerance = 1e-8  # of the solver; MuJoCo's default
    tree.mj.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT  # the kernels have no limits
    tree.move(q, np.zeros(chain.model.nv) if va is None else chain.joint_rates(q, va))
    return tree.mj, tree.data


# --- any robot ----------------------------------------------------------------------------------


def torques_of(chain: ClosedChain) -> Callable[..., Array]:
    """The function of its torques, or of its generalized forces with too few motors."""
    enough = len(chain.motor_names) >= chain.degrees_of_freedom
    return chain.compute_torques if enough else chain.generalized_forces


def derivatives(chain: ClosedChain, motion: Motion) -> Calls:
    """Derivatives of one configuration, and Pinocchio's of the open tree."""
    q, va, aa = motion
    model, data, tau = chain.model, chain.model.createData(), np.ones(len(chain.motor_names))
    v = chain.joint_rates(q, va)
    return {
        "torque derivatives": (lambda: chain.torque_derivatives(q, va, aa), 1),
        "acceleration derivatives": (lambda: chain.acceleration_derivatives(q, va, tau), 1),
        "pin.computeRNEADerivatives, open tree": (
            lambda: pin.computeRNEADerivatives(model, data, q, v, v),
            1,
        ),
        "pin.computeABADerivatives, open tree": (
            lambda: pin.computeABADerivatives(model, data, q, v, v),
            1,
        ),
    }


def single_calls(
    chain: ClosedChain, reference: ClosedChain, motion: Motion, closed: Closed | None
) -> Calls:
    """One configuration; without the robot in MuJoCo no direct dynamics."""
    q, va, aa = motion
    model, data, kkt = chain.model, chain.model.createData(), Kkt(chain, q)
    v = chain.joint_rates(q, va)
    ours = torques_of(chain)
    theirs = torques_of(reference)
    bare = not (model.damping.any() or model.friction.any() or model.armature.any())
    if bare:
        forces = chain.generalized_forces(q, va, aa)
        assert np.abs(kkt.forces(q, va, aa) - forces).max() < 1e-8 * np.abs(forces).max()
    calls: Calls = {
        "pin.rnea, open tree": (lambda: pin.rnea(model, data, q, v, v), 1),
        "torques": (lambda: ours(q, va, aa), 1),
        "KKT, by hand": (lambda: kkt.forces(q, va, aa), 1),
        "reference path, torques": (lambda: theirs(q, va, aa), 1),
    }
    if closed is None:
        return calls
    world, state = closed
    world.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER  # MuJoCo's default, one evaluation
    mechanism = chain.mechanism
    constrained = Constrained(chain)
    tau = np.ones(len(chain.motor_names))
    force = mechanism.actuation @ tau
    if bare:
        found = constrained.accelerations(q, v, force)[mechanism.coordinates]
        assert np.allclose(found, chain.compute_accelerations(q, va, tau), rtol=1e-5)
    return calls | {
        "accelerations": (lambda: chain.compute_accelerations(q, va, tau), 1),
        "pin.constraintDynamics": (lambda: constrained.accelerations(q, v, force), 1),
        "mj_step": (lambda: mujoco.mj_step(world, state), 1),
        "reference path, accelerations": (lambda: reference.compute_accelerations(q, va, tau), 1),
    }


def batches(chain: ClosedChain, motion: Motion, torques_only: bool = False) -> Calls:
    """Samples of a motion, each array with rows of its own."""
    (q, va, aa), nv, ours = motion, chain.model.nv, torques_of(chain)
    out = {"out": np.empty_like(ours(q, va, aa))} if ours == chain.compute_torques else {}
    n = len(q)
    pool = pin.ModelPool(chain.model, 1)
    columns = np.asfortranarray(q.T)
    rates = np.asfortranarray(np.ones((nv, n)))
    theirs = np.empty((nv, n), order="F")
    calls: Calls = {"torques, batch": (lambda: ours(q, va, aa, **out), n)}
    if not torques_only:
        tau = np.zeros((n, len(chain.motor_names)))
        row = np.empty((n, len(reactions.names_of(chain.mechanism)), 6))
        cause = {"aa": aa} if out else {"tau": tau}
        calls["accelerations, batch"] = (lambda: chain.compute_accelerations(q, va, tau), n)
        calls["reactions, batch"] = (lambda: chain.reactions(q, va, out=row, **cause), n)
    return calls | {
        "pin.rneaInParallel, 1 thread": (
            lambda: pin.rneaInParallel(1, pool, columns, rates, rates, theirs),
            n,
        )
    }


def rollouts(chain: ClosedChain, q: Array, closed: Closed, starts: int, steps: int) -> Calls:
    """Motions without torques from rest, one thread, both by the classical Runge-Kutta method."""
    world, state = closed
    dt = world.opt.timestep
    rest = np.zeros((starts, chain.degrees_of_freedom))
    world.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    row = np.zeros(mujoco.mj_stateSize(world, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(world, state, row, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    runner = mujoco.rollout.Rollout(nthread=0)  # 0: this thread
    rows = np.tile(row, (starts, 1))
    torques = np.zeros((starts, steps, len(chain.motor_names)))
    q = np.tile(q, (starts, 1))
    ours = chain.rollout(torques, q, rest, dt).q[:, -1]
    theirs, _ = runner.rollout(world, state, rows, nstep=steps)
    ways = [np.abs(ours - q).max(), np.abs(theirs[:, -1] - row)[:, 1 : 1 + world.nq].max()]
    assert np.isclose(*ways, rtol=1e-3), f"not the same motion: {ways}"
    units = starts * steps
    return {
        "rollout": (lambda: chain.rollout(torques, q, rest, dt), units),
        "mujoco.rollout": (lambda: runner.rollout(world, state, rows, nstep=steps), units),
    }


# --- the SST ------------------------------------------------------------------------------------


def on_the_circle(robot: SST, t: Array | float) -> Motion:
    """A motion on the paper's circle."""
    q, va, aa = (np.ascontiguousarray(x) for x in robot.joint_motion(*paper_circle(t)))
    return q, va, aa


def batch(robot: SST, n: int) -> Motion:
    """Random samples of the paper's circle."""
    return on_the_circle(robot, np.random.default_rng(0).uniform(0, paper.PERIOD, n))

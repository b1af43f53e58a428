# SPDX-License-Identifier: BSD-2-Clause
"""What benchmark.py measures on robots other than the SST: compiled kernels against the rest."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import cassie
from pinocchio_peers import Constrained, Kkt
from sst_pin import ClosedChain, robots
from sst_pin.chain.tree import series_of
from sst_pin.compiled import build

Array = NDArray[np.float64]
Calls = dict[str, tuple[Callable[[], object], float]]


def floating_cassie() -> ClosedChain:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "cassie.xml")
        path.write_text(cassie.mjcf(), encoding="utf-8")
        return ClosedChain.from_mjcf(path)


ROBOTS: dict[str, Callable[[], ClosedChain]] = {
    "four-bar": robots.four_bar,
    "planar 3-RRR": robots.planar_3rrr,
    "delta": robots.delta,
    "hexapod": robots.stewart,
    "Cassie, floating": floating_cassie,
    "ladder of 4": partial(robots.ladder, 4),
    "ladder of 96": partial(robots.ladder, 96),
}
#: Coordinates above which inertia matrices are not written out, so that torques alone are compiled.
MOST = 40


def closed_in_mujoco(chain: ClosedChain, q: Array, dt: float) -> tuple[Any, Any]:
    """The tree in MuJoCo with springs and dampers, its points closed by stiff `connect`s."""
    model, spec = chain.model, mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = dt, model.gravity.linear
    bodies, places = [spec.worldbody], []
    for i in range(1, model.njoints):
        joint, at, inertia = model.joints[i], model.jointPlacements[i], model.inertias[i]
        body = bodies[model.parents[i]].add_body(name=model.names[i])
        body.pos, body.quat = at.translation, _quaternion(pin.Quaternion(at.rotation))
        body.mass, body.ipos = max(inertia.mass, 1e-9), inertia.lever
        moments = inertia.inertia + 1e-12 * np.eye(3)
        body.fullinertia = moments[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        body.explicitinertial = True
        own = q[joint.idx_q : joint.idx_q + joint.nq].copy()
        if joint.nq > joint.nv:
            kinds = {4: mujoco.mjtJoint.mjJNT_BALL, 7: mujoco.mjtJoint.mjJNT_FREE}
            body.add_joint(name=model.names[i], type=kinds[joint.nq])
            own[-4:] = own[[-1, -4, -3, -2]]
            places.append((model.names[i], own, joint.idx_q, joint.idx_v))
        else:  # turns and slides in a row
            for k, (one, _) in enumerate(series_of(joint)):  # S of a universal joint is not all set
                data = one.createData()
                one.calc(data, np.zeros(1))
                S = np.ravel(data.S)
                turns = bool(S[3:].any())
                kind = mujoco.mjtJoint.mjJNT_HINGE if turns else mujoco.mjtJoint.mjJNT_SLIDE
                name = f"{model.names[i]} {k}"
                body.add_joint(name=name, type=kind, axis=S[3:] if turns else S[:3])
                places.append((name, own[k : k + 1], joint.idx_q + k, joint.idx_v + k))
        bodies.append(body)
    for k, closure in enumerate(chain.closures):
        names = []
        for name in (closure.frame_a, closure.frame_b):
            frame = model.frames[model.getFrameId(name)]
            site = bodies[frame.parentJoint].add_site(name=f"{k} {name}")
            site.pos = frame.placement.translation
            names.append(site.name)
        equality = spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, name1=names[0], name2=names[1])
        equality.objtype = mujoco.mjtObj.mjOBJ_SITE
        equality.solref[:2], equality.solimp[:2] = (-1e6, -2e3), 0.9999
    compiled = spec.compile()
    compiled.opt.tolerance = 1e-8
    state = mujoco.MjData(compiled)
    mechanism = chain._current.mechanism
    for name, own, i, k in places:
        joint = compiled.joint(name)
        start, size = joint.qposadr[0], len(joint.dofadr)
        state.qpos[start : start + len(own)] = own
        compiled.dof_damping[joint.dofadr] = mechanism.friction.viscous[k : k + size]
        if size == 1:
            compiled.jnt_stiffness[joint.id] = mechanism.springs.stiffness[k]
            compiled.qpos_spring[start] = mechanism.springs.reference[i]
    return compiled, state


def _quaternion(x: pin.Quaternion) -> Array:
    return np.array([x.w, x.x, x.y, x.z])


def compiled(name: str) -> tuple[ClosedChain, dict[str, float]]:
    """The robot with its kernels, and what they cost: seconds, bytes."""
    with tempfile.TemporaryDirectory() as folder:
        before = os.environ.get("XDG_CACHE_HOME")
        os.environ["XDG_CACHE_HOME"] = folder
        try:
            seconds = []
            for _ in range(2):
                chain = ROBOTS[name]()
                start = time.perf_counter()
                chain.compile()
                seconds.append(time.perf_counter() - start)
            size = sum(entry.size for entry in build.cached())
        finally:
            del os.environ["XDG_CACHE_HOME"]
            if before is not None:
                os.environ["XDG_CACHE_HOME"] = before
    return chain, {"compile": seconds[0], "from the cache": seconds[1], "bytes": size}


def single_calls(name: str, chain: ClosedChain) -> Calls:
    q, n, motors = chain.generic_configuration(), chain.degrees_of_freedom, len(chain.motor_names)
    va, aa = np.random.default_rng(0).normal(size=(2, n))
    model, data, reference = chain.model, chain.model.createData(), ROBOTS[name]()
    v, tau, kkt = chain.joint_rates(q, va), np.ones(motors), Kkt(chain, q)
    ours = chain.compute_torques if motors >= n else chain.generalized_forces
    theirs = reference.compute_torques if motors >= n else reference.generalized_forces
    forces = chain.generalized_forces(q, va, aa)
    if not (model.damping.any() or model.friction.any() or model.armature.any()):
        found = kkt.forces(q, va, aa)
        assert np.abs(found - forces).max() < 1e-8 * np.abs(forces).max(), name
    calls: Calls = {
        "pin.rnea, open tree": (lambda: pin.rnea(model, data, q, v, v), 1),
        "torques": (lambda: ours(q, va, aa), 1),
        "KKT, by hand": (lambda: kkt.forces(q, va, aa), 1),
        "reference path, torques": (lambda: theirs(q, va, aa), 1),
    }
    if n > MOST:
        return calls
    constrained, B = Constrained(chain), chain._current.mechanism.motors
    force = B @ tau
    world, state = closed_in_mujoco(chain, q, 1e-4)
    world.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    return calls | {
        "accelerations": (lambda: chain.compute_accelerations(q, va, tau), 1),
        "pin.constraintDynamics": (lambda: constrained.accelerations(q, v, force), 1),
        "mj_step": (lambda: mujoco.mj_step(world, state), 1),
        "reference path, accelerations": (lambda: reference.compute_accelerations(q, va, tau), 1),
    }


def batches(chain: ClosedChain, samples: int) -> Calls:
    """Random motions at one configuration and at rows of their own."""
    model, n, motors = chain.model, chain.degrees_of_freedom, len(chain.motor_names)
    q = np.tile(chain.generic_configuration(), (samples, 1))
    va, aa = np.random.default_rng(0).normal(size=(2, samples, n))
    enough = motors >= n
    ours = chain.compute_torques if enough else chain.generalized_forces
    out = np.empty((samples, motors if enough else n))
    pool, columns = pin.ModelPool(model, 1), np.asfortranarray(q.T)
    rates = np.asfortranarray(np.ones((model.nv, samples)))
    theirs = np.empty((model.nv, samples), order="F")
    keyword = {"out": out} if enough else {}
    return {
        "torques, batch": (lambda: ours(q, va, aa, **keyword), samples),
        "pin.rneaInParallel, 1 thread": (
            lambda: pin.rneaInParallel(1, pool, columns, rates, rates, theirs),
            samples,
        ),
    }


def rollouts(chain: ClosedChain, starts: int = 64, steps: int = 50) -> Calls:
    """Motions without torques from rest, one thread, both by the classical Runge-Kutta method."""
    dt, q = 1e-4, chain.generic_configuration()
    rest, tau = np.zeros((starts, chain.degrees_of_freedom)), len(chain.motor_names)
    world, state = closed_in_mujoco(chain, q, dt)
    world.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    row = np.zeros(mujoco.mj_stateSize(world, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(world, state, row, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    runner, rows = mujoco.rollout.Rollout(nthread=0), np.tile(row, (starts, 1))
    torques, q = np.zeros((starts, steps, tau)), np.tile(q, (starts, 1))
    ours = chain.rollout(torques, q, rest, dt).q[:, -1]
    theirs, _ = runner.rollout(world, state, rows, nstep=steps)
    ways = [np.abs(ours - q).max(), np.abs(theirs[:, -1] - row)[:, 1 : 1 + world.nq].max()]
    assert np.isclose(*ways, rtol=1e-3), f"not the same motion: {ways}"
    return {
        "rollout": (lambda: chain.rollout(torques, q, rest, dt), starts * steps),
        "mujoco.rollout": (
            lambda: runner.rollout(world, state, rows, nstep=steps),
            starts * steps,
        ),
    }


def measure(
    names: Sequence[str], in_turn: Callable[..., Any], repeats: tuple[int, int], turn: float
) -> dict[str, Any]:
    """All of it, by robot.

    Args:
        names: Names of the robots.
        in_turn: Measures calls, as in benchmark.py.
        repeats: Numbers of long calls and of short ones.
        turn: Seconds of a short one.
    """
    few, many = repeats
    found = {}
    for name in names:
        chain, cost = compiled(name)
        samples = 1000 if chain.model.nv > 100 else 100_000
        found[name] = {
            "joints": chain.model.nv,
            "freedoms": chain.degrees_of_freedom,
            "path": chain.path,
            "cost": cost,
            "single call": in_turn(single_calls(name, chain), many, turn),
            "sample of a batch": in_turn(batches(chain, samples), few),
        }
        if chain.degrees_of_freedom <= MOST:
            found[name]["rollout step"] = in_turn(rollouts(chain), few)
    return found

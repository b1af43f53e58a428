# SPDX-License-Identifier: BSD-2-Clause
"""What benchmark.py measures on robots other than the SST: compiled kernels against the rest."""

import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import mujoco
import numpy as np
import pinocchio as pin

import benchmark_cases as cases
import cassie
from sst_pin import ClosedChain, robots
from sst_pin.arrays import Array
from sst_pin.compiled import libraries
from sst_pin.model.tree import series_of
from tests.gallery import ladder


def cassie_of_mujoco(locked: Sequence[str] = ()) -> ClosedChain:
    """Floating, or with joints held."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "cassie.xml")
        path.write_text(cassie.mjcf(), encoding="utf-8")
        return ClosedChain.from_mjcf(path, locked=locked)


ROBOTS: dict[str, Callable[[], ClosedChain]] = {
    "four-bar": robots.four_bar,
    "planar 3-RRR": robots.planar_3rrr,
    "delta": robots.delta,
    "hexapod": robots.stewart,
    "Cassie, floating": cassie_of_mujoco,
    "ladder of 4": partial(ladder, 4),
    "ladder of 96": partial(ladder, 96),
}
#: Coordinates above which inertia matrices are not written out, so that torques alone are compiled.
MOST = 40


def closed_in_mujoco(chain: ClosedChain, q: Array, dt: float) -> cases.Closed:
    """The tree in MuJoCo with springs and dampers, its points closed by stiff `connect`s."""
    model, spec = chain.model, mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = dt, model.gravity.linear
    bodies, places = [spec.worldbody], []
    for i in range(1, model.njoints):
        joint, at, inertia = model.joints[i], model.jointPlacements[i], model.inertias[i]
        body = bodies[model.parents[i]].add_body(name=model.names[i])
        body.pos, body.quat = at.translation, np.roll(pin.Quaternion(at.rotation).coeffs(), 1)
        body.mass, body.ipos = max(inertia.mass, 1e-9), inertia.lever
        moments = inertia.inertia + 1e-12 * np.eye(3)
        body.fullinertia = moments[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        body.explicitinertial = True
        own = q[joint.idx_q : joint.idx_q + joint.nq].copy()
        if joint.nq > joint.nv:
            kinds = {4: mujoco.mjtJoint.mjJNT_BALL, 7: mujoco.mjtJoint.mjJNT_FREE}
            body.add_joint(name=model.names[i], type=kinds[joint.nq])
            own[-4:] = np.roll(own[-4:], 1)
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
    mechanism = chain.mechanism
    for name, own, i, k in places:
        joint = compiled.joint(name)
        start, size = joint.qposadr[0], len(joint.dofadr)
        state.qpos[start : start + len(own)] = own
        compiled.dof_damping[joint.dofadr] = mechanism.friction.viscous[k : k + size]
        if size == 1:
            compiled.jnt_stiffness[joint.id] = mechanism.springs.stiffness[k]
            compiled.qpos_spring[start] = mechanism.springs.reference[i]
    return compiled, state


@contextmanager
def empty_cache() -> Iterator[None]:
    """Nothing is compiled yet."""
    with tempfile.TemporaryDirectory() as folder, patch.dict(os.environ, XDG_CACHE_HOME=folder):
        yield


def compiled(name: str) -> tuple[ClosedChain, dict[str, float]]:
    """The robot with its kernels, and what they cost: seconds, bytes."""
    seconds = []
    with empty_cache():
        for _ in range(2):
            chain = ROBOTS[name]()
            start = time.perf_counter()
            chain.compile()
            seconds.append(time.perf_counter() - start)
        size = sum(library.size for library in libraries.cached())
    return chain, {"compile": seconds[0], "from the cache": seconds[1], "bytes": size}


def measure(
    names: Sequence[str], in_turn: Callable[..., Any], repeats: tuple[int, int], turn: float
) -> dict[str, Any]:
    """All of it, by robot, with `in_turn` of benchmark.py.

    Long calls and short ones have their own numbers of repeats; a turn of short ones lasts `turn`.
    """
    (few, many), found = repeats, {}
    for name in names:
        chain, cost = compiled(name)
        q, n = chain.generic_configuration(), chain.degrees_of_freedom
        motion = (q, *np.random.default_rng(0).normal(size=(2, n)))
        closed = closed_in_mujoco(chain, q, 1e-4) if n <= MOST else None
        calls = cases.single_calls(chain, ROBOTS[name](), motion, closed)
        samples = 1000 if chain.model.nv > 100 else 100_000
        rates = np.random.default_rng(0).normal(size=(2, samples, n))
        many_motions = (np.tile(q, (samples, 1)), *rates)
        found[name] = {
            "joints": chain.model.nv,
            "freedoms": n,
            "path": chain.path,
            "cost": cost,
            "single call": in_turn(calls, many, turn),
            "sample of a batch": in_turn(cases.batches(chain, many_motions), few),
        }
        if closed:
            rolled = cases.rollouts(chain, q, closed_in_mujoco(chain, q, 1e-4), 64, 50)
            found[name]["rollout step"] = in_turn(rolled, few)
    return found

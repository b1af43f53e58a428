# SPDX-License-Identifier: BSD-2-Clause
"""Times of steps with contacts and loops, beside MuJoCo: `python scripts/benchmark/contacts.py`.

The biped of tests/gallery/on_feet.py stands up under gains of its motors, with steps of 0.5 ms, in
MuJoCo with `implicitfast` and loops and contacts as stiff as it allows. Both use one thread. The
calls that are compared take turns, and the least CPU time of each counts, so that other programs on
the machine disturb little. Depths and open loops are the largest of all steps.
"""

import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco import rollout

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.gallery.on_feet import RADIUS, biped
from tests.support.biped_in_mujoco import mujoco_biped, start_of

STEP = 5e-4
STEPS = 600
MANY = 64
FRICTION = 0.8
STIFFNESS = 150.0
DAMPING = 1.0


class Peers(NamedTuple):
    """Least CPU times of two calls that take turns, [s]."""

    ours: float
    mujoco: float


def least_times(
    ours: Callable[[], object], mujoco_call: Callable[[], object], repeats: int
) -> Peers:
    """Time two calls in turns; both run in this thread."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        ours()
        between = time.process_time()
        mujoco_call()
        times.append((between - start, time.process_time() - between))
    return Peers(*np.min(times, axis=0))


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    chain = biped(friction=FRICTION)
    chain.compile()
    n = chain.degrees_of_freedom
    motors = len(chain.motor_names)
    gains = {
        "nonsmooth": True,
        "motor_stiffness": np.full(motors, STIFFNESS),
        "motor_damping": np.full(motors, DAMPING),
    }
    model = mujoco_biped(STEP, STIFFNESS, DAMPING, FRICTION)
    home = chain.home
    data = mujoco.MjData(model)
    qpos, held = start_of(chain, model)

    def reset() -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.ctrl[:] = qpos, held

    def step_mujoco() -> None:
        reset()
        for _ in range(STEPS):
            mujoco.mj_step(model, data)

    tau = np.zeros((STEPS, motors))
    single = least_times(
        lambda: chain.rollout(tau, home, np.zeros(n), STEP, **gains), step_mujoco, 9
    )
    rates = 0.01 * np.random.default_rng(0).normal(size=(MANY, n))
    taus = np.zeros((MANY, STEPS, motors))
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    reset()
    state = np.zeros(size)
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states = np.tile(state, (MANY, 1))
    controls = np.tile(held, (MANY, STEPS, 1))
    many = least_times(
        lambda: chain.rollout(taus, home, rates, STEP, threads=1, **gains),
        lambda: rollout.rollout(model, data, states, controls),
        5,
    )

    motion = chain.rollout(taus, home, rates, STEP, **gains)
    opened = np.abs(chain.residual(motion.q[::8, ::10])).max()
    heights = [chain.frame_placement(motion.q[::8], x.frame)[0][..., 2] for x in chain.contacts]
    reset()
    open_peer, deep_peer = 0.0, 0.0
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
        loops = data.efc_pos[: data.ne]
        open_peer = max(open_peer, float(np.abs(loops).max(initial=0)))
        deep_peer = min(deep_peer, float(data.contact.dist.min(initial=0)))
    show("one biped: mj_step", single, STEPS)
    show(f"{MANY} bipeds: mujoco.rollout", many, MANY * STEPS)
    print(f"loops open {opened:.0e} m, MuJoCo {open_peer:.0e} m")
    print(f"depth {RADIUS - np.min(heights):.0e} m, MuJoCo {-deep_peer:.0e} m")
    unsolved = int((motion.status > 0).sum())
    print(f"residual {motion.residual.max():.0e}, steps not solved {unsolved}")


def show(title: str, times: Peers, steps: int) -> None:
    """Print the times of a step, [us], and their ratio."""
    ours, peer = (seconds / steps * 1e6 for seconds in times)
    print(f"{title} {peer:.1f} us a step; ours {ours:.1f} us; {ours / peer:.2f}")


if __name__ == "__main__":
    main()

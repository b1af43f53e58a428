# SPDX-License-Identifier: BSD-2-Clause
"""Times of steps with contacts and loops, beside MuJoCo: `python scripts/benchmark/contacts.py`.

The biped of tests/gallery/on_feet.py stands up under gains of its motors, with steps of 0.5 ms, in
MuJoCo with `implicitfast` and loops and contacts as stiff as it allows. All times are from one run:
the least of some repeats. Depths and open loops are the largest of all steps.
"""

import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.gallery.on_feet import RADIUS, biped
from tests.support.biped_in_mujoco import mujoco_biped, start_of

STEP, STEPS, MANY, FRICTION = 5e-4, 600, 64, 0.8
STIFFNESS, DAMPING = 150.0, 1.0


def least_time(call: Callable[[], object], repeats: int) -> float:
    """Least time of some calls, [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    chain = biped(friction=FRICTION)
    chain.compile()
    n, motors = chain.degrees_of_freedom, len(chain.motor_names)
    gains = {
        "nonsmooth": True,
        "motor_stiffness": np.full(motors, STIFFNESS),
        "motor_damping": np.full(motors, DAMPING),
    }
    model, home = mujoco_biped(STEP, STIFFNESS, DAMPING, FRICTION), chain.home
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
    one = least_time(lambda: chain.rollout(tau, home, np.zeros(n), STEP, **gains), 9) / STEPS
    peer = least_time(step_mujoco, 5) / STEPS
    rates = 0.01 * np.random.default_rng(0).normal(size=(MANY, n))
    taus = np.zeros((MANY, STEPS, motors))
    many = least_time(lambda: chain.rollout(taus, home, rates, STEP, **gains), 3)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    reset()
    state = np.zeros(size)
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states, controls = np.tile(state, (MANY, 1)), np.tile(held, (MANY, STEPS, 1))
    peers = least_time(lambda: rollout.rollout(model, data, states, controls), 3)

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
    print(f"one biped: {one * 1e6:.1f} us a step; mj_step {peer * 1e6:.1f} us; {one / peer:.2f}")
    many, peers = many / STEPS / MANY * 1e6, peers / STEPS / MANY * 1e6
    print(f"{MANY} bipeds: {many:.2f} us each; mujoco.rollout {peers:.2f} us; {many / peers:.2f}")
    print(f"loops open {opened:.0e} m, MuJoCo {open_peer:.0e} m")
    print(f"depth {RADIUS - np.min(heights):.0e} m, MuJoCo {-deep_peer:.0e} m")
    print(
        f"residual {motion.residual.max():.0e}, steps not solved {int((motion.status > 0).sum())}"
    )


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: BSD-2-Clause
"""Nonsmooth steps of many bipeds on a GPU, beside the compiled rollout on one thread of the CPU."""

import argparse
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import warp as wp

from sst_pin.compiled import warp_batch

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from tests.gallery.on_feet import biped

#: Step of the simulations, [s], and their number.
STEP = 5e-4
STEPS = 600
#: Gains of the motors, [N m/rad] and [N m s/rad].
STIFFNESS = 150.0
DAMPING = 1.0
#: Most bipeds in the compiled rollout.
MOST_COMPILED = 16

Row = dict[str, Any]


def measure_contacts(dtype: str, options: argparse.Namespace) -> Row:
    """Steps per second of bipeds while they fall 10 mm and stand up."""
    chain = biped()
    count = options.samples
    rates = 0.05 * np.random.default_rng(0).normal(size=(count, chain.degrees_of_freedom))
    row = _measure_warp(chain, dtype, options, rates)
    row["compiled"] = _compiled_steps_per_second(chain, rates[: min(count, MOST_COMPILED)])
    return row


def _gains(motors: int) -> dict[str, np.ndarray]:
    """Arguments of a step: the gains of the motors."""
    return {
        "motor_stiffness": np.full(motors, STIFFNESS),
        "motor_damping": np.full(motors, DAMPING),
    }


def _measure_warp(chain: Any, dtype: str, options: argparse.Namespace, rates: np.ndarray) -> Row:
    """Steps per second of Warp's `step`, and how the motions end."""
    batch = chain.warp(options.device, dtype)
    count = options.samples
    motors = len(chain.motor_names)

    def array(value: np.ndarray) -> Any:
        """An array on the device."""
        return wp.array(value, dtype=batch.dtype, device=batch.device)

    places = [chain.model.joints[chain.model.getJointId(name)].idx_q for name in chain.motor_names]
    status = wp.zeros(count, dtype=wp.int32, device=batch.device)
    arguments = {
        "nonsmooth": True,
        "motor_positions": array(np.tile(chain.home[places], (count, 1))),
        "status": status,
        **_gains(motors),
    }
    tau = array(np.zeros((count, motors)))
    start = (array(np.tile(chain.home, (count, 1))), array(rates))
    state = batch.step(start, tau, STEP, **arguments)  # compiles
    wp.synchronize()
    seconds = 0.0
    unsolved = 0
    for _ in range(STEPS):
        begin = perf_counter()
        state = batch.step(state, tau, STEP, out=state, **arguments)
        wp.synchronize()
        seconds += perf_counter() - begin
        unsolved += int((status.numpy() == warp_batch.Status.UNSOLVED).sum())
    end = state.q.numpy().astype(float)
    closed = end[np.isfinite(end).all(axis=1)]
    return {
        "dtype": dtype,
        "device": batch.device.name,
        "samples": count,
        "steps": count * STEPS / seconds,
        "unsolved": unsolved,
        "ended": count - len(closed),
        "gap": float(np.abs(chain.residual(closed)).max(initial=0)),
    }


def _compiled_steps_per_second(chain: Any, rates: np.ndarray) -> float:
    """Steps per second of the compiled rollout from these rates."""
    chain.compile()
    count = len(rates)
    motors = len(chain.motor_names)
    torques = np.zeros((count, STEPS, motors))
    arguments = {"nonsmooth": True, **_gains(motors)}
    chain.rollout(torques[:, :1], chain.home, rates, STEP, **arguments)  # starts its threads
    begin = perf_counter()
    chain.rollout(torques, chain.home, rates, STEP, **arguments)
    return count * STEPS / (perf_counter() - begin)


def contacts_table(rows: list[Row]) -> list[tuple[str, ...]]:
    """Speeds of bipeds, in a form to read."""
    title = f"{rows[0]['samples']} bipeds"
    lines = [(title, "steps/s", "compiled rollout", "ratio", "not solved", "ended", "loops open")]
    for row in rows:
        line = (
            row["dtype"],
            f"{row['steps']:.4g}",
            f"{row['compiled']:.4g}",
            f"{row['steps'] / row['compiled']:.3g}",
            str(row["unsolved"]),
            str(row["ended"]),
            f"{row['gap']:.0e}",
        )
        lines.append(line)
    return lines

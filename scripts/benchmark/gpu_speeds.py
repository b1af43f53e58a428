# SPDX-License-Identifier: BSD-2-Clause
"""Samples per second of a robot's kernels on a GPU, and their errors."""

import argparse
import subprocess
from collections.abc import Callable
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import warp as wp

import sst_pin
from gpu_resources import KERNELS, operations
from sst_pin.compiled import warp_batch

#: Step of the simulations, [s], and their number.
STEP = 1e-4
STEPS = 1000
#: States near home from which samples are made.
STATES = 64
#: Units of an SM for fused multiply-adds of doubles and floats, by architecture.
UNITS = {
    70: {"float64": 32, "float32": 64},
    75: {"float64": 2, "float32": 64},
    80: {"float64": 32, "float32": 64},
    86: {"float64": 2, "float32": 128},
    89: {"float64": 2, "float32": 128},
    90: {"float64": 64, "float32": 128},
}

Row = dict[str, Any]


class States(NamedTuple):
    """States of a robot with accelerations, and torques for them."""

    q: np.ndarray
    va: np.ndarray
    aa: np.ndarray
    tau: np.ndarray

    def repeated(self, count: int) -> "States":
        """These states again and again, `count` samples."""
        return States(*(np.resize(x, (count, x.shape[1])) for x in self))

    def on_device(self, batch: warp_batch.WarpBatch) -> "States":
        """The same states as arrays of Warp."""
        return States(*(wp.array(x, dtype=batch.dtype, device=batch.device) for x in self))


def measure(name: str, chain: sst_pin.ClosedChain, dtype: str, options: argparse.Namespace) -> Row:
    """Samples per second of a robot's kernels, and their errors."""
    start = perf_counter()
    batch = chain.warp(options.device, dtype)
    states = states_near_home(batch, chain)
    row: Row = {
        "robot": name,
        "dtype": dtype,
        "device": batch.device.name,
        "samples": options.samples,
        "torque error": torque_error(batch, states),
    }
    row |= speeds(batch, states.repeated(options.samples), options)
    for label in KERNELS:
        arithmetic = row[label] * operations(batch, KERNELS[label])
        row[f"{label}: share"] = arithmetic / limit(batch.device, dtype)
    row |= end_of_motions(batch, chain, states)
    row["seconds"] = perf_counter() - start
    return row


def states_near_home(batch: warp_batch.WarpBatch, chain: sst_pin.ClosedChain) -> States:
    """Closed configurations with random rates and accelerations, in the numbers of the device."""
    random = np.random.default_rng(0)
    noise = 0.03 * random.normal(size=(4 * STATES, chain.model.nv))
    near = np.array([pin.integrate(chain.model, chain.home, x) for x in noise])
    closed = batch.closed(wp.array(near, dtype=batch.dtype, device=batch.device)).numpy()
    q = closed[np.isfinite(closed).all(axis=1)][:STATES]
    va, aa = random.normal(size=(2, len(q), chain.degrees_of_freedom))
    # Rounded as on the device, so that both compute the same.
    numbers = batch.dtype.__name__
    q, va, aa = (x.astype(numbers).astype(float) for x in (q, va, aa))
    return States(q=q, va=va, aa=aa, tau=chain.compute_torques(q, va, aa))


def torque_error(batch: warp_batch.WarpBatch, states: States) -> float:
    """Largest error of the torques on the device, relative to the largest torque."""
    x = states.on_device(batch)
    computed = batch.torques(x.q, x.va, x.aa).numpy()
    return float(np.nanmax(np.abs(computed - states.tau)) / np.abs(states.tau).max())


def speeds(batch: warp_batch.WarpBatch, states: States, options: argparse.Namespace) -> Row:
    """Samples per second of each kernel, and how many samples have a bad status."""
    x = states.on_device(batch)
    tau = wp.empty_like(x.tau)
    aa = wp.empty_like(x.va)
    state = (wp.empty_like(x.q), wp.empty_like(x.va))
    count = len(states.q)
    status = wp.zeros(count, dtype=wp.int32, device=batch.device)
    calls = {
        "torques": lambda: batch.torques(x.q, x.va, x.aa, out=tau, status=status),
        "accelerations": lambda: batch.accelerations(x.q, x.va, x.tau, out=aa, status=status),
        "steps": lambda: batch.step((x.q, x.va), x.tau, STEP, out=state, status=status),
    }
    row: Row = {"bad": {}}
    for label, call in calls.items():
        row[label] = count / seconds_of(call, options.seconds)
        row["bad"][label] = int((status.numpy() != 0).sum())

    # Each sample with parameters of its own.
    scales = np.random.default_rng(1).uniform(0.9, 1.1, size=(count, 1))
    each = batch.with_parameters(batch.parameters.numpy() * scales)
    row["steps, own parameters"] = count / seconds_of(
        lambda: each.step((x.q, x.va), x.tau, STEP, out=state), options.seconds
    )
    return row


def seconds_of(call: Callable[[], object], least: float) -> float:
    """Seconds of a call on the device, the least of five turns, each of some seconds at least."""
    call()
    wp.synchronize()
    start = perf_counter()
    call()
    wp.synchronize()
    loops = max(1, round(least / (perf_counter() - start)))
    turns = []
    for _ in range(5):
        start = perf_counter()
        for _ in range(loops):
            call()
        wp.synchronize()
        turns.append((perf_counter() - start) / loops)
    return min(turns)


def limit(device: Any, dtype: str) -> float:
    """Operations per second of a device, a fused multiply-add counted as two; NaN if unknown."""
    if device.is_cpu or device.arch not in UNITS:
        return np.nan
    command = ["nvidia-smi", "--query-gpu=clocks.max.sm", "--format=csv,noheader,nounits"]
    try:
        output = subprocess.run(command, capture_output=True, check=True).stdout
        megahertz = float(output.split()[0])
    except (OSError, subprocess.CalledProcessError, ValueError, IndexError):
        return np.nan
    return 2.0 * UNITS[device.arch][dtype] * device.sm_count * megahertz * 1e6


def end_of_motions(batch: warp_batch.WarpBatch, chain: sst_pin.ClosedChain, states: States) -> Row:
    """How motions from slow states end under the torques that hold the robot at their start."""
    x = states.on_device(batch)
    zero = wp.zeros_like(x.va)
    tau = batch.torques(x.q, zero, zero)
    slow = wp.array(0.1 * states.va, dtype=batch.dtype, device=batch.device)
    end = batch.step((x.q, slow), tau, STEP * STEPS, substeps=STEPS).q.numpy()
    closed = end[np.isfinite(end).all(axis=1)].astype(float)
    gap = float(np.abs(chain.residual(closed)).max(initial=0)) if len(closed) else np.nan
    return {"ended": len(end) - len(closed), "gap": gap}


def table(rows: list[Row]) -> list[tuple[str, ...]]:
    """Speeds and errors, in a form to read."""
    title = f"{rows[0]['device']}, {rows[0]['samples']} samples"
    head = ("numbers", *(f"10^9 {label}/s" for label in KERNELS), "share of limit")
    lines = [(title, *head, "torque error", f"open after {STEPS} steps")]
    for row in rows:
        samples_per_second = [f"{row[label] / 1e9:.3g}" for label in KERNELS]
        shares = [row[f"{label}: share"] for label in KERNELS]
        share = "-"
        if np.isfinite(shares).all():
            share = "/".join(f"{100 * x:.0f}" for x in shares) + "%"
        gap = f"{row['gap']:.0e}" if row["gap"] > 0 else "-"
        error = f"{row['torque error']:.0e}"
        lines.append((row["robot"], row["dtype"], *samples_per_second, share, error, gap))
    return lines

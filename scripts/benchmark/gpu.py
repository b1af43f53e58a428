# SPDX-License-Identifier: BSD-2-Clause
"""Measure the kernels for many robots on a GPU: samples per second, errors, resources.

    python scripts/benchmark/gpu.py                             # on Warp's preferred device
    python scripts/benchmark/gpu.py --robots ankle --out gpu.json
    python scripts/benchmark/gpu.py --contacts --out contacts.json          # bipeds that stand up
    python scripts/benchmark/gpu.py --contacts --device cpu --samples 16    # a try without a GPU
    python scripts/benchmark/gpu.py --resources --arch 90       # no GPU: registers, stack, code
    python scripts/benchmark/gpu.py --resources --robots cassie --dtypes float64
    python scripts/benchmark/gpu.py --page gpu.json             # write the tables of docs/gpu.md

Motions start from 64 states near home with the torques that hold the robot there; `ended` counts
those that reach a singularity. The share of the arithmetic limit counts each operation of the
equations as one; the limit counts a fused multiply-add as two, so that equations without any reach
half of it.

With --contacts, the biped of tests/gallery/on_feet.py (18 coordinates, 6 loops, 8 points) falls
10 mm and stands up under gains of its motors, with nonsmooth steps of 0.5 ms. The compiled rollout
beside it runs on one thread of the CPU. `not solved` counts steps, `ended` robots.
"""  # fmt: skip

import argparse
import json
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import warp as wp

import sst_pin
from sst_pin.compiled import kernels, warp_batch
from sst_pin.dynamics.quantities import Quantity

ROOT = Path(__file__).resolve().parents[2]
ROBOTS = ("ankle", "delta", "sst")
KERNELS = {name: Quantity(name) for name in ("torques", "accelerations")}
KERNELS["steps"] = Quantity("rollout")
#: Units of an SM for fused multiply-adds of doubles and floats, by architecture.
UNITS = {70: (32, 64), 75: (2, 64), 80: (32, 64), 86: (2, 128), 89: (2, 128), 90: (64, 128)}
#: Step of the simulations, [s], and their number.
STEP, STEPS = 1e-4, 1000
#: Step of bipeds with contacts, [s], and their number.
CONTACT_STEP, CONTACT_STEPS = 5e-4, 600
_FREE = {ca.OP_NEG, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}
#: Tags of the numbers of registers and of bytes of the stack in a CUDA binary.
_REGISTERS, _STACK = 0x2F, 0x11

Row = dict[str, Any]


def robot_of(name: str) -> sst_pin.ClosedChain:
    """The SST, a floating Cassie ("cassie"), or a robot of the gallery."""
    if name == "sst":
        return sst_pin.SST()
    if name == "cassie":
        sys.path.append(str(ROOT / "examples"))
        from benchmark_robots import cassie_of_mujoco

        return cassie_of_mujoco()
    return getattr(sst_pin.robots, name)()


# --- what a kernel needs ----------------------------------------------------------------------


def operations(batch: warp_batch.WarpBatch, key: Quantity) -> int:
    """Arithmetic operations of one sample; a step closes the loops four times."""
    total = 0
    for kernel in kernels.entry(batch._equations_of(False, False), key):
        inputs = [ca.vertcat(*kernel.inputs.values()), kernel.parameters]
        result = ca.vertcat(kernel.output, kernel.checks)
        function = ca.Function("count", inputs, [ca.densify(result)], {"cse": True})
        codes = [function.instruction_id(i) for i in range(function.n_instructions())]
        times = 4 if key.name == "rollout" else 1
        total += times * sum(code not in _FREE for code in codes)
    return total


def binary_numbers(binary: bytes, kernel: str) -> Row:
    """Registers, bytes of the stack and bytes of code of a kernel in an ELF file for CUDA."""
    start, size, count, names = (
        *struct.unpack_from("<Q", binary, 40),
        *struct.unpack_from("<3H", binary, 58),
    )
    headers = [struct.unpack_from("<IIQQQQIIQQ", binary, start + size * i) for i in range(count)]

    def text(table: int, offset: int) -> str:
        at = headers[table][4] + offset
        return binary[at : binary.index(b"\0", at)].decode()

    sections = {text(names, header[0]): header for header in headers}
    symbols = next(header for header in headers if header[1] == 2)
    result: Row = {}
    for name, header in sections.items():
        if name.startswith(f".text.{kernel}"):
            result["code"] = header[5]
    at, end = sections[".nv.info"][4], sum(sections[".nv.info"][4:6])
    while at < end:
        form, tag, length = struct.unpack_from("<BBH", binary, at)
        if form == 4 and tag in (_REGISTERS, _STACK):
            symbol, value = struct.unpack_from("<II", binary, at + 4)
            (name_at,) = struct.unpack_from("<I", binary, symbols[4] + 24 * symbol)
            if text(symbols[6], name_at).startswith(kernel):
                result["registers" if tag == _REGISTERS else "stack"] = value
        at += 4 + (length if form == 4 else 0)
    return result


def resources(name: str, chain: sst_pin.ClosedChain, dtype: str, arch: int) -> list[Row]:
    """What the machine code of a robot's kernels needs, without a GPU."""
    rows = []
    batch = chain.warp("cpu", dtype)
    of_robot = KERNELS
    if len(chain.motor_names) < chain.degrees_of_freedom:
        of_robot = KERNELS | {"torques": Quantity("generalized_forces")}
    for label, key in of_robot.items():
        module, start = batch.module(key), perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            wp.compile_aot_module(module, arch=arch, module_dir=folder, use_ptx=False)
            seconds = perf_counter() - start
            binary = next(Path(folder).glob("*.cubin")).read_bytes()
        numbers = binary_numbers(binary, "run_")
        about = {"robot": name, "kernel": label, "dtype": batch.dtype.__name__, "arch": arch}
        rows.append(about | numbers | {"compile": seconds, "operations": operations(batch, key)})
    return rows


# --- samples per second -----------------------------------------------------------------------


def seconds_of(call: Callable[[], object], least: float) -> float:
    """Seconds of a call on the device, the least of five turns of some length."""
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
        clock = float(subprocess.run(command, capture_output=True, check=True).stdout.split()[0])
    except (OSError, subprocess.CalledProcessError, ValueError, IndexError):
        return np.nan
    return 2.0 * UNITS[device.arch][dtype == "float32"] * device.sm_count * clock * 1e6


def samples(batch: warp_batch.WarpBatch, chain: sst_pin.ClosedChain) -> dict[str, np.ndarray]:
    """Closed configurations, rates and accelerations of 64 samples near home."""
    random, n = np.random.default_rng(0), chain.degrees_of_freedom
    noise = 0.03 * random.normal(size=(256, chain.model.nv))
    near = np.array([pin.integrate(chain.model, chain.home, x) for x in noise])
    array = wp.array(near, dtype=batch.dtype, device=batch.device)
    q = batch.closed(array).numpy()
    q = q[np.isfinite(q).all(axis=1)][:64]
    va, aa = random.normal(size=(2, len(q), n))
    return {"q": q, "va": va, "aa": aa}


def measure(name: str, dtype: str, options: argparse.Namespace) -> Row:
    """Samples per second of a robot's kernels, and their errors."""
    chain = robot_of(name)
    batch = chain.warp(options.device, dtype)
    device, start = batch.device, perf_counter()
    states = samples(batch, chain)
    few = {x: wp.array(value, dtype=batch.dtype, device=device) for x, value in states.items()}
    exact = [x.numpy().astype(float) for x in few.values()]
    tau = chain.compute_torques(*exact)
    row: Row = {"robot": name, "dtype": dtype, "device": device.name, "samples": options.samples}
    found = batch.torques(few["q"], few["va"], few["aa"]).numpy()
    row["torque error"] = float(np.nanmax(np.abs(found - tau)) / np.abs(tau).max())
    many = [np.resize(x, (options.samples, x.shape[1])) for x in (*exact, tau)]
    q, va, aa, torque = (wp.array(x, dtype=batch.dtype, device=device) for x in many)
    out, like_tau = wp.empty_like(va), wp.empty_like(torque)
    state = wp.empty_like(q), wp.empty_like(va)
    status = wp.zeros(options.samples, dtype=wp.int32, device=device)
    calls = {
        "torques": lambda: batch.torques(q, va, aa, out=like_tau, status=status),
        "accelerations": lambda: batch.accelerations(q, va, torque, out=out, status=status),
        "steps": lambda: batch.step((q, va), torque, STEP, out=state, status=status),
    }
    row["bad"] = {}
    for label, call in calls.items():
        row[label] = options.samples / seconds_of(call, options.seconds)
        row["bad"][label] = int((status.numpy() != 0).sum())
        row[f"{label}: share"] = (
            row[label] * operations(batch, KERNELS[label]) / limit(device, dtype)
        )
    scales = np.random.default_rng(1).uniform(0.9, 1.1, size=(options.samples, 1))
    each = batch.with_parameters(batch.parameters.numpy() * scales)
    row["steps, own parameters"] = options.samples / seconds_of(
        lambda: each.step((q, va), torque, STEP, out=state), options.seconds
    )
    still = np.zeros_like(exact[1])
    held = batch.torques(few["q"], *(wp.array(still, batch.dtype, device=device) for _ in range(2)))
    slow = wp.array(0.1 * exact[1], dtype=batch.dtype, device=device)
    end = batch.step((few["q"], slow), held, STEP * STEPS, substeps=STEPS).q.numpy()
    closed = end[np.isfinite(end).all(axis=1)].astype(float)
    row["ended"] = len(end) - len(closed)
    row["gap"] = float(np.abs(chain.residual(closed)).max(initial=0)) if len(closed) else np.nan
    return row | {"seconds": perf_counter() - start}


# --- bipeds with contacts ---------------------------------------------------------------------


def measure_contacts(dtype: str, options: argparse.Namespace) -> Row:
    """Nonsmooth steps per second of bipeds while they stand up."""
    sys.path.insert(0, str(ROOT))
    from tests.gallery.on_feet import biped

    chain = biped()
    n, motors = chain.degrees_of_freedom, len(chain.motor_names)
    gains = {"motor_stiffness": np.full(motors, 150.0), "motor_damping": np.full(motors, 1.0)}
    batch, count = chain.warp(options.device, dtype), options.samples

    def array(value: np.ndarray) -> Any:
        return wp.array(value, dtype=batch.dtype, device=batch.device)

    places = [chain.model.joints[chain.model.getJointId(name)].idx_q for name in chain.motor_names]
    rates = 0.05 * np.random.default_rng(0).normal(size=(count, n))
    tau = array(np.zeros((count, motors)))
    hold = array(np.tile(chain.home[places], (count, 1)))
    status = wp.zeros(count, dtype=wp.int32, device=batch.device)
    fixed = {"nonsmooth": True, "motor_positions": hold, "status": status} | gains
    start = array(np.tile(chain.home, (count, 1))), array(rates)
    state = batch.step(start, tau, CONTACT_STEP, **fixed)  # compiles
    wp.synchronize()
    seconds, unsolved = 0.0, 0
    for _ in range(CONTACT_STEPS):
        begin = perf_counter()
        state = batch.step(state, tau, CONTACT_STEP, out=state, **fixed)
        wp.synchronize()
        seconds += perf_counter() - begin
        unsolved += int((status.numpy() == warp_batch.Status.UNSOLVED).sum())
    end = state.q.numpy().astype(float)
    closed = end[np.isfinite(end).all(axis=1)]

    chain.compile()
    few = min(count, 16)
    torques = np.zeros((few, CONTACT_STEPS, motors))
    chain.rollout(torques[:, :1], chain.home, rates[:few], CONTACT_STEP, nonsmooth=True, **gains)
    begin = perf_counter()
    chain.rollout(torques, chain.home, rates[:few], CONTACT_STEP, nonsmooth=True, **gains)
    return {
        "dtype": dtype,
        "device": batch.device.name,
        "samples": count,
        "steps": count * CONTACT_STEPS / seconds,
        "compiled": few * CONTACT_STEPS / (perf_counter() - begin),
        "unsolved": unsolved,
        "ended": count - len(closed),
        "gap": float(np.abs(chain.residual(closed)).max(initial=0)),
    }


def contacts_table(rows: list[Row]) -> list[tuple[str, ...]]:
    """Speeds of bipeds, in a form to read."""
    where = f"{rows[0]['samples']} bipeds"
    lines = [(where, "steps/s", "compiled rollout", "ratio", "not solved", "ended", "loops open")]
    for row in rows:
        speeds = f"{row['steps']:.4g}", f"{row['compiled']:.4g}"
        ratio = f"{row['steps'] / row['compiled']:.3g}"
        counts = str(row["unsolved"]), str(row["ended"])
        lines.append((row["dtype"], *speeds, ratio, *counts, f"{row['gap']:.0e}"))
    return lines


# --- results ----------------------------------------------------------------------------------


def table(rows: list[Row]) -> list[tuple[str, ...]]:
    """Speeds and errors, in a form to read."""
    head = ("numbers", *(f"10^9 {x}/s" for x in KERNELS), "share of limit")
    where = f"{rows[0]['device']}, {rows[0]['samples']} samples"
    lines = [(where, *head, "torque error", "open after 1000 steps")]
    for row in rows:
        speeds = (f"{row[x] / 1e9:.3g}" for x in KERNELS)
        shares = "/".join(f"{100 * row[f'{x}: share']:.0f}" for x in KERNELS)
        errors = f"{row['torque error']:.0e}", f"{row['gap']:.0e}" if row["gap"] > 0 else "-"
        lines.append(
            (row["robot"], row["dtype"], *speeds, "-" if "nan" in shares else f"{shares}%", *errors)
        )
    return lines


def resource_table(rows: list[Row]) -> list[tuple[str, ...]]:
    """Resources of machine code, in a form to read."""
    head = ("operations", "registers", "stack, bytes", "code, kB")
    lines = [("robot", "numbers", "kernel", *head)]
    for row in rows:
        numbers = row["operations"], row["registers"], row["stack"], round(row["code"] / 1000)
        lines.append((row["robot"], row["dtype"], row["kernel"], *map(str, numbers)))
    return lines


def write_page(results: dict[str, Any]) -> None:
    """Write the table of docs/gpu.md."""
    sys.path.insert(0, str(ROOT / "scripts" / "pages"))
    import markdown_tables

    tables = {"speeds": lambda _: table(results["speeds"])}
    markdown_tables.rewrite(ROOT / "docs" / "gpu.md", tables)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", default=ROBOTS)
    parser.add_argument("--dtypes", nargs="+", default=["float64", "float32"])
    parser.add_argument("--device", help="by default Warp's preferred one")
    parser.add_argument("--samples", type=int, help="by default 4194304, on a CPU 256")
    parser.add_argument("--seconds", type=float, default=0.1, help="of a turn of a measurement")
    parser.add_argument("--block", type=int, help="threads of a block")
    parser.add_argument("--blocks", type=int, help="blocks at the same time on each SM")
    parser.add_argument("--resources", action="store_true", help="of machine code; no speeds")
    parser.add_argument("--contacts", action="store_true", help="bipeds; 4096, on a CPU 16")
    parser.add_argument("--arch", type=int, default=90)
    parser.add_argument("--out", type=Path, help="a JSON file for the results")
    parser.add_argument("--page", type=Path, help="write the table of docs/gpu.md from this file")
    options = parser.parse_args()
    if options.page:
        write_page(json.loads(options.page.read_text()))
        return 0
    if options.block:
        warp_batch._BLOCK = options.block
    if options.blocks:
        warp_batch._BLOCKS = options.blocks * wp.get_device(options.device).sm_count
    on_cpu = wp.get_device(options.device).is_cpu
    if options.contacts:
        options.samples = options.samples or (16 if on_cpu else 4096)
        rows = [measure_contacts(dtype, options) for dtype in options.dtypes]
        if options.out:
            options.out.write_text(json.dumps({"contacts": rows}, indent=1))
        for line in contacts_table(rows):
            print(*(f"{x:16}" for x in line))
        return 0
    options.samples = options.samples or (256 if on_cpu else 2**22)
    name, rows = "resources" if options.resources else "speeds", []
    for robot in options.robots:
        for dtype in options.dtypes:
            try:
                if options.resources:
                    rows += resources(robot, robot_of(robot), dtype, options.arch)
                else:
                    rows.append(measure(robot, dtype, options))
            except Exception as error:  # the time on a GPU is short: the other robots count
                print(f"{robot}, {dtype}: {error!r}", file=sys.stderr)
            if options.out:
                options.out.write_text(json.dumps({name: rows}, indent=1))
    for line in (resource_table if options.resources else table)(rows):
        print(*(f"{x:16}" for x in line))
    return 0


if __name__ == "__main__":
    sys.exit(main())

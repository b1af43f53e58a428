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
import sys
from pathlib import Path
from typing import Any

import warp as wp

import sst_pin
from gpu_contacts import contacts_table, measure_contacts
from gpu_resources import Row, resource_table, resources
from gpu_speeds import measure, table
from sst_pin.compiled import warp_batch

ROOT = Path(__file__).resolve().parents[2]
ROBOTS = ("ankle", "delta", "sst")


def robot_of(name: str) -> sst_pin.ClosedChain:
    """The SST, a floating Cassie ("cassie"), or a robot of the gallery."""
    if name == "sst":
        return sst_pin.SST()
    if name == "cassie":
        sys.path.append(str(ROOT / "examples"))
        from benchmark_robots import cassie_of_mujoco

        return cassie_of_mujoco()
    return getattr(sst_pin.robots, name)()


def contact_rows(options: argparse.Namespace) -> list[Row]:
    """Rows of bipeds with contacts."""
    return [measure_contacts(dtype, options) for dtype in options.dtypes]


def robot_rows(options: argparse.Namespace) -> list[Row]:
    """Rows of robots, of resources or speeds; the file of `--out` grows with them."""
    rows: list[Row] = []
    for name in options.robots:
        for dtype in options.dtypes:
            try:
                chain = robot_of(name)
                if options.resources:
                    rows += resources(name, chain, dtype, options.arch)
                else:
                    rows.append(measure(name, chain, dtype, options))
            except Exception as error:  # the time on a GPU is short: the other robots count
                print(f"{name}, {dtype}: {error!r}", file=sys.stderr)
            write(options.out, "resources" if options.resources else "speeds", rows)
    return rows


def write(path: Path | None, name: str, rows: list[Row]) -> None:
    """Write rows to a JSON file, if there is one."""
    if path is not None:
        path.write_text(json.dumps({name: rows}, indent=1))


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
        rows = contact_rows(options)
        write(options.out, "contacts", rows)
        lines = contacts_table(rows)
    else:
        options.samples = options.samples or (256 if on_cpu else 2**22)
        rows = robot_rows(options)
        lines = resource_table(rows) if options.resources else table(rows)
    for line in lines:
        print(*(f"{cell:16}" for cell in line))
    return 0


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: BSD-2-Clause
"""Largest motor torques over more samples than memory holds: Dask's blocks, compiled kernels.

pip install 'dask[array,distributed]'
python examples/dask_sweep.py                         # the SST, a few blocks; all with --all
python examples/dask_sweep.py stewart --processes 2   # another robot, in several processes
"""  # fmt: skip

import argparse
from collections.abc import Callable

import dask.array as da
import numpy as np

import sst_pin

#: From indices of samples, shape (N,), to q, va, aa.
States = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


def sweep(robot: sst_pin.ClosedChain, states: States, samples: int, block: int) -> da.Array:
    """Torques of many states, as a lazy array.

    Args:
        robot: Any closed chain, compiled or not.
        states: Makes the states of a block.
        samples: How many in all.
        block: How many at a time.

    Returns:
        Shape (samples, motors), [N m] or [N]; nothing is computed yet.
    """
    nq = len(robot.position_names)
    n = robot.degrees_of_freedom
    motors = len(robot.motor_names)

    def rows(index: np.ndarray) -> np.ndarray:
        return np.concatenate(states(index), axis=1)

    index = da.arange(samples, chunks=block)
    chunks = (index.chunks[0], (nq + 2 * n,))
    x = index.map_blocks(rows, new_axis=1, chunks=chunks, dtype=float)
    return da.apply_gufunc(
        robot.compute_torques, f"({nq}),({n}),({n})->({motors})",
        x[:, :nq], x[:, nq : nq + n], x[:, nq + n :], output_dtypes=float,
    )  # fmt: skip


def circle(robot: sst_pin.SST, samples: int) -> States:
    """The paper's circle, run through at a hundred speeds."""

    def states(index: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        speed = 0.5 + 0.01 * (index % 100)
        R, omega, alpha = sst_pin.paper_circle(index / samples * np.pi / 6)
        return robot.joint_motion(R, omega * speed[:, None], alpha * speed[:, None] ** 2)

    return states


def grid(robot: sst_pin.robots.GalleryRobot, samples: int) -> States:
    """The platform at rest on a grid of 10 cm about home."""
    side = round(samples ** (1 / 3))
    home = robot.platform_pose(robot.home)
    n = robot.degrees_of_freedom

    def states(index: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        poses = np.tile(home, (len(index), 1, 1))
        cells = np.stack(np.unravel_index(index % side**3, (side, side, side)), axis=1)
        poses[:, :3, 3] += 0.1 * (cells / (side - 1) - 0.5)
        at_rest = np.zeros((len(index), n))
        return robot.inverse_kinematics(poses), at_rest, at_rest

    return states


def main() -> None:
    """Print the largest torques of some blocks, or of all."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("robot", nargs="?", choices=["sst", "delta", "stewart"], default="sst")
    parser.add_argument("--all", action="store_true", help="all blocks, not every hundredth")
    parser.add_argument("--processes", type=int, default=0, help="of dask.distributed")
    arguments = parser.parse_args()
    if arguments.robot == "sst":
        robot = sst_pin.SST()
        samples = 100_000_000
        block = 250_000
        motion = circle
    else:
        robot = getattr(sst_pin.robots, arguments.robot)()
        samples = 10**6
        block = 5000
        motion = grid
        robot.compile()
    tau = sweep(robot, motion(robot, samples), samples, block)
    print(f"{tau.shape[0]:,} samples in {tau.numblocks[0]} blocks, {tau.nbytes / 1e9:.3g} GB")
    largest = abs(tau if arguments.all else tau.blocks[::100]).max(axis=0)
    if arguments.processes:
        from dask.distributed import Client

        with Client(n_workers=arguments.processes, threads_per_worker=1):
            found = largest.compute()
    else:
        found = largest.compute()
    print("largest torques (N m, or N of struts):", found.round(4))


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: BSD-2-Clause
"""Peak torques over a hundred million samples: Dask holds the blocks, the kernels compute them.

pip install 'dask[array]'
python examples/dask_sweep.py            # a few blocks; all of them with --all
"""

import sys

import dask.array as da
import numpy as np

import sst_pin

SAMPLES, BLOCK = 100_000_000, 250_000


def sweep(robot: sst_pin.SST, samples: int = SAMPLES, block: int = BLOCK) -> da.Array:
    """Torques of the paper's circle, run through at a hundred speeds, as a lazy array.

    Args:
        robot: Which follows the circle.
        samples: How many in all.
        block: How many at a time.

    Returns:
        Shape (samples, 3), [N m]; nothing is computed yet.
    """

    def states(index: np.ndarray) -> np.ndarray:
        speed = 0.5 + 0.01 * (index % 100)
        R, omega, alpha = sst_pin.paper_circle(index / samples * np.pi / 6)
        omega, alpha = omega * speed[:, None], alpha * speed[:, None] ** 2
        return np.concatenate(robot.joint_motion(R, omega, alpha), axis=1)

    index = da.arange(samples, chunks=block)
    x = index.map_blocks(states, new_axis=1, chunks=(index.chunks[0], (15,)), dtype=float)
    return da.apply_gufunc(
        robot.compute_torques, "(q),(m),(m)->(m)", x[:, :9], x[:, 9:12], x[:, 12:],
        output_dtypes=float,
    )  # fmt: skip


def main() -> None:
    """Print the peaks of some blocks, or of all."""
    tau = sweep(sst_pin.SST())
    print(f"{tau.shape[0]:,} samples in {tau.numblocks[0]} blocks, {tau.nbytes / 1e9:.1f} GB")
    some = tau if "--all" in sys.argv else tau.blocks[::100]
    print("peak torques (N m):", abs(some).max(axis=0).compute().round(4))


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: BSD-2-Clause
"""Hold the SST at its home pose, where it would fall over, by a linear-quadratic regulator.

The gain comes from `linearize` with the step of the controller; the region from which the robot
comes back within its torque limits is found by simulating many starts at once. The arcs' ends and
collisions are left out.

pip install 'sst-pin[plot]'
python examples/lqr_hold.py            # writes lqr_hold.png
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are
from scipy.spatial.transform import Rotation

import sst_pin
from sst_pin import plots

Array = NDArray[np.float64]
STEP = 0.005  # of the controller [s]
LIMIT = 6.0  # of each motor [N m]; at home 4.3 are needed


class Regulator(NamedTuple):
    """tau = hold - gain (gamma - gamma of the pose, va), within the limits of the motors."""

    q: Array
    hold: Array
    gain: Array
    poles: Array  # of the robot alone, continuous, [1/s]

    def torques(self, robot: sst_pin.SST, q: Array, va: Array) -> Array:
        """The torques at states (..., 9), (..., 3)."""
        motors = list(robot.motor_indices)
        off = np.concatenate([q[..., motors] - self.q[motors], va], axis=-1)
        return np.clip(self.hold - off @ self.gain.T, -LIMIT, LIMIT)


def regulator(robot: sst_pin.SST) -> Regulator:
    """The gain that is best for a rad of error, 0.1 rad/s and 1 N m alike."""
    rest = np.zeros(3)
    q = robot.home
    hold = robot.compute_torques(q, rest, rest)
    poles = np.linalg.eigvals(robot.linearize(q, rest, hold)[0])
    A, B = robot.linearize(q, rest, hold, dt=STEP)
    cost = np.diag([1.0, 1, 1, 0.01, 0.01, 0.01])
    effort = np.eye(3) / 100
    P = solve_discrete_are(A, B, cost, effort)
    gain = np.linalg.solve(effort + B.T @ P @ B, B.T @ P @ A)
    return Regulator(q, hold, gain, poles)


def swing(robot: sst_pin.SST, control: Regulator, q: Array, seconds: float) -> Array:
    """Largest error of a motor of each start (N, 9) at rest, step by step, shape (steps, N)."""
    motors = list(robot.motor_indices)
    va = np.zeros((len(q), 3))
    errors = []
    for _ in range(round(seconds / STEP)):
        errors.append(np.abs(q[:, motors] - control.q[motors]).max(axis=1))
        alive = np.isfinite(q).all(axis=1) & np.isfinite(va).all(axis=1)
        tau = control.torques(robot, q[alive], va[alive])
        # One step of the controller is two of the integrator; NaN behind a singularity.
        motion = robot.rollout(
            np.repeat(tau[:, None], 2, axis=1), q[alive], va[alive], STEP / 2, on_error="nan"
        )
        q = np.full_like(q, np.nan)
        va = np.full_like(va, np.nan)
        q[alive], va[alive] = motion.q[:, -1], motion.va[:, -1]
    return np.array(errors)


def starts(robot: sst_pin.SST, angles: Array) -> Array:
    """Configurations with the star turned from home about x and y, shape (k, k, 9)."""
    x, y = np.meshgrid(angles, angles, indexing="ij")
    turns = Rotation.from_rotvec(np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)).as_matrix()
    q = robot.inverse_kinematics(turns @ robot.platform_orientation(robot.home))
    return q.reshape(len(angles), len(angles), 9)


def region(robot: sst_pin.SST, control: Regulator, angles: Array, seconds: float = 3.0) -> Array:
    """Which starts come back to within 0.02 rad, shape (k, k)."""
    q = starts(robot, angles).reshape(-1, 9)
    errors = swing(robot, control, q, seconds)
    held = np.nan_to_num(errors[-1], nan=np.inf) < 0.02
    return held.reshape(len(angles), len(angles))


def main() -> None:
    """Print the poles, draw the region."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    robot = sst_pin.SST()
    robot.compile()
    control = regulator(robot)
    print("poles of the robot alone (1/s):", np.sort_complex(control.poles).round(2))
    angles = np.linspace(-1.0, 1.0, 41)
    held = region(robot, control, angles)
    print(f"{held.mean():.0%} of {held.size} starts come back")
    degrees = np.degrees(angles)
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.5, 3.6), layout="constrained")
    left.pcolormesh(degrees, degrees, held.T, cmap="Blues", vmin=-0.3, vmax=1.4, shading="nearest")
    left.plot(0, 0, "k+")
    left.set(xlabel="star turned about x (deg)", ylabel="about y (deg)", aspect="equal")
    left.set_title("starts at rest that come back (dark)")
    some = starts(robot, np.array([-0.4, 0.0, 0.4])).reshape(-1, 9)
    errors = np.degrees(swing(robot, control, some, 1.5))
    turns = [f"{x:+.0f}, {y:+.0f}" for x in (-23, 0, 23) for y in (-23, 0, 23)]
    for error, turn, look in zip(errors.T, turns, ("-", "--", ":") * 3, strict=True):
        right.semilogy(STEP * np.arange(len(error)), error + 1e-6, look, label=turn)
    right.legend(title="start (deg)", fontsize="x-small", ncols=3)
    right.set(xlabel="time (s)", ylabel="largest error of a motor (deg)", ylim=(1e-3, 100))
    right.set_title(f"from starts within 0.4 rad, torques within {LIMIT:g} N m")
    path = Path("lqr_hold.png")
    figure.savefig(path, dpi=150)
    print(path)


if __name__ == "__main__":
    with plots.style():
        main()

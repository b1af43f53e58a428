# SPDX-License-Identifier: BSD-2-Clause
"""The fastest motion of the SST from rest to rest, within its torques and its arcs.

Direct collocation, solved by IPOPT from a straight line as a guess. What is found is a list of
torques, each held for an interval; they are given to `simulate` and to the closed robot in MuJoCo.
Collisions are left out.

pip install 'sst-pin[compile,mjcf,plot]'
python examples/time_optimal.py            # writes time_optimal.png
"""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

import sst_pin
from collocation import DEGREE, Solution, Transcription
from sst_pin import plots
from sst_pin.sst.arc_limits import arc_ends

Array = NDArray[np.float64]
LIMIT = 8.0  # of each motor [N m]; 7 are needed to hold the last pose
#: Rotations of the star from home, as rotation vectors in {E} [deg].
START, GOAL = (-35.0, -20.0, 35.0), (-15.0, -35.0, -30.0)
#: How far the points of the motion stay from the ends of the arcs and from sin(mu_k) = 0, [rad].
MARGIN, FLAT = 0.01, 0.1


def pose(robot: sst_pin.SST, turn: ArrayLike) -> Array:
    """Configuration with the star turned from home by a rotation vector in {E}, [deg]."""
    home = robot.platform_orientation(robot.home)
    return robot.inverse_kinematics(home @ Rotation.from_rotvec(turn, degrees=True).as_matrix())


def fastest(
    robot: sst_pin.SST,
    start: Array,
    goal: Array,
    intervals: int,
    limit: float = LIMIT,
    print_level: int = 0,
) -> Solution:
    """The motion of least duration, from the guess that it is straight and takes 1 s."""
    program = Transcription(robot, start, intervals)
    program.end_at(goal)
    low, high = arc_ends(robot.geometry) + np.array([[MARGIN], [-MARGIN]])
    low[1::3], high[1::3] = FLAT, np.pi - FLAT  # the working branch
    program.bound(low, program.q, high)
    program.bound(-limit, program.tau, limit)
    program.bound(0.01, program.duration, 10)
    program.opti.minimize(program.duration)
    program.guess_line(goal, 1.0)
    return program.solve(print_level)


def at_limit(solution: Solution, limit: float = LIMIT) -> Array:
    """Share of the time that each motor is at its limit, shape (3,)."""
    return np.asarray((np.abs(solution.tau) > 0.999 * limit).mean(axis=0))


def simulated(robot: sst_pin.SST, solution: Solution, samples: int = 4) -> sst_pin.Trajectory:
    """The motion of `simulate` under the torques, with a number of samples in each interval."""
    interval = solution.duration / len(solution.tau)
    q = [solution.q[:1]]
    va = [np.zeros((1, 3))]
    aa = []
    for tau in solution.tau:
        t = np.linspace(0, interval, samples + 1)
        motion = robot.simulate(tau, q[-1][-1], va[-1][-1], t)
        q.append(motion.q[1:])
        va.append(motion.va[1:])
        aa.append(motion.aa[:-1])
    t = np.linspace(0, solution.duration, samples * len(solution.tau) + 1)
    return robot.trajectory(t, np.vstack(q), np.vstack(va), np.vstack([*aa, motion.aa[-1:]]))


def replayed(solution: Solution, step: float = 2e-4) -> Array:
    """Where MuJoCo's closed SST is at the end of each interval, shape (intervals, 9).

    The loops of the file are closed by welds; the robot is the paper's.

    Args:
        solution: The motion.
        step: The longest of MuJoCo's, [s]; a whole number of them makes an interval.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_path(sst_pin.sst.MJCF_PATH)
    interval = solution.duration / len(solution.tau)
    steps = int(np.ceil(interval / step))
    model.opt.timestep = interval / steps
    data = mujoco.MjData(model)
    data.qpos[:] = solution.q[0]
    ends = []
    for tau in solution.tau:
        data.ctrl[:] = tau
        mujoco.mj_step(model, data, nstep=steps)
        ends.append(data.qpos.copy())
    return np.array(ends)


def main() -> None:
    """Find the motion, replay it, draw it."""
    robot = sst_pin.SST()
    start, goal = pose(robot, START), pose(robot, GOAL)
    solution = fastest(robot, start, goal, 40)
    ends = solution.q[DEGREE::DEGREE]
    motion = simulated(robot, solution)
    replays = {"simulate": motion.q[4::4], "MuJoCo": replayed(solution)}
    print(f"{solution.duration:.4f} s, found in {solution.iterations} iterations")
    print("at the limit of torque:", ", ".join(f"{x:.1%}" for x in at_limit(solution)))
    for name, q in replays.items():
        print(f"{name} is off by at most {np.abs(q - ends).max():.1e} rad")
    print("what the machine cannot take of it:", *(robot.check_limits(motion) or ["nothing"]))
    print(draw(solution, motion, {name: np.abs(q - ends).max(1) for name, q in replays.items()}))


def draw(solution: Solution, motion: sst_pin.Trajectory, deviations: dict[str, Array]) -> Path:
    """Torques, joints on arcs, and deviations of the replays."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(10.5, 3.4), layout="constrained")
    torques = figure.subplot_mosaic("1ab;2ab;3ab", sharex=True)
    angles, replays = torques.pop("a"), torques.pop("b")
    edges = np.linspace(0, solution.duration, len(solution.tau) + 1)
    for k, (axes, tau) in enumerate(zip(torques.values(), solution.tau.T, strict=True)):
        axes.stairs(tau, edges, baseline=None, color=f"C{k}", linewidth=2)
        axes.axhspan(LIMIT, 2 * LIMIT, color="0.85", zorder=0)
        axes.axhspan(-2 * LIMIT, -LIMIT, color="0.85", zorder=0)
        axes.set(ylabel=f"motor {k + 1} (N m)", ylim=(-1.25 * LIMIT, 1.25 * LIMIT))
    axes.set_xlabel("time (s)")
    for k in range(3):
        for i, name, style in ((0, "gamma", "-"), (2, "beta", "--")):
            angle = np.degrees(motion.q[:, 3 * k + i])
            angles.plot(motion.t, angle, style, color=f"C{k}", label=rf"$\{name}_{k + 1}$")
    angles.axhspan(-10, 0, color="0.85", zorder=0)
    angles.axhspan(90, 100, color="0.85", zorder=0)
    angles.set(xlabel="time (s)", ylabel="on the arcs (deg)", ylim=(-10, 100))
    angles.legend(ncols=3, fontsize="small", loc="center right")
    for name, deviation in deviations.items():
        replays.semilogy(edges[1:], deviation, label=f"by {name}")
    replays.set(xlabel="time (s)", ylabel="largest deviation of a joint (rad)")
    replays.legend()
    path = Path("time_optimal.png")
    figure.savefig(path, dpi=150)
    return path


if __name__ == "__main__":
    with plots.style():
        main()

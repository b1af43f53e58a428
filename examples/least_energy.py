# SPDX-License-Identifier: BSD-2-Clause
"""A delta's pick and place of least electric energy, beside a fifth-order motion of the same time.

Motor k takes the power tau_k v_k + r tau_k^2: mechanical power and the loss in its copper. Drives
share one supply and feed back into it when they brake, so the energy is the integral of the sum.
From rest to rest, mechanical power adds up to the change of potential energy.

pip install 'sst-pin[compile,plot]'
python examples/least_energy.py            # writes least_energy.png
"""

from pathlib import Path

import casadi as ca
import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.integrate import simpson

import sst_pin
from collocation import DEGREE, Solution, Transcription
from sst_pin import plots
from sst_pin.robots.gallery_robot import GalleryRobot

Array = NDArray[np.float64]
#: Positions of the platform [m]; duration [s]; copper loss [W/(N m)^2]; of each motor [N m].
PICK, PLACE = np.array([-0.1, 0.03, -0.28]), np.array([0.1, -0.02, -0.28])
DURATION = 0.35
LOSS = 4.0
LIMIT = 4.0
#: How far joints may be beyond where they start and end: [rad], away from singular poses.
ROOM = 0.4
#: What stands between: height and half its width [m].
HEIGHT, HALF = 0.04, 0.07


def robot() -> GalleryRobot:
    """The delta of the gallery with 0.1 kg on its platform of 0.15 kg."""
    return sst_pin.robots.delta(platform_mass=0.25)


def ground(x: Array) -> Array:
    """The least height of the platform's point over that of pick and place, [m]."""
    return HEIGHT * (1 - (x / HALF) ** 4)


def energy(motion: sst_pin.Trajectory) -> tuple[float, float]:
    """Electric energy of a smooth motion and its part lost in copper, [J]."""
    work = float(simpson((motion.tau * motion.va).sum(1), x=motion.t))
    copper = float(simpson(LOSS * (motion.tau**2).sum(1), x=motion.t))
    return work + copper, copper


def energy_of_held(chain: GalleryRobot, solution: Solution) -> tuple[float, float]:
    """The work of torques held over intervals: tau times the turn of the motors."""
    motors = [chain.position_names.index(name) for name in chain.coordinates]
    turns = np.diff(solution.q[::DEGREE, motors], axis=0)
    interval = solution.duration / len(solution.tau)
    copper = float(LOSS * (solution.tau**2).sum() * interval)
    return float((solution.tau * turns).sum()) + copper, copper


def plain(chain: GalleryRobot, t: Array) -> sst_pin.Trajectory:
    """Fifth order along the ground, and the lowest hump 64 s^3 (1 - s)^3 that clears it.

    Args:
        chain: The robot.
        t: Times over the duration, from 0 to 1, shape (N,).
    """
    s = Polynomial([0, 0, 0, 10, -15, 6])
    hump = 64 * s**3 * (1 - s) ** 3
    fine = np.linspace(0, 1, 2001)[1:-1]
    over = ground(PICK[0] + s(fine) * (PLACE - PICK)[0])
    height = (over[over > 0] / hump(fine)[over > 0]).max()
    way = PLACE - PICK
    up = np.array([0, 0, height])
    p, rate, acceleration = (
        (np.outer(s.deriv(k)(t), way) + np.outer(hump.deriv(k)(t), up)) / DURATION**k
        for k in range(3)
    )
    q = posed(chain, PICK + p)
    J = chain.frame_jacobian(q, "platform")[:, :3]
    va = np.linalg.solve(J, rate[..., None])[..., 0]
    drift = np.array([chain.frame_drift(*x, "platform")[:3] for x in zip(q, va, strict=True)])
    aa = np.linalg.solve(J, (acceleration - drift)[..., None])[..., 0]
    return chain.trajectory(t * DURATION, q, va, aa)


def posed(chain: GalleryRobot, p: Array) -> Array:
    """Configurations with the platform at p, shape (..., 3)."""
    poses = np.broadcast_to(np.eye(4), (*p.shape[:-1], 4, 4)).copy()
    poses[..., :3, 3] = p
    return chain.inverse_kinematics(poses)


def least(chain: GalleryRobot, intervals: int, print_level: int = 0) -> Solution:
    """The motion of least energy, from the plain motion as a guess."""
    start, goal = posed(chain, PICK), posed(chain, PLACE)
    program = Transcription(chain, start, intervals)
    program.end_at(goal)
    program.opti.subject_to(program.duration == DURATION)
    program.bound(-LIMIT, program.tau, LIMIT)
    ends = np.array([start, goal])
    program.bound(ends.min(0) - ROOM, program.q, ends.max(0) + ROOM)
    platform = chain.casadi().frame_placement("platform").map(program.q.shape[1])
    x, _, z = ca.vertsplit(platform(program.q)[0])
    program.opti.subject_to(ca.vec(z - PICK[2] - ground(x)) >= 0)
    tau = program.torques()
    power = tau * program.va + LOSS * tau**2
    program.opti.minimize(program.integral(ca.sum1(power)))
    program.guess(plain(chain, np.append(0, program.fractions)))
    return program.solve(print_level)


def simulated(chain: GalleryRobot, solution: Solution, samples: int) -> sst_pin.Trajectory:
    """The motion of `rollout` under the torques, with a number of samples in each interval."""
    tau = np.repeat(solution.tau, samples, axis=0)
    t = np.linspace(0, solution.duration, len(tau) + 1)
    motion = chain.rollout(tau, solution.q[0], solution.va[0], t[1])
    held = np.vstack([tau, tau[-1]])
    aa = chain.compute_accelerations(motion.q, motion.va, held)
    return chain.trajectory(t, motion.q, motion.va, aa, held)


def main() -> None:
    """Both motions: a table and a picture."""
    chain = robot()
    solution = least(chain, 16)
    motions = {
        "fifth order": plain(chain, np.linspace(0, 1, 201)),
        "least energy": simulated(chain, solution, 10),
    }
    off = np.abs(motions["least energy"].q[10::10] - solution.q[DEGREE::DEGREE]).max()
    print(f"{solution.iterations} iterations; rollout is off by at most {off:.1e} rad")
    print("| motion | energy, J | copper, J | largest torque, N m |\n|---|---|---|---|")
    energies = energy(motions["fifth order"]), energy_of_held(chain, solution)
    for (name, motion), (total, copper) in zip(motions.items(), energies, strict=True):
        print(f"| {name} | {total:.3f} | {copper:.3f} | {np.abs(motion.tau).max():.2f} |")
    print(draw(chain, motions))


def draw(chain: GalleryRobot, motions: dict[str, sst_pin.Trajectory]) -> Path:
    """Paths, torques and power."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    rows = [["paths", "powers"], ["torques", "torques"]]
    figure, places = plt.subplot_mosaic(rows, figsize=(7.5, 6.2), layout="constrained")
    paths = places["paths"]
    torques = places["torques"]
    powers = places["powers"]
    x = np.linspace(-HALF, HALF, 200)
    paths.fill_between(1e3 * x, 1e3 * ground(x), color="0.85", label="to be cleared")
    for (name, motion), style in zip(motions.items(), ("--", "-"), strict=True):
        p = 1e3 * (chain.platform_pose(motion.q)[:, :3, 3] - (0, 0, PICK[2]))
        paths.plot(p[:, 0], p[:, 2], style, color="k", label=name)
        for k, tau in enumerate(motion.tau.T, 1):
            torques.plot(motion.t, tau, style, color=f"C{k - 1}", label=f"motor {k}, {name}")
        power = (motion.tau * motion.va + LOSS * motion.tau**2).sum(axis=1)
        powers.plot(motion.t, power, style, color="k", label=name)
    paths.set(xlabel="platform's x (mm)", ylabel="height (mm)")
    torques.set(xlabel="time (s)", ylabel="torque (N m)")
    powers.set(xlabel="time (s)", ylabel="electric power (W)")
    for axes, columns in ((paths, 2), (torques, 2), (powers, 1)):
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=columns)
    path = Path("least_energy.png")
    figure.savefig(path, dpi=150)
    return path


if __name__ == "__main__":
    with plots.style():
        main()

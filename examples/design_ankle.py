# SPDX-License-Identifier: BSD-2-Clause
"""Design the parallel ankle of a humanoid: ten lengths, for small and even motor torques in a gait.

pip install 'sst-pin[plot]'
python examples/design_ankle.py            # writes design_ankle.png

SciPy's SLSQP minimises the peak torque and the ripple, with exact derivatives through the loops.
The foot must reach the corners of its range with well conditioned motors.
"""

import time
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

import sst_pin
from sst_pin import plots

#: Ten changes of the design, each in metres: of both cranks, levers, heights of the motors with
#: their rods, rods alone, and distances from the middle.
VARIABLES = [
    name
    for side, out in (("left", 1.0), ("right", -1.0))
    for name in (
        f"motor_{side}.length",
        {f"lever_{side}.x": -1.0},
        {f"motor_{side}.z": 1.0, f"rod_{side}.length": 1.0},
        f"rod_{side}.length",
        {f"motor_{side}.y": out, f"lever_{side}.y": out},
    )
]
#: Largest change and largest change in one round [m], and weight of the ripple.
LARGEST, ROUND, RIPPLE = 0.02, 0.005, 0.3
#: Limits of the motors' Jacobian: its condition number, and speed of a motor per speed of the foot.
CONDITION, SPEED = 2.0, 2.5
#: Corners of the foot's range, pitch and roll [rad].
CORNERS = np.array([(p, r) for p in (-0.6, 0.4) for r in (-0.25, 0.25)])
STEP = 1.1  # duration of a gait cycle [s]


class Gait(NamedTuple):
    """One cycle of the ankle: pitch and roll, their rates, and the moment on the foot."""

    x: np.ndarray
    va: np.ndarray
    aa: np.ndarray
    moment: np.ndarray


def gait(count: int = 32) -> Gait:
    """A walk in the shape of measured ones: push-off at half of the cycle, then swing."""
    phase = np.arange(count) / count
    # Coefficients of cosines and sines of pitch and roll [rad].
    cosines = np.array([[-0.02, 0.1, -0.08, 0.02], [0.02, 0.04, 0.0, 0.0]])
    sines = np.array([[0.0, -0.12, 0.1, -0.03], [0.0, 0.06, 0.02, 0.0]])
    k = np.arange(4)
    angle = 2 * np.pi * np.outer(phase, k)
    rate = 2 * np.pi * k / STEP
    c, s = np.cos(angle), np.sin(angle)
    x = c @ cosines.T + s @ sines.T
    va = (-s * rate) @ cosines.T + (c * rate) @ sines.T
    aa = -(c * rate**2) @ cosines.T - (s * rate**2) @ sines.T
    stance = np.where(phase < 0.6, np.sin(np.pi * np.minimum(phase / 0.6, 1)) ** 2, 0.0)
    late = np.clip(phase / 0.6, 0, 1)
    moment = np.column_stack([6.0 * stance * (1 - late), -40.0 * stance * late, 0 * phase])
    return Gait(x, va, aa, moment)


class Ankle:
    """The ankle for changes of its design; the coordinates are pitch and roll of the foot."""

    def __init__(self) -> None:
        self.drawn = sst_pin.robots.ankle().with_coordinates(["ankle_pitch", "ankle_roll"])
        self.gait = gait()
        self._poses = np.vstack([self.gait.x, CORNERS])
        pairs = [dict(zip(self.drawn.coordinates, x, strict=True)) for x in self._poses]
        self._guess = np.array([self.drawn.assemble(pair) for pair in pairs])
        count, corners = len(self.gait.x), len(CORNERS)
        self._va = np.vstack([self.gait.va, np.zeros((corners, 2))])
        self._aa = np.vstack([self.gait.aa, np.zeros((corners, 2))])
        self._load = np.zeros((count + corners, self.drawn.model.njoints - 1, 6))
        foot = self.drawn.joint_names.index("ankle_roll")
        self._load[:count, foot, 3:] = self.gait.moment
        self._known: tuple[bytes, tuple[np.ndarray, ...]] = (b"", ())

    def chain(self, p: np.ndarray) -> sst_pin.ClosedChain:
        """The ankle with changes p of its variables."""
        changes: dict[str, float] = {}
        for name, value in zip(VARIABLES, p, strict=True):
            group = {name: 1.0} if isinstance(name, str) else name
            for key, factor in group.items():
                changes[key] = changes.get(key, 0.0) + factor * value
        return self.drawn.with_design(changes)

    def evaluate(self, p: np.ndarray) -> tuple[np.ndarray, ...]:
        """Torques (N, 2), condition numbers and speeds (2, N + corners), their derivatives by p."""
        if self._known[0] == p.tobytes():
            return self._known[1]
        chain = self.chain(p)
        q = chain.assemble(self._guess, fixed=chain.coordinates)
        motion = q, self._va, self._aa
        tau = chain.compute_torques(*motion, external_wrenches=self._load)
        d = chain.design_derivatives(*motion, VARIABLES, external_wrenches=self._load)
        J = chain.actuator_jacobian(q)
        by_J = np.swapaxes(chain.actuation, 0, 1) @ np.moveaxis(d.L, -1, 1)
        U, s, Vt = np.linalg.svd(J)
        by_s = np.einsum("tak,tpab,tkb->tkp", U, by_J, Vt)
        condition = s[:, 0] / s[:, 1]
        by_condition = condition[:, None] * (by_s[:, 0] / s[:, :1] - by_s[:, 1] / s[:, 1:])
        count = len(self.gait.x)
        sizes = np.array([condition, s[:, 0]])
        by_sizes = np.array([by_condition, by_s[:, 0]])
        result = tau[:count], d.torques[:count], sizes, by_sizes
        self._known = p.tobytes(), result
        return result


def ripple(tau: np.ndarray) -> float:
    """Root of the mean square of the torques' changes from sample to sample."""
    return float(np.sqrt(np.mean((tau - np.roll(tau, 1, axis=0)) ** 2)))


def optimise(ankle: Ankle, rounds: int = 8) -> np.ndarray:
    """The best changes of the design; the last variable of SLSQP is the peak torque."""
    tau = ankle.evaluate(np.zeros(len(VARIABLES)))[0]
    peak = np.abs(tau).max()
    even = ripple(tau)
    most = np.array([[CONDITION], [SPEED]])

    def cost(x: np.ndarray) -> tuple[float, np.ndarray]:
        tau, by_p, _, _ = ankle.evaluate(ROUND * x[:-1])
        change = tau - np.roll(tau, 1, axis=0)
        by_change = by_p - np.roll(by_p, 1, axis=0)
        value = ripple(tau)
        slope = np.einsum("tm,tmp->p", change, by_change) / (tau.size * value)
        return x[-1] + RIPPLE * value / even, np.append(RIPPLE * ROUND * slope / even, 1.0)

    def room(x: np.ndarray) -> np.ndarray:
        tau, _, sizes, _ = ankle.evaluate(ROUND * x[:-1])
        sides = np.concatenate([x[-1] - tau.ravel() / peak, x[-1] + tau.ravel() / peak])
        return np.concatenate([sides, (most - sizes).ravel()])

    def slopes(x: np.ndarray) -> np.ndarray:
        _, by_p, _, by_sizes = ankle.evaluate(ROUND * x[:-1])
        rows = by_p.reshape(-1, by_p.shape[-1]) * ROUND / peak
        sides = np.column_stack([np.vstack([-rows, rows]), np.ones(2 * len(rows))])
        last = -ROUND * by_sizes.reshape(-1, by_p.shape[-1])
        return np.vstack([sides, np.column_stack([last, np.zeros(len(last))])])

    x = np.append(np.zeros(len(VARIABLES)), 1.0)
    limits = {"type": "ineq", "fun": room, "jac": slopes}
    for _ in range(rounds):  # within steps of which each can be assembled
        low = np.maximum(x[:-1] - 1, -LARGEST / ROUND)
        high = np.minimum(x[:-1] + 1, LARGEST / ROUND)
        best = minimize(
            cost,
            x,
            jac=True,
            bounds=[*zip(low, high, strict=True), (0, 2)],
            constraints=[limits],
            method="SLSQP",
            options={"maxiter": 10, "ftol": 1e-3},
        )
        print(f"peak {best.x[-1]:.3f} of the first, cost {best.fun:.3f}, {best.nit} iterations")
        settled = np.abs(best.x - x).max() < 0.05
        x = best.x
        if settled:
            break
    return ROUND * x[:-1]


def side_view(axes: plt.Axes, ankle: Ankle, p: np.ndarray, **look: str) -> None:
    """The ankle at zero pitch and roll, seen along y: cranks, rods and levers."""
    chain = ankle.chain(p)
    q = chain.assemble({"ankle_pitch": 0.0, "ankle_roll": 0.0})
    data = chain.model.createData()
    pin.framesForwardKinematics(chain.model, data, q)
    for side, style in (("left", "-"), ("right", "--")):
        joints = [chain.model.getJointId(f"{name}_{side}") for name in ("motor", "rod")]
        points = [data.oMi[joint].translation for joint in joints]
        points.append(data.oMf[chain.model.getFrameId(f"lever_{side}")].translation)
        points.append(np.zeros(3))
        axes.plot(*(1e3 * np.array(points)[:, [0, 2]]).T, style, marker="o", ms=3, **look)


def picture(ankle: Ankle, p: np.ndarray, path: Path) -> None:
    """Torques and shape, before in grey and after."""
    figure, (torques, shape) = plt.subplots(
        1, 2, figsize=(8, 4.4), width_ratios=(3, 2), layout="constrained"
    )
    phase = 100 * np.arange(len(ankle.gait.x)) / len(ankle.gait.x)
    for label, changes, colour in (("before", 0 * p, "0.6"), ("after", p, "C0")):
        tau = ankle.evaluate(changes)[0]
        for motor, style in enumerate(("-", "--")):
            side = ("left", "right")[motor]
            torques.plot(phase, tau[:, motor], style, color=colour, label=f"{side}, {label}")
        torques.axhline(np.abs(tau).max(), color=colour, lw=0.6, ls=":")
        side_view(shape, ankle, changes, color=colour)
    torques.set(xlabel="gait cycle (%)", ylabel="motor torque (N m)")
    torques.set_title("torques of the gait", fontsize="medium")
    torques.legend()
    shape.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal", xlim=(-110, 50))
    shape.set_title("the links from the side", fontsize="medium")
    for height, word in ((266, "crank"), (230, "rod"), (4, "lever to the ankle")):
        x = -20 if word == "crank" else -25
        shape.text(x if word != "rod" else -46, height, word, fontsize="small", va="bottom")
    figure.savefig(path, dpi=150)


def main() -> None:
    """Optimise, print and draw."""
    begin = time.perf_counter()
    ankle = Ankle()
    p = optimise(ankle)
    print(f"{'change':42} (mm)")
    for name, change in zip(VARIABLES, p, strict=True):
        print(f"{name if isinstance(name, str) else ' + '.join(name):42} {1e3 * change:6.1f}")
    for label, changes in (("before", 0 * p), ("after", p)):
        tau, _, (condition, speed), _ = ankle.evaluate(changes)
        print(
            f"{label:7} peak {np.abs(tau).max():5.2f} N m, ripple {ripple(tau):.3f} N m, "
            f"condition number {condition.max():.2f}, speed {speed.max():.2f}"
        )
    path = Path("design_ankle.png")
    picture(ankle, p, path)
    print(f"{path}, {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    with plots.style():
        main()

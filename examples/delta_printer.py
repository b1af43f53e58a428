# SPDX-License-Identifier: BSD-2-Clause
"""Calibrate a delta printer from heights that its own nozzle probes on the bed.

```bash
python examples/delta_printer.py            # writes delta_printer.png
```

At each point the nozzle goes down until it touches the bed, which is flat. The heights of the three
carriages there are all that is known. Towers stand in wrong places, and end stops are off.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

import sst_pin
from sst_pin import plots
from sst_pin.identification import Calibration, Heights, calibrate_with

# Dimensions, [m].
TOWER_RADIUS = 0.14
PLATFORM_RADIUS = 0.03
ROD = 0.25
SPACING = 0.05
BED_RADIUS = 0.085  # m, that is probed
NOISE = 10e-6  # m, of a probe
TOWERS = ("tower_1", "tower_2", "tower_3")
#: Errors that are looked for: end stops, radii and angles of the towers.
WHICH = [f"{tower}.{axis}" for tower in TOWERS for axis in "zxy"]


def printer() -> sst_pin.ClosedChain:
    """The printer as it is drawn: carriages on three towers, pairs of rods, a platform."""
    model = pin.Model()
    closures = []
    model.name = "delta_printer"
    end = pin.SE3(np.eye(3), np.array([0, 0, -ROD]))
    first = np.array([PLATFORM_RADIUS, SPACING / 2, 0])
    rod = pin.Inertia.FromCylinder(0.02, 0.003, ROD)
    rod.lever = np.array([0, 0, -ROD / 2])
    platform = 0
    for k, tower in enumerate(TOWERS):
        leg = pin.SE3(pin.rpy.rpyToMatrix(0, 0, 2 * np.pi * k / 3), np.zeros(3))
        place = leg * pin.SE3(np.eye(3), np.array([TOWER_RADIUS, 0, 0]))
        carriage = model.addJoint(0, pin.JointModelPZ(), place, tower)
        model.appendBodyToJoint(
            carriage, pin.Inertia.FromBox(0.2, 0.04, 0.05, 0.04), pin.SE3.Identity()
        )
        for side, offset in (("a", SPACING / 2), ("b", -SPACING / 2)):
            name = f"{k + 1}{side}"
            universal = pin.JointModelUniversal(np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
            at = pin.SE3(np.eye(3), np.array([0, offset, 0]))
            joint = model.addJoint(carriage, universal, at, f"rod_{name}")
            model.appendBodyToJoint(joint, rod, pin.SE3.Identity())
            if not platform:
                platform = model.addJoint(joint, pin.JointModelSpherical(), end, "platform")
                plate = pin.Inertia.FromCylinder(0.1, PLATFORM_RADIUS, 0.01)
                plate.lever = -first
                model.appendBodyToJoint(platform, plate, pin.SE3.Identity())
                continue
            vertex = leg.act(np.array([PLATFORM_RADIUS, offset, 0])) - first
            for frame, parent, where in (
                (f"ball_{name}", platform, pin.SE3(np.eye(3), vertex)),
                (f"end_{name}", joint, end),
            ):
                model.addFrame(pin.Frame(frame, parent, where, pin.FrameType.OP_FRAME))
            closures.append(sst_pin.Closure(f"ball_{name}", f"end_{name}", "3d"))
    nozzle = pin.SE3(np.eye(3), -first)
    model.addFrame(pin.Frame("nozzle", platform, nozzle, pin.FrameType.OP_FRAME))
    reach = TOWER_RADIUS - PLATFORM_RADIUS
    lean = np.arcsin(reach / ROD)
    guess = pin.neutral(model)
    for tower in TOWERS:
        guess[model.joints[model.getJointId(tower)].idx_q] = np.sqrt(ROD**2 - reach**2)
        for side in "ab":
            rod_at = model.joints[model.getJointId(f"rod_{tower[-1]}{side}")]
            guess[rod_at.idx_q + 1] = lean
    ball = model.joints[model.getJointId("platform")].idx_q
    guess[ball : ball + 4] = pin.Quaternion(pin.rpy.rpyToMatrix(0, -lean, 0)).coeffs()
    model.referenceConfigurations["home"] = guess
    chain = sst_pin.ClosedChain(model, closures, TOWERS)
    model.referenceConfigurations["home"] = chain.assemble(guess)
    return sst_pin.ClosedChain(model, closures, TOWERS)


def points(count: int) -> np.ndarray:
    """Points on the bed that fill a disc: a centre and a spiral, shape (count, 2), [m]."""
    k = np.arange(count)
    radius = BED_RADIUS * np.sqrt(k / max(count - 1, 1))
    return np.column_stack([radius * np.cos(2.4 * k), radius * np.sin(2.4 * k)])


def probed(
    drawn: sst_pin.ClosedChain, real: sst_pin.ClosedChain, where: np.ndarray, seed: int
) -> np.ndarray:
    """Positions of the carriages where the nozzle of the real printer touches the bed, (N, 3).

    The firmware lowers the nozzle above points of the bed by the drawn geometry.
    """
    heights = np.zeros(len(where))
    at = [drawn.position_names.index(tower) for tower in TOWERS]
    real_home = real.home
    for _ in range(4):  # the real height changes almost as the drawn one does
        targets = np.column_stack([where, heights])
        q = drawn.frame_configuration("nozzle", targets)
        guesses = np.tile(real_home, (len(where), 1))
        guesses[:, at] = q[:, at]
        real_q = real.assemble(guesses)
        heights = heights - real.frame_placement(real_q, "nozzle")[0][:, 2]
    x = q[:, at]
    # A probe that triggers too early or too late lifts all carriages alike.
    return x + np.random.default_rng(seed).normal(scale=NOISE, size=(len(x), 1))


def calibrated(
    drawn: sst_pin.ClosedChain,
    x: np.ndarray,
    which: Sequence[str] = WHICH,
    noise: float | None = None,
) -> Calibration:
    """The geometry from the heights of the touched points, which are all zero."""
    touched = Heights("nozzle", x, heights=np.zeros(len(x)), noise=noise)
    return calibrate_with(drawn, [touched], which=which)


def bed(drawn: sst_pin.ClosedChain, real: sst_pin.ClosedChain, where: np.ndarray) -> np.ndarray:
    """Heights of the real nozzle where the firmware lowers it to the bed, shape (N,), [m]."""
    at = [drawn.position_names.index(tower) for tower in TOWERS]
    q = drawn.frame_configuration("nozzle", np.column_stack([where, 0 * where[:, 0]]))
    guesses = np.tile(real.home, (len(where), 1))
    guesses[:, at] = q[:, at]
    return real.frame_placement(real.assemble(guesses), "nozzle")[0][:, 2]


def main() -> None:
    """Print what 7, 16 and 50 points tell, and draw the bed before and after."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib.figure import Figure

    drawn = printer()
    random = np.random.default_rng(3)
    real = drawn.with_design(
        {
            name: float(error)
            for name, error in zip(WHICH, 3e-4 * random.normal(size=len(WHICH)), strict=True)
        }
    )
    side = np.linspace(-BED_RADIUS, BED_RADIUS, 15)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    inside = np.linalg.norm(grid, axis=1) <= BED_RADIUS
    maps = {"as drawn": bed(drawn, real, grid[inside])}
    print(f"as drawn: the bed is off by {1e6 * maps['as drawn'].std():.0f} um")
    for count in (7, 16, 50):
        noise = NOISE if count < 10 else None  # 7 values cannot tell it besides the errors
        result = calibrated(drawn, probed(drawn, real, points(count), 0), noise=noise)
        maps[f"{count} points"] = bed(result.chain, real, grid[inside])
        off = 1e6 * maps[f"{count} points"].std()
        print(f"{count} points: off by {off:.0f} um; hidden: {', '.join(result.hidden)}")
    with plots.style():
        figure = Figure(figsize=(10, 2.3), layout="constrained")
        axes = figure.subplots(1, len(maps))
        for ax, (title, heights) in zip(axes, maps.items(), strict=True):
            values = np.full(len(grid), np.nan)
            values[inside] = 1e6 * (heights - heights.mean())
            largest = float(np.nanmax(np.abs(values)))
            picture = ax.imshow(
                values.reshape(15, 15),
                cmap="coolwarm",
                vmin=-largest,
                vmax=largest,
                extent=(-85, 85, -85, 85),
                origin="lower",
            )
            ax.plot(*(1e3 * points(int(title.split()[0]) if title[0].isdigit() else 0).T), "k.")
            ax.set_title(title, fontsize="small")
            ax.set_xlabel("x (mm)")
            figure.colorbar(picture, ax=ax, shrink=0.7, label="height (µm)")
        axes[0].set_ylabel("y (mm)")
        figure.savefig(Path("delta_printer.png"), dpi=150)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: BSD-2-Clause
"""Write the tables, pictures and CSV files of docs/standard_problems.md.

    python -m scripts.pages.make_standard_problems [PROBLEM ...]

computes all problems, or those named, on their full time.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure

from sst_pin import plots
from tests.gallery import andrews
from tests.gallery import standard_referees as referees
from tests.gallery.standard_problems import ANDREWS, Problem, problems
from tests.support.files import load

tables = load("scripts/pages/markdown_tables.py")

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = DOCS / "standard_problems.md"
FOLDER = DOCS / "standard_problems"
HEADER = ("quantity", "published", "this package", "difference")


def andrews_at_its_end() -> list[tuple[str, ...]]:
    """Torque, accelerations and forces at the published state of Andrews' mechanism."""
    chain = andrews()
    q, v, a = (np.array([ANDREWS[x][name] for name in chain.joint_names]) for x in ("q", "v", "dv"))
    tau = chain.compute_torques(q, v[:1], a[:1])[0]
    accelerations = chain.joint_accelerations(q, v[:1], a[:1])
    forces = -chain.reactions(q, v[:1], a[:1]).closures[:, :2]  # in the axes of theta
    turned = forces @ referees.turn(2, q[0] + q[1])[:2, :2].T
    given = np.array(list(ANDREWS["forces"].values()))
    worst = [
        np.abs(x - y).max() / np.abs(y).max() for x, y in ((accelerations, a), (turned, given))
    ]
    return [
        ("torque at 0.03 s [N m]", "0.033", f"{tau:.12f}", f"{abs(tau - 0.033):.0e}"),
        ("accelerations at 0.03 s, relative", "-", "-", f"{worst[0]:.0e}"),
        ("forces where the loops meet at 0.03 s, relative", "-", "-", f"{worst[1]:.0e}"),
    ]


def table(problem: Problem, motion: Any, exact: np.ndarray | None) -> list[tuple[str, ...]]:
    """What is published at some times, and the whole motion against the independent equations."""
    rows: list[tuple[str, ...]] = [HEADER]
    ours = problem.of(problem.chain, motion)
    end = motion.t[-1]
    at_the_end = tuple((end, name, "-") for name in problem.columns)
    for t, name, published in problem.published or at_the_end:
        i = int(np.argmin(np.abs(problem.t - t)))
        j = problem.columns.index(name)
        found = f"stops at {end:g} s"
        off = "-"
        if t <= end + 1e-9:
            truth = float(published.split(",")[0]) if exact is None else exact[i, j]
            found = f"{ours[i, j]:.10f}"
            off = f"{abs(ours[i, j] - truth):.0e}"
        rows.append((f"{name} at {t:g} s", published, found, off))
    if exact is not None:
        worst = np.abs(ours - exact[: len(ours)]).max()
        rows.append((f"all times up to {end:g} s", "-", "-", f"{worst:.0e}"))
    return rows


def picture(problem: Problem, motion: Any) -> Figure:
    """The axes of the bodies at the start, and the compared columns over time."""
    chain = problem.chain
    data = chain.model.createData()
    pin.forwardKinematics(chain.model, data, chain.home)
    with plots.style():
        figure = Figure(figsize=(7.2, 2.8), layout="constrained")
        robot = figure.add_subplot(1, 2, 1, projection="3d")
        shapes = chain.visual_model.geometryObjects
        for body in (shape for shape in shapes if not shape.name.startswith("joint_")):
            at = data.oMi[body.parentJoint] * body.placement
            shape = body.geometry
            half = getattr(shape, "halfSide", None)
            half = (
                np.array([0, 0, shape.halfLength]) if half is None else half * (half == max(half))
            )
            robot.plot(*np.transpose([at.act(half), at.act(-half)]), color=body.meshColor, lw=3)
        robot.set_aspect("equal")
        robot.set_axis_off()
        spatial = np.ptp(robot.get_zlim()) > 0.2 * np.ptp(robot.get_xlim())
        robot.view_init(*((20, -70) if spatial else (90, -90)))
        axes = figure.add_subplot(1, 2, 2, xlabel="time [s]")
        for name, values in zip(problem.columns, problem.of(chain, motion).T, strict=True):
            words = name.rsplit("_", 1)
            axes.plot(motion.t, values, label=f"{words[0].replace('_', ' ')} [{words[1]}]")
        axes.legend(fontsize="small")
    return figure


def main(names: list[str]) -> None:
    """Compute and write."""
    FOLDER.mkdir(exist_ok=True)
    every = problems()
    done = {}
    for name in names or every:
        problem = every[name]
        problem.chain.compile()
        problem.simulate(problem.t[:2])  # compiles
        motion = problem.simulate(problem.t)
        exact = problem.independent(problem.t) if problem.independent else None
        done[name] = table(problem, motion, exact)
        chain = problem.chain
        energy = chain.kinetic_energy(motion.q, motion.va) + chain.potential_energy(motion.q)
        if not problem.tau and name != "governor":
            done[name].append(("energy, constant", "-", "-", f"{np.ptp(energy):.0e} J"))
        print(name, motion.stopped or "whole", *done[name], sep="\n  ", flush=True)
        rows = [",".join(("t_s", *problem.columns))]
        rows += [
            ",".join(f"{x:.12g}" for x in (t, *row))
            for t, row in zip(motion.t, problem.of(chain, motion), strict=True)
        ]
        (FOLDER / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
        with plots.style():
            picture(problem, motion).savefig(FOLDER / f"{name}.png", dpi=150)
    if "andrews" in done:
        done["andrews"] += andrews_at_its_end()
    tables.rewrite(PAGE, {name: lambda _, name=name: done[name] for name in done})


if __name__ == "__main__":
    main(sys.argv[1:])

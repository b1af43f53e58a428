# SPDX-License-Identifier: BSD-2-Clause
"""Write the tables, pictures and CSV files of docs/standard_problems.md.

    python scripts/pages/make_standard_problems.py [PROBLEM ...]

computes all problems, or those named, on their full time.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure

import standard_referees as referees
from markdown_tables import Table, read_table, with_tables
from sst_pin import ClosedChain, Closure, plots, robots
from sst_pin.robots.building_blocks import Tree, rod, shift

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE, FOLDER = DOCS / "standard_problems.md", DOCS / "standard_problems"
HEADER = ("quantity", "published", "this package", "independent", "off by")
ANDREWS = robots.PUBLISHED["andrews"]
ANGLES = tuple(ANDREWS["q"])  # in the order of the problem's statement


class Problem(NamedTuple):
    """A standard problem.

    Attributes:
        chain: The robot.
        va: Its rates at the start, which is `home`.
        tau: Torques of the motors.
        t: Times of the result, [s].
        columns: Names of what is compared, as the library writes them.
        of: These columns of a motion, shape (N, columns).
        independent: These columns at given times by other equations.
        published: Times and values of a column that are published.
        options: Options of `simulate`.
    """

    chain: Any
    va: tuple[float, ...]
    tau: tuple[float, ...]
    t: np.ndarray
    columns: tuple[str, ...]
    of: Callable[[Any], np.ndarray]
    independent: Callable[[np.ndarray], np.ndarray] | None
    published: tuple[tuple[float, str, str], ...]
    options: dict[str, Any]

    def simulate(self, t: np.ndarray) -> Any:
        """The motion at some times."""
        return self.chain.simulate(list(self.tau), self.chain.home, self.va, t, **self.options)


def modelica_four_bar() -> ClosedChain:
    """Fourbar1 of the Modelica Standard Library."""
    tree = Tree("modelica_four_bar")
    tree.model.gravity.linear = np.array([0, -9.80665, 0])
    first, second, third = referees.BARS
    x, y, z = (getattr(pin, f"JointModelR{axis}")() for axis in "XYZ")
    bars = []
    for bar in referees.BARS:
        mass, _ = referees.cylinder(bar)
        bars.append(rod(mass, bar, referees.RADIUS))
    tree.joint("crank", x, bars[0])
    tree.joint("slider", pin.JointModelPX(), bars[1], at=shift((1.2, 0)))
    tree.joint("hinge_y", y, [], "slider", shift(second))
    tree.joint("hinge_z", z, bars[2], "hinge_y")
    tree.frame("tip", "crank", first)
    tree.frame("end", "hinge_z", third)
    tree.model.referenceConfigurations["home"] = np.array([0, -0.2, 0, 0.0])
    chain = ClosedChain(tree.model, [Closure("tip", "end", "3d")], ["crank"])
    chain._shapes = tree.visual_model
    return chain


def _ends(motion: Any) -> np.ndarray:
    return np.stack([np.cos(motion.q[:, 0]), np.sin(motion.q[:, 0])], axis=1)


def _andrews_angles(chain: Any) -> Callable[[Any], np.ndarray]:
    order = [chain.position_names.index(name) for name in ANGLES]
    return lambda motion: motion.q[:, order]


def _bricard_point(chain: Any) -> Callable[[Any], np.ndarray]:
    return lambda motion: chain.platform_pose(motion.q)[:, :3, 3]


def problems() -> dict[str, Problem]:
    """All of them, by the name of their section."""
    few, many, andrews, bricard = (
        robots.n_four_bar(2),
        robots.n_four_bar(40),
        robots.andrews(),
        robots.bricard(),
    )
    slider_crank, governor = robots.slider_crank(), robots.governor()
    B0 = ("B0_x_m", "B0_y_m")
    return {
        "n_four_bar_2": Problem(
            few, (-1.0,), (0.0,), np.linspace(0, 20, 201), B0, _ends,
            lambda t: referees.n_four_bar(2, t),
            ((10, "B0_x_m", "0.3284574"), (10, "B0_y_m", "0.9445188")),
            {"through_singularities": True},
        ),
        "n_four_bar_40": Problem(
            many, (-1.0,), (0.0,), np.linspace(0, 20, 201), B0, _ends,
            lambda t: referees.n_four_bar(40, t),
            (
                (19.4, "B0_x_m", "-0.284004"), (19.4, "B0_y_m", "0.958823"),
                (20, "B0_x_m", "0.410902"), (20, "B0_y_m", "0.911679"),
            ), {"through_singularities": True},
        ),
        "andrews": Problem(
            andrews, (0.0,), (0.033,), np.linspace(0, 0.03, 201),
            tuple(f"{name}_rad" for name in ANGLES), _andrews_angles(andrews), None,
            tuple((0.03, f"{name}_rad", f"{x:.12g}") for name, x in ANDREWS["q"].items()), {},
        ),
        "bricard": Problem(
            bricard, (0.0,), (0.0,), np.linspace(0, 10, 201), ("P3_x_m", "P3_y_m", "P3_z_m"),
            _bricard_point(bricard), referees.bricard, (), {},
        ),
        "governor": Problem(
            governor, (2 * np.pi, 0.0, 0.0, 0.0), (0.0,) * 4, np.linspace(0, 10, 201),
            ("shaft_rad", "arm_rad", "slider_m"), lambda motion: motion.q[:, [0, 1, 3]],
            referees.governor, (), {"method": "LSODA"},
        ),
        "slider_crank": Problem(
            slider_crank, (6.0,), (0.0,), np.linspace(0, 5, 201), ("crank_rad", "slider_m"),
            lambda motion: motion.q[:, :2],
            lambda t: np.stack(referees.slider_crank(t), axis=1),
            ((5, "slider_m", "0.24076, 0.26101"),), {},
        ),
        "modelica_four_bar": Problem(
            modelica_four_bar(), (referees.RATE,), (0.0,), np.linspace(0, 5, 201), ("angle_rad",),
            lambda motion: motion.q[:, :1],
            lambda t: referees.modelica_four_bar(t)[:, None],
            (
                (0.1, "angle_rad", "0.573724169"), (0.25, "angle_rad", "1.803753622"),
                (4.75, "angle_rad", "38.11562345"), (5, "angle_rad", "40.328236222"),
            ), {},
        ),
    }  # fmt: skip


def andrews_at_its_end() -> Table:
    """Torque, accelerations and forces at the published state of Andrews' mechanism."""
    chain = robots.andrews()
    q, v, a = (np.array([ANDREWS[x][name] for name in chain.joint_names]) for x in ("q", "v", "dv"))
    tau = chain.compute_torques(q, v[:1], a[:1])[0]
    accelerations = chain.joint_accelerations(q, v[:1], a[:1])
    forces = -chain.reactions(q, v[:1], a[:1]).closures[:, 3:5]  # in the axes of theta
    turned = forces @ referees.turn(2, q[0] + q[1])[:2, :2].T
    given = np.array(list(ANDREWS["forces"].values()))
    worst = [
        np.abs(x - y).max() / np.abs(y).max() for x, y in ((accelerations, a), (turned, given))
    ]
    return [
        ("torque at 0.03 s [N m]", "0.033", f"{tau:.12f}", "-", f"{abs(tau - 0.033):.0e}"),
        ("accelerations at 0.03 s, relative", "-", "-", "-", f"{worst[0]:.0e}"),
        ("forces where the loops meet at 0.03 s, relative", "-", "-", "-", f"{worst[1]:.0e}"),
    ]


def table(problem: Problem, motion: Any, exact: np.ndarray | None) -> Table:
    """What is published at some times, and the whole motion against the independent equations."""
    rows: Table = [HEADER]
    ours = problem.of(motion)
    end = motion.t[-1]
    asked = [(t, name) for t, name, _ in problem.published] or [
        (end, name) for name in problem.columns
    ]
    published = {(t, name): text for t, name, text in problem.published}
    for t, name in asked:
        j = problem.columns.index(name)
        if t > end + 1e-9:
            shown = f"{exact[np.argmin(np.abs(problem.t - t)), j]:.10f}"
            rows.append(
                (f"{name} at {t:g} s", published[t, name], f"stops at {end:g} s", shown, "-")
            )
            continue
        i = int(np.argmin(np.abs(motion.t - t)))
        text = published.get((t, name), "-")
        truth = float(text.split(",")[0]) if exact is None else exact[i, j]
        shown = "-" if exact is None else f"{truth:.10f}"
        off = f"{abs(ours[i, j] - truth):.0e}"
        rows.append((f"{name} at {t:g} s", text, f"{ours[i, j]:.10f}", shown, off))
    if exact is not None:
        worst = np.abs(ours - exact[: len(ours)]).max()
        rows.append((f"all times up to {end:g} s", "-", "-", "-", f"{worst:.0e}"))
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
            at, shape = data.oMi[body.parentJoint] * body.placement, body.geometry
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
        for name, values in zip(problem.columns, problem.of(motion).T, strict=True):
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
        started = time.perf_counter()
        motion = problem.simulate(problem.t)
        took = time.perf_counter() - started
        exact = problem.independent(problem.t) if problem.independent else None
        done[name] = table(problem, motion, exact)
        chain = problem.chain
        energy = chain.kinetic_energy(motion.q, motion.va) + chain.potential_energy(motion.q)
        done[name].append(("time of computing, compiled", "-", f"{took:.2g} s", "-", "-"))
        if not any(problem.tau) and name != "governor":
            done[name].append(("energy", "-", "-", "constant", f"{np.ptp(energy):.0e} J"))
        print(name, motion.stopped or "whole", *done[name], sep="\n  ", flush=True)
        rows = [",".join(("t_s", *problem.columns))]
        rows += [
            ",".join(f"{x:.12g}" for x in (t, *row))
            for t, row in zip(motion.t, problem.of(motion), strict=True)
        ]
        (FOLDER / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
        with plots.style():
            picture(problem, motion).savefig(FOLDER / f"{name}.png", dpi=150)
    if "andrews" in done:
        done["andrews"] += andrews_at_its_end()
    page = PAGE.read_text(encoding="utf-8")
    page = with_tables(page, lambda x: done[x] if x in done else read_table(page, x))
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])

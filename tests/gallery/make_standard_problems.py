# SPDX-License-Identifier: BSD-2-Clause
"""Write the tables, pictures and CSV files of docs/standard_problems.md.

    python -m tests.gallery.make_standard_problems [PROBLEM ...]

computes all problems, or those named, on their full time.
"""

import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure

from sst_pin import ClosedChain, Closure, plots, robots
from sst_pin.robots.building_blocks import Tree, rod, shift
from tests.data import PUBLISHED
from tests.gallery import andrews, governor, n_four_bar
from tests.gallery import standard_referees as referees
from tests.support.files import load

tables = load("scripts/pages/markdown_tables.py")

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE, FOLDER = DOCS / "standard_problems.md", DOCS / "standard_problems"
HEADER = ("quantity", "published", "this package", "independent", "difference")
ANDREWS = PUBLISHED["andrews"]
ANGLES = tuple(ANDREWS["q"])  # in the order of the problem's statement


class Problem(NamedTuple):
    """A standard problem, which starts at `home`."""

    chain: Any
    va: tuple[float, ...]  # at the start
    end: float  # [s]
    columns: tuple[str, ...]  # what is compared, as the library calls it
    of: Callable[[Any, Any], np.ndarray]  # these columns of a motion of the chain, (N, columns)
    independent: Callable[[np.ndarray], np.ndarray] | None = None  # at given times, other equations
    published: tuple[tuple[float, str, str], ...] = ()  # times and values of columns
    tau: float = 0.0  # of the first motor
    options: Mapping[str, Any] = {}  # of `simulate`

    @property
    def t(self) -> np.ndarray:
        """Times of the result, [s]."""
        return np.linspace(0, self.end, 201)

    def simulate(self, t: np.ndarray) -> Any:
        """The motion at some times."""
        tau = [self.tau] * len(self.chain.motor_names)
        return self.chain.simulate(tau, self.chain.home, self.va, t, **self.options)


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


def _ends(_: Any, motion: Any) -> np.ndarray:
    return np.stack([np.cos(motion.q[:, 0]), np.sin(motion.q[:, 0])], axis=1)


def _andrews_angles(chain: Any, motion: Any) -> np.ndarray:
    return motion.q[:, [chain.position_names.index(name) for name in ANGLES]]


def problems() -> dict[str, Problem]:
    """All of them, by the name of their section."""
    B0, through = ("B0_x_m", "B0_y_m"), {"through_singularities": True}
    return {
        "n_four_bar_2": Problem(
            n_four_bar(2), (-1.0,), 20, B0, _ends, lambda t: referees.n_four_bar(2, t),
            ((10, "B0_x_m", "0.3284574"), (10, "B0_y_m", "0.9445188")), options=through,
        ),
        "n_four_bar_40": Problem(
            n_four_bar(40), (-1.0,), 20, B0, _ends, lambda t: referees.n_four_bar(40, t),
            (
                (19.4, "B0_x_m", "-0.284004"), (19.4, "B0_y_m", "0.958823"),
                (20, "B0_x_m", "0.410902"), (20, "B0_y_m", "0.911679"),
            ), options=through,
        ),
        "andrews": Problem(
            andrews(), (0.0,), 0.03, tuple(f"{name}_rad" for name in ANGLES),
            _andrews_angles, tau=0.033,
            published=tuple((0.03, f"{n}_rad", f"{x:.12g}") for n, x in ANDREWS["q"].items()),
        ),
        "bricard": Problem(
            robots.bricard(), (0.0,), 10, ("P3_x_m", "P3_y_m", "P3_z_m"),
            lambda chain, motion: chain.platform_pose(motion.q)[:, :3, 3], referees.bricard,
        ),
        "governor": Problem(
            governor(), (2 * np.pi, 0.0, 0.0, 0.0), 10,
            ("shaft_rad", "arm_rad", "slider_m"), lambda _, motion: motion.q[:, [0, 1, 3]],
            referees.governor, options={"method": "Radau"},
        ),
        "slider_crank": Problem(
            robots.slider_crank(), (6.0,), 5, ("crank_rad", "slider_m"),
            lambda _, motion: motion.q[:, :2],
            lambda t: np.stack(referees.slider_crank(t), axis=1),
            ((5, "slider_m", "0.24076, 0.26101"),),
        ),
        "modelica_four_bar": Problem(
            modelica_four_bar(), (referees.RATE,), 5, ("angle_rad",),
            lambda _, motion: motion.q[:, :1],
            lambda t: referees.modelica_four_bar(t)[:, None],
            (
                (0.1, "angle_rad", "0.573724169"), (0.25, "angle_rad", "1.803753622"),
                (4.75, "angle_rad", "38.11562345"), (5, "angle_rad", "40.328236222"),
            ),
        ),
    }  # fmt: skip


def andrews_at_its_end() -> list[tuple[str, ...]]:
    """Torque, accelerations and forces at the published state of Andrews' mechanism."""
    chain = andrews()
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


def table(problem: Problem, motion: Any, exact: np.ndarray | None) -> list[tuple[str, ...]]:
    """What is published at some times, and the whole motion against the independent equations."""
    rows: list[tuple[str, ...]] = [HEADER]
    ours, end = problem.of(problem.chain, motion), motion.t[-1]
    at_the_end = tuple((end, name, "-") for name in problem.columns)
    for t, name, published in problem.published or at_the_end:
        i, j = int(np.argmin(np.abs(problem.t - t))), problem.columns.index(name)
        shown = "-" if exact is None else f"{exact[i, j]:.10f}"
        found, off = f"stops at {end:g} s", "-"
        if t <= end + 1e-9:
            truth = float(published.split(",")[0]) if exact is None else exact[i, j]
            found, off = f"{ours[i, j]:.10f}", f"{abs(ours[i, j] - truth):.0e}"
        rows.append((f"{name} at {t:g} s", published, found, shown, off))
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
        started = time.perf_counter()
        motion = problem.simulate(problem.t)
        took = time.perf_counter() - started
        exact = problem.independent(problem.t) if problem.independent else None
        done[name] = table(problem, motion, exact)
        chain = problem.chain
        energy = chain.kinetic_energy(motion.q, motion.va) + chain.potential_energy(motion.q)
        done[name].append(("time of computing, compiled", "-", f"{took:.2g} s", "-", "-"))
        if not problem.tau and name != "governor":
            done[name].append(("energy", "-", "-", "constant", f"{np.ptp(energy):.0e} J"))
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

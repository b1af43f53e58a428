# SPDX-License-Identifier: BSD-2-Clause
"""Measure every equation of the paper; write the numbers of docs/paper.md and its three figures.

Tables stand between `<!-- table: name -->` and `<!-- end -->`; what is around them, and the words
in those of equations and misprints, are written by hand. With --check nothing is written: every
function, test and file that the page names must exist, and its tables must be what would be
written now, residuals to two orders of magnitude.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import paper_equations as equations
import printed_forms as forms
from markdown_tables import Table, differences, read_table, table_names, with_tables
from sst_pin import SST, Parameters, RigidBody, Trajectory, paper_circle
from sst_pin.description.parameters import PAPER_LINK, PAPER_PASSIVE_LINK
from sst_pin.files import write_files
from sst_pin.sst.paper import PERIOD, angles_off_path, example_1, example_2
from sst_pin.verification.virtual_work import VirtualWork

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "paper.md"

#: Time steps of Exudyn in one period, and stiffnesses of MuJoCo's welds: each the coarse one first.
STEPS, STIFFNESSES = (700, 1400), (1e6, 1e7)


# --- equations and misprints --------------------------------------------------------------------


def equation_table(stands: Table) -> Table:
    """The table as it stands, its last column measured."""
    header, *rows = stands
    return [header, *((*row[:-1], f"{equations.EQUATIONS[row[0]](_cases()):.0e}") for row in rows)]


def misprint_table(stands: Table) -> Table:
    """The table as it stands, its last two columns measured where they are no dashes."""
    header, *rows = stands
    return [header, *(row if row[-1] == "-" else _measured(row) for row in rows)]


def _measured(row: tuple[str, ...]) -> tuple[str, ...]:
    printed, ours = zip(*equations.MISPRINTS[row[0]](_cases()), strict=True)
    return *row[:-2], f"{min(printed):.0e} to {max(printed):.0e}", f"{max(ours):.0e}"


@cache
def _cases() -> list[forms.Case]:
    return forms.cases(equations.SEED, equations.STATES, equations.ROBOTS)


# --- alternative readings -----------------------------------------------------------------------

DEFAULT = "default (gravity along -z)"


def readings() -> dict[str, Parameters]:
    """The paper's robot under each reading of what the paper leaves open."""

    def star(mass: float, center: float, *moments: float) -> RigidBody:
        return RigidBody(mass, (center, 0, 0), np.diag(moments))

    link, passive = PAPER_LINK, PAPER_PASSIVE_LINK
    center, g, diagonal = 0.8 / np.pi, 9.81, 9.81 / np.sqrt(3)
    # About O the star would have a negative moment about its mass centre, which no `Parameters`
    # takes. All bodies turn about O, so the motors see mass times distance and the inertia about
    # O alone: a thousand times the mass at a thousandth of the distance is the same star to them.
    about_O = np.array((0.224, 0.224, 0.150)) - 2600 * (center / 1000) ** 2 * np.array((0, 1, 1))
    return {
        DEFAULT: Parameters(),
        "R = 0.40 m in (45) to (50)": Parameters(
            link=RigidBody(link.mass, (0.2, 0, 0), link.inertia),
            passive_link=RigidBody(passive.mass, (0.4, 0, 0), passive.inertia),
        ),
        "R = 0.35 m in (54)": Parameters(star=star(2.6, 0.7 / np.pi, 0.224, 0.224, 0.150)),
        "star: 0.150 kg m² about s": Parameters(star=star(2.6, center, 0.150, 0.224, 0.224)),
        "star: 0.150 kg m² about y and z": Parameters(star=star(2.6, center, 0.224, 0.150, 0.150)),
        "star: inertia about O": Parameters(star=star(2600, center / 1000, *about_O)),
        "no gravity": Parameters(gravity=(0, 0, 0)),
        "gravity along +z": Parameters(gravity=(0, 0, g)),
        "gravity along -x": Parameters(gravity=(-g, 0, 0)),
        "gravity along -y": Parameters(gravity=(0, -g, 0)),
        "gravity along -(1, 1, 1)": Parameters(gravity=-diagonal * np.ones(3)),
        "gravity along +(1, 1, 1)": Parameters(gravity=diagonal * np.ones(3)),
    }


def _motions() -> dict[str, Trajectory]:
    t = np.linspace(0, PERIOD, 401)
    return {name: example_1(SST(parameters), t) for name, parameters in readings().items()}


def reading_table(_: Table) -> Table:
    names = [f"tau_{k}" for k in (1, 2, 3)]
    table = [
        (
            "reading",
            *(f"peak of {name}" for name in names),
            *(f"{name} at t = 0" for name in names),
            "largest change",
        )
    ]
    motions = _motions()
    for name, motion in motions.items():
        change = np.abs(motion.tau - motions[DEFAULT].tau).max()
        peaks = np.abs(motion.tau).max(axis=0)
        start = motion.tau[0].round(9) + 0.0  # no minus zero
        table.append((name, *(f"{x:.2f}" for x in (*peaks, *start, change))))
    return table


def draw_readings() -> None:
    from matplotlib.figure import Figure

    import method_figures
    from sst_pin import plots

    motions = _motions()
    with plots.style():
        figure = Figure(figsize=(7.0, 7.6), layout="constrained")
        axes = figure.subplots(4, 3, sharex=True, sharey=True)
        for ax, (name, motion) in zip(axes.flat, motions.items(), strict=True):
            method_figures.torques_of_reading(
                ax, motions[DEFAULT], motion, name.replace("-", "\N{MINUS SIGN}")
            )
        axes.flat[0].set_ylim(-46, 38)
        figure.supxlabel("time (s)", fontsize=9)
        figure.supylabel("motor torque (N m)", fontsize=9)
        handles, labels = axes.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, ncols=4, loc="outside upper center", handlelength=2.6)
        _write(figure, "alternatives")


# --- referees -----------------------------------------------------------------------------------


def compare_referees(_: Table) -> Table:
    """Torques and motions of all methods; draws both figures on the way."""
    robot = SST()
    example = example_1(robot, np.linspace(0, PERIOD, 401))
    table = [("method", "compared", "worst difference", "unit")]
    table += [
        (label, "torques, example 1", f"{worst:.0e}", "N m") for label, worst in _torques(robot)
    ]
    table += [
        (label, "path, example 2", f"{worst:.0e}", "rad") for label, worst in _paths(robot, example)
    ]
    return table


def _torques(robot: SST) -> Iterator[tuple[str, float]]:
    import method_figures
    from method_figures import Method
    from sst_pin.verification.referees import exudyn_engine, lagrange, mujoco_engine, symbolic

    parameters, t = Parameters(), np.linspace(0, PERIOD, 121)
    ours, states = example_1(robot, t), list(zip(*paper_circle(t), strict=True))
    judges = (
        ("virtual work", VirtualWork, 1),
        ("Lagrange multipliers", lagrange.LagrangeMultipliers, None),
        ("Lagrange, CasADi", symbolic.SymbolicLagrange, None),
        ("MuJoCo, projected", mujoco_engine.MujocoInverse, 2),
        ("Exudyn, one instant", exudyn_engine.ExudynInstant, 3),
    )
    found = []
    for label, kind, look in judges:
        judge = kind(parameters)
        tau = np.array([judge.torques(*state) for state in states])
        yield label, float(np.abs(tau - ours.tau).max())
        if look is not None:
            found.append(Method(label, t, tau, look))

    # Exudyn's first torques are off: it starts a quarter of a period before what is kept.
    early = PERIOD / 4
    for rough, steps in ((False, STEPS[1]), (True, STEPS[0])):
        t, tau = exudyn_engine.stepped_torques(
            parameters, lambda t: paper_circle(t - early), PERIOD + early, steps * 5 // 4
        )
        t, tau = t[steps // 4 :] - early, tau[steps // 4 :]
        found.append(Method(f"Exudyn, {steps} steps", t, tau, 4, rough))
    errors = []
    for method in found:
        off = np.abs(method.values - example_1(robot, method.t).tau).max(axis=1)
        errors.append(method._replace(values=off))
        if method.marker == 4:
            yield method.label, float(off.max())

    from matplotlib.figure import Figure

    from sst_pin import plots

    with plots.style():
        figure = Figure(figsize=(3.5, 5.0), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.15, 1))
        ours = example_1(robot, np.linspace(0, PERIOD, 401))
        method_figures.torques_of_methods(top, ours, [m for m in found if not m.rough])
        top.set(xlabel="")
        method_figures.differences(bottom, errors, "difference from NOC (N m)")
        method_figures.legend_below(figure, bottom)
        _write(figure, "figure_10_referees")


def _paths(robot: SST, example: Trajectory) -> Iterator[tuple[str, float]]:
    import method_figures
    from method_figures import Method
    from sst_pin.verification.referees import exudyn_engine, mujoco_engine

    parameters, torque, coarse = Parameters(), example.torque(), example.t[::4]
    R, omega, _ = paper_circle(0.0)
    ours = example_2(robot, example)
    path, _ = VirtualWork(parameters).simulate(lambda t, R, omega: torque(t), R, omega, coarse)
    found = [Method("virtual work", coarse, path, 1)]
    for rough, stiffness in ((False, STIFFNESSES[1]), (True, STIFFNESSES[0])):
        step = PERIOD / 5000  # far below what either stiffness needs
        t, path = mujoco_engine.welded_motion(
            parameters, R, omega, torque, PERIOD, step=step, stiffness=stiffness
        )
        label = f"MuJoCo, welds $10^{{{np.log10(stiffness):.0f}}}$ s$^{{-2}}$"
        found.append(Method(label, t[::20], path[::20], 2, rough))
    for rough, steps in ((False, STEPS[1]), (True, STEPS[0])):
        t, path = exudyn_engine.stepped_motion(parameters, R, omega, torque, PERIOD, steps)
        found.append(Method(f"Exudyn, {steps} steps", t, path, 4, rough))

    errors = [Method("NOC", ours.t, angles_off_path(robot, example, ours), 0)]
    for method in found:
        s, wanted = method.values[:, :, 0], paper_circle(method.t).R[:, :, 0]
        off = np.arctan2(np.linalg.norm(np.cross(s, wanted), axis=1), (s * wanted).sum(axis=1))
        errors.append(method._replace(values=off))
    for method in errors:
        yield re.sub(r"[${}]", "", method.label), float(method.values.max())

    from matplotlib.figure import Figure

    from sst_pin import plots

    with plots.style():
        figure = Figure(figsize=(3.5, 5.8), layout="constrained")
        grid = figure.add_gridspec(2, 1, height_ratios=(1.25, 1))
        top, bottom = figure.add_subplot(grid[0], projection="3d"), figure.add_subplot(grid[1])
        marked = [method for method in found if not method.rough]
        method_figures.paths_of_methods(top, robot, example, ours, marked)
        bottom.plot([], [], color="0.8", linewidth=4, label="wanted path")
        method_figures.differences(bottom, errors, "angle off the path (rad)")
        bottom.set(xlim=(0, PERIOD), ylim=(1e-15, 1e-4))  # the first sample of all is exact
        method_figures.legend_below(figure, bottom)
        _write(figure, "figure_11_referees")


def _write(figure: object, stem: str) -> None:
    from sst_pin import plots

    name = f"{stem}.png"
    writer = plots.figure_writer(figure, name)  # type: ignore[arg-type]
    write_files({ROOT / "docs" / name: writer}, force=True)


# --- the page -----------------------------------------------------------------------------------

#: What makes each table, and whether it takes seconds or longer.
TABLES: dict[str, tuple[Callable[[Table], Table], bool]] = {
    "equations": (equation_table, True),
    "misprints": (misprint_table, True),
    "readings": (reading_table, True),
    "referees": (compare_referees, False),
}


def write() -> None:
    page = PAGE.read_text(encoding="utf-8")
    page = with_tables(page, lambda name: TABLES[name][0](read_table(page, name)))
    draw_readings()
    PAGE.write_text(page, encoding="utf-8")


def problems(page: str) -> Iterator[str]:
    """What is wrong with the page, one sentence each."""
    yield from _missing_names(page)
    written = table_names(page)
    for name in TABLES.keys() ^ written:
        yield f"table {name}: only in the page or only in the script"
    for name in TABLES.keys() & written:
        make, quick = TABLES[name]
        stands = read_table(page, name)
        if not stands:
            yield f"table {name}: empty"
        elif quick:
            yield from differences(name, stands, make(stands))


def _missing_names(page: str) -> Iterator[str]:
    for name, target in re.findall(r"\[`?([^\]`]+)`?\]\(([^)#]+)\)", page):
        if target.startswith("http"):
            continue
        path = (PAGE.parent / target).resolve()
        if not path.exists():
            yield f"{target}: no such file"
        elif path.is_relative_to(ROOT / "tests") and path.stem != name:
            if name not in _functions_in(path):
                yield f"{target}: no test {name}"
        elif path.is_relative_to(ROOT / "sst_pin") and path.stem != name:
            module, *inner = name.split(".")
            thing: object = import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
            for part in inner:
                thing = getattr(thing, part, None)
            if thing is None or module != path.stem:
                yield f"{target}: no {name}"


@cache
def _functions_in(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="exit 1 when the page is not current")
    if not parser.parse_args().check:
        write()
        return 0
    found = list(problems(PAGE.read_text(encoding="utf-8")))
    for problem in found:
        print(problem, file=sys.stderr)
    if found:
        print("run scripts/pages/make_paper_docs.py", file=sys.stderr)
    return bool(found)


if __name__ == "__main__":
    raise SystemExit(main())

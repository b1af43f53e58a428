# SPDX-License-Identifier: BSD-2-Clause
"""Write the table of referees in docs/paper.md, and its three figures.

The table stands between `<!-- table: referees -->` and `<!-- end -->`; all else is written by hand.
With --check nothing is written: the table must be there.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import markdown_tables
import method_figures
from markdown_tables import Table, Tables
from method_figures import Method
from sst_pin import SST, Parameters, Trajectory, paper_circle, plots
from sst_pin.description.parameters import PAPER_LINK, PAPER_PASSIVE_LINK
from sst_pin.sst import RigidBody
from sst_pin.sst.paper import PERIOD, angles_off_path, example_1, example_2
from sst_pin.verification.lagrange import LagrangeMultipliers
from sst_pin.verification.mujoco_tree import MujocoInverse
from tests.referees import exudyn_engine
from tests.referees.mujoco_motion import welded_motion
from tests.referees.virtual_work import VirtualWork

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = DOCS / "paper.md"

#: Time steps of Exudyn in one period, and stiffnesses of MuJoCo's welds: each the coarse one first.
STEPS, STIFFNESSES = (700, 1400), (1e6, 1e7)


# --- alternative readings -----------------------------------------------------------------------

DEFAULT = "default (gravity along -z)"


def readings() -> dict[str, Parameters]:
    """The paper's robot under each reading of what the paper leaves open."""

    def star(mass: float, center: float, *moments: float) -> RigidBody:
        return RigidBody(mass, (center, 0, 0), np.diag(moments))

    link = PAPER_LINK
    passive = PAPER_PASSIVE_LINK
    center = 0.8 / np.pi
    g = 9.81
    diagonal = 9.81 / np.sqrt(3)
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


def draw_readings() -> None:
    motions = _motions()
    with plots.style():
        figure = Figure(figsize=(7.0, 7.6), layout="constrained")
        axes = figure.subplots(4, 3, sharex=True, sharey=True)
        for ax, (name, motion) in zip(axes.flat, motions.items(), strict=True):
            title = name.replace("-", "\N{MINUS SIGN}")
            method_figures.torques_of_reading(ax, motions[DEFAULT], motion, title)
        axes.flat[0].set_ylim(-46, 38)
        figure.supxlabel("time (s)", fontsize=9)
        figure.supylabel("motor torque (N m)", fontsize=9)
        handles, labels = axes.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, ncols=4, loc="outside upper center", handlelength=2.6)
        figure.savefig(DOCS / "alternatives.png")


# --- referees -----------------------------------------------------------------------------------


def compare_referees(_: Table) -> Table:
    """Torques and motions of all methods; draws the page's figures on the way."""
    draw_readings()
    robot = SST()
    example = example_1(robot, np.linspace(0, PERIOD, 401))
    rows: Table = [("method", "compared", "worst difference", "unit")]
    for what, unit, compare in (
        ("torques, example 1", "N m", _torques),
        ("path, example 2", "rad", _paths),
    ):
        rows += [(label, what, f"{worst:.0e}", unit) for label, worst in compare(robot, example)]
    return rows


def _torques(robot: SST, example: Trajectory) -> Iterator[tuple[str, float]]:
    parameters = Parameters()
    t = np.linspace(0, PERIOD, 121)
    ours = example_1(robot, t)
    states = list(zip(*paper_circle(t), strict=True))
    motion = list(zip(ours.q, ours.va, ours.aa, strict=True))
    judges = (
        ("virtual work", VirtualWork(parameters), states, 1),
        ("Lagrange multipliers", LagrangeMultipliers(robot), motion, None),
        ("MuJoCo, mj_inverse", MujocoInverse(robot), motion, 2),
        ("Exudyn, one instant", exudyn_engine.ExudynInstant(parameters), states, 3),
    )
    found = []
    for label, judge, asked, look in judges:
        tau = np.array([judge.torques(*state) for state in asked])
        yield label, float(np.abs(tau - ours.tau).max())
        if look is not None:
            found.append(Method(label, t, tau, look))

    # Exudyn's first torques are off: it starts a quarter of a period before what is kept.
    early = PERIOD / 4
    for rough, steps in ((False, STEPS[1]), (True, STEPS[0])):
        t, tau = exudyn_engine.stepped_torques(
            parameters, lambda t: paper_circle(t - early), PERIOD + early, steps * 5 // 4
        )
        t = t[steps // 4 :] - early
        tau = tau[steps // 4 :]
        found.append(Method(f"Exudyn, {steps} steps", t, tau, 4, rough))
    errors = []
    for method in found:
        off = np.abs(method.values - example_1(robot, method.t).tau).max(axis=1)
        errors.append(method._replace(values=off))
        if method.marker == 4:
            yield method.label, float(off.max())

    with plots.style():
        figure = Figure(figsize=(3.5, 5.0), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.15, 1))
        method_figures.torques_of_methods(top, example, [m for m in found if not m.rough])
        top.set(xlabel="")
        method_figures.differences(bottom, errors, "difference from NOC (N m)")
        method_figures.legend_below(figure, bottom)
        figure.savefig(DOCS / "figure_10_referees.png")


def _paths(robot: SST, example: Trajectory) -> Iterator[tuple[str, float]]:
    parameters = Parameters()
    torque = example.torque()
    coarse = example.t[::4]
    R, omega, _ = paper_circle(0.0)
    ours = example_2(robot, example)
    path, _ = VirtualWork(parameters).simulate(lambda t, R, omega: torque(t), R, omega, coarse)
    found = [Method("virtual work", coarse, path, 1)]
    for rough, stiffness in ((False, STIFFNESSES[1]), (True, STIFFNESSES[0])):
        step = PERIOD / 5000  # far below what either stiffness needs
        t, path = welded_motion(
            parameters, R, omega, torque, PERIOD, step=step, stiffness=stiffness
        )
        label = f"MuJoCo, welds $10^{{{np.log10(stiffness):.0f}}}$ s$^{{-2}}$"
        found.append(Method(label, t[::20], path[::20], 2, rough))
    for rough, steps in ((False, STEPS[1]), (True, STEPS[0])):
        t, path = exudyn_engine.stepped_motion(parameters, R, omega, torque, PERIOD, steps)
        found.append(Method(f"Exudyn, {steps} steps", t, path, 4, rough))

    errors = [Method("NOC", ours.t, angles_off_path(robot, example, ours), 0)]
    for method in found:
        s = method.values[:, :, 0]
        wanted = paper_circle(method.t).R[:, :, 0]
        off = np.arctan2(np.linalg.norm(np.cross(s, wanted), axis=1), (s * wanted).sum(axis=1))
        errors.append(method._replace(values=off))
    for method in errors:
        yield re.sub(r"[${}]", "", method.label), float(method.values.max())

    with plots.style():
        figure = Figure(figsize=(3.5, 5.8), layout="constrained")
        grid = figure.add_gridspec(2, 1, height_ratios=(1.25, 1))
        top = figure.add_subplot(grid[0], projection="3d")
        bottom = figure.add_subplot(grid[1])
        marked = [method for method in found if not method.rough]
        method_figures.paths_of_methods(top, robot, example, ours, marked)
        bottom.plot([], [], color="0.8", linewidth=4, label="wanted path")
        method_figures.differences(bottom, errors, "angle off the path (rad)")
        bottom.set(xlim=(0, PERIOD), ylim=(1e-15, 1e-4))  # the first sample of all is exact
        method_figures.legend_below(figure, bottom)
        figure.savefig(DOCS / "figure_11_referees.png")


# --- the page -----------------------------------------------------------------------------------

SLOW: Tables = {"referees": compare_referees}


if __name__ == "__main__":
    sys.exit(markdown_tables.main(PAGE, {}, SLOW))

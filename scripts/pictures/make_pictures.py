# SPDX-License-Identifier: BSD-2-Clause
"""Draw the pictures of the README, of docs/ and of urdf/: all, or those named."""

import argparse
import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from PIL import Image

import browser_pictures
from sst_pin import SST, Parameters, paper_circle, plots, reach_map
from sst_pin import robots as gallery
from sst_pin.description.colours import LEG_COLOURS
from sst_pin.files import Writer, write_files
from sst_pin.sst import PACKAGE_PATH, orientation
from sst_pin.sst.paper import PERIOD, example_1
from tests.gallery import adams_spherical_3rrr
from tests.support.files import load

run_pages = load("scripts/pages/run_pages.py")

DOCS = Path(__file__).resolve().parents[2] / "docs"


def robot() -> Figure:
    """The paper's robot on its circle, and the torques along it."""
    robot = SST()
    motion = example_1(SST(), np.linspace(0, PERIOD, 401))
    with plots.style():
        figure = Figure(figsize=(7.5, 3.4), layout="constrained")
        left = figure.add_subplot(1, 2, 1, projection="3d")
        plots.robot_pose(left, robot, motion.q[70])
        E = robot.star_radius * robot.platform_orientation(motion.q)[:, :, 0]
        left.plot(*E.T, color="0.3", linewidth=0.8, linestyle=(0, (2, 1)))
        plots.motor_torques(figure.add_subplot(1, 2, 2), motion)
    return figure


def summary() -> Figure:
    """All about the paper's circle, with friction in every joint."""
    robot = SST(Parameters(viscous_friction=0.2))
    motion = example_1(robot, np.linspace(0, PERIOD, 401))
    return plots.motion_page(robot, motion)


def workspace() -> Figure:
    """Where the paper's robot can point its axis, at two roll angles, and what holding it takes."""
    robot = SST()
    side = np.radians(np.linspace(-4, 94, 99))
    circle = paper_circle(np.linspace(0, PERIOD, 361)).R[:, :, 0]
    middle = (1, 1, 1)
    angles = {"pitch": side - np.pi / 2, "yaw": side}
    # Angles are theta = yaw, phi = pitch + 90 deg and psi = roll of the paper.
    angles["rotation"] = orientation(0.0, np.pi / 2, 0.0)
    with plots.style():
        figure = Figure(figsize=(7.5, 6.4), layout="constrained")
        for row, psi in zip(figure.subplots(2, 2), (0, 30), strict=True):
            poses = reach_map(robot, "E", 10.0, roll=np.radians(psi), **angles)
            for ax, show in zip(row, ("condition", "used"), strict=True):
                plots.reach_map(ax, poses, show, axis="x", middle=middle)
                ax.plot(*plots.equal_area(circle, middle).T, color="black", linestyle="--")
                corners = plots.equal_area(robot.geometry.R_0[:, :, 0], middle)
                for k, (x, y) in enumerate(1.1 * corners, 1):
                    ax.text(x, y, rf"$\mathbf{{v}}_{k}$", ha="center", va="center")
                ax.set_title(rf"$\psi$ = {psi}°", pad=14)
    return figure


def reach() -> Figure:
    """Where a five-bar and a delta reach, and what 1 kg at the delta takes of motors of 1.2 N m."""
    side = np.linspace(-0.14, 0.14, 71)
    weight = (0.0, 0.0, -9.81, 0.0, 0.0, 0.0)
    lift = reach_map(gallery.five_bar(), "platform", x=side, y=np.linspace(-0.18, 0.18, 91))
    x = np.linspace(-0.42, 0.42, 71)
    z = np.linspace(-0.5, 0.02, 45)
    load = reach_map(gallery.delta(), "platform", 1.2, x=x, z=z, wrench=weight)
    with plots.style():
        figure = Figure(figsize=(7.5, 3.3), layout="constrained")
        left, right = figure.subplots(1, 2)
        plots.reach_map(left, lift)
        plots.reach_map(right, load, "used")
    return figure


def bearings() -> Figure:
    """Loads of the SST's bearings on the circle of the paper, its joints equally stiff."""
    robot = SST()
    motion = example_1(robot, np.linspace(0, PERIOD, 401))
    soft = dict.fromkeys(robot.joint_names, [1e8] * 3 + [1e6] * 3)
    return plots.loads_page(robot.loads(motion, stiffness=soft))


def who_acts() -> Figure:
    """Who acts on whom in a joint and in a closure, on a four-bar."""
    points = {"crank": (0, 0), "coupler": (0.6, 1.4), "rocker": (3.2, 0), "tip": (2.9, 2.0)}
    crank, coupler, rocker, tip = (np.array(p, dtype=float) for p in points.values())
    with plots.style():
        figure = Figure(figsize=(7, 3.2), layout="constrained")
        ax = figure.add_subplot()
        for start, end, name, side in (
            (crank, coupler, "crank", (-0.32, 0.0)),
            (coupler, tip, "coupler", (0.0, 0.2)),
            (rocker, tip, "rocker", (0.35, 0.0)),
        ):
            ax.plot(*np.transpose([start, end]), color="0.75", linewidth=9, solid_capstyle="round")
            ax.text(*((start + end) / 2 + side), name, ha="center", va="center", style="italic")
        ax.plot([-0.8, 4.0], [-0.12, -0.12], color="0.4", linewidth=2)
        ax.text(1.6, -0.32, "ground", ha="center", va="center", style="italic")
        for at, way, text, place in (
            (crank, (-0.35, 0.55), "ground on crank:\nw.of('crank')", (-1.55, 0.75)),
            (coupler, (0.7, -0.45), "crank on coupler:\nw.of('coupler')", (1.0, 0.72)),
            (rocker, (0.3, 0.6), "ground on rocker:\nw.of('rocker')", (3.7, 0.75)),
            (
                tip,
                (0.75, 0.1),
                "closure, frame A on the coupler, B on the rocker:\n"
                "coupler on rocker: w.of('coupler_pin - rocker_pin')",
                (3.75, 2.1),
            ),
        ):
            arrow = {"arrowstyle": "-|>", "color": LEG_COLOURS[1], "linewidth": 1.8}
            ax.annotate("", at + way, at, arrowprops=arrow)
            ax.plot(*at, "o", color="white", markeredgecolor="black", zorder=3)
            ax.text(*place, text, va="center", fontsize=8)
        ax.set(xlim=(-1.7, 6.6), ylim=(-0.5, 2.5), aspect="equal")
        ax.set_axis_off()
    return figure


def adams() -> Figure:
    """Sizes of the torques of a spherical 3-RRR: ours as lines, those of ADAMS as marks."""
    t = adams_spherical_3rrr.DATA["t"]
    theirs = np.abs(adams_spherical_3rrr.DATA["tau"])
    ours = np.abs(adams_spherical_3rrr.torques())
    with plots.style():
        figure = Figure(figsize=(7.5, 2.8), layout="constrained")
        left, right = figure.subplots(1, 2)
        for k, colour in enumerate(LEG_COLOURS[:3]):
            left.plot(t, ours[:, k], color=colour, label=f"motor {k + 1}")
            left.plot(t[::8], theirs[::8, k], "o", color=colour, markersize=3, fillstyle="none")
            right.plot(t, 1e3 * (ours - theirs)[:, k], color=colour)
        left.set(xlabel="time (s)", ylabel="motor torque (N m)")
        above = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0)}
        left.legend(title="lines: sst_pin; marks: ADAMS", ncols=3, fontsize="small", **above)
        right.set(xlabel="time (s)", ylabel="difference (mN m)")
    return figure


def loader() -> Figure:
    """The loader of docs/loader.md from the side at its breakout force.

    Arrows: the force of each parent on its child, of the link on the bucket, of the ground on the
    edge. Their lengths are proportional to the forces.
    """
    page: dict[str, Any] = {}  # what the page's code defines, up to the reactions `w`
    for block in run_pages.blocks((DOCS / "loader.md").read_text(encoding="utf-8")):
        if block.language == "python" and "w" not in page:
            exec(compile(block.text, "loader.md", "exec"), page)
    points = {name: np.array(place) for name, place in page["pins"].items()}
    for frame in ("bucket_top", "edge", "lift_foot", "lift_eye", "tilt_foot", "tilt_eye"):
        points[frame] = page["loader"].frame_placement(page["q"], frame)[0][[0, 2]]
    reactions = page["w"]
    metres_per_newton = 1.4e-6
    with plots.style():
        figure = Figure(figsize=(5, 3), layout="constrained")
        ax = figure.add_subplot()
        for colour, corners in (
            ("0.9", ("boom", "tilt_foot", "lift_foot")),  # the frame of the vehicle
            ("0.75", ("boom", "crank", "bucket", "lift_eye")),
            ("0.6", ("tilt_eye", "crank", "link")),
            ("#F0D9A8", ("bucket_top", "bucket", "edge")),
            ("0.45", ("link", "bucket_top")),
        ):
            outline = [points[corner] for corner in corners]
            style = {"color": colour, "linewidth": 7, "joinstyle": "round", "capstyle": "round"}
            ax.add_patch(Polygon(outline, **style))
        for name, force, colour, place in (
            ("lift", page["force"][0], LEG_COLOURS[0], (0.5, -1.25)),
            ("tilt", page["force"][1], LEG_COLOURS[2], (0.65, 0.55)),
        ):
            foot = points[f"{name}_foot"]
            eye = points[f"{name}_eye"]
            ax.plot(*np.transpose([foot, eye]), color=colour, linewidth=2.5)  # the rod
            ax.plot(*np.transpose([foot, foot + 0.6 * (eye - foot)]), color=colour, linewidth=7)
            text = f"{name} {force / 1000:.0f} kN"
            ax.text(*place, text, color=colour, size=11, ha="center", va="center")
        for place in (points[name] for name in points if name != "edge"):
            ax.plot(*place, "o", color="white", markeredgecolor="black", markersize=5, zorder=3)
        # At home the axes of joints and frames are those of the world.
        for name, at, wrench, place in (
            ("boom", "boom", reactions.of("boom"), (-0.6, 0.3)),
            ("crank", "crank", reactions.of("crank"), (1.8, -0.25)),
            ("link", "link", reactions.of("link"), (1.35, -1.4)),
            ("bucket", "bucket", reactions.of("bucket"), (2.3, -1.75)),
            ("link end", "bucket_top", reactions.of("link_end - bucket_top"), (2.5, -0.6)),
            ("ground", "edge", page["ground"][3], (3.4, -1.95)),
        ):
            force = wrench[[0, 2]]
            tip = points[at] + metres_per_newton * force
            arrow = {"arrowstyle": "-|>", "color": LEG_COLOURS[1], "linewidth": 1.8}
            arrow |= {"shrinkA": 0, "shrinkB": 0, "mutation_scale": 12}
            ax.annotate("", tip, points[at], arrowprops=arrow, zorder=4)
            text = f"{name}\n{np.linalg.norm(force) / 1000:.0f} kN"
            ax.text(*place, text, size=11, linespacing=1, ha="center", va="center")
        ax.set(xlim=(-1.15, 3.8), ylim=(-2.2, 0.7), aspect="equal")
        ax.set_axis_off()
    return figure


FIGURES = {
    f.__name__: f for f in (robot, summary, workspace, reach, bearings, who_acts, adams, loader)
}


def drawn(figure: Figure) -> Image.Image:
    """A figure in 200 dots an inch."""
    pixels = io.BytesIO()
    with plots.style():
        figure.savefig(pixels, dpi=200)
    return Image.open(pixels)


def writers(name: str) -> dict[Path, Writer]:
    """Writers of the files of a picture; a PNG has 256 colours: enough for lines and flat areas."""
    if name == "motion":
        return {DOCS / "motion.gif": browser_pictures.circle(181).writer("motion.gif")}
    image = drawn(FIGURES[name]()) if name in FIGURES else browser_pictures.PICTURES[name]()
    image = image.convert("RGB").quantize(256, kmeans=1, dither=Image.Dither.NONE)
    path = Path(PACKAGE_PATH, "sst.png") if name == "scene" else DOCS / f"{name}.png"
    return {path: lambda file: image.save(file, "png", optimize=True)}


def main() -> None:
    names = [*FIGURES, *browser_pictures.PICTURES, "motion"]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(names))
    for name in parser.parse_args().names or names:
        if name not in names:
            parser.error(f"no picture {name}; there are: {', '.join(names)}")
        write_files(writers(name), force=True)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin workspace`: where the star's axis can point, and how well it is held there."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files import Writer
from ..sst.paper import PERIOD
from ..sst.platform_motion import paper_circle
from ..sst.workspace import Workspace, workspace_at, workspace_over_rolls
from .common import Commands, add_figure, add_urdf, output_name, robot_of, say, write


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "workspace",
        _run,
        "Map of the directions of the star's axis: reach, conditioning, singular curves, at one "
        "roll psi of the star and at the best of all.",
    )
    add_urdf(parser)
    add_figure(parser)
    parser.add_argument(
        "--psi", type=_angle, default=0.0, metavar="DEG", help="roll of the star (default: 0)"
    )
    parser.add_argument(
        "--data", type=Path, metavar="FILE", help="the map at psi as numbers, .npz or .csv"
    )


def _angle(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise argparse.ArgumentTypeError(f"{text!r} is not an angle in degrees")
    return number


def _run(arguments: argparse.Namespace) -> None:
    from .. import plots  # needs the extra `plot`

    name = output_name(arguments.output, ".png")
    plots.require_ending(name)
    robot = robot_of(arguments)
    at_psi = workspace_at(robot, np.radians(arguments.psi))
    if str(arguments.data) == str(arguments.output) == "-":
        raise InputError("--data", "standard output holds one of the map and its numbers")
    files: dict[Path, Writer] = {}
    if arguments.data is not None:
        files[arguments.data] = at_psi.writer(output_name(arguments.data, ".csv"))
    over_rolls = workspace_over_rolls(robot)
    path = None
    if arguments.urdf is None:
        circle = paper_circle(np.linspace(0, PERIOD, 361)).R[:, :, 0]
        path = ("circle of the paper", circle)
    figure = plots.workspace_page(robot, at_psi, over_rolls, path)
    files[arguments.output] = plots.figure_writer(figure, name)
    write(files, arguments)
    say(f"at psi = {arguments.psi:g} deg: {_summary(at_psi)}", arguments)
    roll = np.degrees(over_rolls.roll[over_rolls.on_arcs].max(initial=0))
    say(f"over all psi: {_summary(over_rolls)}, up to {roll:.0f} deg of roll", arguments)
    say(f"-> {', '.join(map(str, files))}", arguments)


def _summary(workspace: Workspace) -> str:
    if workspace.best is None:
        return "no direction with all sliders on their arcs"
    theta, phi = (np.degrees(angle[workspace.best]) for angle in (workspace.theta, workspace.phi))
    worst = workspace.condition_number[workspace.on_arcs].max()
    return (
        f"{workspace.area:.3g} sr on the arcs, condition number "
        f"{workspace.condition_number[workspace.best]:.3g} (theta {theta:.1f}, phi {phi:.1f} deg) "
        f"to {worst:.3g}"
    )

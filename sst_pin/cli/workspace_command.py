# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin workspace`: map of the directions of the star's axis, with condition numbers."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files import Writer
from ..sst.paper import PERIOD
from ..sst.platform_motion import paper_circle
from ..sst.workspace import WorkspaceMap, workspace_at, workspace_over_rolls
from .common import Commands, add_figure, add_robot, number, output_name, say, sst_of, write


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "workspace",
        _run,
        "Draw a map of the directions of the star's axis: reach, condition number, singular "
        "curves; for one roll angle psi of the star, and for the best psi of each direction.",
    )
    add_robot(parser)
    add_figure(parser)
    parser.add_argument(
        "--psi",
        type=number("an angle in degrees", math.isfinite),
        default=0.0,
        metavar="DEG",
        help="roll angle of the star (default: 0)",
    )
    parser.add_argument(
        "--data", type=Path, metavar="FILE", help="also write the map at psi as .npz or .csv"
    )


def _run(arguments: argparse.Namespace) -> None:
    from .. import plots  # needs the extra `plot`

    name = output_name(arguments.output, ".png")
    plots.require_ending(name)
    robot = sst_of(arguments)
    at_psi = workspace_at(robot, np.radians(arguments.psi))
    if str(arguments.data) == str(arguments.output) == "-":
        raise InputError("--data", "standard output can hold the figure or the data, not both")
    files: dict[Path, Writer] = {}
    if arguments.data is not None:
        files[arguments.data] = at_psi.writer(output_name(arguments.data, ".csv"))
    over_rolls = workspace_over_rolls(robot)
    path = None
    if arguments.robot is None:
        circle = paper_circle(np.linspace(0, PERIOD, 361)).R[:, :, 0]
        path = ("circle of the paper", circle)
    figure = plots.workspace_page(robot, at_psi, over_rolls, path)
    files[arguments.output] = plots.figure_writer(figure, name)
    write(files, arguments)
    say(f"at psi = {arguments.psi:g} deg: {_summary(at_psi)}", arguments)
    roll = np.degrees(over_rolls.roll[over_rolls.on_arcs].max(initial=0))
    say(f"over all psi: {_summary(over_rolls)}, up to {roll:.0f} deg of roll", arguments)
    say(f"-> {', '.join(map(str, files))}", arguments)


def _summary(workspace: WorkspaceMap) -> str:
    if workspace.best is None:
        return "no direction has all sliders on their arcs"
    theta, phi = (np.degrees(angle[workspace.best]) for angle in (workspace.theta, workspace.phi))
    worst = workspace.condition_number[workspace.on_arcs].max()
    return (
        f"{workspace.area:.3g} sr on the arcs, condition number "
        f"{workspace.condition_number[workspace.best]:.3g} (theta {theta:.1f}, phi {phi:.1f} deg) "
        f"to {worst:.3g}"
    )

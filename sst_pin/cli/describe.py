# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin describe`: a description folder, such as urdf/, for any SST."""

from __future__ import annotations

import argparse
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..description import description_writers
from ..description.parameters import Parameters, RigidBody
from ..files import write_files
from ..sst.robot_wrapper import configurations_of
from .common import Commands, add_force, add_robot, require_extras, sst_of, triple


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add(
        "describe",
        _run,
        "Write an SST as a folder for other tools: URDF, cuts, SRDF, MJCF, meshes, README. The "
        "robot is the paper's, or that of --robot; the other options change its parameters.",
    )
    add_robot(parser)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="created if it does not exist",
    )
    add_force(parser)
    parser.add_argument(
        "--alpha", type=triple, metavar="A1,A2,A3", help="angles between the arcs, degrees"
    )
    parser.add_argument(
        "--base-directions",
        type=_directions,
        metavar="'X,Y,Z X,Y,Z X,Y,Z'",
        help="directions from O to P_1, P_2, P_3; vectors of any length",
    )
    for name, unit, text in (
        ("base-radius", "M", "radius of the base, m"),
        ("star-radius", "M", "radius of the star, m"),
        ("link-mass", "KG", "mass of each actuator link, kg; scales its inertia too"),
        ("passive-mass", "KG", "mass of each passive link, kg; scales its inertia too"),
        ("star-mass", "KG", "mass of the star, kg; scales its inertia too"),
        ("viscous-friction", "D", "viscous friction of all nine joints, N m s/rad"),
        ("coulomb-friction", "F", "Coulomb friction of all nine joints, N m"),
    ):
        parser.add_argument(f"--{name}", type=float, metavar=unit, help=text)
    parser.add_argument(
        "--gravity", type=triple, metavar="X,Y,Z", help="gravity in base axes, m/s^2"
    )


def _directions(text: str) -> list[Array]:
    return [triple(part) for part in text.split()]


def _run(arguments: argparse.Namespace) -> None:
    require_extras(mesh="trimesh", plot="matplotlib")
    from ..plots.paper_figures import picture_writers

    p = _changed(sst_of(arguments).parameters, arguments)
    files = description_writers(p, configurations_of(p)) | picture_writers(p)
    folder = arguments.output
    write_files({folder / n: write for n, write in files.items()}, arguments.force, folder=folder)
    print(f"{len(files)} files -> {arguments.output}")


def _changed(p: Parameters, arguments: argparse.Namespace) -> Parameters:
    """The parameters with what the options say in place."""
    given = {name: value for name, value in vars(arguments).items() if value is not None}
    changes = {f.name: given[f.name] for f in fields(Parameters) if f.name in given}
    if "alpha" in given:
        changes["arc_angles"] = np.radians(given["alpha"])
    if "link_mass" in given:
        changes["link"] = [_weighing(given["link_mass"], body) for body in p.links]
    if "passive_mass" in given:
        changes["passive_link"] = [_weighing(given["passive_mass"], b) for b in p.passive_links]
    if "star_mass" in given:
        changes["star"] = _weighing(given["star_mass"], p.star)
    return replace(p, **changes)


def _weighing(mass: float, body: RigidBody) -> RigidBody:
    """A body of the same shape and another density."""
    with np.errstate(over="ignore", invalid="ignore"):  # `Parameters` judges what comes out
        return RigidBody(mass, body.center_of_mass, body.inertia * (mass / body.mass))

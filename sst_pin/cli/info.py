# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin info`: versions, model and mobility."""

from __future__ import annotations

import argparse
import json
import platform

from ..arrays import Array
from ..chain.closed_chain import ClosedChain
from ..errors import ClosureError, DescriptionError
from ..version import __version__
from .common import Commands, add_robot, robot_of, version_of


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add("info", _run, "Print versions, the model and its mobility.")
    add_robot(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")


def _run(arguments: argparse.Namespace) -> None:
    robot = robot_of(arguments)
    mobility = robot.mobility(_home_of(robot))
    others = {name: version_of(name) for name in ("pin", "numpy", "scipy", "matplotlib")}
    versions = {"sst-pin": __version__} | others
    source = arguments.robot or "the URDF of the package"
    model = robot.mechanism.model
    mass = sum(inertia.mass for inertia in model.inertias)
    if arguments.json:
        content = {
            "versions": {"python": platform.python_version()} | versions,
            "system": f"{platform.system()} {platform.machine()}",
            "model": model.name,
            "source": str(source),
            "joints": list(robot.joint_names),
            "motors": list(robot.motor_names),
            "coordinates": list(mobility.coordinates),
            "degrees_of_freedom": mobility.degrees_of_freedom,
            "closure_equations": len(mobility.rows),
            "redundant_closure_equations": mobility.redundant_rows,
            "moving_mass_kg": mass,
            "gravity_m_s2": model.gravity.linear.tolist(),
            "friction": not robot.friction.none,
            "path": robot.path,
        }
        print(json.dumps(content, indent=1))
        return
    print(f"Python {platform.python_version()} on {platform.system()} {platform.machine()}")
    print(", ".join(f"{name} {version}" for name, version in versions.items()))
    print(f"model {model.name}: {source}")
    print(f"  order of the joints in q: {', '.join(robot.joint_names)}")
    print(f"  moving mass {mass:.6g} kg, gravity {model.gravity.linear.tolist()} m/s^2")
    friction = "none" if robot.friction.none else "viscous and Coulomb, from the description"
    print(f"  friction: {friction}")
    print(f"  dynamics computed by: {robot.path}")
    print(mobility)


def _home_of(robot: ClosedChain) -> Array | None:
    try:
        return robot.home
    except (DescriptionError, ClosureError):
        return None

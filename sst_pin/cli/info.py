# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin info`: what is installed and which model is meant."""

from __future__ import annotations

import argparse
import platform

from .common import Commands, add_urdf, robot_of, version_of


def add_to(commands: Commands) -> None:
    """Add the command."""
    add_urdf(commands.add("info", _run, "Versions, the model, its mobility."))


def _run(arguments: argparse.Namespace) -> None:
    robot = robot_of(arguments)
    packages = ("sst-pin", "pin", "numpy", "scipy", "matplotlib")
    print(f"Python {platform.python_version()} on {platform.system()} {platform.machine()}")
    print(", ".join(f"{name} {version_of(name)}" for name in packages))
    print(f"model {robot.model.name}: {arguments.urdf or 'the shipped URDF'}")
    mass = sum(inertia.mass for inertia in robot.model.inertias)
    print(f"  joints in the order of q: {', '.join(robot.joint_names)}")
    print(f"  moving mass {mass:.6g} kg, gravity {robot.model.gravity.linear.tolist()} m/s^2")
    friction = "none" if robot.friction.none else "viscous and Coulomb, as in the URDF"
    print(f"  friction {friction}")
    print(f"  dynamics by {robot.path}")
    print(robot.mobility(robot.home))

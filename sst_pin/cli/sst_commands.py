# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin paper` and `describe`: the paper's examples, the files of an SST or of any robot."""

import argparse
import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from ..description.folder import description_writers
from ..description.frames import JOINT_NAMES
from ..description.mjcf_writer import write_mjcf
from ..description.parameters import Parameters, RigidBody
from ..errors import InputError
from ..files import Writer, write_files
from ..sst.paper import PERIOD, compare, example_1, example_2
from ..sst.robot import SST
from ..sst.robot_wrapper import configurations_of
from . import common

#: Options of `describe` that do not change parameters of an SST.
_COMMON = {"command", "robot", "model", "output", "force"}


def paper(arguments: argparse.Namespace) -> int:
    """Both examples of the paper and their figures."""
    from .. import plots  # needs the extra `plot`

    if not 10 <= arguments.samples <= 10**7:
        raise InputError("--samples", f"{arguments.samples} is not from 10 to 10 million")
    robot = common.sst_of(arguments)
    out = arguments.output
    t = np.linspace(0, PERIOD, arguments.samples)
    began = time.perf_counter()
    example = example_1(robot, t)
    seconds = time.perf_counter() - began
    must_stop = common.print_findings(robot.check_limits(example), arguments)
    if must_stop:
        return 1

    # Example 1 and example 2, as lines of a table.
    peaks = np.abs(example.tau).max(axis=0)
    rms = np.sqrt((example.tau**2).mean(axis=0))
    lines = [
        f"Example 1: inverse dynamics along the circle, {len(t)} samples, {seconds:.3f} s",
        "                    tau_1      tau_2      tau_3",
        " ".join(["peak |tau| (N m)", *(f"{value:10.4f}" for value in peaks)]),
        " ".join(["RMS tau    (N m)", *(f"{value:10.4f}" for value in rms)]),
        "Example 2: direct dynamics with these torques, one period",
        "start     path error   closures   energy error   time",
    ]
    motions = {"example_1": example}
    for name, is_rounded in (("exact", False), ("printed", True)):
        began = time.perf_counter()
        motion = example_2(robot, example, is_rounded)
        motions[f"example_2_{name}_start"] = motion
        seconds = time.perf_counter() - began
        errors = compare(robot, example, motion)
        line = f"{name:8}  {errors.path_error:.1e} rad  {errors.closure:.1e}    "
        line += f"{errors.energy:.1e} J     {seconds:.2f} s{common.early_end(motion)}"
        lines.append(line)

    # Motions and figures as files.
    files = dict[Path, Writer]()
    for stem, motion in motions.items():
        for name in (f"{stem}.csv", f"{stem}.npz"):
            files[out / name] = motion.writer(name)
    figures = plots.paper_figures(
        robot, example, motions["example_2_exact_start"], motions["example_2_printed_start"]
    )
    files |= {out / name: writer for name, writer in figures.items()}
    write_files(files, arguments.force, folder=out)
    print(*lines, f"{len(files)} files in {out}", sep="\n")
    return 0


def describe(arguments: argparse.Namespace) -> None:
    """Write any robot as MJCF, or an SST as a description folder such as urdf/."""
    robot = common.robot_of(arguments)
    output = arguments.output
    if output.suffix.lower() in (".xml", ".mjcf"):
        options = {name for name, value in vars(arguments).items() if value is not None}
        changes_sst = bool(options - _COMMON)
        if changes_sst:  # for another robot, `sst_of` raises an error
            robot = SST(_with_options(common.sst_of(arguments).parameters, arguments))
        write_mjcf(robot, output, arguments.force)
        print(f"{robot.mechanism.model.name or 'robot'} with closed loops -> {output}")
        return
    if not set(JOINT_NAMES) <= set(robot.joint_names):
        raise InputError("--output", f"{output}: this robot is no SST; -o FILE.xml writes an MJCF")
    common.require_extras(mesh="trimesh", plot="matplotlib")
    from ..plots.paper_figures import picture_writers

    # A robot with the joints of an SST is read again as an SST, with its parameters.
    p = _with_options(common.sst_of(arguments).parameters, arguments)
    files = description_writers(p, configurations_of(p)) | picture_writers(p)
    write_files({output / n: write for n, write in files.items()}, arguments.force, folder=output)
    print(f"{len(files)} files -> {output}")


def _with_options(p: Parameters, arguments: argparse.Namespace) -> Parameters:
    """The parameters, changed by the options.

    Options with the name of a parameter replace it; the others are angles in degrees, and masses.
    """
    options = {name: value for name, value in vars(arguments).items() if value is not None}
    changes = {f.name: options[f.name] for f in fields(Parameters) if f.name in options}
    if "alpha" in options:
        changes["arc_angles"] = np.radians(options["alpha"])
    if "link_mass" in options:
        changes["link"] = [_with_mass(options["link_mass"], body) for body in p.links]
    if "passive_mass" in options:
        mass = options["passive_mass"]
        changes["passive_link"] = [_with_mass(mass, body) for body in p.passive_links]
    if "star_mass" in options:
        changes["star"] = _with_mass(options["star_mass"], p.star)
    return replace(p, **changes)


def _with_mass(mass: float, body: RigidBody) -> RigidBody:
    """The body with another mass; its inertia changes in proportion."""
    with np.errstate(over="ignore", invalid="ignore"):  # `Parameters` checks the result
        return RigidBody(mass, body.center_of_mass, body.inertia * (mass / body.mass))

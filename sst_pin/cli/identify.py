# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin identify`: dynamic parameters from measurements."""

import argparse
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from .. import identification
from ..arrays import positive_number
from ..closed_chain import ClosedChain
from ..errors import InputError
from ..files import Writer, require_ending, text_writer
from ..identification.urdf_numbers import with_dynamics
from ..reading import cuts_beside, is_mjcf
from ..simulation.motion_files import read_log
from . import common

#: The largest decimation that is chosen by default.
_EVERY = 10


def identify(arguments: argparse.Namespace) -> int:
    """Dynamic parameters from a log."""
    # The output and the robot, before the work.
    output = arguments.output
    masses = arguments.masses or {}
    require_ending(common.output_name(output, ".md"), ".md")
    with_picture = str(output) != "-"
    if with_picture:
        common.require_extras(identification="clarabel", plot="matplotlib")
    else:
        common.require_extras(identification="clarabel")
    urdf = None
    if arguments.urdf:
        urdf = Path(arguments.robot or "")
        if not urdf.is_file() or is_mjcf(urdf):
            raise InputError("--robot", "needed: a URDF, which is written with the numbers found")
        require_ending(arguments.urdf, ".urdf")
    robot = _with_masses(common.robot_of(arguments), masses)

    # The log as a motion; its last third is for validation.
    t, x, tau, start = read_log(robot.engine, common.source_of(arguments.log))
    cutoff = arguments.cutoff
    every = arguments.decimate
    # By default at most the samples of a period of the cut-off frequency: the filter before has
    # removed what is faster.
    if every is None:
        in_period = (len(t) - 1) / (t[-1] - t[0]) / cutoff if cutoff > 0 else 1
        every = max(1, min(_EVERY, int(in_period)))
    motion = identification.measured_motion(
        robot, t, x, tau, cutoff=cutoff, decimate=every, start=start
    )
    cut = 2 * len(motion) // 3
    first = motion[:cut]
    unseen = motion[cut:]

    # The parameters. Each combination has the column of one parameter, after which it is named.
    base = identification.base_parameters(robot, _parameters(robot, arguments.which, masses))
    estimate = identification.estimate(
        robot,
        base,
        first.q,
        first.va,
        first.aa,
        first.tau,
        robust=arguments.robust,
        decimate=every,  # as above, so that torques and regressor pass the same filter
    )
    theta = identification.consistent_parameters(robot, estimate)

    # The report, its picture, and the URDF.
    text = identification.report(robot, estimate, theta, unseen)
    files = dict[Path, Writer]()
    if with_picture:
        from .. import plots

        name = output.with_name(f"{output.stem}_torques.png")
        page = plots.torques_page(unseen, identification.predicted_torques(robot, theta, unseen))
        files[name] = plots.figure_writer(page, name)
        text += f"\n![Measured and predicted torques of the unseen motion](<{name.name}>)\n"
    if urdf is not None:
        new = with_dynamics(robot.with_parameters(theta), urdf, Path(arguments.urdf).parent)
        files |= _with_closures(new, urdf, arguments.urdf)
    common.write({output: text_writer(text), **files}, arguments)
    result = f"{len(base)} combinations, {int(estimate.supported.sum())} supported"
    common.say(f"{len(motion)} samples, {result} -> {output}", arguments)
    if not estimate.supported.all():
        common.say(_advice(robot, estimate), arguments)
    return 0


def _advice(robot: ClosedChain, estimate: identification.Estimate) -> str:
    """What to do about combinations that the log does not support."""
    names = np.array(robot.dynamic_parameters.names)
    supported = names[estimate.base.columns[estimate.supported]]
    if not len(supported):
        return "no combination is supported: a faster or longer motion is needed"
    return (
        "values that are not supported stay unknown; this considers only the supported ones: "
        f"--which {','.join(supported)}"
    )


def _with_masses(robot: ClosedChain, masses: Mapping[str, float]) -> ClosedChain:
    """The robot whose bodies have known masses; mass centres and radii of gyration stay."""
    theta = robot.dynamic_parameters
    for body, mass in masses.items():
        present = theta[f"{body}.mass"]
        if not present > 0:
            raise InputError("--masses", f"body {body} has no mass that could be scaled")
        theta = theta.scale_mass(body, positive_number("--masses", mass) / present)
    return robot.with_parameters(theta) if masses else robot


def _parameters(robot: ClosedChain, which: str | None, masses: Mapping[str, float]) -> list[str]:
    """Patterns of the parameters considered: bodies, friction and lines by default.

    For a line that is a motor only its damping is considered: its force is the motor's. Known
    masses are not considered.
    """
    if which:
        patterns = which.split(",")
    else:
        patterns = ["*.m*", "*.i*", "*.viscous", "*.coulomb"]
        for line in map(str, robot.lines):
            patterns.append(f"{line}.damping")
            if line not in robot.motor_names:
                patterns += [f"{line}.stiffness", f"{line}.preload"]
    if not masses:
        return patterns
    known = {f"{body}.mass" for body in masses}
    considered = []
    for name in robot.dynamic_parameters.names:
        fits = any(fnmatchcase(name, pattern) for pattern in patterns)
        if fits and name not in known:
            considered.append(name)
    return considered


def _with_closures(text: str, urdf: Path, output: Path) -> dict[Path, Writer]:
    """Writers of a URDF and of the YAML and SRDF files that belong to it."""
    files = {output: text_writer(text)}
    if str(output) != "-":
        for ending, path in ((".yaml", cuts_beside(urdf)), (".srdf", urdf.with_suffix(".srdf"))):
            if path is not None and path.is_file():
                copy = output.with_suffix(ending)
                files[copy] = text_writer(path.read_text(encoding="utf-8"))
    return files

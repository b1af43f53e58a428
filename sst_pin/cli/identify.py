# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin identify`: dynamic parameters from measurements."""

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .. import identification
from ..arrays import Array, names_matching_any, positive_number
from ..closed_chain import ClosedChain
from ..errors import InputError
from ..files import Writer, require_ending, text_writer
from ..identification.urdf_numbers import with_dynamics
from ..reading import cuts_beside, is_mjcf
from ..simulation.motion_files import read_log
from . import common
from .commands import PATTERNS

#: The largest decimation that is chosen by default.
_LARGEST_DECIMATION = 10


def identify(arguments: argparse.Namespace) -> int:
    """Dynamic parameters from a log: a report with a picture, and perhaps a URDF.

    The first two thirds of the log give the parameters. The last third, which the report calls
    unseen, validates them.
    """
    # Faults of the options, before the work.
    output = arguments.output
    with_picture = str(output) != "-"
    _check_output(arguments, with_picture)
    urdf = _urdf_of_robot(arguments)
    masses = arguments.masses or {}
    robot = _with_masses(common.robot_of(arguments), masses)

    # The log as a motion.
    log = read_log(robot.engine, common.source_of(arguments.log))
    decimate = arguments.decimate
    if decimate is None:
        decimate = _decimation(log.t, arguments.cutoff)
    motion = identification.measured_motion(
        robot,
        log.t,
        log.x,
        log.tau,
        cutoff=arguments.cutoff,
        decimate=decimate,
        start=log.start,
    )
    end_of_fit = 2 * len(motion) // 3
    motion_of_fit = motion[:end_of_fit]
    motion_of_validation = motion[end_of_fit:]

    # The combinations of parameters that motions show, their values, and bodies that have them.
    base = identification.base_parameters(robot, _patterns(robot, arguments.which, masses))
    estimate = identification.estimate(
        robot,
        base,
        motion_of_fit.q,
        motion_of_fit.va,
        motion_of_fit.aa,
        motion_of_fit.tau,
        robust=arguments.robust,
        decimate=decimate,  # as above, so that torques and regressor pass the same filter
    )
    theta = identification.consistent_parameters(robot, estimate)

    # The report, its picture, and the URDF.
    report = identification.report(robot, estimate, theta, motion_of_validation)
    files = dict[Path, Writer]()
    if with_picture:
        from .. import plots

        name = output.with_name(f"{output.stem}_torques.png")
        page = plots.torques_page(
            motion_of_validation,
            identification.predicted_torques(robot, theta, motion_of_validation),
        )
        files[name] = plots.figure_writer(page, name)
        report += f"\n![Measured and predicted torques of the unseen motion](<{name.name}>)\n"
    if urdf is not None:
        text = with_dynamics(robot.with_parameters(theta), urdf, Path(arguments.urdf).parent)
        files |= _urdf_writers(text, urdf, arguments.urdf)
    common.write({output: text_writer(report), **files}, arguments)
    result = f"{len(base)} combinations, {int(estimate.supported.sum())} supported"
    common.say(f"{len(motion)} samples, {result} -> {output}", arguments)
    if not estimate.supported.all():
        common.say(_advice(robot, estimate), arguments)
    return 0


def _check_output(arguments: argparse.Namespace, with_picture: bool) -> None:
    """Refuse an output of another format, and missing packages."""
    require_ending(common.output_name(arguments.output, ".md"), ".md")
    if with_picture:
        common.require_extras(identification="clarabel", plot="matplotlib")
    else:
        common.require_extras(identification="clarabel")


def _urdf_of_robot(arguments: argparse.Namespace) -> Path | None:
    """The URDF of the robot, if a URDF is to be written; else None."""
    if not arguments.urdf:
        return None
    urdf = Path(arguments.robot or "")
    if not urdf.is_file() or is_mjcf(urdf):
        raise InputError("--robot", "needed: a URDF, which is written with the numbers found")
    require_ending(arguments.urdf, ".urdf")
    return urdf


def _decimation(t: Array, cutoff: float) -> int:
    """The default decimation: the number of samples in a period of the cut-off frequency.

    The low-pass filter, which comes before, has removed faster changes. The result is at most
    `_LARGEST_DECIMATION`.
    """
    if not cutoff > 0:  # `measured_motion` refuses this frequency
        return 1
    sample_rate = (len(t) - 1) / (t[-1] - t[0])
    return max(1, min(_LARGEST_DECIMATION, int(sample_rate / cutoff)))


def _advice(robot: ClosedChain, estimate: identification.Estimate) -> str:
    """What to do about combinations that the log does not support."""
    names = np.array(robot.dynamic_parameters.names)
    supported_names = names[estimate.base.columns[estimate.supported]]
    if not len(supported_names):
        return (
            "no combination is supported: a faster or longer motion is needed, or fewer parameters "
            "by --which"
        )
    return (
        "values that are not supported stay unknown; this considers only the supported ones: "
        f"--which {','.join(supported_names)}"
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


def _patterns(robot: ClosedChain, which: str | None, masses: Mapping[str, float]) -> list[str]:
    """Names, or patterns of names, of the parameters that are considered.

    By default these are masses, first moments and moments of inertia of bodies, friction, and the
    parameters of forces along lines. If a motor acts on a line, only the line's damping is
    considered, because the rest of the force is measured as the motor's. Known masses are left out.
    """
    if which:
        patterns = which.split(",")
    else:
        patterns = PATTERNS.split(",")
        for line in map(str, robot.lines):
            patterns.append(f"{line}.damping")
            if line not in robot.motor_names:
                patterns += [f"{line}.stiffness", f"{line}.preload"]
    if not masses:
        return patterns
    names = robot.dynamic_parameters.names
    considered = names_matching_any("parameter", patterns, names)
    known = {f"{body}.mass" for body in masses}
    return [name for name in considered if name not in known]


def _urdf_writers(text: str, urdf: Path, output: Path) -> dict[Path, Writer]:
    """Writers of a new URDF, and of copies of the YAML and the SRDF beside the first one."""
    files = {output: text_writer(text)}
    if str(output) != "-":
        for ending, path in ((".yaml", cuts_beside(urdf)), (".srdf", urdf.with_suffix(".srdf"))):
            if path is not None and path.is_file():
                copy = output.with_suffix(ending)
                files[copy] = text_writer(path.read_text(encoding="utf-8"))
    return files

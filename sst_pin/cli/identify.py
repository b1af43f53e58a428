# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin identify`: dynamic parameters from measurements."""

import argparse
from pathlib import Path

from .. import identification
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
    output = arguments.output
    require_ending(common.output_name(output, ".md"), ".md")
    pictures = {} if str(output) == "-" else {"plot": "matplotlib"}
    common.require_extras(identification="clarabel", **pictures)
    urdf = Path(arguments.robot or "") if arguments.urdf else None
    if urdf:
        if not urdf.is_file() or is_mjcf(urdf):
            raise InputError("--robot", "needed: a URDF, which is written with the numbers found")
        require_ending(arguments.urdf, ".urdf")
    robot, source = common.robot_of(arguments), common.source_of(arguments.log)
    t, x, tau, start = read_log(robot.engine, source)
    cutoff, every = arguments.cutoff, arguments.decimate
    if every is None:  # at most the samples of a period of the cut-off frequency
        in_period = (len(t) - 1) / (t[-1] - t[0]) / cutoff if cutoff > 0 else 1
        every = max(1, min(_EVERY, int(in_period)))
    options = {"cutoff": cutoff, "decimate": every, "start": start}
    motion = identification.measured_motion(robot, t, x, tau, **options)
    cut = 2 * len(motion) // 3
    first, unseen = motion[:cut], motion[cut:]
    base = identification.base_parameters(robot, _parameters(robot, arguments.which))
    options = {"robust": arguments.robust, "decimate": every}
    estimate = identification.estimate(
        robot, base, first.q, first.va, first.aa, first.tau, **options
    )
    theta = identification.consistent_parameters(robot, estimate)
    text, files = identification.report(robot, estimate, theta, unseen), dict[Path, Writer]()
    if pictures:
        from .. import plots

        name = output.with_name(f"{output.stem}_torques.png")
        page = plots.torques_page(unseen, identification.predicted_torques(robot, theta, unseen))
        files[name] = plots.figure_writer(page, name)
        text += f"\n![Measured and predicted torques of the unseen motion](<{name.name}>)\n"
    if urdf:
        new = with_dynamics(robot.with_parameters(theta), urdf, Path(arguments.urdf).parent)
        files |= _with_closures(new, urdf, arguments.urdf)
    common.write({output: text_writer(text), **files}, arguments)
    result = f"{len(base)} combinations, {int(estimate.supported.sum())} supported"
    common.say(f"{len(motion)} samples, {result} -> {output}", arguments)
    return 0


def _parameters(robot: ClosedChain, which: str | None) -> list[str]:
    """Patterns of the parameters considered: bodies, friction and lines by default.

    For a line that is a motor only its damping is considered: its force is the motor's.
    """
    if which:
        return which.split(",")
    motors = set(robot.motor_names)
    words = ("damping",), ("stiffness", "damping", "preload")
    lines = [f"{x}.{word}" for x in map(str, robot.lines) for word in words[x not in motors]]
    return ["*.m*", "*.i*", "*.viscous", "*.coulomb", *lines]


def _with_closures(text: str, urdf: Path, output: Path) -> dict[Path, Writer]:
    """Writers of a URDF and of the YAML and SRDF files that belong to it."""
    files = {output: text_writer(text)}
    if str(output) != "-":
        for ending, path in ((".yaml", cuts_beside(urdf)), (".srdf", urdf.with_suffix(".srdf"))):
            if path is not None and path.is_file():
                copy = output.with_suffix(ending)
                files[copy] = text_writer(path.read_text(encoding="utf-8"))
    return files

# SPDX-License-Identifier: BSD-2-Clause
"""Report of all problems of a robot's files, for any robot."""

import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from .. import reading
from ..engine import Engine
from ..errors import (
    ActuationError,
    ClosureError,
    DescriptionError,
    DescriptionWarning,
    InputError,
    MissingExtraError,
    SSTError,
)
from ..files import as_path
from ..loops.guesses import home_of
from ..loops.mobility import Mobility
from ..model.checks import tendon_of
from ..model.closures import Constraint, frames_of
from ..model.tree import frame_id
from ..simulation.check import findings
from ..summaries import listed
from .inertia_checks import check_inertias
from .problems import SEVERITIES, Problem, error, merged, note, warning
from .robot_file import RobotFile
from .shape_checks import check_shapes

__all__ = ["Problem", "examine", "summary_of", "validate"]

#: Largest residual of the loops at a `home` that is rounded to four digits, [m] or [rad].
_ROUNDED_HOME = 1e-3


def validate(
    path: str | Path, cuts: str | Path | None = None, *, model: str | None = None
) -> list[Problem]:
    """All problems of a robot's files.

    Of a URDF or SDF it checks names, tree, limits, axes, inertias and meshes; of the closures
    whether they can close, whether the motors hold the robot, and whether `home` is closed, regular
    and within the limits of the joints. MuJoCo itself checks an MJCF.

    Args:
        path: A URDF, an SDF, or an MJCF with the ending .xml or .mjcf.
        cuts: YAML of closures and motors, see `ClosedChain.from_urdf`; by default the one beside
            the URDF, if there is one. An MJCF has none.
        model: The model of an SDF, by name; needed if several models move.

    Returns:
        Errors, which prevent computing or drawing the robot; warnings; and notes, mostly about
        what other tools do not read. Empty for a good description.

    Raises:
        InputError: For an MJCF with `cuts`.
        MissingExtraError: For an MJCF without MuJoCo.

    Example:
        >>> sst_pin.validate(sst_pin.URDF_PATH)
        []
    """
    return examine(path, cuts, model).problems


class Report(NamedTuple):
    """What `validate` finds out about a robot's files."""

    problems: list[Problem]
    #: Mobility and moving mass, for people; empty if there are errors.
    summary: str


def examine(path: str | Path, cuts: str | Path | None = None, model: str | None = None) -> Report:
    """The problems of a file, errors first, and the summary of the robot."""
    # `Urdf.read` reports a path of another type.
    if isinstance(path, (str, Path)) and reading.is_mjcf(Path(path)):
        if cuts is not None:
            raise InputError("cuts", "an MJCF contains its closures and motors")
        report = _mjcf(as_path(path))
    else:
        cuts_path = None if cuts is None else as_path(cuts)
        report = _urdf(path, cuts_path, model)
    merged_problems = merged(report.problems)
    problems = sorted(merged_problems, key=lambda problem: SEVERITIES.index(problem.severity))
    return Report(problems, "" if _have_error(problems) else report.summary)


def _have_error(problems: Sequence[Problem]) -> bool:
    return any(problem.severity == "error" for problem in problems)


def summary_of(model: pin.Model, mobility: Mobility | str) -> str:
    """Mobility, or why it is not known, and moving mass of a robot, for people."""
    mass = sum(inertia.mass for inertia in list(model.inertias)[1:])  # without the base
    return f"{mobility}\nmoving mass         {mass:.6g} kg"


def _urdf(path: str | Path, cuts: Path | None, model: str | None) -> Report:
    """The report on a URDF or an SDF."""
    try:
        urdf = reading.Urdf.read(path, model)
    except DescriptionError as caught:
        return Report(_errors_of(caught, "file"), "")
    problems = list(urdf.problems)
    summary = ""
    if not _have_error(problems):  # Pinocchio needs a tree
        robot = _with_files_beside(urdf, cuts)
        problems += robot.problems
        summary = robot.summary
    problems += check_inertias(urdf.root, urdf.helpers)
    problems += check_shapes(urdf.root, Path(path).parent)
    return Report(problems, summary)


def _with_files_beside(urdf: reading.Urdf, cuts: Path | None) -> Report:
    """The report on the robot of a URDF, its YAML and its SRDF."""
    try:
        content = reading.read_cuts(urdf, cuts)
    except SSTError as caught:
        return Report(_errors_of(caught, "cuts"), "")
    srdf = str(Path(urdf.source).with_suffix(".srdf"))
    try:
        robot = reading.closed_robot(urdf, content)
    except SSTError as caught:
        is_about_srdf = str(caught).startswith(srdf)  # errors begin with the file
        return Report(_errors_of(caught, "srdf" if is_about_srdf else "file"), "")
    report = _robot(robot)
    summary = report.summary
    if robot.open_tree:
        summary = f"open tree           {robot.open_tree}\n{summary}"
    return Report([*robot.notes, *report.problems], summary)


def _mjcf(path: Path) -> Report:
    """The report on an MJCF, with what MuJoCo reports."""
    from .mjcf import robot_file_of

    try:
        robot = robot_file_of(path)
    except MissingExtraError:
        raise
    except SSTError as caught:
        return Report(_errors_of(caught, "file"), "")
    report = _robot(robot)
    return Report([*report.problems, *robot.notes], report.summary)


def _errors_of(caught: SSTError, where: str) -> list[Problem]:
    """The problems of an exception as errors.

    For a wrong file, the texts of exceptions start with "not a URDF: ". Here `where` says this.
    """
    texts = caught.problems if isinstance(caught, DescriptionError) else [str(caught)]
    return [error(where, re.sub("^not (a URDF|an SDF|an MJCF): ", "", text)) for text in texts]


def _robot(robot: RobotFile) -> Report:
    """The report on closures, motors and home of a robot that could be read."""
    try:
        # Without known names and closed loops there is no mechanism. Closing needs the names.
        problems = list(_unknown_names(robot))
        if not problems:
            problems = list(_closures_that_stay_open(robot))
        if problems:
            return Report(problems, "")

        # The mechanism; its warnings become notes.
        with warnings.catch_warnings(record=True) as caught_warnings:
            warnings.simplefilter("always", DescriptionWarning)
            engine = Engine(robot.mechanism())
        problems = [note("closures", str(caught.message)) for caught in caught_warnings]
        problems += _home(engine)
        try:
            mobility = engine.loops.mobility()
        except ClosureError as caught:
            # `mobility` starts from random configurations only; `_gap` also starts from q = 0.
            text = "only the start q = 0 leads to closed loops, so mobility is not computed"
            problems = [warning("closures", text), *problems]
            return Report(problems, summary_of(robot.model, str(caught)))
        problems = [*_actuation(engine, mobility), *problems]
        return Report(problems, summary_of(robot.model, mobility))
    except SSTError as caught:
        where = "actuation" if isinstance(caught, ActuationError) else "robot"
        return Report(_errors_of(caught, where), "")


def _unknown_names(robot: RobotFile) -> Iterator[Problem]:
    """Errors of closures, lines and motors whose frames or joints do not exist."""
    model = robot.model
    if not model.nv:
        yield error("tree", "all joints are fixed")
    frames = {f"closure {closure}": frames_of(closure) for closure in robot.closures}
    for line in robot.lines:
        frames[f"line {line}"] = (line.frame_a, line.frame_b)
    for where, names in frames.items():
        for name in names:
            try:
                frame_id(model, name)
            except DescriptionError as caught:  # several frames of this name, at different places
                yield from _errors_of(caught, f"frame {name}")
            except SSTError:
                yield error(where, f"no frame {name} in the model")
    known = [*list(model.names)[1:], *map(str, robot.lines)]
    for motor in robot.actuated:
        for name in tendon_of(motor)[1]:
            if name not in known:
                yield error(f"motor {name}", "no moving joint of this name in the model")


def _closures_that_stay_open(robot: RobotFile) -> Iterator[Problem]:
    """Errors of closures that Newton's method cannot close from any of its starts."""
    # Each closure alone first: if it cannot be closed, it is the one with the fault.
    gaps = {closure: _gap(robot, [closure]) for closure in robot.closures}
    for closure, gap in gaps.items():
        if gap:
            yield error(f"closure {closure}", f"cannot be closed: {gap:.3g} (m or rad) stays open")
    if any(gaps.values()):
        return
    gap = _gap(robot, robot.closures)
    if gap:
        text = f"each can be closed alone, but not all together: {gap:.3g} (m or rad) stays open"
        yield error("closures", text)


def _gap(robot: RobotFile, closures: Sequence[Constraint]) -> float:
    """Smallest residual of these closures, [m] or [rad]; 0 if Newton's method closes them.

    It starts from several random configurations, and from q = 0.
    """
    without_forces = robot._replace(closures=tuple(closures), actuated=(), lines=())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DescriptionWarning)  # `_robot` reports them
        engine = Engine(without_forces.mechanism())
    try:
        engine.loops.example()  # from random configurations
        return 0.0
    except ClosureError as caught:
        smallest_residual = caught.residual
    # Some robots close only from q = 0 itself, with all joints free to move.
    model = engine.mechanism.model
    assembly = engine.reference.context.assembly
    try:
        assembly.assemble(pin.neutral(model), free=np.arange(model.nv))
        return 0.0
    except ClosureError:
        return smallest_residual


def _home(engine: Engine) -> Iterator[Problem]:
    """Warnings of a home that is open, singular or beyond limits."""
    mechanism = engine.mechanism
    q = home_of(mechanism)
    if q is None or not len(mechanism.coordinates):
        return
    gap = np.abs(engine.loops.at(q).f).max(initial=0.0)
    try:
        change = pin.difference(mechanism.model, q, engine.loops.home)
    except ClosureError:
        yield warning("home", f"cannot be closed: open by {gap:.3g} (m or rad); correct the pose")
        return
    if gap > _ROUNDED_HOME:
        largest = int(np.abs(change).argmax())
        rate = mechanism.space.rate_names[largest]
        unit = mechanism.space.rate_units[largest]
        coordinates = ", ".join(mechanism.coordinate_names)
        yield warning(
            "home",
            f"the loops are open by {gap:.3g} (m or rad); `chain.home` closes them with "
            f"{coordinates} fixed and moves {rate} by {change[largest]:.3g} {unit}; "
            "if the pose is right, a length or a frame is wrong",
        )
    # The home is one sample without a time, which `findings` takes as NaN.
    for finding in findings(engine, np.array([np.nan]), np.array([engine.loops.home])):
        yield warning("home", str(finding))


def _actuation(engine: Engine, mobility: Mobility) -> Iterator[Problem]:
    """Problems of too few motors, and a note on more motors than degrees of freedom."""
    freedoms = mobility.degrees_of_freedom
    motors = len(mobility.motor_names)
    motor_word = "motor" if motors == 1 else "motors"
    degree_word = "degree" if freedoms == 1 else "degrees"
    count = f"{motors} {motor_word} for {freedoms} {degree_word} of freedom"
    if not freedoms:
        yield error("mobility", "nothing can move; check kinds and axes of the closures")
    elif not mobility.sufficient:
        loose = freedoms - mobility.held
        verb = "moves" if loose == 1 else "move"
        text = f"{count}; {loose} of them {verb} with the motors locked: "
        yield warning("actuation", text + listed(mobility.loose_joints))
    elif mobility.redundantly_actuated:
        yield note("actuation", f"{count}; the smallest torques are computed")

# SPDX-License-Identifier: BSD-2-Clause
"""Report of all problems of a robot description, for any robot."""

from __future__ import annotations

from pathlib import Path

import pinocchio as pin

from ..closed_chain import ClosedChain
from ..errors import ClosureError, DescriptionError, InputError
from ..files import as_path
from . import Urdf, is_mjcf, whole_robot
from .link_contents import check_inertias, check_shapes
from .problems import Problem

__all__ = ["Problem", "examine", "validate"]


def validate(path: str | Path, cuts: str | Path | None = None) -> list[Problem]:
    """All problems of a description and of its closures.

    Of a URDF it checks names, tree, limits and axes; moving links without mass; impossible
    inertias; missing meshes, and meshes that some tools cannot read. With a YAML it also checks
    unknown names, closures that cannot close, and whether there are too few or too many motors.
    Of an MJCF it checks what `ClosedChain.from_mjcf` cannot read, closures and motors; MuJoCo
    itself checks the rest.

    Args:
        path: Any URDF, or an MJCF with the ending .xml or .mjcf.
        cuts: YAML of closures and motors, see `ClosedChain.from_urdf`; by default the file with the
            name of the URDF and the ending .yaml. Without a YAML the URDF is an open tree. An MJCF
            has none.

    Returns:
        Errors first, then warnings; empty for a good description.

    Raises:
        InputError: For an MJCF with `cuts`.
        MissingExtraError: For an MJCF without MuJoCo.

    Example:
        >>> sst_pin.validate(sst_pin.URDF_PATH)
        []
    """
    return examine(path, cuts)[0]


def examine(path: str | Path, cuts: str | Path | None = None) -> tuple[list[Problem], str]:
    """What `validate` gives, and joints, mass and mobility of a robot without errors."""
    if isinstance(path, (str, Path)) and is_mjcf(Path(path)):
        if cuts is not None:
            raise InputError("cuts", "an MJCF contains its closures and motors")
        return _examined(*whole_robot.check_mjcf(as_path(path)), Path(path))
    try:
        urdf = Urdf.read(path)
    except DescriptionError as caught:
        return whole_robot.errors_of(caught, "file"), ""
    path, problems = Path(path), list(urdf.problems)
    robot: whole_robot.Robot = None
    if not any(problem.severity == "error" for problem in problems):  # Pinocchio needs a tree
        found, robot = whole_robot.check(urdf, None if cuts is None else as_path(cuts))
        problems += found
    problems += [*check_inertias(urdf.root), *check_shapes(urdf.root, path.parent)]
    return _examined(problems, robot, path)


def _examined(
    problems: list[Problem], robot: whole_robot.Robot, path: Path
) -> tuple[list[Problem], str]:
    problems = sorted(problems, key=lambda problem: problem.severity)
    if robot is None or any(problem.severity == "error" for problem in problems):
        return problems, ""
    if not isinstance(robot, ClosedChain):
        text = f"joints              {robot.njoints - 1}, an open tree: no {path.stem}.yaml"
        return problems, summary_of(robot, text)
    try:
        return problems, summary_of(robot.model, robot.mobility())
    except ClosureError as caught:
        return problems, summary_of(robot.model, caught)


def summary_of(model: pin.Model, mobility: object) -> str:
    """Mobility and moving mass of a robot, for people."""
    mass = sum(inertia.mass for inertia in list(model.inertias)[1:])  # without the base
    return f"{mobility}\nmoving mass         {mass:.6g} kg"

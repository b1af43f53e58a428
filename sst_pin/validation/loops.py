# SPDX-License-Identifier: BSD-2-Clause
"""Loops that can be closed and motors that hold the robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from .. import reading
from ..chain.closed_chain import ClosedChain
from ..chain.closures import Constraint, frames_of
from ..chain.tree import frame_id
from ..errors import ActuationError, ClosureError, DescriptionError, SSTError, UnknownNameError
from ..reading.problems import Problem, error, warning

#: Open by so much a configuration is that was written with four digits, [m] or [rad].
_WRITTEN = 1e-3
#: Where the problem of a robot in which nothing moves is.
_STILL = "mobility"


def check(urdf: str, path: Path, cuts: Path | None) -> Iterator[Problem]:
    """Problems that only the robot as a whole has.

    Args:
        urdf: Text of a URDF that is a tree.
        path: Where it came from.
        cuts: The YAML of the cuts; None for an open tree.
    """
    where, found = "cuts", None
    try:
        if cuts is not None:
            found = reading.parse_cuts(reading.read_text(cuts, "YAML of the cuts"), str(cuts))
        where = "file"
        if found is None:
            reading.parse_urdf(urdf, str(path))
            return
        robot = reading.closed(urdf, str(path), found)
    except DescriptionError as caught:
        yield from (error(where, text) for text in caught.problems)
        return
    problems = list(_unknown(robot))
    yield from problems
    if problems:
        return
    try:
        reading.load_poses(path, robot.model, found.joints)
    except DescriptionError as caught:
        yield from (error("srdf", text) for text in caught.problems)
    yield from _moving(robot)


def check_mjcf(path: Path) -> Iterator[Problem]:
    """Problems of an MJCF that MuJoCo has not.

    Args:
        path: Of the file.

    Raises:
        MissingExtraError: Without MuJoCo.
    """
    from ..reading.mjcf import read_mjcf

    try:
        found = read_mjcf(path)
    except DescriptionError as caught:
        told = [problem.removeprefix("not an MJCF: ") for problem in caught.problems]
        yield from (error("file", text) for text in told)
        return
    robot = reading.Extended(found.model, found.closures, found.actuated)
    if not robot.closures:
        yield error("equality", "no closures: connect, weld, joint or tendon")
    if not robot.model.nv:
        yield error("tree", "no joints")
    if robot.closures and robot.model.nv:
        yield from _moving(robot)


def _moving(robot: reading.Extended) -> Iterator[Problem]:
    problems = list(_open(robot.model, robot.closures))
    yield from problems
    if problems:
        return
    problems = list(_actuation(robot))
    yield from problems
    if not any(problem.where == _STILL for problem in problems):
        yield from _home(robot)


def _unknown(robot: reading.Extended) -> Iterator[Problem]:
    model = robot.model
    if not robot.closures:
        yield error("cuts", "no closures")
    if not model.nv:
        yield error("tree", "all joints are fixed")
    for closure in robot.closures:
        for frame in frames_of(closure):
            try:
                frame_id(model, frame)
            except UnknownNameError:
                yield error(f"closure {closure}", f"no frame {frame} in the URDF")
            except DescriptionError as caught:
                yield from (error(f"frame {frame}", text) for text in caught.problems)
    for motor in robot.actuated:
        if motor not in list(model.names)[1:]:
            yield error(f"motor {motor}", "no moving joint of this name in the URDF")


def _open(model: pin.Model, closures: Sequence[Constraint]) -> Iterator[Problem]:
    """Closures that stay open from wherever Newton's method starts."""
    alone = {closure: _gap(model, [closure]) for closure in closures}
    for closure, gap in alone.items():
        if gap:
            yield error(f"closure {closure}", f"cannot be closed: {gap:.3g} (m or rad) stays open")
    if not any(alone.values()) and (gap := _gap(model, closures)):
        text = f"each can be closed alone, but not all together: {gap:.3g} (m or rad) stays open"
        yield error("closures", text)


def _gap(model: pin.Model, closures: Sequence[Constraint]) -> float:
    """What stays open at best, 0 when the loops can be closed."""
    chain = ClosedChain(model, closures, ())
    try:
        chain.generic_configuration()
    except ClosureError as caught:
        try:
            chain.assemble(pin.neutral(model), fixed=())
        except ClosureError:
            return caught.residual
    return 0.0


def _home(robot: reading.Extended) -> Iterator[Problem]:
    if "home" not in robot.model.referenceConfigurations:
        return
    chain = ClosedChain(robot.model, robot.closures, robot.actuated)
    home = pin.normalize(robot.model, robot.model.referenceConfigurations["home"])
    gap = np.abs(chain.residual(home)).max()
    try:
        chain.home  # noqa: B018
    except ClosureError:
        yield warning("home", f"cannot be closed: open by {gap:.3g} (m or rad); correct the pose")
    else:
        if gap > _WRITTEN:
            text = f"the loops are open by {gap:.3g} (m or rad); `chain.home` closes them"
            yield warning("home", text)


def _actuation(robot: reading.Extended) -> Iterator[Problem]:
    try:
        mobility = ClosedChain(*robot).mobility()
    except ClosureError:
        yield warning("closures", "they can be closed at q = 0 only, so mobility is not computed")
        return
    except ActuationError as caught:
        yield error("actuation", str(caught))
        return
    except SSTError as caught:
        yield error("robot", str(caught))
        return
    if not mobility.degrees_of_freedom:
        yield error(_STILL, "nothing can move; check kinds and axes of the closures")
    elif not mobility.sufficient:
        loose = mobility.degrees_of_freedom - mobility.held
        yield error(
            "actuation",
            f"insufficient: {mobility.degrees_of_freedom} degrees of freedom, "
            f"{len(robot.actuated)} motors; {loose} move with the motors locked, through "
            f"{', '.join(mobility.loose_joints)}",
        )
    elif mobility.redundantly_actuated:
        yield warning(
            "actuation",
            f"redundant: {len(robot.actuated)} motors for {mobility.degrees_of_freedom} degrees of "
            "freedom; the smallest torques are computed",
        )

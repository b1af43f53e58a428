# SPDX-License-Identifier: BSD-2-Clause
"""Checks of the whole robot: loops that can be closed, motors that hold it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from .. import reading
from ..chain.closed_chain import ClosedChain
from ..chain.closures import Constraint, frames_of
from ..chain.tree import frame_id
from ..errors import ActuationError, ClosureError, DescriptionError, SSTError, UnknownNameError
from ..reading import Urdf
from ..reading.problems import Problem, error, warning

#: How far the loops of a configuration written with four digits are open, [m] or [rad].
_WRITTEN = 1e-3
#: Place of the problem that nothing can move.
_STILL = "mobility"
#: An open tree is its model; None where there is no robot.
Robot: TypeAlias = ClosedChain | pin.Model | None


def check(urdf: Urdf, cuts: Path | None) -> tuple[list[Problem], Robot]:
    """Problems that only the robot as a whole has, and the robot; without loops an open tree."""
    where = "cuts"
    try:
        found = reading.read_cuts(urdf, cuts)
        where = "file"
        robot = reading.closed(urdf, found)
        if not found.source and not reading.is_marked(robot):
            return [], robot.model
    except DescriptionError as caught:
        return [error(where, text) for text in caught.problems], None
    if problems := list(_unknown(robot)):
        return problems, None
    try:
        reading.load_poses(urdf, robot.model, found.joints)
    except DescriptionError as caught:
        problems = [error("srdf", text) for text in caught.problems]
    moving, chain = _moving(robot)
    return problems + moving, chain


def check_mjcf(path: Path) -> tuple[list[Problem], Robot]:
    """Problems of an MJCF that MuJoCo does not report, and the robot."""
    from ..reading.mjcf import read_mjcf

    try:
        robot = read_mjcf(path)
    except DescriptionError as caught:
        told = [problem.removeprefix("not an MJCF: ") for problem in caught.problems]
        return [error("file", text) for text in told], None
    return _moving(robot) if robot.model.nv else ([error("tree", "no joints")], None)


def _moving(robot: reading.Described) -> tuple[list[Problem], Robot]:
    """Problems of the closed chain, and the chain."""
    if problems := list(_open(robot.model, robot.closures)):
        return problems, None
    try:
        chain = ClosedChain(**robot.arguments)
    except SSTError as caught:
        where = "actuation" if isinstance(caught, ActuationError) else "robot"
        return [error(where, str(caught))], None
    problems = list(_actuation(chain))
    if not any(problem.where == _STILL for problem in problems):
        problems += _home(chain)
    return problems, chain


def _unknown(robot: reading.Described) -> Iterator[Problem]:
    model = robot.model
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
    for line in robot.forces:
        for frame in (line.frame_a, line.frame_b):
            if not model.existFrame(frame):
                yield error(f"line {line}", f"no frame {frame} in the URDF")
    known = [*list(model.names)[1:], *map(str, robot.forces)]
    for motor in robot.actuated:
        if motor not in known:
            yield error(f"motor {motor}", "no moving joint of this name in the URDF")


def _open(model: pin.Model, closures: Sequence[Constraint]) -> Iterator[Problem]:
    """Closures that Newton's method cannot close from any of its starts."""
    alone = {closure: _gap(model, [closure]) for closure in closures}
    for closure, gap in alone.items():
        if gap:
            yield error(f"closure {closure}", f"cannot be closed: {gap:.3g} (m or rad) stays open")
    if not any(alone.values()) and (gap := _gap(model, closures)):
        text = f"each can be closed alone, but not all together: {gap:.3g} (m or rad) stays open"
        yield error("closures", text)


def _gap(model: pin.Model, closures: Sequence[Constraint]) -> float:
    """Smallest residual of the closures, 0 if the loops can be closed."""
    chain = ClosedChain(model, closures, ())
    try:
        chain.generic_configuration()
    except ClosureError as caught:
        try:
            chain.assemble(pin.neutral(model), fixed=())
        except ClosureError:
            return caught.residual
    return 0.0


def _home(chain: ClosedChain) -> Iterator[Problem]:
    if "home" not in chain.model.referenceConfigurations:
        return
    home = pin.normalize(chain.model, chain.model.referenceConfigurations["home"])
    gap = np.abs(chain.residual(home)).max(initial=0.0)
    try:
        chain.home  # noqa: B018
    except ClosureError:
        yield warning("home", f"cannot be closed: open by {gap:.3g} (m or rad); correct the pose")
    else:
        if gap > _WRITTEN:
            text = f"the loops are open by {gap:.3g} (m or rad); `chain.home` closes them"
            yield warning("home", text)


def _actuation(chain: ClosedChain) -> Iterator[Problem]:
    motors = len(chain.motor_names)
    try:
        mobility = chain.mobility()
    except ClosureError:
        yield warning("closures", "they can be closed at q = 0 only, so mobility is not computed")
        return
    except SSTError as caught:
        yield error("actuation" if isinstance(caught, ActuationError) else "robot", str(caught))
        return
    if not mobility.degrees_of_freedom:
        yield error(_STILL, "nothing can move; check kinds and axes of the closures")
    elif not mobility.sufficient:
        loose = mobility.degrees_of_freedom - mobility.held
        yield error(
            "actuation",
            f"insufficient: {mobility.degrees_of_freedom} degrees of freedom, "
            f"{motors} motors; {loose} move with the motors locked, through "
            f"{', '.join(mobility.loose_joints)}",
        )
    elif mobility.redundantly_actuated:
        yield warning(
            "actuation",
            f"redundant: {motors} motors for {mobility.degrees_of_freedom} degrees of "
            "freedom; the smallest torques are computed",
        )

# SPDX-License-Identifier: BSD-2-Clause
"""Checks of the whole robot: loops that can be closed, motors that hold it."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from .. import reading
from ..closed_chain import ClosedChain
from ..errors import ActuationError, ClosureError, DescriptionError, MissingExtraError, SSTError
from ..model.closures import Constraint, frames_of
from ..model.tree import frame_id
from . import Urdf
from .problems import Problem, error, warning

#: How far the loops of a configuration written with four digits are open, [m] or [rad].
_WRITTEN = 1e-3
#: An open tree is its model; None where there is no robot.
Robot: TypeAlias = ClosedChain | pin.Model | None


def check(urdf: Urdf, cuts: Path | None) -> tuple[list[Problem], Robot]:
    """Problems that only the robot as a whole has, and the robot; without loops an open tree."""
    where, problems = "cuts", list[Problem]()
    try:
        found = reading.read_cuts(urdf, cuts)
        where = "file"
        robot = reading.closed(urdf, found)
    except SSTError as caught:
        return errors_of(caught, where), None
    try:
        robot = reading.with_poses(robot, urdf)
    except SSTError as caught:
        problems = errors_of(caught, "srdf")
    problems += [warning("srdf", note) for note in robot.notes]
    if not found.source and not reading.is_marked(robot):
        return problems, robot.model
    more, chain = _moving(robot)
    return problems + more, chain


def check_mjcf(path: Path) -> tuple[list[Problem], Robot]:
    """Problems of an MJCF that MuJoCo does not report, and the robot."""
    from .mjcf import described

    try:
        robot = described(path)
    except MissingExtraError:
        raise
    except SSTError as caught:
        return errors_of(caught, "file"), None
    problems, chain = _moving(robot)
    return problems + [warning("file", note) for note in robot.notes], chain


def errors_of(caught: SSTError, where: str) -> list[Problem]:
    """An error as problems."""
    told = caught.problems if isinstance(caught, DescriptionError) else [str(caught)]
    return [error(where, re.sub("^not (a URDF|an MJCF): ", "", text)) for text in told]


def _moving(robot: reading.Described) -> tuple[list[Problem], Robot]:
    """Problems of the closed chain, and the chain."""
    try:
        problems = list(_unknown(robot)) or list(_open(robot.model, robot.closures))
        if problems:
            return problems, None
        chain = ClosedChain(**robot.arguments)
        return [*_actuation(chain), *_home(chain)], chain
    except SSTError as caught:
        where = "actuation" if isinstance(caught, ActuationError) else "robot"
        return errors_of(caught, where), None


def _unknown(robot: reading.Described) -> Iterator[Problem]:
    """Names of no frame and no joint."""
    model = robot.model
    if not model.nv:
        yield error("tree", "all joints are fixed")
    ends = {f"closure {closure}": frames_of(closure) for closure in robot.closures}
    ends |= {f"line {line}": (line.frame_a, line.frame_b) for line in robot.forces}
    for where, frame in ((where, frame) for where, frames in ends.items() for frame in frames):
        try:
            frame_id(model, frame)
        except DescriptionError as caught:
            yield from errors_of(caught, f"frame {frame}")
        except SSTError:
            yield error(where, f"no frame {frame} in the URDF")
    known = [*list(model.names)[1:], *map(str, robot.forces)]
    for motor in robot.actuated:
        if isinstance(motor, str) and motor not in known:
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
    model = chain.mechanism.model
    poses = model.referenceConfigurations
    if "home" not in poses or not chain.degrees_of_freedom:
        return
    gap = np.abs(chain.residual(pin.normalize(model, poses["home"]))).max(initial=0.0)
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
    freedoms = mobility.degrees_of_freedom
    if not freedoms:
        yield error("mobility", "nothing can move; check kinds and axes of the closures")
    elif not mobility.sufficient:
        text = f"insufficient: {freedoms} degrees of freedom, {motors} motors; "
        text += f"{freedoms - mobility.held} move with the motors locked, through "
        yield error("actuation", text + ", ".join(mobility.loose_joints))
    elif mobility.redundantly_actuated:
        text = f"redundant: {motors} motors for {freedoms} degrees of freedom"
        yield warning("actuation", f"{text}; the smallest torques are computed")

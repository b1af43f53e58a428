# SPDX-License-Identifier: BSD-2-Clause
"""Reads an MJCF as a Pinocchio model, closures and motors, through MuJoCo's compiler.

MuJoCo resolves defaults, angles, meshes and inertias; the numbers of its compiled model are read.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from ..arrays import in_order, names
from ..errors import DescriptionError, UnknownNameError
from ..files import as_path
from ..model.checks import Motor
from .mjcf_compiled import Compiled
from .mjcf_contacts import contacts_of
from .mjcf_limits import put_efforts
from .mjcf_loops import closures_of, lines_of, motors_of, named_motors
from .mjcf_tree import MjcfTree
from .mjcf_unread import contact_note, impossible, unread
from .problems import note, warning
from .robot_file import RobotFile, naming, warned
from .shapes import mjcf_shapes
from .urdf import MOST_JOINTS


def read_mjcf(
    path: str | Path,
    locked: Sequence[str] = (),
    actuated: Sequence[Motor] | None = None,
    contacts: bool = False,
) -> RobotFile:
    """Read a robot as `ClosedChain.from_mjcf`; warnings point to the caller of that method."""
    robot = robot_file_of(path, locked, actuated, contacts)
    warnings = (problem.text for problem in robot.notes if problem.severity == "warning")
    return warned(robot, warnings, robot.source)


def robot_file_of(
    path: str | Path,
    locked: Sequence[str] = (),
    actuated: Sequence[Motor] | None = None,
    contacts: bool = False,
) -> RobotFile:
    """Tree, closures and motors; `actuated` replaces the motors of the file.

    With `contacts`, those that can act in nonsmooth rollouts are read too.
    """
    compiled = Compiled(as_path(path), names("locked", locked))
    source = compiled.source
    problems = compiled.problems
    problems += [*impossible(compiled), *_switched_off(compiled, actuated)] or _names(compiled)
    if problems:
        raise DescriptionError(source, problems)
    tree = MjcfTree(compiled)
    closures = tuple(closures_of(compiled, tree))
    if actuated is None:
        motors = tuple(motors_of(compiled, tree))
    else:
        motors = named_motors(compiled, in_order("actuated", actuated))
    tree.add_body_frames()
    stiffness = tree.add_numbers()
    lines = tuple(lines_of(compiled, motors, put_efforts(compiled, tree)))
    touching = tuple(contacts_of(compiled, tree)) if contacts else ()
    problems += unread(compiled, tree)
    if (moving := tree.model.njoints - 1) > MOST_JOINTS:
        problems.append(f"{moving} moving joints; at most {MOST_JOINTS} are supported")
    if problems:
        raise DescriptionError(source, problems)
    tree.add_home(closures)
    shapes = partial(mjcf_shapes, compiled.mj, tree.bodies)
    parts = source, tree.model, closures, motors, shapes, stiffness, tree.rest
    notes = [warning("file", text) for text in dict.fromkeys(compiled.notes)]
    if not contacts and (text := contact_note(compiled, tree)):
        notes.append(note("file", text))
    return RobotFile(*parts, lines=lines, contacts=touching, notes=tuple(notes))


def _switched_off(compiled: Compiled, actuated: Sequence[Motor] | None) -> Iterator[str]:
    """Disabled flags that switch off the closures or the motors."""
    closes = compiled.mj.eq_active0.any()
    drives = compiled.mj.nu and actuated is None
    for flag, what in (("constraint", closes), ("equality", closes), ("actuation", drives)):
        if what and compiled.disabled(flag):
            motor = "motor then; name some by actuated="
            missing = motor if flag == "actuation" else "closure then"
            yield f'<flag {flag}="disable">: there is no {missing}'


def _names(compiled: Compiled) -> Iterator[str]:
    """Problems of ambiguous names; raises an error for an unknown one."""
    joints = range(compiled.mj.njnt)
    counts = Counter(map(compiled.joint, joints))
    known = counts + Counter(name for joint in joints for name in compiled.rates(joint))
    with naming(compiled.source):
        for name in compiled.locked.difference(known):
            raise UnknownNameError("joint", name, known)
    if twice := [name for name, count in counts.items() if count > 1]:
        yield f"a joint without a name gets its body's name: several joints {', '.join(twice)}"
    for name in sorted(compiled.locked):
        if known[name] > counts[name] > 0:
            yield f"locked: {name} is a joint and a rate of another one; rename the joint"
    if "universe" in counts:
        yield "joint universe: Pinocchio's base has this name; rename the joint"

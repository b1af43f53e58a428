# SPDX-License-Identifier: BSD-2-Clause
"""Reads an MJCF as a Pinocchio model, closures and motors, through MuJoCo's compiler.

MuJoCo resolves defaults, angles, meshes and inertias; the numbers of its compiled model are read.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from ..arrays import in_order, names, require_flags
from ..errors import DescriptionError, UnknownNameError
from ..files import as_path
from ..model.checks import Motor
from .mjcf_actuators import motors_of, named_motors
from .mjcf_closures import add_closures, tendon_couplings
from .mjcf_compiled import Compiled
from .mjcf_contacts import add_contacts, contact_note, ropes_of
from .mjcf_joint_numbers import put_joint_numbers, springs_of
from .mjcf_keyframes import put_home, put_keyframes
from .mjcf_limits import put_efforts
from .mjcf_lines import lines_of
from .mjcf_numbers import impossible_numbers
from .mjcf_tree import MjcfTree
from .mjcf_unread import joint_notes, unread_forces
from .problems import note, warning
from .robot_file import RobotFile, naming, warn_of
from .shapes import mjcf_shapes
from .urdf import MOST_JOINTS


def read_mjcf(
    path: str | Path,
    locked: Sequence[str] = (),
    actuated: Sequence[Motor] | None = None,
    contacts: bool = False,
) -> RobotFile:
    """Read an MJCF, for `ClosedChain.from_mjcf`, and issue its warnings."""
    robot = robot_file_of(path, locked, actuated, contacts)
    texts = [problem.text for problem in robot.notes if problem.severity == "warning"]
    warn_of(texts, robot.source)
    return robot


def robot_file_of(
    path: str | Path,
    locked: Sequence[str] = (),
    actuated: Sequence[Motor] | None = None,
    contacts: bool = False,
) -> RobotFile:
    """The robot of an MJCF; `actuated` replaces the motors of the file.

    With `contacts`, the contacts and ropes that nonsmooth rollouts can compute are read too.
    """
    require_flags(contacts=contacts)
    compiled = Compiled(as_path(path), names("locked", locked))
    # The readers below add to the problems and the notes of `compiled`.
    compiled.problems += impossible_numbers(compiled)
    compiled.problems += _disabled_parts(compiled, actuated)
    if not compiled.problems:
        compiled.problems += _name_problems(compiled)
    _raise_problems(compiled)

    # The tree, the closures and the motors.
    tree = MjcfTree(compiled)
    closures = (*tendon_couplings(compiled, tree), *add_closures(compiled, tree))
    if actuated is None:
        motors = tuple(motors_of(compiled, tree))
    else:
        motors = named_motors(compiled, in_order("actuated", actuated))
    # Frames at sites and at ends of closures keep their names; bodies get those that are left.
    tree.add_body_frames()

    # Numbers of joints, and configurations.
    put_joint_numbers(compiled, tree)
    springs = springs_of(compiled, tree)
    put_keyframes(compiled, tree)
    efforts_of_lines = put_efforts(compiled, tree)

    # Forces along lines, ropes and contacts.
    ropes = tuple(ropes_of(compiled)) if contacts else ()
    names_of_ropes = {rope.name for rope in ropes}
    lines = tuple(lines_of(compiled, motors, efforts_of_lines, names_of_ropes))
    points = tuple(add_contacts(compiled, tree)) if contacts else ()

    # What is not read.
    compiled.problems += unread_forces(compiled, tree)
    compiled.notes += joint_notes(compiled)
    moving = tree.model.njoints - 1
    if moving > MOST_JOINTS:
        text = f"{moving} moving joints; at most {MOST_JOINTS} are supported"
        compiled.problems.append(text)
    _raise_problems(compiled)

    notes = [warning("file", text) for text in dict.fromkeys(compiled.notes)]
    if not contacts:
        text = contact_note(compiled, tree)
        if text:
            notes.append(note("file", text))
    robot = RobotFile(
        source=compiled.source,
        model=tree.model,
        closures=closures,
        actuated=motors,
        shapes=partial(mjcf_shapes, compiled.mj, tree.bodies),
        stiffness=springs.stiffness,
        spring_reference=springs.reference,
        lines=lines,
        contacts=(*points, *ropes),
        weight_shares=tree.weight_shares(),
        notes=tuple(notes),
    )
    put_home(robot, tree.configuration(compiled.mj.qpos0))
    return robot


def _raise_problems(compiled: Compiled) -> None:
    """Raise an error that lists all problems, if there are any."""
    if compiled.problems:
        raise DescriptionError(compiled.source, compiled.problems)


def _disabled_parts(compiled: Compiled, actuated: Sequence[Motor] | None) -> Iterator[str]:
    """Problems of flags that switch off closures, or motors if `actuated` names none."""
    if compiled.mj.eq_active0.any():
        for flag in ("constraint", "equality"):
            if compiled.disabled(flag):
                yield f'<flag {flag}="disable">: there is no closure then'
    if compiled.mj.nu and actuated is None and compiled.disabled("actuation"):
        text = "there is no motor then; name some by actuated="
        yield f'<flag actuation="disable">: {text}'


def _name_problems(compiled: Compiled) -> Iterator[str]:
    """Problems of ambiguous names; raises an error for an unknown locked joint or rate."""
    joints = Counter[str]()
    rates = Counter[str]()
    for joint in range(compiled.mj.njnt):
        joints[compiled.joint_name(joint)] += 1
        rates.update(compiled.rate_names(joint))
    known = joints + rates
    with naming(compiled.source):
        for name in compiled.locked.difference(known):
            raise UnknownNameError("joint", name, known)
    repeated = [name for name, count in joints.items() if count > 1]
    if repeated:
        text = f"several joints {', '.join(repeated)}"
        yield f"a joint without a name gets its body's name: {text}"
    for name in sorted(compiled.locked):
        if name in joints and name in rates:
            yield f"locked: {name} is a joint and a rate of another one; rename the joint"
    if "universe" in joints:
        yield "joint universe: Pinocchio's base has this name; rename the joint"

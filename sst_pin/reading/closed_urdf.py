# SPDX-License-Identifier: BSD-2-Clause
"""Reads a URDF with its YAML and SRDF into a `RobotFile`."""

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from pathlib import Path

import pinocchio as pin

from ..arrays import names
from ..errors import DescriptionError
from ..model.checks import Motor, tendon_of, without_locked
from ..model.closures import Coupling, frames_of
from ..summaries import listed
from .acting_elements import motors_of
from .cut_joints import Marks
from .cuts import Cuts, parse_cuts
from .joint_numbers import LIMITS, put_numbers, springs_of, updated
from .problems import Problem, warning
from .robot_file import RobotFile, naming, warned
from .shapes import urdf_shapes
from .srdf import Srdf
from .text import read_text
from .urdf import Urdf, closing_frames, is_closing
from .urdf_checks import inertia_notes


def read_urdf(
    path: str | Path | Urdf,
    cuts: str | Path | None = None,
    locked: Sequence[str] = (),
    actuated: Sequence[Motor] | None = None,
    *,
    default: str | Path | None = None,
    model: str | None = None,
) -> RobotFile:
    """Read a robot as `ClosedChain.from_urdf`; warnings point to the caller of that method."""
    urdf = path if isinstance(path, Urdf) else Urdf.read(path, model)
    content = read_cuts(urdf, cuts, default)
    robot = closed(urdf, content._replace(locked=(*content.locked, *names("locked", locked))))
    notes = [*urdf.notices, *robot.notes]
    if actuated is not None:
        robot = robot._replace(actuated=actuated)
    elif robot.open_tree:
        notes.append(warning("closures", robot.open_tree))
    texts = (f"{problem.where}: {problem.text}" for problem in notes)
    return warned(robot, [*texts, *inertia_notes(urdf.root)], urdf.source)


def read_cuts(urdf: Urdf, path: str | Path | None, default: str | Path | None = None) -> Cuts:
    """Cuts of a URDF: from `path`, else the YAML beside it, else `default`.

    The YAML beside it has its name, or is a `loop_closures.yaml` of its package. Without a YAML,
    the cuts have only the motors that the URDF marks: as a URDF+, or by transmissions.
    """
    if path is None:
        path = cuts_beside(Path(urdf.source)) or default
    if path is None:
        return Cuts(urdf.marks.independent or motors_of(urdf.root))
    return parse_cuts(read_text(path, "YAML of the cuts"), str(path))


def cuts_beside(urdf: Path) -> Path | None:
    """The YAML with the cuts of a URDF, if there is one."""
    package = urdf.parent.parent if urdf.parent.name == "urdf" else urdf.parent
    folders = (urdf.parent, package, package / "config")
    paths = [urdf.with_suffix(".yaml"), *(folder / "loop_closures.yaml" for folder in folders)]
    return next((path for path in paths if path.is_file()), None)


def closed(urdf: Urdf, cuts: Cuts) -> RobotFile:
    """The tree of a URDF with closures from its cuts, or else from its marks, and its mimic joints.

    Without cuts and marks it is an open tree. An SRDF beside it names configurations.
    """
    model, marks, fixed = urdf.tree(dict(cuts.joints)), urdf.marks, cuts.fixed
    model.gravity.linear = urdf.gravity if cuts.gravity is None else cuts.gravity
    source = f"{urdf.source} with {cuts.source}" if cuts.source else urdf.source
    unknown = [name for name in cuts.dependent if name not in list(model.names)[1:]]
    if unknown:
        raise DescriptionError(source, [f"dependent: no moving joint {name}" for name in unknown])
    led = {*cuts.dependent, *(coupling.joint for coupling in cuts.couplings)}
    followers = [mimic for mimic in urdf.mimics if mimic.joint not in led]
    couplings = tuple(_unlocked([*followers, *marks.gears, *cuts.couplings], fixed, source))
    limited = {name for key in LIMITS for name in cuts.numbers.get(key, {})}
    notes = [*_unused(model, cuts, marks), *urdf.lost_limits(dict(cuts.joints), limited)]
    loops = cuts.closures
    path, srdf = Path(urdf.source).with_suffix(".srdf"), None
    with naming(source):
        if not loops:
            joints = cuts.hinges or marks.joints
            loops = (*closing_frames(model), *(joint.closure(model) for joint in joints))
        numbers = updated(urdf.numbers, cuts.numbers, fixed)
        put_numbers(model, numbers)
    if path.is_file():
        srdf = Srdf(path)
        texts = srdf.load_configurations(model, urdf.joint_names, cuts.locked)
        notes += [warning("srdf", text) for text in texts]
    with naming(source):
        fixed_joints = {j.get("name") for j in urdf.root.iterfind("joint[@type='fixed']")}
        locked = [name for name in dict.fromkeys(cuts.locked) if name not in fixed_joints]
        model = without_locked(model, locked) if locked else model
        stiffness, rest = springs_of(model, numbers)
    closures = (*loops, *couplings)
    motors, note = tuple(_free_motors(cuts.actuated, fixed)), ""
    if not (cuts.source or loops or marks.independent):
        note = f"no {path.stem}.yaml with closures and motors is beside it; "
        if cuts.actuated:
            note += "its transmissions name the motors"
        else:
            led = {coupling.joint for coupling in couplings}
            motors = tuple(_single_joints(model, led))
            note += "each joint of one axis"
            if led:
                note += " that mimics none"
            note += " has a motor; actuated= names the motors"
    if not any(inertia.mass for inertia in list(model.inertias)[1:]):
        notes.append(_without_mass(model))
    shapes = partial(urdf_shapes, urdf.root, path.parent)
    parts = source, model, closures, motors, shapes, stiffness, rest, srdf, cuts.lines
    return RobotFile(*parts, cuts.brakes, cuts.contacts, tuple(notes), note)


def _unused(model: pin.Model, cuts: Cuts, marks: Marks) -> Iterator[Problem]:
    """A warning of the closures of the URDF that those of the YAML replace."""
    names = [joint.name for joint in marks.joints]
    if cuts.closures:
        ends = {name for closure in cuts.closures for name in frames_of(closure)}
        names += [f.name for f in model.frames if is_closing(f) and f.name not in ends]
    if names and (cuts.closures or cuts.hinges):
        text = f"the URDF also has {listed(names)}, not read because {cuts.source} has closures"
        yield warning("closures", text)


def _single_joints(model: pin.Model, led: Collection[str]) -> Iterator[str]:
    """Joints of one axis that follow no other joint."""
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        if joint.nv == 1 and name not in led:
            yield name


def _without_mass(model: pin.Model) -> Problem:
    """A warning of a robot whose moving links have no mass."""
    links = [f.name for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint]
    text = "no moving link has mass, so torques miss weights and inertias; write <inertial>"
    return warning(f"links {listed(links)}", text)


def _free_motors(motors: Sequence[Motor], locked: Collection[str]) -> Iterator[Motor]:
    """Motors without the joints that are locked."""
    for motor in motors:
        name, shares = tendon_of(motor)
        if free := {joint: x for joint, x in shares.items() if joint not in locked}:
            yield motor if isinstance(motor, str) else {name: free}


def _unlocked(
    couplings: Sequence[Coupling], locked: Collection[str], source: str
) -> Iterator[Coupling]:
    """The couplings that remain when some joints are locked at zero."""
    for coupling in couplings:
        free = {n: c for n, c in coupling.polynomials.items() if n not in locked}
        offset = coupling.offset
        offset += sum(c[0] for n, c in coupling.polynomials.items() if n in locked)
        if coupling.joint not in locked:
            yield Coupling(coupling.joint, free, offset)
        elif free or offset:
            text = f"locked joint {coupling.joint} mimics {', '.join(free) or 'with an offset'}: "
            raise DescriptionError(source, [text + "lock both joints, at zero, or none"])

# SPDX-License-Identifier: BSD-2-Clause
"""A URDF with the files beside it, YAML and SRDF, as one value from which robots are made."""

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from pathlib import Path

import pinocchio as pin

from ..arrays import names
from ..errors import DescriptionError
from ..loops.draft import Motor, tendon_of, without_locked
from ..model.closures import Constraint, Coupling, frames_of
from ..summaries import listed
from .acting_words import unread
from .cut_joints import Marks
from .cuts import Cuts, parse_cuts
from .described import Described, naming, warned
from .problems import Problem, warning
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
) -> Described:
    """Read a robot; see `ClosedChain.from_urdf`, whose caller a warning points to."""
    urdf = path if isinstance(path, Urdf) else Urdf.read(path)
    content = read_cuts(urdf, cuts, default)
    locked = tuple(dict.fromkeys([*content.locked, *names("locked", locked)]))
    content = content._replace(locked=locked)
    robot = with_locked(with_poses(closed(urdf, content), urdf, locked), urdf, content)
    notes = [*robot.notes, *unread(urdf.root)]
    if actuated is not None:
        robot = robot._replace(actuated=actuated)
    elif robot.open_tree:
        notes.append(warning("closures", robot.open_tree))
    texts = (f"{problem.where}: {problem.text}" for problem in notes)
    return warned(robot, [*texts, *inertia_notes(urdf.root)], urdf.source)


def read_cuts(urdf: Urdf, path: str | Path | None, default: str | Path | None = None) -> Cuts:
    """Cuts of a URDF: from `path`, the YAML beside it, `default`, or none if the URDF has marks.

    The YAML beside it has its name, or is a `loop_closures.yaml` or `robot_data.yaml` of its
    package.
    """
    if path is None:
        path = cuts_beside(Path(urdf.source)) or default
    if path is None:
        return Cuts(urdf.marks.independent)
    return parse_cuts(read_text(path, "YAML of the cuts"), str(path))


def cuts_beside(urdf: Path) -> Path | None:
    """The YAML with the cuts of a URDF, if there is one."""
    package = urdf.parent.parent if urdf.parent.name == "urdf" else urdf.parent
    folders = (urdf.parent, package, package / "config")
    names = ("loop_closures.yaml", "robot_data.yaml")
    paths = [urdf.with_suffix(".yaml"), *(folder / name for folder in folders for name in names)]
    return next((path for path in paths if path.is_file()), None)


def with_poses(robot: Described, urdf: Urdf, locked: Collection[str] = ()) -> Described:
    """The robot with the named configurations of the SRDF beside its file."""
    model, path = robot.model, Path(urdf.source).with_suffix(".srdf")
    if not path.is_file():
        return robot
    srdf = Srdf(path)
    notes = srdf.load_configurations(model, urdf.joint_names, locked)
    more = (warning("srdf", text) for text in notes)
    return robot._replace(srdf=srdf, notes=(*robot.notes, *more))


def closed(urdf: Urdf, cuts: Cuts) -> Described:
    """The tree of a URDF, closed by its cuts, or else by its marks, and by its mimic joints.

    Without cuts and marks it is an open tree. No joint is locked yet, see `with_locked`.
    """
    model, marks = urdf.tree(cuts.joints), urdf.marks
    model.gravity.linear = urdf.gravity if cuts.gravity is None else cuts.gravity
    source = f"{urdf.source} with {cuts.source}" if cuts.source else urdf.source
    unknown = [name for name in cuts.dependent if name not in list(model.names)[1:]]
    if unknown:
        raise DescriptionError(source, [f"dependent: no moving joint {name}" for name in unknown])
    fixed, numbers = _fixed(cuts), urdf.numbers.updated(cuts.numbers)
    loops, notes = cuts.closures, tuple(_unused(model, cuts, marks))
    with naming(source):
        if not loops:
            joints = cuts.hinges or marks.joints
            loops = (*closing_frames(model), *(joint.closure(model) for joint in joints))
        numbers.put(model, fixed)
        springs = numbers.springs(model, fixed)
    led = {*cuts.dependent, *(coupling.joint for coupling in cuts.couplings)}
    followers = [mimic for mimic in urdf.mimics if mimic.joint not in led]
    couplings = tuple(_held([*followers, *marks.gears, *cuts.couplings], fixed, source))
    shapes = partial(urdf_shapes, urdf.root, Path(urdf.source).parent)
    found = source, model, (*loops, *couplings), cuts.actuated, shapes, *springs
    robot = Described(*found, forces=cuts.forces, notes=notes)
    if cuts.source or cuts.actuated or loops:
        return robot
    led = {closure.joint for closure in couplings if isinstance(closure, Coupling)}
    motors = tuple(name for name in list(model.names)[1:] if name not in led)
    text = f"no {Path(urdf.source).with_suffix('.yaml').name} with closures and motors is beside it"
    text += f"; each joint{' that mimics none' * bool(led)} has a motor; actuated= names the motors"
    return robot._replace(actuated=motors, open_tree=text)


def with_locked(robot: Described, urdf: Urdf, cuts: Cuts) -> Described:
    """The robot with the joints locked that the cuts name."""
    if not cuts.locked:
        return robot
    fixed = {joint.get("name") for joint in urdf.root.iterfind("joint[@type='fixed']")}
    with naming(robot.source):
        model = without_locked(robot.model, [n for n in cuts.locked if n not in fixed])
        numbers = urdf.numbers.updated(cuts.numbers)
        stiffness, reference = numbers.springs(model, _fixed(cuts))
    closures = tuple(_held(robot.closures, cuts.locked, robot.source))
    motors = tuple(_free_motors(robot.actuated, cuts.locked))
    return robot._replace(
        model=model,
        closures=closures,
        actuated=motors,
        stiffness=stiffness,
        spring_reference=reference,
    )


def _fixed(cuts: Cuts) -> set[str]:
    """Joints that do not move, by the type that the YAML gives them or because they are locked."""
    return {name for name, kind in cuts.joints.items() if kind == "FIXED"}.union(cuts.locked)


def _unused(model: pin.Model, cuts: Cuts, marks: Marks) -> Iterator[Problem]:
    """Closures of the URDF in whose place those of the YAML count."""
    if not (cuts.closures or cuts.hinges):
        return
    names = [joint.name for joint in marks.joints]
    ends = {name for closure in cuts.closures for name in frames_of(closure)}
    if not cuts.hinges:
        names += [
            frame.name for frame in model.frames if is_closing(frame) and frame.name not in ends
        ]
    if names:
        text = f"the URDF also has {listed(names)}, not read because {cuts.source} has closures"
        yield warning("closures", text)


def _free_motors(motors: Sequence[Motor], locked: Collection[str]) -> Iterator[Motor]:
    """Motors without the joints that are locked."""
    for motor in motors:
        name, shares = tendon_of(motor)
        if free := {joint: x for joint, x in shares.items() if joint not in locked}:
            yield motor if isinstance(motor, str) else {name: free}


def _held(
    closures: Sequence[Constraint], locked: Collection[str], source: str
) -> Iterator[Constraint]:
    """Closures with some joints held at zero."""
    for closure in closures:
        if not isinstance(closure, Coupling):
            yield closure
            continue
        free = {n: c for n, c in closure.polynomials.items() if n not in locked}
        offset = closure.offset
        offset += sum(c[0] for n, c in closure.polynomials.items() if n in locked)
        if closure.joint not in locked:
            yield Coupling(closure.joint, free, offset)
        elif free or offset:
            text = f"locked joint {closure.joint} mimics {', '.join(free) or 'with an offset'}: "
            raise DescriptionError(source, [text + "lock both joints, at zero, or none"])

# SPDX-License-Identifier: BSD-2-Clause
"""A URDF with the files beside it, YAML and SRDF, as one value from which robots are made."""

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from pathlib import Path

from ..arrays import names
from ..errors import DescriptionError
from ..loops.draft import Motor, without_locked
from ..model.closures import Constraint, Coupling
from .cuts import Cuts, parse_cuts
from .described import Described, naming, warned
from .shapes import urdf_shapes
from .srdf import Srdf
from .text import read_text
from .urdf import Urdf, closing_frames
from .urdf_checks import inertia_notes, left_out


def read_urdf(
    path: str | Path | Urdf,
    cuts: str | Path | None = None,
    locked: Sequence[str] = (),
    actuated: Sequence[Motor] | None = None,
    *,
    default: str | Path | None = None,
) -> Described:
    """Read a robot; see `ClosedChain.from_urdf`, whose caller a warning points to."""
    urdf, locked = path if isinstance(path, Urdf) else Urdf.read(path), names("locked", locked)
    found = read_cuts(urdf, cuts, default)
    robot = closed(urdf, found)
    if actuated is not None:
        robot = robot._replace(notes=())
    robot = with_poses(robot, urdf, locked)
    model, closures, motors = robot.model, robot.closures, robot.actuated
    if locked:
        with naming(robot.source):
            model = without_locked(model, locked)
        closures = tuple(_held(closures, locked, robot.source))
        motors = tuple(name for name in motors if name not in locked)
    motors = motors if actuated is None else actuated
    robot = robot._replace(model=model, closures=closures, actuated=motors)
    notes = (f"{problem.where}: {problem.text}" for problem in left_out(urdf.root))
    return warned(robot, [*robot.notes, *notes, *inertia_notes(urdf.root)], urdf.source)


def read_cuts(urdf: Urdf, path: str | Path | None, default: str | Path | None = None) -> Cuts:
    """Cuts of a URDF: from `path`, the YAML beside it, `default`, or none if the URDF has marks.

    The YAML beside it has its name, or is a `loop_closures.yaml` of its package.
    """
    if path is None:
        path = cuts_beside(Path(urdf.source)) or default
    if path is None:
        return Cuts((), urdf.marks.independent, urdf.gravity, {})
    return parse_cuts(read_text(path, "YAML of the cuts"), str(path))


def cuts_beside(urdf: Path) -> Path | None:
    """The YAML with the cuts of a URDF, if there is one."""
    package = urdf.parent.parent if urdf.parent.name == "urdf" else urdf.parent
    folders = (urdf.parent, package, package / "config")
    paths = [urdf.with_suffix(".yaml"), *(folder / "loop_closures.yaml" for folder in folders)]
    return next((path for path in paths if path.is_file()), None)


def with_poses(robot: Described, urdf: Urdf, locked: Collection[str] = ()) -> Described:
    """The robot with the named configurations of the SRDF beside its file."""
    model, path = robot.model, Path(urdf.source).with_suffix(".srdf")
    if not path.is_file():
        return robot
    srdf = Srdf(path)
    notes = srdf.load_configurations(model, urdf.joint_names, locked)
    return robot._replace(srdf=srdf, notes=(*robot.notes, *notes))


def closed(urdf: Urdf, cuts: Cuts) -> Described:
    """The tree of a URDF, closed by its cuts, or else by its marks, and by its mimic joints.

    Without cuts and marks it is an open tree, as a note says.
    """
    model, marks = urdf.tree(cuts.joints), urdf.marks
    model.gravity.linear = cuts.gravity
    source = f"{urdf.source} with {cuts.source}" if cuts.source else urdf.source
    unknown = [name for name in cuts.dependent if name not in list(model.names)[1:]]
    if unknown:
        raise DescriptionError(source, [f"dependent: no moving joint {name}" for name in unknown])
    closures = cuts.closures
    with naming(source):
        if not closures:
            joints = cuts.hinges or marks.joints
            closures = (*closing_frames(model), *(joint.closure(model) for joint in joints))
    followers = [mimic for mimic in urdf.mimics if mimic.joint not in cuts.dependent]
    fixed = [name for name, kind in cuts.joints.items() if kind == "FIXED"]
    closures = (*closures, *marks.gears, *_held(followers, fixed, source))
    shapes = partial(urdf_shapes, urdf.root, Path(urdf.source).parent)
    robot = Described(source, model, closures, cuts.actuated, shapes, forces=cuts.forces)
    if cuts.source or cuts.actuated or any(not isinstance(c, Coupling) for c in closures):
        return robot
    mimicking = {closure.joint for closure in closures if isinstance(closure, Coupling)}
    motors = tuple(name for name in list(model.names)[1:] if name not in mimicking)
    text = f"no {Path(urdf.source).with_suffix('.yaml').name} with closures and motors is beside it"
    text += f"; each joint{' that mimics none' if mimicking else ''} has a motor"
    return robot._replace(actuated=motors, notes=(f"{text}; actuated= names the motors",))


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

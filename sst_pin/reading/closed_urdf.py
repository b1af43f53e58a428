# SPDX-License-Identifier: BSD-2-Clause
"""Reads a URDF with its YAML and SRDF into a `RobotFile`.

The YAML has the cuts: closures where loops are cut in the tree of the URDF, motors, and more; see
`cuts`. The SRDF has configurations by name.
"""

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from pathlib import Path

import pinocchio as pin

from ..arrays import names
from ..errors import DescriptionError
from ..model.checks import Motor, tendon_of
from ..model.closures import Constraint, Coupling, frames_of
from ..model.locked_joints import without_locked
from ..model.weight_shares import checked_shares
from ..summaries import listed
from .closing_frames import closures_of_frames, is_closing
from .cuts import Cuts, parse_cuts
from .inertia_checks import inertia_notes
from .joint_kinds import lost_limits
from .joint_numbers import LIMITS, combined_numbers, put_numbers, springs_of
from .loop_elements import LoopElements
from .problems import Problem, warning
from .robot_file import RobotFile, naming, warn_of
from .shapes import urdf_shapes
from .srdf import Srdf
from .text import read_text
from .tool_elements import motors_of
from .urdf import Urdf


def read_urdf(
    path: str | Path | Urdf,
    cuts: str | Path | None = None,
    locked: Sequence[str] = (),
    actuated: Sequence[Motor] | None = None,
    *,
    default: str | Path | None = None,
    model: str | None = None,
) -> RobotFile:
    """Read the files of a robot, for `ClosedChain.from_urdf`, and issue their warnings.

    Args:
        path: The path of the URDF or SDF, or the file as a `Urdf`.
        cuts: The YAML of the cuts; by default the one beside the URDF.
        locked: Joints that are locked at zero, besides those that the YAML locks.
        actuated: The motors, in place of those of the files.
        default: The YAML to use if there is none beside the URDF.
        model: The model of an SDF, by name.
    """
    urdf = path if isinstance(path, Urdf) else Urdf.read(path, model)
    content = read_cuts(urdf, cuts, default)
    all_locked = (*content.locked, *names("locked", locked))
    robot = closed_robot(urdf, content._replace(locked=all_locked))
    notes = [*urdf.notices, *robot.notes]
    if actuated is not None:
        robot = robot._replace(actuated=actuated)
    elif robot.open_tree:
        notes.append(warning("closures", robot.open_tree))
    texts = (f"{problem.where}: {problem.text}" for problem in notes)
    warn_of([*texts, *inertia_notes(urdf.root)], urdf.source)
    return robot


def read_cuts(urdf: Urdf, path: str | Path | None, default: str | Path | None = None) -> Cuts:
    """Cuts of a URDF: from `path`, else from the YAML beside the URDF, else from `default`.

    The YAML beside a URDF has the name of the URDF, or is a `loop_closures.yaml` of its package.
    Without a YAML, the cuts have only the motors that the URDF marks: the joints that a URDF+ (the
    dialect of the library GRBDA) calls independent, or the joints of transmissions and controllers.
    """
    if path is None:
        path = cuts_beside(Path(urdf.source)) or default
    if path is None:
        return Cuts(actuated=urdf.loop_elements.independent or motors_of(urdf.root))
    return parse_cuts(read_text(path, "YAML of the cuts"), str(path))


def cuts_beside(urdf: Path) -> Path | None:
    """The YAML with the cuts of a URDF, if there is one."""
    paths = [urdf.with_suffix(".yaml")]
    package = urdf.parent.parent if urdf.parent.name == "urdf" else urdf.parent
    for folder in (urdf.parent, package, package / "config"):
        paths.append(folder / "loop_closures.yaml")
    for path in paths:
        if path.is_file():
            return path
    return None


def closed_robot(urdf: Urdf, cuts: Cuts) -> RobotFile:
    """The robot of a URDF and its cuts, with an SRDF beside the URDF.

    Mimic joints of the URDF become closures, too. An open tree is a robot whose files have neither
    a YAML nor closures; it may have mimic joints.

    Two sets of joints do not move. `cuts.locked` are locked at zero: their joints leave the tree
    here. `cuts.fixed_joints` are these and the joints of the kind "FIXED" in the YAML, which
    `urdf.tree` has already left out.
    """
    urdf_path = Path(urdf.source)
    source = f"{urdf.source} with {cuts.source}" if cuts.source else urdf.source
    notes = list[Problem]()

    # The tree, before joints are locked.
    model = urdf.tree(cuts.kinds)
    model.gravity.linear = urdf.gravity if cuts.gravity is None else cuts.gravity
    _require_dependent(model, cuts, source)

    # Closures.
    couplings = _couplings(urdf, cuts, source)
    notes += _warning_of_replaced_closures(model, cuts, urdf.loop_elements)
    with naming(source):
        loops = _add_loops(model, cuts, urdf.loop_elements)

    # Numbers of joints. Limits in the URDF are lost if the YAML gives their joint another kind.
    notes += lost_limits(urdf.root, cuts.kinds, _joints_with_limits(cuts))
    with naming(source):
        numbers = combined_numbers(urdf.numbers, cuts.numbers, cuts.fixed_joints)
        put_numbers(model, numbers)

    # Configurations by name. They have positions of all joints, so joints are locked afterwards.
    srdf = _srdf_beside(urdf_path)
    if srdf is not None:
        texts = srdf.load_configurations(model, urdf.joint_names, cuts.locked)
        notes += [warning("srdf", text) for text in texts]

    # Locked joints leave the tree; springs are those of the joints that remain.
    with naming(source):
        weight_shares = urdf.weight_shares(model) | checked_shares(cuts.weight_shares)
        locked = _locked_joints(urdf, cuts)
        if locked:
            model, weight_shares = without_locked(model, locked, weight_shares)
        stiffness, spring_reference = springs_of(model, numbers)

    # Motors. `cuts.actuated` are those that the files name; without a YAML, `read_cuts` takes them
    # from the URDF. In an open tree whose files name no motors, each joint of one axis has one. A
    # URDF+ names its independent joints, which are its motors, so it is no open tree.
    is_open_tree = not cuts.source and not loops and not urdf.loop_elements.independent
    files_name_motors = bool(cuts.actuated)
    followers = {coupling.joint for coupling in couplings}
    if is_open_tree and not files_name_motors:
        motors: tuple[Motor, ...] = tuple(_single_joints(model, followers))
    else:
        motors = tuple(_moving_motors(cuts.actuated, cuts.fixed_joints))
    warning_of_open_tree = ""
    if is_open_tree:
        warning_of_open_tree = _open_tree_warning(
            urdf_path.stem, files_name_motors, bool(followers)
        )

    if not any(inertia.mass for inertia in list(model.inertias)[1:]):
        notes.append(_mass_warning(model))
    return RobotFile(
        source=source,
        model=model,
        closures=(*loops, *couplings),
        actuated=motors,
        shapes=partial(urdf_shapes, urdf.root, urdf_path.parent),
        stiffness=stiffness,
        spring_reference=spring_reference,
        srdf=srdf,
        lines=cuts.lines,
        brakes=cuts.brakes,
        contacts=cuts.contacts,
        weight_shares=weight_shares,
        notes=tuple(notes),
        open_tree=warning_of_open_tree,
    )


def _srdf_beside(urdf: Path) -> Srdf | None:
    """The SRDF with the name of a URDF; None if there is none."""
    path = urdf.with_suffix(".srdf")
    return Srdf(path) if path.is_file() else None


def _require_dependent(model: pin.Model, cuts: Cuts, source: str) -> None:
    """Raise an error if a dependent joint of the cuts is not in the tree.

    Dependent joints are joints whose positions the closures determine. The YAML names them, so that
    `_couplings` ignores their `<mimic>`. It would ignore a wrong name without a word.
    """
    known = list(model.names)[1:]
    problems = [f"dependent: no moving joint {n}" for n in cuts.dependent if n not in known]
    if problems:
        raise DescriptionError(source, problems)


# --- closures -----------------------------------------------------------------------------------


def _warning_of_replaced_closures(
    model: pin.Model, cuts: Cuts, elements: LoopElements
) -> Iterator[Problem]:
    """A warning if the URDF marks closures and the YAML replaces them; see `_add_loops`.

    Closures of the YAML replace all of them, hinges of the YAML only the joints that close loops.
    """
    replaced = [joint.name for joint in elements.joints]
    if cuts.closures:
        used_frames = set[str]()
        for closure in cuts.closures:
            used_frames.update(frames_of(closure))
        for frame in model.frames:
            if is_closing(frame) and frame.name not in used_frames:
                replaced.append(frame.name)
    if replaced and (cuts.closures or cuts.hinges):
        text = f"the URDF also has {listed(replaced)}, not read because {cuts.source} has closures"
        yield warning("closures", text)


def _add_loops(model: pin.Model, cuts: Cuts, elements: LoopElements) -> tuple[Constraint, ...]:
    """The closures of the YAML, else those that the URDF marks.

    A URDF marks closures by pairs of frames `closing_NAME_1` and `closing_NAME_2`, see
    `closing_frames`, and by joints that close loops, see `loop_elements`. The frames of such joints
    are added to the model.

    The two kinds of YAML have either closures or hinges: `closures` of the LAAS schema, or `hinges`
    of a `loop_closures.yaml`.
    """
    if cuts.closures:
        return cuts.closures
    joints = cuts.hinges or elements.joints  # the YAML replaces what the URDF marks
    return (*closures_of_frames(model), *(joint.add_closure(model) for joint in joints))


def _couplings(urdf: Urdf, cuts: Cuts, source: str) -> tuple[Coupling, ...]:
    """The mimic joints and gears of a URDF and the couplings of its cuts, without fixed joints.

    A `<mimic>` is ignored if a closure or a coupling of the cuts determines the joint's position.
    """
    determined = {*cuts.dependent, *(coupling.joint for coupling in cuts.couplings)}
    mimics = [mimic for mimic in urdf.mimics if mimic.joint not in determined]
    couplings = [*mimics, *urdf.loop_elements.gears, *cuts.couplings]
    return tuple(_couplings_that_move(couplings, cuts.fixed_joints, source))


def _couplings_that_move(
    couplings: Sequence[Coupling], fixed_joints: Collection[str], source: str
) -> Iterator[Coupling]:
    """The couplings that remain when some joints are fixed at zero.

    At zero, the polynomial c_0 + c_1 x + ... of a fixed joint is the constant c_0.
    """
    for coupling in couplings:
        moving = {}
        constant = 0.0  # the sum of the c_0 of fixed joints
        for name, coefficients in coupling.polynomials.items():
            if name in fixed_joints:
                constant += coefficients[0]
            else:
                moving[name] = coefficients
        offset = coupling.offset + constant
        if coupling.joint not in fixed_joints:
            yield Coupling(coupling.joint, moving, offset)
        elif moving or offset:
            leaders = ", ".join(moving) or "with an offset"
            text = f"locked joint {coupling.joint} mimics {leaders}: "
            raise DescriptionError(source, [text + "lock both joints, at zero, or none"])


# --- joints -------------------------------------------------------------------------------------


def _joints_with_limits(cuts: Cuts) -> set[str]:
    """Joints to which the cuts give a limit."""
    joints = set[str]()
    for key in LIMITS:
        joints.update(cuts.numbers.get(key, {}))
    return joints


def _locked_joints(urdf: Urdf, cuts: Cuts) -> list[str]:
    """The names of the cuts' locked joints, each once, without joints that the URDF fixes."""
    # Pinocchio's tree has no joint for a fixed joint, so that such a name would be unknown.
    fixed_in_urdf = {joint.get("name") for joint in urdf.root.iterfind("joint[@type='fixed']")}
    return [name for name in dict.fromkeys(cuts.locked) if name not in fixed_in_urdf]


def _moving_motors(motors: Sequence[Motor], fixed_joints: Collection[str]) -> Iterator[Motor]:
    """Motors without the joints that are fixed; a motor whose joints are all fixed is left out.

    A motor is a name of a joint or line, or a tendon with shares of them by name.
    """
    for motor in motors:
        # A name has itself with the share 1. The name of a tendon without one of its own is "".
        tendon, shares = tendon_of(motor)
        moving = {joint: share for joint, share in shares.items() if joint not in fixed_joints}
        if not moving:
            continue
        if isinstance(motor, str):
            yield motor
        else:
            yield {tendon: moving}


def _single_joints(model: pin.Model, followers: Collection[str]) -> Iterator[str]:
    """Joints of one axis that follow no other joint."""
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        if joint.nv == 1 and name not in followers:
            yield name


def _open_tree_warning(name: str, has_motors: bool, has_followers: bool) -> str:
    """The warning of a robot without loops: which motors it has.

    `name` is the name of the file that could have closures, without its ending.
    """
    text = f"no {name}.yaml with closures and motors is beside it; "
    if has_motors:
        return text + "its transmissions or controllers name the motors"
    text += "each joint of one axis"
    if has_followers:
        text += " that mimics none"
    return text + " has a motor; actuated= names the motors"


def _mass_warning(model: pin.Model) -> Problem:
    """A warning of a robot whose moving links have no mass."""
    links = [f.name for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint]
    text = "no moving link has mass, so torques miss weights and inertias; write <inertial>"
    return warning(f"links {listed(links)}", text)

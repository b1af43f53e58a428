# SPDX-License-Identifier: BSD-2-Clause
"""Checks the arguments of `ClosedChain` and makes a `Mechanism` of them."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, finite_array, in_order, single_array
from ..arrays import names as names_of
from ..errors import DescriptionError, InputError
from .closures import Brake, Closure, Constraint, Coupling, Distance, Rolling
from .contacts import Contact, Contacts, Rope, contacts_of
from .joint_series import PartlyLocked, Series
from .joint_space import JointSpace
from .lines import LineForce, Lines
from .mechanism import Friction, Mechanism, Springs, read_only
from .rebuilt_tree import POSITION_ARRAYS, RATE_ARRAYS, rebuilt
from .tree import frame_id, joint_id

#: Mimic joints that Pinocchio computes correctly. It omits the pitch of helical ones.
_MIMIC = re.compile(
    r"Mimicking joint type: JointModel([RP][XYZ]|(Revolute|Prismatic)Unaligned)$", re.M
)

#: Products of three larger numbers, as in inertias times accelerations, may overflow.
_TOO_LARGE = 1e100

#: Largest error of R^T R for a rotation R. Quaternions that are not normalised have larger ones.
_NO_ROTATION = 1e-6

#: A motor: the name of a joint or line, or a tendon. A tendon maps names of joints or lines to
#: factors, or its own name to such a mapping: {"split": {"left": 1, "right": 1}}.
Motor = str | Mapping[str, float] | Mapping[str, Mapping[str, float]]


def closures_of(closures: Sequence[Constraint | tuple[str, str]]) -> tuple[Constraint, ...]:
    """The closures as objects; a pair of frame names becomes a `Closure` of kind "6d"."""
    result: list[Constraint] = []
    for closure in in_order("closures", closures, "closures"):
        if isinstance(closure, (Closure, Distance, Coupling, Rolling, Brake)):
            result.append(closure)
        elif isinstance(closure, (tuple, list)) and len(closure) == 2:
            result.append(Closure(*closure))
        else:
            raise InputError("closures", _no_closure(closure))
    return tuple(result)


def _no_closure(value: object) -> str:
    """Why a value is not a closure, and what to write instead."""
    if not isinstance(value, pin.RigidConstraintModel):
        return f"{value!r} is neither a closure nor two frame names"
    kind = "6d" if value.type == pin.ContactType.CONTACT_6D else "3d"
    frame = 'pin.Frame("a", c.joint1_id, c.joint1_placement, pin.FrameType.OP_FRAME)'
    text = f"a RigidConstraintModel c does not name frames; write model.addFrame({frame})"
    return f'{text}, "b" for joint2 alike, and Closure("a", "b", "{kind}")'


def recipe_of(
    closures: Sequence[Constraint | tuple[str, str]],
    actuated: Sequence[Motor],
    coordinates: Sequence[str] | None,
    lines: Sequence[LineForce],
    brakes: Sequence[str] = (),
    contacts: Sequence[Contact | Rope] = (),
    **numbers: ArrayLike | None,
) -> partial[Mechanism]:
    """A function that makes a mechanism of a tree, with the checked arguments of `ClosedChain`.

    `numbers` are viscous_friction, coulomb_friction, stiffness and spring_reference.
    """
    return partial(
        mechanism_of,
        closures=closures_of(closures),
        motors=motors_of(actuated),
        coordinates=None if coordinates is None else coordinates_of(coordinates),
        numbers={
            name: None if value is None else read_only(finite_array(name, value, ()))
            for name, value in numbers.items()
        },
        lines=lines_of(lines),
        brakes=names_of("brakes", brakes),
        contacts=contacts_of(contacts),
    )


def mechanism_of(
    model: pin.Model,
    closures: tuple[Constraint, ...],
    motors: Sequence[Motor],
    coordinates: Sequence[str] | None,
    numbers: Mapping[str, ArrayLike | None],
    lines: tuple[LineForce, ...],
    brakes: tuple[str, ...] = (),
    contacts: Contacts | None = None,
) -> Mechanism:
    """A mechanism from the arguments of `ClosedChain`; the tree is not copied.

    If `coordinates` is None, `loops.coordinates.settled` chooses them later.
    `numbers` has viscous_friction, coulomb_friction, stiffness and spring_reference.
    """
    _require_sound(model, closures)
    space = JointSpace(model)
    closures = (*closures, *_brakes(space, brakes, lines, coordinates or ()))
    B, names = _motors(space, motors, lines)
    for name in (end for line in lines for end in (line.frame_a, line.frame_b)):
        frame_id(model, name)
    on_lines = Lines(lines, read_only(B[model.nv :]))

    def of_rates(name: str, default: Array) -> Array:
        value = numbers[name]
        return single_array(name, default if value is None else value, (model.nv,))

    friction = Friction(
        of_rates("viscous_friction", model.damping),
        of_rates("coulomb_friction", model.friction),
    )
    rest = pin.neutral(model)
    if numbers["spring_reference"] is not None:
        rest = single_array("spring_reference", numbers["spring_reference"], (model.nq,))
        space.require_on_manifold(rest, "spring_reference")
    springs = Springs(of_rates("stiffness", np.zeros(model.nv)), space.normalised(rest))
    springs.check(model)
    contacts = contacts or Contacts()
    contacts.check(model)
    rates = space.rates_of(coordinates or ())
    if coordinates is not None and not len(rates):
        raise InputError("coordinates", "the list is empty; omit it to have coordinates chosen")
    parts = closures, rates, B[: model.nv], names, friction, springs, on_lines, contacts
    return Mechanism(model, *parts)


def _brakes(
    space: JointSpace,
    names: Sequence[str],
    lines: Sequence[LineForce],
    coordinates: Sequence[str],
) -> Iterator[Brake]:
    """A brake for each line, and for each rate of each joint, of these names."""
    by_name = {line.name: line for line in lines}
    wanted = set(space.rates_of(coordinates).tolist())
    seen = set[str]()
    for name in names:
        if name in by_name:
            brakes = [Brake(name, (by_name[name].frame_a, by_name[name].frame_b))]
        else:
            rates = space.rates_of([name])
            if wanted & set(rates.tolist()):
                raise InputError("brakes", f"{name} is a coordinate, which must be free to move")
            brakes = [Brake(space.rate_names[k]) for k in rates]
        for brake in brakes:
            if brake.name in seen:
                raise InputError("brakes", f"{brake.name} appears twice")
            seen.add(brake.name)
            yield brake


def without_locked(model: pin.Model, locked: Sequence[str] | Mapping[str, float]) -> pin.Model:
    """The tree with some joints, or single rates of joints, fixed."""
    model = copied(model)
    if list(model.mimicking_joints):
        raise InputError("locked", "the model has mimic joints; lock joints before you add these")
    problems = [
        f"pose {pose.key()}: {len(pose.data())} numbers, {model.nq} are needed"
        for pose in model.referenceConfigurations
        if len(pose.data()) != model.nq
    ]
    if problems:
        raise DescriptionError(f"model {model.name}", problems)
    space = JointSpace(model)
    q = pin.neutral(model)
    owners = {k: name for name, rates in space.rates.items() for k in rates}
    rates = dict[str, dict[int, float]]()
    series = dict[int, Series]()
    for name in names_of("locked", list(locked) if isinstance(locked, Mapping) else locked):
        indices = space.rates_of([name]).tolist()
        value = 0.0
        owner = owners[indices[0]]
        joint = model.joints[joint_id(model, owners[indices[0]])]
        if isinstance(locked, Mapping):
            value = float(single_array("locked", locked[name], ()))
            if len(indices) > 1 or (joint.nq, joint.nv) == (2, 1):
                cure = (
                    f"; name {', '.join(space.names_by_joint['rate'][name])}"
                    if joint.nv > 1
                    else ""
                )
                raise InputError("locked", f"joint {name} has several coordinates{cure}")
        rates.setdefault(owner, {}).update({k - joint.idx_v: value for k in indices})
        if joint.nq == 1:
            q[joint.idx_q] = value
    for name, fixed in rates.items():
        joint = model.joints[i := joint_id(model, name)]
        whole = joint.nv == 1 or name in locked
        here = q[joint.idx_q : joint.idx_q + joint.nq]
        series[i] = Series.fixed(joint, here) if whole else PartlyLocked(joint, fixed)
    return rebuilt(model, series)


def coordinates_of(coordinates: Sequence[str]) -> tuple[str, ...]:
    """Names of coordinates, in their order."""
    return names_of("coordinates", in_order("coordinates", coordinates))


def motors_of(motors: Sequence[Motor]) -> tuple[Motor, ...]:
    """The motors; tendons are copied, so that later changes of the caller do not count."""

    def copy_of(motor: Motor) -> Motor:
        if not isinstance(motor, Mapping):
            return motor
        name, shares = tendon_of(motor)
        return {name: dict(shares)} if name else dict(shares)

    return tuple(map(copy_of, in_order("actuated", motors)))


def tendon_of(motor: Motor) -> tuple[str, Mapping[str, float]]:
    """The name of a motor, empty for a tendon without one, and the factors of what it drives."""
    if not isinstance(motor, Mapping):
        return motor, {motor: 1.0} if isinstance(motor, str) else {}  # which is refused later
    for name, shares in motor.items():
        if isinstance(shares, Mapping) and len(motor) == 1:
            return name, shares
    return "", motor  # type: ignore[return-value]  # `_motors` checks its numbers


def lines_of(lines: Sequence[LineForce]) -> tuple[LineForce, ...]:
    """The `LineForce` objects as a tuple; raises an error if two have the same name."""
    forces = in_order("lines", lines, "LineForce")
    for force in forces:
        if not isinstance(force, LineForce):
            raise InputError("lines", f"{force!r} is not a LineForce")
    twice = [name for name, k in Counter(map(str, forces)).items() if k > 1]
    if twice:
        raise InputError("lines", f"several lines have the name {', '.join(twice)}; give name=")
    return forces


def _motors(
    space: JointSpace, motors: Sequence[Motor], forces: Sequence[LineForce]
) -> tuple[Array, tuple[str, ...]]:
    """B with a row for each rate, then for each line, and the motors' names."""
    lines = {line.name: row for row, line in enumerate(forces, len(space.rate_names))}
    if both := lines.keys() & {*space.joint_names, *space.rate_names}:
        raise InputError("lines", f"line {min(both)} has the name of a joint; give another name=")
    size = len(space.rate_names) + len(lines)

    def rows(names: list[str]) -> Indices:
        parts = [[lines[name]] if name in lines else space.rates_of([name]) for name in names]
        if len(set(rows := [int(k) for indices in parts for k in indices])) != len(rows):
            raise InputError("names", f"a joint appears twice in {names}")
        return np.array(rows, dtype=np.intp)

    columns: list[Array] = []
    names: list[str] = []
    for motor in motors:
        if isinstance(motor, Mapping):
            name, shares = tendon_of(motor)
            column = np.zeros(size)
            k = rows(list(shares))
            column[k] = finite_array("actuated", list(shares.values()), (len(k),))
            if not column.any():
                raise InputError("actuated", f"{dict(motor)}: this motor acts on no joint")
            columns.append(column)
            sum_ = " + ".join(f"{share:g} {joint}" for joint, share in shares.items())
            names.append(name or sum_.replace("+ -", "- "))
        else:
            (name,) = names_of("actuated", [motor])
            k = rows([name])
            columns.extend(np.eye(size)[k])
            names.extend([name] if name in lines else [space.rate_names[i] for i in k])
    if len(set(names)) != len(names):
        raise InputError("actuated", f"a joint appears twice in {names}")
    return np.array(columns).reshape(-1, size).T, tuple(names)


def _require_sound(model: pin.Model, closures: Sequence[Constraint]) -> None:
    names = list(model.names)[1:]
    problems = [f"joint {n}: the name appears twice" for n, k in Counter(names).items() if k > 1]
    problems += [f"joint {i}: it has no name" for i, name in enumerate(names, 1) if not name]
    if "universe" in names:
        problems.append("joint universe: the world has this name; rename the joint")
    problems += [
        f"joint {name}: a closure has this name too; rename the joint"
        for name in sorted({*names} & {*map(str, closures)})
    ]
    if model.nv and not problems:
        problems = _names_with_two_meanings(model)
    problems += _impossible_numbers(model)
    if model != pin.Model(model):
        problems.append("contains NaN")
    if model.gravity.angular.any():
        problems.append(f"gravity.angular is {model.gravity.angular}; it must be zero")
    if not model.nv:
        problems.append("no moving joints")
    problems += [
        f"mimic joint {names[j - 1]}: Pinocchio supports only revolute and prismatic mimic joints "
        "with limits and a factor other than 0; use an ordinary joint with a Coupling to the "
        "joint that it follows"
        for j in model.mimicking_joints
        if not (_MIMIC.search(str(model.joints[j].extract())) and model.joints[j].extract().scaling)
    ]
    problems += [
        f"joint {name}: joints of type ellipsoid are not supported"
        for name, joint in zip(names, list(model.joints)[1:], strict=True)
        if joint.shortname() == "JointModelEllipsoid"
    ]
    if problems:
        raise DescriptionError(f"model {model.name}", problems)


def copied(model: pin.Model) -> pin.Model:
    """A copy of a model, whose arrays and parents are checked before.

    Pinocchio reads past the end of short arrays, and ends the process for wrong parents.
    """
    problems = []
    for names, size in ((RATE_ARRAYS, model.nv), (POSITION_ARRAYS, model.nq)):
        for name in names:
            length = len(getattr(model, name))
            if length != size:
                problems.append(f"{name}: {length} numbers, {size} are needed")
    problems += [
        f"joint {i}: its parent {parent} does not come before it"
        for i, parent in enumerate(list(model.parents)[1:], 1)
        if parent >= i
    ]
    problems += [
        f"frame {frame.name}: its parent joint {frame.parentJoint} does not exist"
        for frame in model.frames
        if frame.parentJoint >= model.njoints
    ]
    if problems:
        raise DescriptionError(f"model {model.name}", problems)
    return pin.Model(model)


def _impossible_numbers(model: pin.Model) -> list[str]:
    """Numbers that are not finite, and placements whose matrix is not a rotation.

    Estimated masses and rotor inertias may be negative.
    """
    names = [f"joint {name}" for name in list(model.names)[1:]]
    places = list(zip(names, list(model.jointPlacements)[1:], strict=True))
    places += [(f"frame {frame.name}", frame.placement) for frame in model.frames]
    bodies = zip(names, list(model.inertias)[1:], strict=True)
    numbers = [("gravity", model.gravity.vector), ("armature", model.armature)]
    numbers += [(f"body of {name}", body.toDynamicParameters()) for name, body in bodies]
    numbers += [(f"placement of {name}", place.homogeneous) for name, place in places]
    problems = [f"{name}: not finite" for name, array in numbers if not np.isfinite(array).all()]
    problems += [
        f"{name}: {np.abs(array).max():.3g} is too large to be computed with"
        for name, array in numbers
        if _TOO_LARGE < np.abs(array).max(initial=0.0) < np.inf
    ]
    with np.errstate(over="ignore", invalid="ignore"):
        problems += [
            f"placement of {name}: {R.tolist()} is no rotation"
            for name, R in [(name, place.rotation) for name, place in places]
            if np.abs(R.T @ R - np.eye(3)).max() > _NO_ROTATION or np.linalg.det(R) < 0
        ]
    return problems


def _names_with_two_meanings(model: pin.Model) -> list[str]:
    """Error messages for names that two joints share, as joint, position or rate."""
    problems = []
    for kind, of_joints in JointSpace(model).names_by_joint.items():
        owner: dict[str, str] = {}
        for joint, names in of_joints.items():
            for name in {joint, *names}:
                if owner.setdefault(name, joint) != joint:
                    problems.append(
                        f"joints {owner[name]} and {joint}: {name} names a {kind} of both; "
                        "rename one of them"
                    )
    return list(dict.fromkeys(problems))

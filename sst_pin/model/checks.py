# SPDX-License-Identifier: BSD-2-Clause
"""Checks the arguments of `ClosedChain` and makes a `Mechanism` of them.

`recipe_of` checks the arguments, and `mechanism_of` makes a mechanism of them and a tree. They are
followed by functions for each argument, and at the end by the checks of the tree.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, in_order, read_only, single_array
from ..arrays import names as names_of
from ..errors import DescriptionError, InputError
from .closures import Brake, Closure, Constraint, Coupling, Distance, Rolling
from .contacts import Contact, Contacts, Rope, contacts_of
from .joint_space import JointSpace
from .lines import LineForce, Lines
from .mechanism import Friction, Mechanism, Springs
from .rebuilt_tree import POSITION_ARRAYS, RATE_ARRAYS
from .tree import frame_id
from .weight_shares import weight_shares_of

#: Matches mimic joints that Pinocchio computes correctly: revolute and prismatic ones with limits.
#: Only the printed form of a mimic joint shows its kind. Pinocchio omits the pitch of helical ones.
#: Continuous ones, such as "RUBX", have no limits.
_MIMIC = re.compile(
    r"Mimicking joint type: JointModel([RP][XYZ]|(Revolute|Prismatic)Unaligned)$", re.M
)

#: Larger numbers are refused: the product of three, as in mass times length squared, may overflow.
_TOO_LARGE = 1e100

#: Largest error of R^T R for a rotation R. Quaternions that are not normalised have larger ones.
_NO_ROTATION = 1e-6

#: A motor: the name of a joint or line, or a tendon, which acts on several of them. A tendon maps
#: their names to factors, {"left": 1, "right": 1}. A tendon with a name of its own maps this name
#: to such a mapping, {"split": {"left": 1, "right": 1}}.
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
    weight_shares: Mapping[str, Array] = MappingProxyType({}),
    **numbers: ArrayLike | None,
) -> partial[Mechanism]:
    """A function that makes a mechanism of a tree, with the checked arguments of `ClosedChain`.

    A chain makes mechanisms of several trees: after `refresh`, or with other parameters. So the
    arguments are checked and copied once, here.

    `numbers` are viscous_friction, coulomb_friction, stiffness and spring_reference.
    `weight_shares` is a result of `checked_shares` or `without_locked`.
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
        weight_shares=weight_shares,
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
    weight_shares: Mapping[str, Array] = MappingProxyType({}),
) -> Mechanism:
    """A mechanism from the arguments of `ClosedChain`; the tree is not copied.

    If `coordinates` is None, `loops.coordinates.with_chosen_coordinates` chooses them later.
    `numbers` has viscous_friction, coulomb_friction, stiffness and spring_reference.
    """
    _require_sound(model, closures)
    space = JointSpace(model)
    closures = (*closures, *_brakes(space, brakes, lines, coordinates or ()))
    B, motor_names = _actuation(space, motors, lines)
    B_rates, B_lines = np.split(B, [model.nv])
    for line in lines:
        frame_id(model, line.frame_a)  # raises an error for an unknown frame
        frame_id(model, line.frame_b)
    contacts = contacts or Contacts()
    contacts.check(model)
    if coordinates is not None and not coordinates:
        raise InputError("coordinates", "the list is empty; omit it to have coordinates chosen")
    return Mechanism(
        model,
        closures,
        coordinates=space.rates_of(coordinates or ()),
        actuation=B_rates,
        motor_names=motor_names,
        friction=_friction(model, numbers),
        springs=_springs(model, space, numbers),
        lines=Lines(lines, B_lines),
        contacts=contacts,
        weight_shares=weight_shares_of(model, weight_shares),
    )


def _friction(model: pin.Model, numbers: Mapping[str, ArrayLike | None]) -> Friction:
    """The friction of the joints: the arguments, else what the model says."""
    return Friction(
        _of_rates(model, numbers, "viscous_friction", model.damping),
        _of_rates(model, numbers, "coulomb_friction", model.friction),
    )


def _springs(
    model: pin.Model, space: JointSpace, numbers: Mapping[str, ArrayLike | None]
) -> Springs:
    """The springs of the joints; without a reference they are relaxed at the neutral pose."""
    reference = pin.neutral(model)
    if numbers["spring_reference"] is not None:
        reference = single_array("spring_reference", numbers["spring_reference"], (model.nq,))
        space.require_on_manifold(reference, "spring_reference")
    stiffness = _of_rates(model, numbers, "stiffness", np.zeros(model.nv))
    springs = Springs(stiffness, space.normalised(reference))
    springs.check(model)
    return springs


def _of_rates(
    model: pin.Model, numbers: Mapping[str, ArrayLike | None], name: str, default: Array
) -> Array:
    """The argument `name`, or its default: a number for each rate, shape (nv,)."""
    value = numbers[name]
    return single_array(name, default if value is None else value, (model.nv,))


def _brakes(
    space: JointSpace,
    names: Sequence[str],
    lines: Sequence[LineForce],
    coordinates: Sequence[str],
) -> list[Brake]:
    """The brakes with these names: one for a line, and one for each rate of a joint."""
    result: list[Brake] = []
    lines_by_name = {line.name: line for line in lines}
    rates_of_coordinates = set(space.rates_of(coordinates).tolist())
    seen = set[str]()
    for name in names:
        if name in lines_by_name:
            line = lines_by_name[name]
            brakes = [Brake(name, (line.frame_a, line.frame_b))]
        else:
            rates = space.rates_of([name]).tolist()
            if not rates_of_coordinates.isdisjoint(rates):
                raise InputError("brakes", f"{name} is a coordinate, which must be free to move")
            brakes = [Brake(space.rate_names[k]) for k in rates]
        for brake in brakes:
            if brake.name in seen:
                raise InputError("brakes", f"{brake.name} appears twice")
            seen.add(brake.name)
            result.append(brake)
    return result


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
    """The name of a motor, and the factors of the joints and lines that it acts on, by their names.

    The name is empty for a tendon without a name of its own.
    """
    if not isinstance(motor, Mapping):
        # Anything but a name is refused by `_actuation`.
        factors = {motor: 1.0} if isinstance(motor, str) else {}
        return motor, factors
    if len(motor) == 1:
        ((name, shares),) = motor.items()
        if isinstance(shares, Mapping):
            return name, shares
    return "", motor  # type: ignore[return-value]  # `_actuation` checks its numbers


def lines_of(lines: Sequence[LineForce]) -> tuple[LineForce, ...]:
    """The `LineForce` objects as a tuple; raises an error if two have the same name."""
    result = in_order("lines", lines, "LineForce")
    for line in result:
        if not isinstance(line, LineForce):
            raise InputError("lines", f"{line!r} is not a LineForce")
    twice = [name for name, count in Counter(map(str, result)).items() if count > 1]
    if twice:
        raise InputError("lines", f"several lines have the name {', '.join(twice)}; give name=")
    return result


def _actuation(
    space: JointSpace, motors: Sequence[Motor], lines: Sequence[LineForce]
) -> tuple[Array, tuple[str, ...]]:
    """B, shape (nv + lines, motors), and the motors' names.

    Motors with the torques tau act with the forces B tau: first on each rate, then on each line.
    """
    rates = len(space.rate_names)
    row_of_line = {line.name: row for row, line in enumerate(lines, rates)}
    in_both = row_of_line.keys() & {*space.joint_names, *space.rate_names}
    if in_both:
        name = min(in_both)
        raise InputError("lines", f"line {name} has the name of a joint; give another name=")

    columns: list[Array] = []
    motor_names: list[str] = []
    for motor in motors:
        if isinstance(motor, Mapping):  # a tendon: one motor on several joints and lines
            name, shares = tendon_of(motor)
            rows = _rows_of(space, row_of_line, list(shares))
            column = np.zeros(rates + len(lines))
            column[rows] = finite_array("actuated", list(shares.values()), (len(rows),))
            if not column.any():
                raise InputError("actuated", f"{dict(motor)}: this motor acts on no joint")
            columns.append(column)
            terms = " + ".join(f"{share:g} {joint}" for joint, share in shares.items())
            motor_names.append(name or terms.replace("+ -", "- "))
        else:  # a line, or a motor for each rate of a joint
            (name,) = names_of("actuated", [motor])
            for row in _rows_of(space, row_of_line, [name]):
                column = np.zeros(rates + len(lines))
                column[row] = 1.0
                columns.append(column)
                motor_names.append(name if name in row_of_line else space.rate_names[row])
    if len(set(motor_names)) != len(motor_names):
        raise InputError("actuated", f"a joint appears twice in {motor_names}")
    B = np.array(columns).reshape(-1, rates + len(lines)).T
    return B, tuple(motor_names)


def _rows_of(space: JointSpace, row_of_line: Mapping[str, int], names: Sequence[str]) -> list[int]:
    """Rows of B for named joints, rates and lines; a row that appears twice is refused."""
    rows: list[int] = []
    for name in names:
        if name in row_of_line:
            rows.append(row_of_line[name])
        else:
            rows.extend(space.rates_of([name]).tolist())
    if len(set(rows)) != len(rows):
        raise InputError("names", f"a joint appears twice in {list(names)}")
    return rows


def _require_sound(model: pin.Model, closures: Sequence[Constraint]) -> None:
    """Refuse names, numbers and joints that the dynamics cannot use; the error lists them all."""
    names = list(model.names)[1:]
    problems = []

    # Names
    for name, count in Counter(names).items():
        if count > 1:
            problems.append(f"joint {name}: the name appears twice")
    for number, name in enumerate(names, 1):
        if not name:
            problems.append(f"joint {number}: it has no name")
    if "universe" in names:
        problems.append("joint universe: the world has this name; rename the joint")
    for name in sorted({*names} & {*map(str, closures)}):
        problems.append(f"joint {name}: a closure has this name too; rename the joint")
    if not problems:  # names of positions and rates are made from sound names of joints
        problems = _names_with_two_meanings(model)

    # Numbers
    problems += _impossible_numbers(model)
    if model != pin.Model(model):  # a model differs from its copy only if a number is NaN
        problems.append("contains NaN")
    if model.gravity.angular.any():
        problems.append(f"gravity.angular is {model.gravity.angular}; it must be zero")

    # Joints
    if not model.nv:
        problems.append("no moving joints")
    for number in model.mimicking_joints:
        mimic = model.joints[number].extract()
        if not _MIMIC.search(str(mimic)) or not mimic.scaling:
            problems.append(
                f"mimic joint {names[number - 1]}: Pinocchio supports only revolute and prismatic "
                "mimic joints with limits and a factor other than 0; use an ordinary joint with a "
                "Coupling to the joint that it follows"
            )
    for name, joint in zip(names, list(model.joints)[1:], strict=True):
        if joint.shortname() == "JointModelEllipsoid":
            problems.append(f"joint {name}: joints of type ellipsoid are not supported")
    if problems:
        raise DescriptionError(f"model {model.name}", problems)


def copied(model: pin.Model) -> pin.Model:
    """A copy of a model, after a check of the lengths of its arrays and of the parents.

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
    """Problems of the numbers: not finite, too large, or a matrix of a placement is no rotation.

    Negative masses and rotor inertias pass: estimated ones may be negative.
    """
    numbers: list[tuple[str, Array]] = [
        ("gravity", model.gravity.vector),
        ("armature", model.armature),
    ]
    placements: list[tuple[str, pin.SE3]] = []
    for number in range(1, model.njoints):
        name = model.names[number]
        numbers.append((f"body of joint {name}", model.inertias[number].toDynamicParameters()))
        placements.append((f"placement of joint {name}", model.jointPlacements[number]))
    for frame in model.frames:
        placements.append((f"placement of frame {frame.name}", frame.placement))
    numbers += [(name, placement.homogeneous) for name, placement in placements]

    problems = []
    for name, array in numbers:
        if not np.isfinite(array).all():
            problems.append(f"{name}: not finite")
        elif np.abs(array).max(initial=0.0) > _TOO_LARGE:
            largest = np.abs(array).max()
            problems.append(f"{name}: {largest:.3g} is too large to be computed with")
    for name, placement in placements:
        R = placement.rotation
        with np.errstate(over="ignore", invalid="ignore"):
            error = np.abs(R.T @ R - np.eye(3)).max()
            if error > _NO_ROTATION or np.linalg.det(R) < 0:
                problems.append(f"{name}: {R.tolist()} is no rotation")
    return problems


def _names_with_two_meanings(model: pin.Model) -> list[str]:
    """Problems of names that two joints share: as a joint, a position or a rate."""
    problems = []
    for kind, names_of_joints in JointSpace(model).names_by_joint.items():
        owners: dict[str, str] = {}
        for joint, names in names_of_joints.items():
            for name in {joint, *names}:
                owner = owners.setdefault(name, joint)
                if owner != joint:
                    problems.append(
                        f"joints {owner} and {joint}: {name} names a {kind} of both; "
                        "rename one of them"
                    )
    return list(dict.fromkeys(problems))

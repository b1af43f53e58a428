# SPDX-License-Identifier: BSD-2-Clause
"""From a tree, names and numbers as a caller gives them to a `Mechanism`."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import finite_array
from ..arrays import names as names_of
from ..errors import DescriptionError, InputError
from .closures import Closure, Constraint, Coupling, Distance, Rolling
from .joint_space import JointSpace
from .mechanism import Friction, Mechanism, Springs
from .tree import joint_id

Array = NDArray[np.float64]

#: Mimic joints that Pinocchio computes rightly. It leaves out the pitch of helical ones.
_MIMIC = re.compile(
    r"Mimicking joint type: JointModel([RP][XYZ]|(Revolute|Prismatic)Unaligned)$", re.M
)

#: A motor: the joint that it drives, or how its force is shared by joints (a tendon).
Motor = str | Mapping[str, float]


def closures_of(closures: Sequence[Constraint | tuple[str, str]]) -> tuple[Constraint, ...]:
    """Closures, with pairs of names for frames that must coincide.

    Raises:
        InputError: For anything else.
    """
    found: list[Constraint] = []
    if not isinstance(closures, Iterable):
        raise InputError("closures", f"{closures!r}: a sequence of closures is needed")
    for closure in closures:
        if isinstance(closure, (Closure, Distance, Coupling, Rolling)):
            found.append(closure)
        elif isinstance(closure, (tuple, list)) and len(closure) == 2:
            found.append(Closure(*closure))
        else:
            raise InputError("closures", f"{closure!r} is neither a closure nor two frame names")
    return tuple(found)


def draft(
    model: pin.Model,
    closures: tuple[Constraint, ...],
    motors: Sequence[Motor],
    coordinates: Sequence[str] | None,
    *,
    viscous_friction: ArrayLike | None,
    coulomb_friction: ArrayLike | None,
    stiffness: ArrayLike | None,
    spring_reference: ArrayLike | None,
) -> Mechanism:
    """A mechanism whose coordinates are those asked for, else all that motors act on.

    Raises:
        DescriptionError: For a tree that cannot be computed.
        UnknownNameError: For a joint that it does not have.
        InputError: For numbers that do not fit.
    """
    _require_sound(model, closures)
    space = JointSpace(model)
    B, names = _motors(space, motors, model.nv)
    friction = Friction(
        _of_rates("viscous_friction", viscous_friction, model.damping),
        _of_rates("coulomb_friction", coulomb_friction, model.friction),
    )
    rest = pin.neutral(model) if spring_reference is None else spring_reference
    springs = Springs(
        _of_rates("stiffness", stiffness, np.zeros(model.nv)),
        finite_array("spring_reference", rest, (model.nq,)),
    )
    springs.check(model)
    mechanism = Mechanism(model, closures, np.empty(0, dtype=np.intp), B, names, friction, springs)
    chosen = (
        mechanism.driven
        if coordinates is None
        else space.rates_of(names_of("coordinates", coordinates))
    )
    return Mechanism(model, closures, chosen, B, names, friction, springs)


def without_locked(model: pin.Model, locked: Sequence[str] | Mapping[str, float]) -> pin.Model:
    """The tree with some joints held.

    Raises:
        UnknownNameError: For a joint that it does not have.
        InputError: For a tree with mimic joints, which Pinocchio cannot reduce.
    """
    if list(model.mimicking_joints):
        raise InputError("locked", "the model has mimic joints; lock joints before you add these")
    q = pin.neutral(model)
    ids = [joint_id(model, name) for name in names_of("locked", locked)]
    if isinstance(locked, Mapping):
        for index, value in zip(ids, locked.values(), strict=True):
            joint = model.joints[index]
            if (joint.nq, joint.nv) != (1, 1):
                raise InputError("locked", f"joint {model.names[index]} has several coordinates")
            q[joint.idx_q] = float(finite_array("locked", value, ()))
    return pin.buildReducedModel(model, ids, q)


def _motors(space: JointSpace, motors: Sequence[Motor], nv: int) -> tuple[Array, tuple[str, ...]]:
    """B and the motors' names."""
    if isinstance(motors, str) or not isinstance(motors, Iterable):
        raise InputError("actuated", f"{motors!r}: a sequence of names is needed")
    columns: list[Array] = []
    names: list[str] = []
    for motor in motors:
        if isinstance(motor, Mapping):
            column = np.zeros(nv)
            k = space.rates_of(list(motor))
            column[k] = finite_array("actuated", list(motor.values()), (len(k),))
            if not column.any():
                raise InputError("actuated", f"{dict(motor)}: this motor acts on no joint")
            columns.append(column)
            shares = " + ".join(f"{share:g} {name}" for name, share in motor.items())
            names.append(shares.replace("+ -", "- "))
        else:
            k = space.rates_of(names_of("actuated", [motor]))
            columns.extend(np.eye(nv)[k])
            names.extend(space.rate_names[i] for i in k)
    if len(set(names)) != len(names):
        raise InputError("actuated", f"a joint appears twice in {names}")
    return np.array(columns).reshape(-1, nv).T, tuple(names)


def _of_rates(name: str, given: ArrayLike | None, default: Array) -> Array:
    array = finite_array(name, default if given is None else given, (len(default),))
    if array.shape != default.shape:
        raise InputError(name, f"shape {array.shape}, expected {default.shape}")
    return array


def _require_sound(model: pin.Model, closures: Sequence[Constraint]) -> None:
    names = list(model.names)[1:]
    problems = [f"joint {n}: the name appears twice" for n, k in Counter(names).items() if k > 1]
    if model != pin.Model(model):
        problems.append("contains NaN")
    if model.gravity.angular.any():
        problems.append(f"gravity.angular is {model.gravity.angular}; weights have no such part")
    if not model.nv:
        problems.append("no moving joints")
    if not closures:
        problems.append("no closures; for an open tree use pinocchio.rnea")
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

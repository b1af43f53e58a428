# SPDX-License-Identifier: BSD-2-Clause
"""The geometry and the `Parameters` of an SST from its tree, or the problems of the tree."""

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, read_only
from ..description.frames import JOINT_NAMES
from ..description.parameters import Parameters, RigidBody
from ..errors import DescriptionError
from ..model.geometry import place_of
from ..model.mechanism import Friction
from ..model.tree import frame_named
from .kinematics import Geometry

#: Pairs of frames that the closures of the shipped description connect. `SST` compares the closures
#: of a file with them.
CUTS = {("closedloop1_A", "closedloop1_B"), ("closedloop2_A", "closedloop2_B")}
#: Frames of the closures, and the number of the arc of the star that each is fixed to.
_STAR_OF = {"closedloop1_A": 1, "closedloop2_A": 1, "closedloop1_B": 2, "closedloop2_B": 3}
#: Points whose distances from O are the radii.
_POINTS = ("E", "P_1", "P_2", "P_3")
#: Tolerance of positions and angles, [m] and [rad], for numbers written with ten digits.
_EXACT = 1e-9


def geometry_of(model: pin.Model, source: str) -> Geometry:
    """The geometry of an SST from its tree.

    Raises:
        DescriptionError: If the tree is not that of an SST; the error lists all differences, and
            names the `source` of the model.
    """
    problems = _joint_problems(model)
    if not problems:  # axes and frames can be checked only if the joints are right
        problems = [*_axis_problems(model), *_cut_problems(model)]
    if problems:
        raise DescriptionError(source, problems)
    R_0 = [model.jointPlacements[model.getJointId(f"gamma_{k}")].rotation for k in (1, 2, 3)]
    ends = ("closedloop1_A", "closedloop1_B", "closedloop2_B")
    R_E = [frame_named(model, name).placement.rotation for name in ends]
    return Geometry(read_only(np.array(R_0)), read_only(np.array(R_E)))


def _joint_problems(model: pin.Model) -> list[str]:
    """Joints that are missing, superfluous or in another order."""
    names = tuple(model.names)[1:]
    problems = [f"joint {name} is missing" for name in JOINT_NAMES if name not in names]
    problems += [f"joint {x}: an SST has no such joint" for x in names if x not in JOINT_NAMES]
    if not problems and names != JOINT_NAMES:
        order = "their order must be gamma_k, mu_k, beta_k of each leg"
        problems.append(f"joints {', '.join(names)}; {order}")
    return problems


def _axis_problems(model: pin.Model) -> Iterator[str]:
    """Joints whose type, parent or placement is not that of an SST."""
    for index, name in enumerate(JOINT_NAMES, start=1):
        joint = name.split("_")[0]
        placement = model.jointPlacements[index]
        kind = model.joints[index].shortname()
        expected = "JointModelRX" if joint == "mu" else "JointModelRZ"
        parent = 0 if joint == "gamma" else index - 1
        if kind != expected:
            yield f"joint {name}: type {kind}, expected {expected}"
        if model.parents[index] != parent:
            parents = model.names[model.parents[index]], model.names[parent]
            yield f"joint {name}: its parent is {parents[0]}, expected {parents[1]}"
        if np.abs(placement.translation).max() > _EXACT:
            yield f"joint {name}: not in the centre O; origin xyz must be 0 0 0"
        if joint != "gamma" and np.abs(placement.rotation - np.eye(3)).max() > _EXACT:
            yield f"joint {name}: origin rpy must be 0 0 0"


def _cut_problems(model: pin.Model) -> Iterator[str]:
    """Frames of the closures that are missing, or elsewhere than on the star at O."""
    missing = [name for name in _STAR_OF if not model.existFrame(name)]
    for name in missing:
        yield f"frame {name} of the cuts is missing"
    for name, k in _STAR_OF.items():
        if name not in missing:
            frame = frame_named(model, name)
            fixed_to_star = frame.parentJoint == model.getJointId(f"beta_{k}")
            if not fixed_to_star or np.abs(frame.placement.translation).max() > _EXACT:
                yield f"frame {name}: must be fixed to star_{k} with origin xyz 0 0 0"
    if not missing:
        first = frame_named(model, "closedloop1_A").placement
        second = frame_named(model, "closedloop2_A").placement
        if not first.actInv(second).isIdentity(_EXACT):
            yield "frame closedloop2_A: must coincide with closedloop1_A"


def parameters_of(model: pin.Model, geometry: Geometry, friction: Friction) -> Parameters:
    """The parameters of the tree of an SST.

    Parameters do not describe all that a tree can have; `differences` finds the rest.
    """
    frames = [name for name in _POINTS if not model.existFrame(name)]
    problems = [f"frame {name} is missing; its distance from O gives a radius" for name in frames]
    if problems:
        raise DescriptionError(f"model {model.name} cannot be described by Parameters", problems)
    bodies = [_body(inertia) for inertia in list(model.inertias)[1:]]
    # The star is the sum of its three arcs, in {E}. The tree has the inertia of arc k in {3k}. R_E
    # is the orientation of {E} in {3k}, so R_E^T turns the inertia into {E}.
    arcs = [
        pin.SE3(R_E.T, np.zeros(3)).act(model.inertias[model.getJointId(f"beta_{k}")])
        for k, R_E in enumerate(geometry.R_E, start=1)
    ]
    # Eqs. (30), (31), (35): {E} in {3k} is Rot(x, -turn) with turn = alpha_2 for leg 2 and
    # turn = alpha_2 + alpha_3 for leg 3. In its row y, the entry in column y is cos(turn) and the
    # entry in column z is sin(turn).
    sines = geometry.R_E[1:, 1, 2]
    cosines = geometry.R_E[1:, 1, 1]
    turns = np.arctan2(sines, cosines) % (2 * np.pi)
    alpha_2 = turns[0]
    alpha_3 = (turns[1] - turns[0]) % (2 * np.pi)
    return Parameters(
        base_directions=[frame_named(model, f"P_{k}").placement.translation for k in (1, 2, 3)],
        arc_angles=_rounded((2 * np.pi - alpha_2 - alpha_3, alpha_2, alpha_3)),
        link=_one_or_three(bodies[0::3]),
        passive_link=_one_or_three(bodies[1::3]),
        star=_body(arcs[0] + arcs[1] + arcs[2]),
        viscous_friction=friction.viscous,
        coulomb_friction=friction.coulomb,
        gravity=model.gravity.linear,
        base_radius=_radius(model, "P_1"),
        star_radius=_radius(model, "E"),
    )


def _radius(model: pin.Model, point: str) -> float:
    """Distance of a point from O, [m]."""
    return float(_rounded(np.linalg.norm(frame_named(model, point).placement.translation)))


def _body(inertia: pin.Inertia) -> RigidBody:
    """A body by Pinocchio's inertia."""
    mass = float(_rounded(inertia.mass))
    return RigidBody(mass, _rounded(inertia.lever), _rounded(inertia.inertia))


def _rounded(value: ArrayLike) -> Array:
    """Round to 16 digits of the largest entry, the precision of sums and angles."""
    value = np.asarray(value, dtype=float)
    largest = float(np.abs(value).max())
    if largest < 1e-290:  # zero, or so small that NumPy's factor 10^digits would overflow
        return value
    digits = 16 - int(np.ceil(np.log10(largest)))
    return value.round(digits)


def _one_or_three(bodies: Sequence[RigidBody]) -> RigidBody | Sequence[RigidBody]:
    """One body if those of all legs are the same, as `Parameters` takes them."""
    return bodies[0] if all(body == bodies[0] for body in bodies) else bodies


def differences(model: pin.Model, written: pin.Model) -> Iterator[str]:
    """How a tree differs from the one that its parameters write."""
    for name in (*JOINT_NAMES, *_STAR_OF, *_POINTS):
        joint, place = place_of(model, name)
        written_joint, written_place = place_of(written, name)
        if joint != written_joint:
            yield f"{name}: on joint {model.names[joint]}, expected {model.names[written_joint]}"
        elif np.abs(place.homogeneous - written_place.homogeneous).max() > _EXACT:
            yield f"{name}: origin {_origin(place)}, expected {_origin(written_place)}"
    for i, name in enumerate(JOINT_NAMES):
        low = model.lowerPositionLimit[i]
        high = model.upperPositionLimit[i]
        if max(abs(low + 2 * np.pi), abs(high - 2 * np.pi)) > _EXACT:
            yield f"{name}: limits {low:g} and {high:g} rad, expected -2 pi and 2 pi"
        if model.armature[i] != 0:
            yield f"{name}: armature {model.armature[i]:g} kg m^2, expected 0"


def _origin(place: pin.SE3) -> str:
    """A placement as the attributes of an `<origin>`."""
    xyz = _numbers(place.translation)
    rpy = _numbers(pin.rpy.matrixToRpy(place.rotation))
    return f"xyz {xyz} rpy {rpy}"


def _numbers(vector: Array) -> str:
    """Numbers with nine digits."""
    return " ".join(f"{x:.9g}" for x in vector + 0.0)  # without the sign of -0.0

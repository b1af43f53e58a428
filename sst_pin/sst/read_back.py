# SPDX-License-Identifier: BSD-2-Clause
"""From the tree of an SST back to its `Parameters`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array
from ..chain.mechanism import Friction
from ..chain.tree import frame_named
from ..description import JOINT_NAMES, base_orientations
from ..description.parameters import Parameters, RigidBody
from ..errors import DescriptionError
from .kinematics import Geometry
from .topology import EXACT


def parameters_of(model: pin.Model, geometry: Geometry, friction: Friction) -> Parameters:
    """The parameters that make a tree; the star is the sum of its three arcs.

    The error lists all that the tree holds and parameters do not.
    """
    problems = list(_frame_problems(model)) or [
        *_base_problems(model, geometry),
        *_star_problems(model, geometry),
        *_joint_problems(model),
    ]
    if problems:
        raise DescriptionError(f"model {model.name} cannot be described by Parameters", problems)
    bodies = [_body(inertia) for inertia in list(model.inertias)[1:]]
    # Eqs. (30), (31), (35): {E} in {3k} is Rot(x, -(alpha_2 + ... + alpha_k)).
    turns = np.arctan2(geometry.R_E[1:, 1, 2], geometry.R_E[1:, 1, 1]) % (2 * np.pi)
    alpha_2, alpha_3 = turns[0], (turns[1] - turns[0]) % (2 * np.pi)
    return Parameters(
        base_directions=[frame_named(model, f"P_{k}").placement.translation for k in (1, 2, 3)],
        arc_angles=_rounded((2 * np.pi - alpha_2 - alpha_3, alpha_2, alpha_3)),
        link=_one_or_three(bodies[0::3]),
        passive_link=_one_or_three(bodies[1::3]),
        star=_star(model, geometry),
        viscous_friction=friction.viscous,
        coulomb_friction=friction.coulomb,
        gravity=model.gravity.linear,
        base_radius=_radius(model, "P_1"),
        star_radius=_radius(model, "E"),
    )


def _radius(model: pin.Model, point: str) -> float:
    return float(_rounded(np.linalg.norm(frame_named(model, point).placement.translation)))


def _body(inertia: pin.Inertia) -> RigidBody:
    return RigidBody(
        float(_rounded(inertia.mass)), _rounded(inertia.lever), _rounded(inertia.inertia)
    )


def _rounded(value: ArrayLike) -> Array:
    """To 16 digits of the largest entry: what comes back from sums and angles has no more."""
    value = np.asarray(value, dtype=float)
    digits = 16 - int(np.ceil(np.log10(max(np.abs(value).max(), 1e-300))))
    return value.round(digits)


def _one_or_three(bodies: Sequence[RigidBody]) -> RigidBody | Sequence[RigidBody]:
    return bodies[0] if all(body == bodies[0] for body in bodies) else bodies


def _star(model: pin.Model, geometry: Geometry) -> RigidBody:
    """Body 7 in {E}."""
    arcs = [
        pin.SE3(R_E.T, np.zeros(3)).act(model.inertias[model.getJointId(f"beta_{k}")])
        for k, R_E in enumerate(geometry.R_E, start=1)
    ]
    return _body(arcs[0] + arcs[1] + arcs[2])


def _frame_problems(model: pin.Model) -> Iterator[str]:
    for name in ("E", "P_1", "P_2", "P_3"):
        if not model.existFrame(name):
            yield f"frame {name} is missing; its distance from O gives a radius"


def _base_problems(model: pin.Model, geometry: Geometry) -> Iterator[str]:
    v = geometry.R_0[:, :, 0]
    radius = _radius(model, "P_1")
    wanted = base_orientations(Parameters(base_directions=v))
    for k in range(3):
        if np.abs(geometry.R_0[k] - wanted[k]).max() > EXACT:
            yield f"joint gamma_{k + 1}: z must be normal to x of this leg and of the next"
        name = f"P_{k + 1}"
        frame = frame_named(model, name)
        at_P = np.abs(frame.placement.translation - radius * v[k]).max() < EXACT
        if frame.parentJoint != 0 or not at_P:
            yield f"frame {name}: must be fixed to base on v_{k + 1}, at the same radius as P_1"


def _star_problems(model: pin.Model, geometry: Geometry) -> Iterator[str]:
    if np.abs(geometry.R_E[0] - np.eye(3)).max() > EXACT:
        yield "frame closedloop1_A: {E} must have the orientation of star_1"
    for k in (2, 3):
        if np.abs(geometry.R_E[k - 1, 0] - np.eye(3)[0]).max() > EXACT:
            yield f"frame closedloop{k - 1}_B: {{E}} may be rotated about x of star_{k} only"
    E = frame_named(model, "E")
    radius = _radius(model, "E")
    on_x = E.placement.isApprox(pin.SE3(np.eye(3), np.array((radius, 0, 0))), EXACT)
    if E.parentJoint != model.getJointId("beta_1") or not on_x:
        yield "frame E: must be fixed to star_1 with origin xyz r 0 0, rpy 0 0 0"


def _joint_problems(model: pin.Model) -> Iterator[str]:
    turn = 2 * np.pi
    for i, name in enumerate(JOINT_NAMES):
        limits = model.lowerPositionLimit[i], model.upperPositionLimit[i]
        if np.abs(limits - np.array((-turn, turn))).max() > EXACT:
            yield f"joint {name}: limits {limits[0]:g} and {limits[1]:g} rad must be -2 pi and 2 pi"
        if model.armature[i] != 0:
            yield f"joint {name}: armature {model.armature[i]:g} kg m^2 must be 0"

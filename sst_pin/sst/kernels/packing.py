# SPDX-License-Identifier: BSD-2-Clause
"""The parameter vector of the kernels: what they need to know of a robot, from its model.

All moments are about the centre O, where every body turns: a body is its inertia about O and its
first moment, an actuator link one scalar and two components. The star's axes are those of {31},
the base's those of {01}, so that leg 1 needs neither. `FIELDS` is the order of the vector and, by
`scripts/kernels/make_kernels.py`, the struct `sst_parameters` of the C header.
"""

from __future__ import annotations

from math import prod
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ...chain.mechanism import Friction
from ...description import JOINT_NAMES
from ..kinematics import Geometry

Array = NDArray[np.float64]


class Field(NamedTuple):
    """One array of the parameter vector.

    Attributes:
        name: Of the member of `sst_parameters`.
        shape: Its dimensions, row-major; () for a number.
        meaning: With unit.
    """

    name: str
    shape: tuple[int, ...]
    meaning: str


FIELDS = (
    Field("R_01", (3, 3), "{01} in the base"),
    Field("gravity", (3, 3), "acceleration of gravity in {0k}, m/s^2"),
    Field("x_0", (3, 3), "x axis of {0k} in {01}"),
    Field("y_0", (3, 3), "y axis of {0k} in {01}"),
    Field("e", (3, 3), "e_k, z axis of {0k}, in {01}"),
    Field("x_3", (3, 3), "x axis of {3k} in {31}"),
    Field("y_3", (3, 3), "y axis of {3k} in {31}"),
    Field("n", (3, 3), "e_{k+6}, z axis of {3k}, in {31}"),
    Field("link_inertia", (3,), "actuator link and its rotor about e_k, kg m^2"),
    Field("link_moment", (3, 2), "its first moment along x, y of {1k}, kg m"),
    Field("passive_inertia", (3, 6), "passive link in {2k}: xx, xy, xz, yy, yz, zz, kg m^2"),
    Field("passive_moment", (3, 3), "its first moment in {2k}, kg m"),
    Field("passive_polar", (3,), "its mass times |c|^2, c its mass centre, kg m^2"),
    Field("star_inertia", (6,), "the star in {31}: xx, xy, xz, yy, yz, zz, kg m^2"),
    Field("star_moment", (3,), "its first moment in {31}, kg m"),
    Field("star_polar", (), "its mass times |c|^2, c its mass centre, kg m^2"),
    Field("rotor", (3, 2), "armatures of mu_k and beta_k, kg m^2"),
    Field("viscous", (9,), "viscous friction, in the order of q, N m s/rad"),
    Field("coulomb", (9,), "Coulomb friction, in the order of q, N m"),
    Field("sign_width", (), "where tanh for sign is 76 %, 0 for the sign, rad/s"),
)

#: Length of the parameter vector.
LENGTH = sum(prod(field.shape) for field in FIELDS)


def pack(model: pin.Model, geometry: Geometry, friction: Friction) -> Array:
    """The parameter vector of an SST.

    Args:
        model: Its tree, joints in the order of `JOINT_NAMES`.
        geometry: Of the same tree.
        friction: Of its joints.

    Returns:
        Shape (LENGTH,), in the order of `FIELDS`.
    """
    bodies = {name: model.inertias[model.getJointId(name)] for name in JOINT_NAMES}
    links = [bodies[f"gamma_{k}"] for k in (1, 2, 3)]
    passives = [bodies[f"mu_{k}"] for k in (1, 2, 3)]
    R_star = [geometry.R_E[0] @ R.T for R in geometry.R_E]  # {3k} in {31}
    # The three arcs, as they stand when the loops are closed, are one body.
    arcs = [
        (body.mass, R @ body.lever, R @ _about_O(body) @ R.T)
        for R, body in zip(R_star, (bodies[f"beta_{k}"] for k in (1, 2, 3)), strict=True)
    ]
    rotor = model.armature.reshape(3, 3)
    R_01 = geometry.R_0[0]
    R_0 = np.stack([R_01.T @ R for R in geometry.R_0])  # {0k} in {01}
    R_3 = np.stack(R_star)
    values = {
        "R_01": R_01,
        "gravity": [R.T @ model.gravity.linear for R in geometry.R_0],
        "x_0": R_0[:, :, 0],
        "y_0": R_0[:, :, 1],
        "e": R_0[:, :, 2],
        "x_3": R_3[:, :, 0],
        "y_3": R_3[:, :, 1],
        "n": R_3[:, :, 2],
        "link_inertia": [_about_O(b)[2, 2] for b in links] + rotor[:, 0],
        "link_moment": [b.mass * b.lever[:2] for b in links],
        "passive_inertia": [_upper(_about_O(b)) for b in passives],
        "passive_moment": [b.mass * b.lever for b in passives],
        "passive_polar": [b.mass * (b.lever @ b.lever) for b in passives],
        "star_inertia": _upper(np.sum([inertia for _, _, inertia in arcs], axis=0)),
        "star_moment": np.sum([mass * c for mass, c, _ in arcs], axis=0),
        "star_polar": sum(mass * (c @ c) for mass, c, _ in arcs),
        "rotor": rotor[:, 1:],
        "viscous": friction.viscous,
        "coulomb": friction.coulomb,
        "sign_width": friction.sign_width if friction.coulomb.any() else 0.0,
    }
    return np.concatenate(
        [np.reshape(np.asarray(values[f.name], dtype=float), prod(f.shape)) for f in FIELDS]
    )


def _about_O(body: pin.Inertia) -> Array:
    c = body.lever
    return np.asarray(body.inertia + body.mass * (c @ c * np.eye(3) - np.outer(c, c)))


def _upper(inertia: Array) -> Array:
    return np.asarray(inertia[np.triu_indices(3)])

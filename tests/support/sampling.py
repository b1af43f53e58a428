# SPDX-License-Identifier: BSD-2-Clause
"""Random robots that could be built and random motions that they can make."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from sst_pin.arrays import Array
from sst_pin.description.parameters import Parameters, RigidBody
from sst_pin.sst.robot import SST


def random_body(rng: np.random.Generator, mass: float, radius: float) -> RigidBody:
    """A body of some mass within some radius; mass centre off every axis, full inertia tensor."""
    second_moments = mass * radius**2 * rng.uniform(0.05, 0.4, 3)
    principal = second_moments.sum() - second_moments  # keeps the triangle inequality
    axes = Rotation.random(None, rng).as_matrix()
    inertia = axes @ np.diag(principal) @ axes.T
    return RigidBody(mass, rng.uniform(-radius, radius, 3), (inertia + inertia.T) / 2)


def random_directions(rng: np.random.Generator) -> Array:
    """v_1, v_2, v_3 of an odd base triangle, of either handedness, rows of a (3, 3) array."""
    while True:
        v = rng.normal(size=(3, 3))
        v /= np.linalg.norm(v, axis=1)[:, None]
        if abs(np.linalg.det(v)) > 0.2:  # far from three directions in one plane
            return v


def random_arc_angles(rng: np.random.Generator) -> Array:
    """Unequal alpha_k that add up to 2 pi, shape (3,), [rad]."""
    while True:
        alpha = 2 * np.pi * rng.dirichlet((3, 3, 3))
        if np.abs(np.sin(alpha)).min() > 0.2:  # no two arcs in one plane
            return alpha


def random_parameters(rng: np.random.Generator, friction: bool = True) -> Parameters:
    """An SST far from the paper's: another geometry, nine different bodies, tilted gravity.

    With friction all nine joints have viscous and Coulomb friction, each its own.
    """
    links, passive_links = (
        tuple(random_body(rng, mass, 0.3) for mass in rng.uniform(low, high, 3))
        for low, high in ((0.2, 0.8), (0.05, 0.3))
    )
    return Parameters(
        base_directions=random_directions(rng),
        arc_angles=random_arc_angles(rng),
        link=links,
        passive_link=passive_links,
        star=random_body(rng, rng.uniform(1, 4), 0.4),
        viscous_friction=rng.uniform(0.1, 1, 9) if friction else 0,
        coulomb_friction=rng.uniform(0.1, 1, 9) if friction else 0,
        gravity=rng.normal(size=3) * 6,
    )


def parameters_of_odd_size(seed: int) -> Parameters:
    """Random ones, with two random radii, either one the larger."""
    rng = np.random.default_rng(seed)
    p, (base, star) = random_parameters(rng), rng.uniform(0.1, 1, 2)
    return replace(p, base_radius=base, star_radius=star)


def random_state(robot: SST, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """R, omega, alpha of the star at one instant, away from the singularities of both kinds."""
    while True:
        R = Rotation.random(None, rng).as_matrix()
        distance = robot.singularities(robot.inverse_kinematics(R))
        if distance.first_kind > 0.15 and distance.condition_number < 30:
            return R, rng.normal(scale=2, size=3), rng.normal(scale=20, size=3)


def random_states(robot: SST, rng: np.random.Generator, count: int) -> tuple[Array, Array, Array]:
    """`random_state` many times: shapes (count, 3, 3), (count, 3), (count, 3)."""
    R, omega, alpha = zip(*(random_state(robot, rng) for _ in range(count)), strict=True)
    return np.array(R), np.array(omega), np.array(alpha)

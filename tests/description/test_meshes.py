# SPDX-License-Identifier: BSD-2-Clause
"""Meshes and collision primitives, as Pinocchio with coal, MuJoCo and yourdfpy read them."""

import sys

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import sst_pin
from sst_pin import Parameters
from sst_pin.description.parts import meshes_of
from sst_pin.sst.paper import PERIOD, example_1
from tests.support.sampling import parameters_of_odd_size

ROBOTS = {
    "paper": Parameters(),
    **{f"odd {seed}": parameters_of_odd_size(seed) for seed in range(2)},
    "both spheres one": Parameters(base_radius=0.4),
    "a millimetre": Parameters(base_radius=0.001, star_radius=0.0012),
}


@pytest.fixture(params=ROBOTS.values(), ids=ROBOTS.keys())
def parameters(request):
    return request.param


def test_every_mesh_is_closed_and_its_normals_point_outward(parameters):
    """Each of the solids by itself: no hole, no edge turned over, a positive volume."""
    for name, mesh in meshes_of(parameters).items():
        assert mesh.is_watertight, name
        assert mesh.is_winding_consistent, name
        assert all(solid.volume > 0 for solid in mesh.split()), name
        assert mesh.area_faces.min() > 0, name


def test_meshes_have_the_radii_of_the_parameters(parameters):
    """The middle lines of sides and arcs lie on their spheres, as deep in the metal everywhere."""
    meshes, p = meshes_of(parameters), parameters
    middle = p.base_directions + np.roll(p.base_directions, -1, axis=0)
    middle *= p.base_radius / np.linalg.norm(middle, axis=1)[:, None]
    arcs = np.radians((20, 45, 70))
    side = -np.sign(np.linalg.det(p.base_directions))
    arc = p.star_radius * np.stack([np.cos(arcs), side * np.sin(arcs), 0 * arcs], axis=-1)
    for mesh, points in ((meshes["base"], middle), (meshes["arc"], arc)):
        depths = trimesh.proximity.closest_point_naive(mesh, points)[1]
        assert 0 < depths.min() <= depths.max() < 0.2 * min(p.base_radius, p.star_radius)
        # Chords of at most 4.5 degrees are 0.0008 of the radius off the circle.
        assert np.ptp(depths) < 0.0008 * max(p.base_radius, p.star_radius)


def test_without_trimesh_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(sst_pin.errors.MissingExtraError, match=r"\[mesh\]"):
        meshes_of(Parameters())


def distances(model, shapes, motion):
    """Distances of each pair of shapes in each configuration, shape (N, pairs), [m]."""
    data, actual, rows = model.createData(), shapes.createData(), []
    for q in motion:
        pin.computeDistances(model, data, shapes, actual, q)
        rows.append([result.min_distance for result in actual.distanceResults])
    return np.array(rows)


def test_no_body_passes_through_another_along_the_circle(robot):
    """8.4 mm remain between any two that the SRDF does not exclude as neighbours."""
    wrapper = sst_pin.load()
    motion = example_1(robot, np.linspace(0, PERIOD, 25))
    gaps = distances(wrapper.model, wrapper.collision_model, motion.q)
    assert gaps.min() == pytest.approx(0.0084, abs=1e-4)


def test_the_carriages_hold_their_arcs_along_the_circle(robot):
    """Rollers run 0.2 mm beside the arcs: at every pose the arc passes between them."""
    wrapper = sst_pin.load()
    visual = wrapper.visual_model
    for k in (1, 2, 3):
        pair = (visual.getGeometryId(f"{body}_{k}_0") for body in ("passive", "star"))
        visual.addCollisionPair(pin.CollisionPair(*pair))
    gaps = distances(wrapper.model, visual, example_1(robot, np.linspace(0, PERIOD, 25)).q)
    assert np.abs(gaps - 2e-4).max() < 1e-6
    assert gaps.shape == (25, 3)

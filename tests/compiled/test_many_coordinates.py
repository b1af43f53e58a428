# SPDX-License-Identifier: BSD-2-Clause
"""Direct dynamics where the mass matrix is too large to be written out, on small robots.

The referee is the reference path, whose mass matrix comes from composite bodies.
"""

import numpy as np
import pytest

import sst_pin
from sst_pin.compiled import compiled_backend


def with_forces(robot):
    """The robot with springs, friction and a spring along a line."""
    model, rng = robot.model.copy(), np.random.default_rng(1)
    model.damping, model.friction, model.armature = rng.uniform(0.1, 1, (3, model.nv))
    line = sst_pin.LineForce("universe", model.frames[-1].name, stiffness=50, preload=3, damping=2)
    stiffness = rng.uniform(1, 9, model.nv)
    forces = {"forces": [line], "stiffness": stiffness}
    return sst_pin.ClosedChain(model, robot.closures, robot.motor_names, **forces)


@pytest.fixture(
    params=["five_bar", pytest.param("planar_4rrr", marks=pytest.mark.slow), "four_bar"]
)
def pair(request, monkeypatch):
    """A robot by its mass matrix in columns, and by the reference path."""
    monkeypatch.setitem(compiled_backend._LARGEST, "matrices", 0)
    robot = with_forces(getattr(sst_pin.robots, request.param)())
    compiled = sst_pin.ClosedChain(
        robot.model,
        robot.closures,
        robot.motor_names,
        forces=robot.forces,
        stiffness=robot.mechanism.springs.stiffness,
    )
    compiled.compile()
    return compiled, robot


def states(robot, count=5):
    """Random states near home, torques, and wrenches on the bodies."""
    rng, n = np.random.default_rng(2), robot.degrees_of_freedom
    model = robot.mechanism.model
    q = np.array([robot.assemble(robot.home + rng.normal(0, 0.05, model.nq)) for _ in range(count)])
    va, tau = rng.normal(size=(count, n)), rng.normal(size=(count, len(robot.motor_names)))
    return q, va, tau, rng.normal(size=(count, model.njoints - 1, 6))


def test_accelerations_are_those_of_the_reference_path(pair):
    compiled, robot = pair
    q, va, tau, wrenches = states(robot)
    for loads in ({}, {"external_wrenches": wrenches}):
        wanted = robot.compute_accelerations(q, va, tau, **loads)
        found = compiled.compute_accelerations(q, va, tau, **loads)
        # Both solve with the same mass matrix, whose condition number stays below 1e3.
        np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-10 * abs(wanted).max())
    assert "reference path" not in compiled.path


def test_no_sample_is_left_to_the_reference_path(pair, monkeypatch):
    compiled, robot = pair
    q, va, tau, _ = states(robot)
    monkeypatch.setattr(type(compiled._current.reference), "accelerations", None)
    assert np.isfinite(compiled.compute_accelerations(q, va, tau)).all()


def test_bad_samples_are_named_as_on_the_reference_path(pair):
    compiled, robot = pair
    q, va, tau, _ = states(robot)
    q[2] += 0.1
    for each in pair:
        with pytest.raises(sst_pin.ClosureError) as caught:
            each.compute_accelerations(q, va, tau)
        assert caught.value.samples == ((2,),)
    found = compiled.compute_accelerations(q, va, tau, on_error="nan")
    np.testing.assert_array_equal(np.isnan(found).any(axis=1), np.arange(5) == 2)


def test_simulations_follow_the_reference_path(pair):
    q, va, tau, _ = states(pair[1], 1)
    t = np.linspace(0, 0.05, 6)
    motions = [each.simulate(tau[0], q[0], va[0], t, rtol=1e-9, atol=1e-9) for each in pair]
    # Ten times the tolerance of the integrator.
    np.testing.assert_allclose(motions[0].q, motions[1].q, atol=1e-8)

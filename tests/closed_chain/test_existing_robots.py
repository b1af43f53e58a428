# SPDX-License-Identifier: BSD-2-Clause
"""Closed robots as others describe them go through the dynamics."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.verification.verify import verify_chain
from tests.support.files import ROOT, load
from tests.support.named_robots import cassie, robot_named

example = load("examples/standing_cassie.py")


@pytest.fixture(scope="module")
def delta() -> sst_pin.ClosedChain:
    return sst_pin.ClosedChain.from_urdf(ROOT / "examples" / "delta.urdf")


@pytest.mark.filterwarnings("ignore:.*its friction acts about each axis")
@pytest.mark.parametrize("name", ["delta", pytest.param("cassie", marks=pytest.mark.slow)])
def test_dynamics_agree_with_every_referee(name, delta):
    """At random assembled configurations in random motion."""
    rows = list(verify_chain(delta if name == "delta" else robot_named(name), 5))
    assert "Lagrange multipliers" in {row.referee for row in rows}
    assert all(row.passed for row in rows)


@pytest.mark.filterwarnings("ignore:.*its friction acts about each axis")
def test_cassie_has_one_motor_for_each_freedom_once_its_springs_are_stiff():
    """Per leg 8 hinges and 2 angles of the rod, less 5 rows: the foot's loop is flat."""
    report = robot_named("cassie").mobility()  # on a stand
    assert report.motor_names == tuple(cassie.MOTORS)
    assert (len(report.joints), report.rank, report.redundant_rows) == (20, 10, 2)
    assert report.degrees_of_freedom == 10
    assert report.sufficient


def test_the_platform_of_a_delta_does_not_turn_and_obeys_three_spheres(delta):
    """Each arm's end is a rod's length from the platform: the direct kinematics of Clavel."""
    names = delta.position_names
    guess = {"platform_1a_qy": -np.sin(0.4), "platform_1a_qw": np.cos(0.4)}
    guess |= {name: 0.7 for name in names if name.startswith("elbow") and name.endswith("Y")}
    for motors in np.random.default_rng(0).uniform(-0.4, 0.4, (5, 3)):
        guess |= {f"motor_{k + 1}": angle for k, angle in enumerate(motors)}
        q = delta.assemble([guess.get(name, 0.0) for name in names])
        p, R = delta.frame_placement(q, "platform")
        assert np.abs(R - np.eye(3)).max() < 1e-10
        centre = p - [0.05, 0.04, 0]  # its frame is at a rod's end
        turns = 2 * np.pi / 3 * np.arange(3)
        out = np.stack([np.cos(turns), np.sin(turns), np.zeros(3)], axis=1)
        elbows = (0.12 - 0.05 + 0.15 * np.cos(motors))[:, None] * out
        elbows[:, 2] = -0.15 * np.sin(motors)
        assert np.abs(np.linalg.norm(elbows - centre, axis=1) - 0.32).max() < 1e-10


@pytest.mark.filterwarnings("ignore:.*its friction acts about each axis")
def test_the_robot_stands_still_within_the_cones_of_friction():
    """The ground carries its weight, and direct dynamics with the floating base stay at rest."""
    chain = example.robot()
    q = example.standing(chain)
    torques, forces = example.stance(chain, q)
    weight = -pin.computeTotalMass(chain.model) * chain.model.gravity.linear
    # 1e-8 of 323 N: rounding of the programme.
    np.testing.assert_allclose(forces.sum(axis=0), weight, atol=1e-6)
    assert (forces[:, 2] > 0).all()
    sideways = np.linalg.norm(forces[:, :2], axis=1)
    assert (sideways <= example.FRICTION * forces[:, 2] + 1e-9).all()
    load = {"external_wrenches": example.contact_wrenches(chain, q, forces)}
    rest = np.zeros(chain.degrees_of_freedom)
    # 1e-8 N m over the least inertia of a rod.
    assert np.abs(chain.compute_accelerations(q, rest, torques, **load)).max() < 1e-6
    np.testing.assert_allclose(chain.compute_torques(q, rest, rest, **load), torques, atol=1e-6)

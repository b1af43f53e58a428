# SPDX-License-Identifier: BSD-2-Clause
import re

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import SST, ClosedChain, Parameters, ParametersError
from sst_pin.sst import RigidBody
from tests.support.sampling import random_parameters


def test_defaults_are_the_robot_of_the_paper():
    p = Parameters()
    assert np.array_equal(p.base_directions, np.eye(3))
    assert np.array_equal(p.actuated_axes, [[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # Eqs. (38)-(40)
    assert p.arc_angles == pytest.approx([2 * np.pi / 3] * 3)
    assert [b.mass for b in (p.star, *p.links, *p.passive_links)] == [2.6] + [0.3] * 3 + [0.06] * 3
    assert p.star.center_of_mass == pytest.approx([0.8 / np.pi, 0, 0])
    assert p.links[0].inertia[0, 2] == -0.0001


def test_actuated_axes_are_normal_to_the_sides_of_the_base_triangle():
    """e_k is a unit vector at right angles to v_k and v_{k+1}, right-handed."""
    for seed in range(20):
        p = random_parameters(np.random.default_rng(seed))
        v, w, e = p.base_directions, p.base_directions[[1, 2, 0]], p.actuated_axes
        assert np.linalg.norm(e, axis=1) == pytest.approx([1, 1, 1])
        assert np.abs([(e * v).sum(axis=1), (e * w).sum(axis=1)]).max() < 1e-14
        assert ((e * np.cross(v, w)).sum(axis=1) > 0).all()


def test_values_are_equal_hashable_and_read_only():
    a, b = (random_parameters(np.random.default_rng(3)) for _ in range(2))
    assert a == b
    assert hash(a) == hash(b)
    assert a != Parameters()
    assert a.star != "a star"
    with pytest.raises(ValueError, match="read-only"):
        a.gravity[0] = 1
    with pytest.raises(AttributeError):
        a.base_radius = 1


def test_all_problems_are_reported_at_once():
    heavy = RigidBody(-1.0, (0, 0, 0), np.diag((1, 1, 3)))
    with pytest.raises(ParametersError) as caught:
        Parameters(
            base_directions=[[1, 0, 0], [0, 1, 0], [1, 1, 0]],
            arc_angles=(2, 2, 2),
            link=heavy,
            passive_link=[RigidBody(1, (0, 0), np.eye(3))] * 2,
            star=RigidBody(1, (0, 0, 0), [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]),
            viscous_friction=[0, 0, -1, 0, 0, 0, 0, 0, 0],
            coulomb_friction=[1, 2],
            gravity=(0, 0, np.nan),
            base_radius=0,
        )
    problems = caught.value.problems
    for word in (
        "lie in one plane",
        "not to 2 pi",
        "link.mass",
        "triangle inequality",
        "2 bodies, expected one or three",
        "passive_link[1].center_of_mass: shape (2,), expected (3,)",
        "star.inertia: not symmetric",
        "viscous_friction: negative for joint number 3",
        "coulomb_friction: shape (2,), expected (9,)",
        "gravity: not finite",
        "base_radius",
    ):
        assert any(word in problem for problem in problems), word
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: Parameters(base_directions=np.zeros((3, 3))), "v_1 is zero"),
        (lambda: Parameters(arc_angles=(120, 120, 120)), "are these degrees"),
        (lambda: Parameters(arc_angles=(-1, 2, 2 * np.pi - 1)), "each must lie in"),
        (lambda: Parameters(star=RigidBody(1, (0, 0, 0), -np.eye(3))), "not all positive"),
        (lambda: Parameters(link=["bar"] * 3), "link[0]: a RigidBody is needed"),
        (lambda: Parameters(gravity="down"), "not an array of numbers"),
        (lambda: Parameters(star_radius=np.inf), "star_radius"),
        (lambda: RigidBody("heavy", (0, 0, 0), np.eye(3)), "mass: not an array of numbers"),
        (lambda: Parameters().with_payload(-1), "-1 kg"),
        (lambda: Parameters().with_payload(1, (0, 0)), "at: shape"),
    ],
)
def test_each_impossibility_has_its_sentence(call, word):
    with pytest.raises(ParametersError, match=re.escape(word)):
        call()


@pytest.mark.parametrize("at", [(0.1, -0.2, 0.3), (0, 0, 0)])
def test_a_payload_has_the_torques_of_a_point_mass_on_the_stars_body(at):
    """Pinocchio adds the body where frame E says {E} is; composite inertia here, a sum there."""
    p = random_parameters(np.random.default_rng(2))
    bare, loaded = SST(p), SST(p.with_payload(0.7, at))
    model = bare.model.copy()
    E = model.frames[model.getFrameId("E")]
    from_E = pin.SE3(np.eye(3), np.array(at) - (p.star_radius, 0, 0))
    point = pin.Inertia(0.7, np.zeros(3), np.zeros((3, 3)))
    model.appendBodyToJoint(E.parentJoint, point, E.placement * from_E)
    rubbing = {"viscous_friction": p.viscous_friction, "coulomb_friction": p.coulomb_friction}
    chain = ClosedChain(model, bare.closures, bare.motor_names, **rubbing)
    q, va, aa = bare.home, [0.3, -0.5, 0.7], [1.0, 2.0, -1.0]
    expected = chain.compute_torques(q, va, aa)
    # The URDF of the parameters rounds to 17 digits and fewer.
    assert loaded.compute_torques(q, va, aa) == pytest.approx(expected, abs=1e-10)
    changed = np.abs(expected - bare.compute_torques(q, va, aa)).max()
    assert changed > 0.1 if any(at) else changed < 1e-10  # at O it has no arm


def test_no_payload_changes_nothing():
    p = Parameters()
    assert p.with_payload(0.0, (1, 2, 3)) == p
    assert p.with_payload(1.0).link == p.link


def test_parameters_print_as_a_few_lines():
    p = Parameters(viscous_friction=np.linspace(0.1, 0.2, 9))
    text = repr(p)
    assert len(text.splitlines()) == 6
    for word in ("radius 0.4 m", "(120, 120, 120) deg", "star 2.6 kg", "0.1 to 0.2 N m s/rad"):
        assert word in text
        assert word in p._repr_html_()
    assert repr(p.star).splitlines()[1] == "  mass            2.6 kg"
    assert p.star._repr_html_().count("<tr>") == 3

# SPDX-License-Identifier: BSD-2-Clause
"""Every closure holds what it says, on trees with every joint of Pinocchio."""

import itertools

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from sst_pin import ClosedChain, Closure, robots
from sst_pin.errors import DescriptionError, InputError
from sst_pin.loops.loops import Loops
from sst_pin.model.closures import Coupling, Distance, Rolling
from sst_pin.verification.verify import verify_chain
from tests.support import any_chain, by_hand
from tests.support.any_chain import ALL_JOINTS, CONSTRAINTS, add_joint, tree
from tests.support.differences import derivative, random_q

TREES = any_chain.TREES | {"to the ground": ("", [], ["free-flyer", "spherical", "RY"])}
#: Each of the seven sets of turns, with seven different sets of slides.
MASKS = list(itertools.product([False, True], repeat=6))[1::9]
#: Every closure in one tree; in the other trees one of all rows, for their joints.
EVERYWHERE = [("floating", kind) for kind in CONSTRAINTS]
EVERYWHERE += [(name, "6d") for name in TREES if name != "floating"]


def loops_at(model, constraint, seed):
    """The loops, closed at a random configuration, and that configuration."""
    chain = ClosedChain(model, [constraint], [])
    random = np.random.default_rng(seed)
    q = chain.assemble(random_q(model, random), fixed=(), tries=20, seed=seed)
    return Loops(chain.model, [constraint]), q


def at(loops, q):
    loops.evaluate(q)
    return loops


def assert_jacobian_and_rate(loops, q, random):
    model = loops.model
    Phi = at(loops, q).Phi
    units = np.eye(model.nv)
    columns = [
        derivative(lambda s, e=e: at(loops, pin.integrate(model, q, s * e)).f, 0.003) for e in units
    ]
    residuals = np.stack(columns, axis=-1)
    # Eighth-order differences over 0.003: a rod of 0.7 m leaves (0.003 * 4 / 0.7)^8 = 1e-14, the
    # rounding of numbers near 10 over the step 1e-12.
    assert_allclose(Phi[loops.holonomic], residuals[loops.holonomic], rtol=0, atol=1e-10)
    v = random.normal(size=model.nv)
    rate = derivative(lambda s: at(loops, pin.integrate(model, q, s * v)).Phi, 0.003)
    Phi_dot = at(loops, q).Phi_dot(v)
    assert_allclose(Phi_dot, rate, rtol=0, atol=1e-8 * np.abs(Phi_dot).max())


@pytest.mark.parametrize(("name", "kind"), EVERYWHERE)
def test_Phi_is_the_derivative_of_the_residual_and_Phi_dot_its_rate(name, kind):
    """Where the loop is closed, along every rate of every joint, whatever the rates are."""
    loops, q = loops_at(tree(*TREES[name], seed=1), CONSTRAINTS[kind], seed=2)
    assert_jacobian_and_rate(loops, q, np.random.default_rng(3))


@pytest.mark.parametrize("mask", MASKS, ids=lambda mask: "".join(".x"[m] for m in mask))
def test_any_mask_holds_as_many_motions_as_it_names(mask):
    """Two free bodies: Phi is the residual's derivative, of full rank."""
    loops, q = loops_at(
        tree("", ["free-flyer"], ["free-flyer"], seed=4), Closure("A", "B", mask), seed=5
    )
    assert_jacobian_and_rate(loops, q, np.random.default_rng(6))
    assert np.linalg.matrix_rank(at(loops, q).Phi) == sum(mask) == len(loops.f)


@pytest.mark.parametrize("kind", Closure.KINDS)
def test_a_closure_holds_the_relative_twist_that_its_kind_names(kind):
    """Phi v = 0 for the motions that the kind leaves, in the axes of A, or of A and B."""
    model = tree("", ["free-flyer"], ["free-flyer"], seed=7)
    loops, q = loops_at(model, Closure("A", "B", kind), seed=8)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    A, B = (data.oMf[model.getFrameId(name)] for name in "AB")
    free = {
        "6d": [],
        "3d": [(0, e) for e in np.eye(3)],
        "orientation": [(e, 0) for e in np.eye(3)],
        "hinge": [(0, A.rotation[:, 2])],
        "universal": [(0, A.rotation[:, 0]), (0, B.rotation[:, 1])],
        "cylindrical": [(A.rotation[:, 2], 0), (0, A.rotation[:, 2])],
        "prismatic": [(A.rotation[:, 2], 0)],
        "planar": [(A.rotation[:, 0], 0), (A.rotation[:, 1], 0), (0, A.rotation[:, 2])],
    }[kind]
    J = pin.computeFrameJacobian(model, data, q, model.getFrameId("B"), pin.LOCAL_WORLD_ALIGNED)
    Phi = at(loops, q).Phi
    for linear, angular in free:
        twist = np.concatenate([np.zeros(3) + linear, np.zeros(3) + angular])
        v = np.linalg.pinv(J) @ twist
        assert_allclose(J @ v, twist, atol=1e-12)
        assert_allclose(Phi @ v, 0, atol=1e-9)  # closed to 1e-11, times lengths near 1
    assert np.linalg.matrix_rank(Phi) == 6 - len(free)


@pytest.mark.parametrize("kind", ["hinge", "cylindrical", "planar"])
def test_the_axes_of_a_closed_hinge_point_the_same_way(kind):
    """Opposed axes are no solution: from a guess turned by half a turn it leads back."""
    model = tree("", [], ["free-flyer"], seed=9)
    chain = ClosedChain(model, [Closure("A", "B", kind)], [])
    data = model.createData()
    for seed in range(10):
        q = chain.assemble(random_q(model, np.random.default_rng(seed), 2.0), fixed=())
        pin.framesForwardKinematics(model, data, q)
        z = [data.oMf[model.getFrameId(name)].rotation[:, 2] for name in "AB"]
        assert z[0] @ z[1] > 1 - 1e-12


def test_couplings_follow_their_polynomials():
    random = np.random.default_rng(0)
    model = pin.Model()
    for name in ("RY", "PX", "helical", "revolute", "spherical"):
        add_joint(model, model.njoints - 1, name, ALL_JOINTS[name](), random)
    coupling = Coupling(
        "PX", {"RY": (0.1, -2, 0, 0.3), "helical": (0, 0, 0.5), "revolute": (0,)}, 0.7
    )
    loops = Loops(model, [coupling, Coupling("RY", offset=-0.4)])
    q = random_q(model, random)
    expected = q[1] - 0.7 - (0.1 - 2 * q[0] + 0.3 * q[0] ** 3) - 0.5 * q[2] ** 2
    assert_allclose(at(loops, q).f, [expected, q[0] + 0.4], atol=1e-14)
    assert_jacobian_and_rate(loops, q, random)


def test_each_closure_among_others_has_the_rows_that_it_has_alone():
    """Closures of one kind are computed together, wherever they stand in the list."""
    random = np.random.default_rng(0)
    model = tree(*TREES["floating"], seed=1)
    for name in "CD":
        joint = int(random.integers(1, model.njoints))
        by_hand.mark(model, joint, name, pin.SE3.Random())
    closures = [
        Distance("A", "B", 0.7),
        Closure("C", "D", "3d"),
        Distance("C", "B", 0.3),
        Coupling("b0_revolute", {"a1_RY": (0, 0, 1)}),
        Closure("A", "D", "hinge"),
        Closure("B", "C", "3d"),
        Rolling("A", "C", 0.2),
        Closure("D", "B", "hinge"),
    ]
    q, v = random_q(model, random), random.normal(size=model.nv)
    loops = at(Loops(model, closures), q)
    alone = [at(Loops(model, [closure]), q) for closure in closures]
    assert_allclose(loops.f, np.concatenate([x.f for x in alone]), rtol=0, atol=1e-15)
    for together, rows in (
        (loops.Phi, [x.Phi for x in alone]),
        (loops.Phi_dot(v), [x.Phi_dot(v) for x in alone]),
        (loops.drift(v), [x.drift(v) for x in alone]),
    ):
        expected = np.concatenate(rows)
        assert_allclose(together, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_Phi_is_that_of_the_configuration_that_was_evaluated():
    """Although it is computed at its first use, when the caller may have changed q."""
    model = pin.Model()
    for name in ("driver", "follower"):
        model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), name)
    q = np.array([0.5, 0.25])
    loops = at(Loops(model, [Coupling("follower", {"driver": (0, 0, 1)})]), q)
    q[:] = 9.0
    assert_allclose(loops.Phi, [[-1.0, 1.0]])


def test_the_error_of_a_rod_whose_ends_coincide_is_its_length():
    model = pin.Model()
    slide = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    by_hand.mark(model, slide, "end", by_hand.at())
    loops = Loops(model, [Distance("universe", "end", 0.4)])
    assert at(loops, np.zeros(1)).f.tolist() == [-0.4]
    assert_allclose(at(loops, np.array([0.1])).f, -0.3, rtol=1e-15)


@pytest.mark.parametrize("ball", [False, True])
def test_what_rolls_stands_still_at_the_contact(ball):
    """The slip rows are the velocity of the wheel's material point at the contact, in the plane."""
    model = tree("", ["RY"], ["free-flyer"], seed=10)
    loops, q = loops_at(model, Rolling("A", "B", 0.25, ball=ball), seed=11)
    data, v = model.createData(), np.random.default_rng(12).normal(size=model.nv)
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    plane, wheel = (model.getFrameId(name) for name in "AB")
    A, B = data.oMf[plane], data.oMf[wheel]
    n, z = A.rotation[:, 2], B.rotation[:, 2]
    up = n if ball else (n - n @ z * z) / np.linalg.norm(n - n @ z * z)
    contact = B.translation - 0.25 * up
    assert abs(n @ (contact - A.translation)) < 1e-11

    def velocity(frame):
        twist = pin.getFrameVelocity(model, data, frame, pin.WORLD)
        return twist.linear + np.cross(twist.angular, contact)

    slip = A.rotation.T @ (velocity(wheel) - velocity(plane))
    assert_allclose(at(loops, q).Phi @ v, slip, atol=1e-12)


def test_every_joint_of_pinocchio_is_in_a_tree():
    used = {name for root, a, b in TREES.values() for name in (root, *a, *b) if name}
    types = {ALL_JOINTS[name]().shortname() for name in used}
    kinds = {"RY": "R", "PX": "P", "HZ": "H", "RUBX": "RUB"}
    offered = {name for name in dir(pin) if name.startswith("JointModel")} - {
        "JointModel",
        "JointModelMimic",
        "JointModelEllipsoid",
        *(f"JointModel{kind}{axis}" for kind in kinds.values() for axis in "XYZ"),
    }
    assert offered <= types
    assert {kinds[name] for name in used & set(kinds)} == set(kinds.values())
    model = tree("", [], ["free-flyer"])
    model.addJoint(1, pin.JointModelEllipsoid(0.3, 0.2, 0.1), pin.SE3.Identity(), "egg")
    with pytest.raises(DescriptionError, match="joint egg"):
        ClosedChain(model, [Closure("A", "B")], [])


def test_names_of_coordinates_and_rates_fit_every_joint():
    for name, parts in TREES.items():
        chain = ClosedChain(tree(*parts, seed=13), [Closure("A", "B", "3d")], [])
        model = chain.model
        space = chain.mechanism.space
        assert len(set(space.position_names)) == model.nq, name
        assert len(set(space.rate_names)) == model.nv, name
        random = np.random.default_rng(14)
        q, v = random_q(model, random), random.normal(size=model.nv)
        rate = derivative(lambda s, model=model, q=q, v=v: pin.integrate(model, q, s * v))
        assert_allclose(space.q_dot(q, v), rate, atol=1e-10)


def test_one_hinge_held_twice_moves_as_its_tree_does():
    """Every quantity has one column; the closure adds nothing."""
    model = pin.Model()
    body = pin.Inertia(2.0, np.array([0.3, 0.1, -0.2]), np.diag([0.1, 0.2, 0.15]))
    hinge = by_hand.add(model, 0, pin.JointModelRY(), "hinge", by_hand.at(), body)
    for name, joint in (("A", 0), ("B", hinge)):
        by_hand.mark(model, joint, name, by_hand.at(0, 0.5))
    chain = ClosedChain(model, [Closure("A", "B", "3d")], ["hinge"])

    assert all(row.passed for row in verify_chain(chain, 3))
    q, va = chain.assemble([0.4]), np.array([1.5])
    tau = chain.compute_torques(q, va, [-2.0])
    expected = pin.rnea(model, model.createData(), q, va, np.array([-2.0]))
    assert_allclose(tau, expected, rtol=1e-14)
    assert_allclose(chain.frame_jacobian(q, "B").ravel(), [0, 0, 0, 0, 1, 0], atol=1e-15)
    assert chain.noc(q, va).T.shape == (6, 1)


@pytest.mark.parametrize(
    ("contact", "kind"), [(pin.ContactType.CONTACT_3D, "3d"), (pin.ContactType.CONTACT_6D, "6d")]
)
def test_a_constraint_of_pinocchio_says_what_to_write(contact, kind):
    """The five-bar that follows the advice is closed as the one of the gallery."""
    robot = robots.five_bar()
    (closure,), model = robot.closures, pin.Model(robot.model)
    a, b = (model.frames[model.getFrameId(name)] for name in (closure.frame_a, closure.frame_b))
    ends = a.parentJoint, a.placement, b.parentJoint, b.placement
    c = pin.RigidConstraintModel(contact, model, *ends, pin.ReferenceFrame.LOCAL)
    with pytest.raises(InputError, match=f'and Closure."a", "b", "{kind}".') as caught:
        ClosedChain(model, [c], robot.motor_names)
    assert 'model.addFrame(pin.Frame("a", c.joint1_id, c.joint1_placement, ' in str(caught.value)
    model.addFrame(pin.Frame("a", c.joint1_id, c.joint1_placement, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("b", c.joint2_id, c.joint2_placement, pin.FrameType.OP_FRAME))
    chain = ClosedChain(model, [Closure("a", "b", "3d")], robot.motor_names)
    q = robot.home + 0.1
    assert np.array_equal(chain.residual(q), robot.residual(q))


@pytest.mark.parametrize("kind", ["3d", "6d"])
def test_errors_of_coincident_origins_do_not_turn_with_frame_A(kind):
    """In open loops too: so Newton's method closes them on the way that kernels take."""
    random = np.random.default_rng(5)
    turned = pin.SE3(pin.exp3(random.normal(size=3)), np.zeros(3))
    model = pin.Model()
    for name, parent in (("a", 0), ("b", 0), ("c", 2)):
        place = pin.SE3(pin.exp3(random.normal(size=3)), random.normal(size=3))
        joint = model.addJoint(parent, pin.JointModelSpherical(), place, name)
        model.addFrame(pin.Frame(name, joint, place, pin.OP_FRAME))
    model.addFrame(pin.Frame("a turned", 1, model.frames[1].placement * turned, pin.OP_FRAME))
    q = random_q(model, random)
    v = random.normal(size=model.nv)
    loops = at(Loops(model, [Closure("a", "c", kind)]), q)
    loops_of_turned = at(Loops(model, [Closure("a turned", "c", kind)]), q)
    assert np.abs(loops.f[:3]).max() > 0.1
    for x, y in (
        (loops.f, loops_of_turned.f),
        (loops.Phi, loops_of_turned.Phi),
        (loops.Phi_dot(v), loops_of_turned.Phi_dot(v)),
    ):
        assert_allclose(x[:3], y[:3], rtol=0, atol=1e-14)

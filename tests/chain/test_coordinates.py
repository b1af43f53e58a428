# SPDX-License-Identifier: BSD-2-Clause
"""The coordinates are chosen when a robot is made, from the robot alone."""

from itertools import permutations

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, Closure
from sst_pin.chain.draft import without_locked

BARS = {"crank": 0.2, "coupler": 0.3, "rocker": 0.25}


def body(model, parent, kind, x, name, mass=1.0):
    """A joint at (x, 0, 0) of its parent with a slender body along x; returns its index."""
    joint = model.addJoint(parent, kind, pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])), name)
    model.inertias[joint] = pin.Inertia(mass, np.array([0.1, 0, 0]), np.eye(3) * 0.01)
    return joint


def tip(model, joint, x, name):
    model.addFrame(pin.Frame(name, joint, pin.SE3(np.eye(3), np.array([x, 0, 0.0])), pin.OP_FRAME))


def slide_with_two_bars(unit=1.0):
    """A slide along x and two equal bars, one on the ground, one on the slide: a scissor's half.

    Folded, with the slide at zero, the bars turn together and the slide rests.
    """
    model = pin.Model()
    model.name = "scissor"
    slide = body(model, 0, pin.JointModelPX(), 0.0, "slide")
    bar_s = body(model, slide, pin.JointModelRY(), 0.0, "bar_s")
    bar_g = body(model, 0, pin.JointModelRY(), 0.0, "bar_g")
    tip(model, bar_s, 0.3 * unit, "end_s")
    tip(model, bar_g, 0.3 * unit, "end_g")
    return model, [Closure("end_s", "end_g", "3d")]


def rhombus():
    """Four equal bars; folded, crank and coupler turn together and the rocker rests."""
    model = pin.Model()
    model.name = "rhombus"
    crank = body(model, 0, pin.JointModelRY(), 0.0, "crank")
    coupler = body(model, crank, pin.JointModelRY(), 0.3, "coupler")
    rocker = body(model, 0, pin.JointModelRY(), 0.3, "rocker")
    tip(model, coupler, 0.3, "coupler_tip")
    tip(model, rocker, 0.3, "rocker_tip")
    return model, [Closure("coupler_tip", "rocker_tip", "3d")], np.array([0.7, np.pi, np.pi])


def test_the_motor_on_the_slide_is_the_coordinate():
    """The mode of assembly counts in which the motor holds the robot."""
    chain = ClosedChain(*slide_with_two_bars(), ["slide"])
    assert chain.coordinates == ("slide",)
    q = chain.assemble([0.2, 2.0, 1.0])
    assert q[0] == 0.2
    # The slide alone moves: all bodies fall or rise with the bars by symmetry.
    step = 1e-5
    energy = [chain.potential_energy(chain.assemble(np.add(q, [s, 0, 0]))) for s in (step, -step)]
    tau = chain.compute_torques(q, [0.0], [0.0])
    assert tau == pytest.approx((energy[0] - energy[1]) / (2 * step), rel=1e-6)


@pytest.mark.parametrize("folded_first", [False, True])
def test_coordinates_do_not_depend_on_what_was_called_before(folded_first):
    """A call in the other mode is refused by name and changes nothing."""
    model, closures, folded = rhombus()
    chain = ClosedChain(model, closures, ["rocker", "crank"])
    if folded_first:
        with pytest.raises(sst_pin.SingularConfigurationError, match="for example crank"):
            chain.compute_torques(folded, [1.0], [1.0])
    assert chain.coordinates == ("rocker",)
    open_mode = chain.assemble([0.7, -0.7, 0.7])
    assert chain.generalized_forces(open_mode, [1.0], [1.0]).shape == (1,)
    assert chain.coordinates == ("rocker",)


def test_home_decides_the_mode():
    """In the folded mode the rocker rests; there the crank is the coordinate."""
    model, closures, folded = rhombus()
    model.referenceConfigurations["home"] = folded
    chain = ClosedChain(model, closures, ["rocker", "crank"])
    assert chain.coordinates == ("crank",)
    assert np.isfinite(chain.generalized_forces(folded, [1.0], [1.0])).all()


@pytest.mark.parametrize("coordinates", [["slide"], ["bar_g"]])
def test_coordinates_of_the_caller_stand(coordinates):
    """Wherever they describe the motion; elsewhere the call says which others do."""
    chain = ClosedChain(*slide_with_two_bars(), ["slide"], coordinates=coordinates)
    assert chain.coordinates == tuple(coordinates)
    q = chain.assemble([0.2, 2.0, 1.0])
    assert chain.joint_rates(q, [1.0]).shape == (3,)
    assert chain.condition_number(q) < 100


@pytest.mark.parametrize("coordinates", [["crank", "rocker"], ["crank", "rocker", "coupler"]])
def test_too_many_coordinates_are_refused_at_a_configuration(coordinates):
    """The closures hold the coordinates themselves; rates that break them are no motion."""
    model, closures, _ = rhombus()
    chain = ClosedChain(model, closures, ["crank"], coordinates=coordinates)
    q = chain.assemble([0.7, -0.7, 0.7], ())
    n = np.ones(len(coordinates))
    with pytest.raises(sst_pin.SingularConfigurationError, match="for example crank describe"):
        chain.generalized_forces(q, n, n)


def test_no_coordinates_are_refused():
    model, closures, _ = rhombus()
    with pytest.raises(sst_pin.InputError, match="coordinates: none are named"):
        ClosedChain(model, closures, ["crank"], coordinates=[])
    with pytest.raises(sst_pin.InputError, match="coordinates: none are named"):
        ClosedChain(model, closures, ["crank"]).with_coordinates([])


def _four_bar(order, unit=1.0):
    """A four-bar whose joints are added in an order that keeps parents first."""
    model, of = pin.Model(), {}
    parents = {"crank": (None, 0.0), "coupler": ("crank", 0.2), "rocker": (None, 0.3)}
    for name in order:
        parent, x = parents[name]
        of[name] = body(model, of[parent] if parent else 0, pin.JointModelRY(), x * unit, name)
    tip(model, of["coupler"], 0.3 * unit, "a")
    tip(model, of["rocker"], 0.25 * unit, "b")
    return ClosedChain(model, [Closure("a", "b", "3d")], [])


def test_coordinates_do_not_depend_on_order_or_units():
    orders = [o for o in permutations(BARS) if o.index("crank") < o.index("coupler")]
    chosen = {_four_bar(order, unit).coordinates for order in orders for unit in (1.0, 1e3, 1e-3)}
    assert len(chosen) == 1


@pytest.mark.parametrize(
    ("kind", "other"),
    [
        (pin.JointModelUniversal(np.eye(3)[0], np.eye(3)[1]), "leg_1"),
        (pin.JointModelSpherical(), "leg_wx"),
        (pin.JointModelRUBZ(), "leg_cos"),
    ],
)
def test_a_name_of_two_rates_is_refused(kind, other):
    """`leg_1` would be a rate of the joint leg, or the joint leg_1."""
    model = pin.Model()
    leg = body(model, 0, kind, 0.0, "leg")
    end = body(model, leg, pin.JointModelRY(), 0.2, other)
    foot = body(model, 0, pin.JointModelRY(), 0.3, "foot")
    tip(model, end, 0.2, "a")
    tip(model, foot, 0.2, "b")
    with pytest.raises(sst_pin.DescriptionError, match=f"joints leg and {other}: {other} names a"):
        ClosedChain(model, [Closure("a", "b", "3d")], ["foot"])


@pytest.mark.parametrize("distance", [0.0, 1e3, 1e5])
def test_where_the_robot_stands_does_not_count(distance):
    """Loops open by 0.1 mm are open, assembled ones are closed, at any distance to the origin."""
    model, closures, _ = rhombus()
    moved = pin.Model(model)
    for joint in (1, 3):
        moved.jointPlacements[joint].translation += distance * np.array([0.6, 0.0, 0.8])
    chain = ClosedChain(moved, closures, ["rocker"])
    here = ClosedChain(model, closures, ["rocker"])
    q = chain.assemble([0.7, -0.7, 0.7])
    np.testing.assert_allclose(q, here.assemble([0.7, -0.7, 0.7]), atol=1e-9)
    # At 100 km the places of joints are rounded to 1.5e-11 m.
    tau = here.compute_torques(q, [1.0], [1.0])
    np.testing.assert_allclose(chain.compute_torques(q, [1.0], [1.0]), tau, rtol=1e-8)
    with pytest.raises(sst_pin.ClosureError):
        chain.compute_torques(np.add(q, [0, 3e-4, 0]), [1.0], [1.0])


def rod_between_two_balls(spin):
    """A crank and a rocker joined by a rod on two balls; `spin` is its inertia about itself."""
    model = pin.Model()
    crank = body(model, 0, pin.JointModelRZ(), 0.0, "crank")
    rocker = body(model, 0, pin.JointModelRY(), 0.4, "rocker")
    rod = model.addJoint(
        crank, pin.JointModelSpherical(), pin.SE3(np.eye(3), np.array([0.2, 0, 0])), "rod"
    )
    model.inertias[rod] = pin.Inertia(1.0, np.array([0.15, 0, 0]), np.diag([spin, 0.01, 0.01]))
    tip(model, rod, 0.3, "rod_end")
    tip(model, rocker, 0.2, "rocker_end")
    return ClosedChain(model, [Closure("rod_end", "rocker_end", "3d")], ["crank"])


def test_a_rod_without_spin_inertia_between_two_balls_is_named():
    """Its accelerations would be rounding; torques and a thick rod's accelerations are numbers."""
    thin, thick = rod_between_two_balls(0.0), rod_between_two_balls(1e-9)
    q, n = thin.generic_configuration(), thin.degrees_of_freedom
    state = q, np.zeros(n), [0.0]
    for ask in (
        lambda: thin.compute_accelerations(*state),
        lambda: thin.acceleration_derivatives(*state),
        lambda: thin.simulate([0.0], q, np.zeros(n), [0, 0.1]),
        lambda: thin.rollout(np.zeros((2, 1)), q, np.zeros(n), 1e-3),
    ):
        with pytest.raises(sst_pin.SingularConfigurationError, match=r"rod_w.* move no mass"):
            ask()
    assert np.isfinite(thin.generalized_forces(q, np.zeros(n), np.ones(n))).all()
    assert np.isfinite(thick.compute_accelerations(*state)).all()


def test_a_rod_without_spin_inertia_needs_no_motor_to_spin():
    """Rounding of where its axis passes is no force; a thick rod's spin needs one."""
    thin, thick = rod_between_two_balls(0.0), rod_between_two_balls(1e-3)
    random, q = np.random.default_rng(0), thin.generic_configuration()
    n, crank = thin.degrees_of_freedom, thin.mechanism.coordinate_rate_names.index("crank")
    at_rest = np.zeros((1, 2, n))
    for va, aa in [*at_rest, *random.normal(size=(10, 2, n))]:
        f = thin.generalized_forces(q, va, aa)
        np.testing.assert_allclose(thin.compute_torques(q, va, aa), [f[crank]], rtol=1e-9)
    with pytest.raises(sst_pin.ActuationError, match="no motor supplies the forces rod_w"):
        thick.compute_torques(q, va, aa)


def _tree_added_breadth_first(frames):
    """Joints 1 to 4 whose parents are 0, 1, 1, 2, in this order, with or without joint frames."""
    model, random = pin.Model(), np.random.default_rng(0)
    for parent, kind in zip((0, 1, 1, 2), ("RX", "RY", "RZ", "PX"), strict=True):
        place = pin.SE3(pin.exp3(random.normal(size=3)), random.normal(size=3))
        joint = model.addJoint(parent, getattr(pin, f"JointModel{kind}")(), place, kind)
        if frames:
            model.addJointFrame(joint)
        body_of = pin.Inertia(1.0, random.normal(size=3), 0.1 * np.eye(3))
        model.appendBodyToJoint(joint, body_of, pin.SE3.Identity())
    tip(model, 4, 0.2, "tip")
    model.armature = np.array([0.1, 0.2, 0.3, 0.4])
    model.referenceConfigurations["home"] = np.arange(4.0)
    return model


@pytest.mark.parametrize("frames", [False, True])
@pytest.mark.parametrize("locked", [[1], [2], [4], [2, 4], [1, 3]])
def test_locked_joints_stay_where_they_are_in_a_tree_of_any_order(locked, frames):
    """Forces and places are those of the whole tree with these joints at rest."""
    tree = _tree_added_breadth_first(frames)
    names, free = list(tree.names), [k for k in range(4) if k + 1 not in locked]
    q, v = np.random.default_rng(1).normal(size=(2, 4))
    v[[k - 1 for k in locked]] = 0.0
    fixed = without_locked(tree, {names[k]: q[k - 1] for k in locked})
    assert list(fixed.names)[1:] == [names[k + 1] for k in free]
    forces = pin.rnea(tree, tree.createData(), q, v, v)[free]
    data, whole = fixed.createData(), tree.createData()
    # Rounding of sums in another order.
    np.testing.assert_allclose(pin.rnea(fixed, data, q[free], v[free], v[free]), forces, atol=1e-12)
    pin.framesForwardKinematics(fixed, data, q[free])
    pin.framesForwardKinematics(tree, whole, q)
    found, wanted = (d.oMf[m.getFrameId("tip")] for m, d in ((fixed, data), (tree, whole)))
    np.testing.assert_allclose(found.homogeneous, wanted.homogeneous, atol=1e-12)
    assert fixed.referenceConfigurations["home"].tolist() == free

# SPDX-License-Identifier: BSD-2-Clause
"""The coordinates are chosen when a robot is made, from the robot alone."""

import warnings

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, Closure
from tests.support.by_hand import add, at, mark
from tests.support.planar_bars import planar, rhombus


def body(model, parent, kind, x, name, mass=1.0):
    """A joint at (x, 0, 0) of its parent with a slender body along x; returns its index."""
    inertia = pin.Inertia(mass, np.array([0.1, 0, 0]), np.eye(3) * 0.01)
    return add(model, parent, kind, name, at(x), inertia)


def slide_with_two_bars():
    """A slide along x and two equal bars, one on the ground, one on the slide: a scissor's half.

    Folded, with the slide at zero, the bars turn together and the slide rests.
    """
    model = pin.Model()
    model.name = "scissor"
    slide = body(model, 0, pin.JointModelPX(), 0.0, "slide")
    bar_s = body(model, slide, pin.JointModelRY(), 0.0, "bar_s")
    bar_g = body(model, 0, pin.JointModelRY(), 0.0, "bar_g")
    mark(model, bar_s, "end_s", at(0.3))
    mark(model, bar_g, "end_g", at(0.3))
    return model, [Closure("end_s", "end_g", "3d")]


def test_the_motor_on_the_slide_is_the_coordinate():
    """The mode of assembly counts in which the motor holds the robot."""
    chain = ClosedChain(*slide_with_two_bars(), ["slide"])
    assert chain.coordinates == ("slide",)
    q = chain.assemble([0.2, 2.0, 1.0])
    assert q[0] == 0.2


@pytest.mark.parametrize("pitch", [5e-3, 3e-4, 1e-5])
def test_the_motor_of_a_fine_lead_screw_is_the_coordinate(pitch):
    """However little it moves beside the screw; its force lifts both, by hand."""
    model = pin.Model()
    body(model, 0, pin.JointModelPX(), 0.0, "slide", mass=2.0)
    screw = body(model, 0, pin.JointModelRX(), 0.5, "screw")
    model.inertias[screw] = pin.Inertia(0.2, np.zeros(3), 1e-4 * np.eye(3))
    nut = sst_pin.Coupling("slide", {"screw": (0.0, pitch / (2 * np.pi))})
    chain = ClosedChain(model, [nut], ["slide"])
    assert chain.coordinates == ("slide",)
    tau = chain.compute_torques(np.zeros(2), [0.0], [1.0])
    assert tau == pytest.approx(2.0 + 1e-4 * (2 * np.pi / pitch) ** 2)


def test_a_tendon_holds_the_sum_of_its_joints_and_not_each():
    """What motors hold is the rank of L^T B."""
    model = pin.Model()
    for name in "ab":
        body(model, 0, pin.JointModelRY(), 0.0, name)
    two = ClosedChain(model, [], [{"a": 1.0, "b": 1.0}]).mobility()
    assert (two.held, two.sufficient, two.inner_stresses) == (1, False, 0)
    assert two.loose_joints == ("a", "b")
    # The bars turn against each other while the slide moves: their sum rests.
    scissor = ClosedChain(*slide_with_two_bars(), [{"bar_s": 1.0, "bar_g": 1.0}])
    still = scissor.mobility(scissor.assemble([0.2, 2.0, 1.0], ["slide"]))
    assert (still.held, still.inner_stresses) == (0, 1)
    assert set(still.loose_joints) == {"slide", "bar_s", "bar_g"}


@pytest.mark.filterwarnings("ignore:.*the closures hold the joints of the motors")
def test_coordinates_do_not_depend_on_what_was_called_before():
    model, closures, folded = rhombus()
    chain = ClosedChain(model, closures, ["rocker", "crank"])
    with pytest.raises(sst_pin.SingularConfigurationError, match="here crank"):
        chain.compute_torques(folded, [1.0], [1.0])
    assert chain.coordinates == ("rocker",)
    open_mode = chain.assemble([0.7, -0.7, 0.7])
    assert chain.generalized_forces(open_mode, [1.0], [1.0]).shape == (1,)
    assert chain.coordinates == ("rocker",)


def engine():
    """A crank, a rod and a piston on the slide along x."""
    model = pin.Model()
    model.name = "engine"
    crank = body(model, 0, pin.JointModelRY(), 0.0, "crank")
    rod = body(model, crank, pin.JointModelRY(), 0.1, "rod")
    piston = body(model, 0, pin.JointModelPX(), 0.0, "piston")
    mark(model, rod, "rod_tip", at(0.35))
    mark(model, piston, "pin", at(0.0))
    return model, [Closure("rod_tip", "pin", "3d")]


@pytest.mark.filterwarnings("ignore:.*the closures hold the joints of the motors")
@pytest.mark.parametrize(
    ("robot", "home", "motors", "coordinates"),
    [
        (rhombus, [0.7, np.pi, np.pi], ["rocker", "crank"], ("crank",)),
        (rhombus, [0.01, np.pi, np.pi], ["rocker", "crank"], ("crank",)),
        (rhombus, [0.01, -0.01, 0.01], ["rocker", "crank"], ("rocker",)),
        (slide_with_two_bars, [0.0, 0.5, 0.5], ["slide"], ("bar_g",)),
        (engine, [0.0, 0.0, 0.45], ["piston", "crank"], ("crank",)),
        (engine, [0.0, 0.0, 0.45], ["piston"], ("rod",)),
    ],
)
def test_coordinates_are_independent_at_home_itself(robot, home, motors, coordinates):
    """A motor that rests in its mode, or at its dead point there, moves nothing where one stands.

    The modes of a rhombus meet at its flat pose: home decides also close to it.
    """
    model, closures, *_ = robot()
    model.referenceConfigurations["home"] = np.array(home)
    chain = ClosedChain(model, closures, motors)
    assert chain.coordinates == coordinates
    assert np.array_equal(chain.home, home)
    assert chain.condition_number(chain.home) < 1e3
    q = chain.generic_configuration()
    assert 1e-3 < np.abs(q - home).max() < 0.2
    assert chain.condition_number(q) < 1e3


@pytest.mark.parametrize("coordinates", [["crank", "rocker"], ["crank", "rocker", "coupler"]])
def test_too_many_coordinates_are_refused_at_a_configuration(coordinates):
    """The closures hold the coordinates themselves; rates that break them are no motion."""
    model, closures, _ = rhombus()
    chain = ClosedChain(model, closures, ["crank"], coordinates=coordinates)
    q = chain.assemble([0.7, -0.7, 0.7], ())
    n = np.ones(len(coordinates))
    with pytest.raises(sst_pin.SingularConfigurationError, match="here crank describe"):
        chain.generalized_forces(q, n, n)


def test_a_singularity_of_the_mechanism_asks_for_no_other_coordinates():
    """Where a parallelogram is flat it has one more freedom; no joint alone describes it."""
    model, closures, _ = rhombus()
    chain = ClosedChain(model, closures, ["crank"])
    with pytest.raises(sst_pin.SingularConfigurationError) as caught:
        chain.joint_rates(np.zeros(3), [1.0])
    assert "the closures leave 2 freedoms here to 1 coordinates; move away" in str(caught.value)
    assert "or choose other" not in str(caught.value)


def test_a_home_with_a_zero_quaternion_is_named():
    model = pin.Model()
    body(model, 0, pin.JointModelSpherical(), 0.0, "ball")
    model.referenceConfigurations["home"] = np.zeros(4)
    with pytest.raises(sst_pin.DescriptionError, match="home: the quaternion at 0 is zero"):
        ClosedChain(model, [], [])


def test_a_singular_configuration_is_refused_without_warnings_of_numpy():
    """Neither where a robot is made nor in a call whose numbers nobody watches."""
    model, closures = engine()
    home = model.referenceConfigurations["home"] = np.array([0.0, 0.0, 0.45])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        chain = ClosedChain(model, closures, ["crank"], coordinates=["piston"])
        with pytest.raises(sst_pin.SingularConfigurationError):
            chain.noc(home, [1.0])


@pytest.mark.filterwarnings("ignore:.*the closures hold the joints of the motors")
def test_coordinates_of_another_mode_than_home_serve_where_they_hold():
    """Preload and limits are judged at the q given; compile and casadi ask for one."""
    model, closures, folded = rhombus()
    model.referenceConfigurations["home"] = folded
    chain = ClosedChain(model, closures, ["crank", "rocker"], coordinates=["rocker"])
    state = np.array([0.7, -0.7, 0.7]), [1.0], [1.0]
    B = chain.preload_directions(state[0])
    np.testing.assert_allclose(np.abs(B).ravel(), [0.5**0.5] * 2)  # both joints turn alike
    tau = chain.compute_torques(*state, limits=[100.0, 100.0])
    np.testing.assert_allclose(tau, chain.compute_torques(*state))
    batch = np.tile(folded, (2, 1))
    batch[1] = state[0]
    with pytest.raises(sst_pin.SingularConfigurationError):
        chain.preload_directions(batch)
    for ask in (chain.compile, chain.casadi):
        with pytest.raises(sst_pin.SingularConfigurationError, match="give q"):
            ask()
    chain.compile(state[0])
    np.testing.assert_allclose(chain.compute_torques(*state), tau)


def test_no_coordinates_are_refused():
    model, closures, _ = rhombus()
    with pytest.raises(sst_pin.InputError, match="coordinates: the list is empty"):
        ClosedChain(model, closures, ["crank"], coordinates=[])


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
    mark(model, end, "a", at(0.2))
    mark(model, foot, "b", at(0.2))
    with pytest.raises(sst_pin.DescriptionError, match=f"joints leg and {other}: {other} names a"):
        ClosedChain(model, [Closure("a", "b", "3d")], ["foot"])


def rod_between_two_balls(spin):
    """A crank and a rocker joined by a rod on two balls; `spin` is its inertia about itself."""
    model = pin.Model()
    crank = body(model, 0, pin.JointModelRZ(), 0.0, "crank")
    rocker = body(model, 0, pin.JointModelRY(), 0.4, "rocker")
    inertia = pin.Inertia(1.0, np.array([0.15, 0, 0]), np.diag([spin, 0.01, 0.01]))
    rod = add(model, crank, pin.JointModelSpherical(), "rod", at(0.2), inertia)
    mark(model, rod, "rod_end", at(0.3))
    mark(model, rocker, "rocker_end", at(0.2))
    return ClosedChain(model, [Closure("rod_end", "rocker_end", "3d")], ["crank"])


@pytest.mark.parametrize("spin", [0.0, 1e-14, 1e-10])
def test_a_rod_without_spin_inertia_between_two_balls_is_named(spin):
    """Its accelerations would be noise; torques and a thick rod's accelerations are numbers."""
    thin, thick = rod_between_two_balls(spin), rod_between_two_balls(1e-9)
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


def test_a_singular_home_is_named_with_the_joints_that_move_there_only():
    """A flat parallelogram: its coupler and rocker have one more freedom than beside home."""
    model, closures, _ = rhombus()
    model.referenceConfigurations["home"] = np.zeros(3)
    with pytest.warns(sst_pin.DescriptionWarning, match="1 more degree.*joints coupler, rocker"):
        chain = ClosedChain(model, closures, ["crank"])
    assert chain.coordinates == ("crank",)


def test_a_singular_home_is_named_without_the_joints_of_regular_loops():
    """Beside a flat parallelogram stands a square, which moves at home as it does elsewhere."""
    bars = [("crank", "universe", 0.0, 0.3), ("coupler", "crank", 0.3, 0.4)]
    bars += [("rocker", "universe", 0.4, 0.3)]
    bars += [("left", "universe", 1.0, 0.2), ("top", "left", 0.2, 0.2)]
    bars += [("right", "universe", 1.2, 0.2)]
    model = planar(bars)
    model.referenceConfigurations["home"] = np.array([0, 0, 0, 1, -1, 1]) * np.pi / 2
    closures = [
        Closure("coupler_end", "rocker_end", "3d"),
        Closure("top_end", "right_end", "3d"),
    ]
    text = "1 more degree.*in the joints crank, coupler, rocker;"
    with pytest.warns(sst_pin.DescriptionWarning, match=text):
        ClosedChain(model, closures, ["crank", "left"])

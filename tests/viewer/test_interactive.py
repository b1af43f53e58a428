# SPDX-License-Identifier: BSD-2-Clause
"""The page that answers: sliders move the closed robot, up to where it can go."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sst_pin
from browser import chromium, needs_browser, visit  # noqa: F401
from sst_pin import orientation
from sst_pin.sst.platform_motion import angles_of
from sst_pin.viewer import jog
from sst_pin.viewer.interactive import Interactive

SMALL = st.floats(-0.3, 0.3)
ANY = st.floats(-np.pi, np.pi)


@given(theta=ANY, phi=st.floats(0.01, 3.13), psi=ANY)
def test_angles_of_an_orientation_are_those_it_was_made_of(theta, phi, psi):
    R = orientation(theta, phi, psi)
    assert np.abs(orientation(*angles_of(R)) - R).max() < 1e-12


@pytest.fixture(scope="module")
def by_hand(robot):
    """The SST moved by its star, and by its motors, from home."""
    moved = jog.Jog(robot, robot.home, robot.star_radius)
    star, motors = moved.sliders
    return {
        "star": lambda goal, q=robot.home: moved.move(star, q, goal),
        "motors": lambda goal, q=robot.home: moved.move(motors, q, goal),
    }


@settings(max_examples=15, deadline=None)
@given(change=st.tuples(SMALL, SMALL, SMALL))
def test_the_star_goes_where_it_is_sent_and_stays_closed(robot, by_hand, change):
    """Small turns from home are within reach; closures hold to rounding."""
    goal = angles_of(robot.platform_orientation(robot.home)) + change
    pose = by_hand["star"](goal)
    assert not pose.stopped
    assert np.abs(robot.platform_orientation(pose.q) - orientation(*goal)).max() < 1e-12
    assert np.abs(robot.residual(pose.q)).max() < 1e-12


@settings(max_examples=15, deadline=None)
@given(change=st.tuples(SMALL, SMALL, SMALL))
def test_the_motors_go_where_they_are_sent_in_one_assembly(robot, by_hand, change):
    pose = by_hand["motors"](robot.home[::3] + change)
    assert not pose.stopped
    assert np.abs(pose.q[::3] - robot.home[::3] - change).max() < 1e-12
    assert np.abs(robot.residual(pose.q)).max() < 1e-12
    back = by_hand["motors"](robot.home[::3], pose.q)
    assert np.abs(back.q - robot.home).max() < 1e-9


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("sliders", ["star", "motors"])
def test_a_way_that_leads_too_far_ends_before_the_singularity(robot, by_hand, sliders, seed):
    """Wherever it ends the robot is closed, regular, and still where it can be moved."""
    goal = np.random.default_rng(seed).uniform(-np.pi, np.pi, 3)
    pose = by_hand[sliders](goal)
    assert np.abs(robot.residual(pose.q)).max() < 1e-9
    near = robot.singularities(pose.q)
    assert near.first_kind >= 0.05
    assert near.condition_number <= 50
    robot.compute_torques(pose.q, np.zeros(3), np.zeros(3))
    reached = {
        "star": lambda: orientation(*goal) - robot.platform_orientation(pose.q),
        "motors": lambda: goal - pose.q[::3],
    }[sliders]()
    assert bool(pose.stopped) == (np.abs(reached).max() > 1e-9)


@pytest.mark.parametrize(
    ("gamma", "reason"),
    [
        (
            (np.pi, np.pi / 4, np.pi / 4),
            "leg 3 is close to the plane of its arc, |sin mu_3| < 0.05",
        ),
        ((2.5, 2.5, 2.5), "close to a singularity (second kind), condition number > 50"),
    ],
)
def test_a_way_that_ends_says_why(by_hand, gamma, reason):
    assert by_hand["motors"](gamma).stopped == reason


@pytest.mark.parametrize("name", ["delta", "excavator", "hexaglide", "planar_4rrr", "bennett"])
def test_coordinates_of_any_robot_go_where_they_are_sent(name):
    """Angles and lengths; what is asked for is read again, and the loops hold."""
    chain = getattr(sst_pin.robots, name)()
    moved = jog.Jog(chain, chain.home, 0.2)
    assert sum((sliders.names for sliders in moved.sliders), ()) == chain.coordinates
    for sliders in moved.sliders:
        goal = sliders.read(chain.home) + 0.02 * (-1.0) ** np.arange(len(sliders.names))
        pose = moved.move(sliders, chain.home, goal)
        assert not pose.stopped
        assert np.abs(sliders.read(pose.q) - goal).max() < 1e-12
        assert np.abs(chain.residual(pose.q)).max() < 1e-10


def floating():
    """A body in space with two wheels, geared to each other, one of them driven."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    for k, name in enumerate(("wheel", "pinion"), start=2):
        model.addJoint(1, pin.JointModelRZ(), pin.SE3(np.eye(3), np.eye(3)[k - 2]), name)
    for k in (1, 2, 3):
        model.appendBodyToJoint(k, pin.Inertia.Random(), pin.SE3.Identity())
    gears = sst_pin.Coupling("pinion", {"wheel": (0, -0.5)})
    return sst_pin.ClosedChain(model, [gears], ["wheel"], coordinates=["body", "wheel"])


def test_a_body_that_floats_is_moved_about_and_along_its_axes():
    """Six coordinates of one joint read as the way from the start, along its twist."""
    chain = floating()
    model = chain.model
    start = pin.integrate(model, pin.neutral(model), np.array([*np.arange(6) / 7, 0, 0]))
    lengths, angles = jog.Jog(chain, start, 1.0).sliders
    assert (lengths.unit, angles.unit) == ("m", "rad")
    q = lengths.solve(np.array((0.1, 0.2, 0.3)), start)
    q = angles.solve(np.array((0.3, -0.2, 0.1, 0.4)), q)
    twist = np.array((0.1, 0.2, 0.3, 0.3, -0.2, 0.1, 0.4, -0.2))
    assert np.abs(pin.difference(model, start, q) - twist).max() < 1e-12
    assert np.abs(lengths.read(q) - twist[:3]).max() < 1e-12


def test_sliders_keep_to_limits_and_give_an_angle_without_them_one_turn():
    """Limits of the description; those of two turns or more, or infinite ones, are none."""
    chain = sst_pin.robots.four_bar()
    for limits, wanted in (
        ((-0.5, 2.0), (-0.5, 2.0)),
        ((-np.inf, np.inf), (-np.pi, np.pi)),
        ((-1e308, 1e308), (-np.pi, np.pi)),
        ((0.0, 0.1), (0.0, chain.home[0])),  # home is beyond them
    ):
        model = chain.model.copy()
        model.lowerPositionLimit[0], model.upperPositionLimit[0] = limits
        bounded = sst_pin.ClosedChain(model, chain.closures, chain.motor_names)
        (sliders,) = jog.Jog(bounded, chain.home, 0.1).sliders
        assert (*sliders.low, *sliders.high) == wanted


def test_a_rocker_is_stopped_where_its_linkage_is_straight():
    model = sst_pin.robots.four_bar()
    chain = sst_pin.ClosedChain(model.model, model.closures, ["rocker"])
    moved = jog.Jog(chain, model.home, 0.1)
    (sliders,) = moved.sliders
    start = sliders.read(model.home)
    pose = moved.move(sliders, model.home, start + 3)
    assert pose.stopped
    assert np.abs(chain.residual(pose.q)).max() < 1e-10
    assert not moved.move(sliders, pose.q, start).stopped


@pytest.fixture(scope="module")
def served(chromium, robot):  # noqa: F811
    """The page, opened and connected."""
    with Interactive(robot) as interactive, visit(chromium, interactive.url, 800, 600) as shown:
        shown.page.get_by_text("Loops closed, not singular").wait_for(timeout=30_000)
        yield interactive, shown


def row(page, name):
    """Label, slider and number of one coordinate."""
    return page.get_by_text(name, exact=True).locator("xpath=../../..")


def number(page, name):
    """The field beside a slider."""
    return row(page, name).locator("input[type=text]")


def wait_until(page, read, wanted):
    """Until the robot has come there, within the tenth of a degree that a slider resolves."""
    for _ in range(100):
        if abs(read() - wanted) < np.radians(0.051):
            break
        page.wait_for_timeout(50)
    assert read() == pytest.approx(wanted, abs=np.radians(0.051))


@pytest.mark.slow
@needs_browser
@pytest.mark.parametrize(
    ("name", "degrees", "read"),
    [
        ("theta", 60, lambda robot, q: angles_of(robot.platform_orientation(q))[0]),
        ("gamma_2", 30, lambda robot, q: q[3]),
    ],
)
def test_sliders_move_the_robot_and_closures_hold(served, robot, name, degrees, read):
    """By inverse and direct kinematics; torques and condition number are the package's."""
    interactive, shown = served
    before = shown.page.screenshot()
    number(shown.page, name).fill(str(degrees))
    wait_until(shown.page, lambda: read(robot, interactive.q), np.radians(degrees))
    q = interactive.q
    assert np.abs(robot.residual(q)).max() < 1e-9
    torques = robot.compute_torques(q, np.zeros(3), np.zeros(3)).round(3) + 0.0
    condition = robot.singularities(q).condition_number
    for text in (*(f"{value:.3f} N m" for value in torques), f"{condition:.2f}"):
        shown.page.get_by_role("cell", name=text, exact=True).first.wait_for(timeout=5000)
    assert shown.page.screenshot() != before
    row(shown.page, name).get_by_role("slider").press("ArrowRight")  # a tenth of a degree
    wait_until(shown.page, lambda: read(robot, interactive.q), np.radians(degrees + 0.1))


@pytest.mark.slow
@needs_browser
def test_the_page_stops_at_the_boundary_and_says_so(served, robot):
    """The slider goes back to where the robot is; Home leads out."""
    interactive, shown = served
    number(shown.page, "gamma_1").fill("180")
    shown.page.get_by_text("Stopped:").wait_for()
    assert np.abs(robot.residual(interactive.q)).max() < 1e-9
    shown.page.wait_for_timeout(200)
    stands = float(number(shown.page, "gamma_1").input_value())
    assert stands == pytest.approx(np.degrees(interactive.q[0]), abs=0.06)
    assert stands < 179
    shown.page.get_by_role("button", name="Home").click()
    shown.page.get_by_text("Loops closed, not singular").wait_for()
    assert np.abs(interactive.q - robot.home).max() == 0


@pytest.mark.slow
@needs_browser
def test_the_page_says_that_the_machine_cannot_stand_off_its_arcs(served):
    """theta 20, phi 170 deg: three carriages in the air. Home is a pose that it can take."""
    _, shown = served
    number(shown.page, "theta").fill("20")
    number(shown.page, "phi").fill("170")
    shown.page.get_by_text("The machine cannot reach this pose:").wait_for()
    problems = shown.page.get_by_text("beta_1 leaves its arc of 0 to 90 deg: -80 deg; beta_2")
    problems.wait_for()
    assert not shown.page.get_by_text("Loops closed, not singular").is_visible()
    shown.page.get_by_role("button", name="Home").click()
    shown.page.get_by_text("Loops closed, not singular").wait_for()


def test_the_page_of_another_robot_says_what_holds_it_still():
    """An excavator: degrees and millimetres; torques and forces by `compute_torques`."""
    chain = sst_pin.robots.excavator()
    with Interactive(chain) as page:
        assert np.abs(page.q - chain.home).max() == 0
        shown = {slider.label: slider.value for _, group in page._sliders for slider in group}
        units = [180 / np.pi, 1e3, 1e3, 1e3]
        wanted = units * chain.home[[chain.position_names.index(n) for n in chain.coordinates]]
        assert list(shown) == list(chain.coordinates)
        assert np.abs(np.array([*shown.values()]) - wanted).max() < 0.051
        tau = chain.compute_torques(page.q, np.zeros(4), np.zeros(4))
        for value, unit in zip(tau, ("N m", "N", "N", "N"), strict=True):
            assert f"| {value.round(3) + 0.0:.3f} {unit} |" in page._status.content
        assert "Loops closed, not singular." in page._status.content


def test_the_page_says_that_too_few_motors_hold_nothing():
    with Interactive(floating()) as page:
        assert "No torques hold this pose:" in page._status.content


@pytest.mark.slow
@needs_browser
def test_the_page_asks_only_this_machine_and_nothing_fails(served):
    interactive, shown = served
    assert interactive.url.startswith("http://127.0.0.1:")
    own = interactive.url.rstrip("/")
    assert shown.requests_elsewhere(own, own.replace("http", "ws")) == []
    assert shown.errors == []

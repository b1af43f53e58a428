# SPDX-License-Identifier: BSD-2-Clause
"""The page that answers: sliders move the closed robot, up to where it can go."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from browser import chromium, needs_browser, visit  # noqa: F401
from sst_pin import orientation
from sst_pin.viewer import jog
from sst_pin.viewer.interactive import Interactive

SMALL = st.floats(-0.3, 0.3)
ANY = st.floats(-np.pi, np.pi)


@given(theta=ANY, phi=st.floats(0.01, 3.13), psi=ANY)
def test_angles_of_an_orientation_are_those_it_was_made_of(theta, phi, psi):
    """theta, phi, psi there and back, up to turns."""
    R = orientation(theta, phi, psi)
    assert np.abs(orientation(*jog.angles_of(R)) - R).max() < 1e-12


@settings(max_examples=15, deadline=None)
@given(change=st.tuples(SMALL, SMALL, SMALL))
def test_the_star_goes_where_it_is_sent_and_stays_closed(robot, change):
    """Small turns from home are within reach; closures hold to rounding."""
    goal = jog.angles_of(robot.platform_orientation(robot.home)) + change
    pose = jog.move_star(robot, robot.home, goal)
    assert not pose.stopped
    assert np.abs(robot.platform_orientation(pose.q) - orientation(*goal)).max() < 1e-12
    assert np.abs(robot.residual(pose.q)).max() < 1e-12


@settings(max_examples=15, deadline=None)
@given(change=st.tuples(SMALL, SMALL, SMALL))
def test_the_motors_go_where_they_are_sent_in_one_assembly(robot, change):
    """gamma as asked for; back again is home again."""
    pose = jog.move_motors(robot, robot.home, robot.home[::3] + change)
    assert not pose.stopped
    assert np.abs(pose.q[::3] - robot.home[::3] - change).max() < 1e-12
    assert np.abs(robot.residual(pose.q)).max() < 1e-12
    back = jog.move_motors(robot, pose.q, robot.home[::3])
    assert np.abs(back.q - robot.home).max() < 1e-9


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("move", [jog.move_star, jog.move_motors])
def test_a_way_that_leads_too_far_ends_before_the_singularity(robot, move, seed):
    """Wherever it ends the robot is closed, regular, and still where it can be moved."""
    goal = np.random.default_rng(seed).uniform(-np.pi, np.pi, 3)
    pose = move(robot, robot.home, goal)
    assert np.abs(robot.residual(pose.q)).max() < 1e-9
    near = robot.singularities(pose.q)
    assert near.first_kind >= 0.05
    assert near.condition_number <= 50
    robot.compute_torques(pose.q, np.zeros(3), np.zeros(3))
    reached = {
        jog.move_star: lambda: orientation(*goal) - robot.platform_orientation(pose.q),
        jog.move_motors: lambda: goal - pose.q[::3],
    }[move]()
    assert bool(pose.stopped) == (np.abs(reached).max() > 1e-9)


@pytest.mark.parametrize(
    ("gamma", "reason"),
    [
        ((np.pi, np.pi / 4, np.pi / 4), "boundary of the workspace: leg 3 lies flat on its arc"),
        ((2.5, 2.5, 2.5), "singularity: the motors lose hold of the star"),
    ],
)
def test_a_way_that_ends_says_why(robot, gamma, reason):
    """Singularities of the first and of the second kind."""
    assert jog.move_motors(robot, robot.home, gamma).stopped == reason


@pytest.fixture(scope="module")
def served(chromium, robot):  # noqa: F811
    """The page, opened and connected."""
    with Interactive(robot) as interactive, visit(chromium, interactive.url, 800, 600) as shown:
        shown.page.get_by_text("Closed and movable").wait_for(timeout=30_000)
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
        ("theta", 60, lambda robot, q: jog.angles_of(robot.platform_orientation(q))[0]),
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
    shown.page.get_by_text("Closed and movable").wait_for()
    assert np.abs(interactive.q - robot.home).max() == 0


@pytest.mark.slow
@needs_browser
def test_the_page_says_that_the_machine_cannot_stand_off_its_arcs(served):
    """theta 20, phi 170 deg: three carriages in the air. Home is a pose that it can take."""
    _, shown = served
    number(shown.page, "theta").fill("20")
    number(shown.page, "phi").fill("170")
    shown.page.get_by_text("The machine cannot stand so:").wait_for()
    problems = shown.page.get_by_text("beta_1 leaves its arc of 0 to 90 deg; beta_2 leaves")
    problems.wait_for()
    assert not shown.page.get_by_text("Closed and movable").is_visible()
    shown.page.get_by_role("button", name="Home").click()
    shown.page.get_by_text("Closed and movable").wait_for()


@pytest.mark.slow
@needs_browser
def test_the_page_asks_only_this_machine_and_nothing_fails(served):
    """viser brings its own page."""
    interactive, shown = served
    assert interactive.url.startswith("http://127.0.0.1:")
    own = interactive.url.rstrip("/")
    assert shown.requests_elsewhere(own, own.replace("http", "ws")) == []
    assert shown.errors == []

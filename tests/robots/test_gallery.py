# SPDX-License-Identifier: BSD-2-Clause
"""The gallery against the literature's mobility; test_reference.py holds its dynamics."""

import pickle
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin import robots
from sst_pin.errors import InputError, WorkspaceError
from tests.gallery import EVERY_ROBOT
from tests.support.files import load
from tests.support.named_robots import robot_named

#: Degrees of freedom and redundant closure rows by the literature. Each planar loop of revolutes
#: closed at a point holds its plane once too often (Gruebler's formula with 3 instead of 6);
#: a spherical 3-RRR has three freedoms where Gruebler counts minus three, so its hinges are six
#: rows too many (Gosselin and Angeles, J. Mechanisms 111 (1989)); Bennett's linkage has one where
#: it counts minus two (Bennett 1903), Bricard's where it counts none (IFToMM library, A04); the
#: 6-UPS, 6-PUS, 3-UPS-PU and the delta with universal joints on its arms agree with Gruebler: 6, 6,
#: 3 and 3 (Merlet, Parallel Robots, 2006); so does the ankle: two.
MOBILITY = {
    "agile_eye": (3, 6),
    "agile_wrist": (3, 6),
    "andrews": (1, 3),
    "ankle": (2, 0),
    "bennett": (1, 3),
    "bricard": (1, 1),
    "delta": (3, 0),
    "excavator": (4, 4),
    "five_bar": (2, 1),
    "four_bar": (1, 1),
    "governor": (4, 0),
    "hexaglide": (6, 0),
    "knee": (1, 1),
    "ladder": (4, 4),
    "leg": (4, 1),
    "n_four_bar": (1, 2),
    "planar_3rrr": (3, 2),
    "planar_4rrr": (3, 3),
    "scissor_lift": (1, 4),
    "slider_crank": (1, 0),
    "stewart": (6, 0),
    "ups_pu": (3, 0),
}


@pytest.fixture(scope="module", params=MOBILITY)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def robot(name):
    return robot_named(name)


@pytest.fixture(scope="module")
def configurations(robot):
    """Random assembled configurations near home."""
    rates = np.random.default_rng(0).uniform(-1, 1, (5, robot.degrees_of_freedom))
    ways = (robot.joint_rates(robot.home, va) for va in rates)
    steps = (pin.integrate(robot.model, robot.home, 0.1 * v / np.abs(v).max()) for v in ways)
    return np.array([robot.assemble(q, fixed=()) for q in steps])


def test_the_gallery_is_complete():
    assert sorted(MOBILITY) == sorted(EVERY_ROBOT)


def test_mobility_is_that_of_the_literature(name, robot):
    report = robot.mobility(robot.home)
    assert (report.degrees_of_freedom, report.redundant_rows) == MOBILITY[name]
    assert report.sufficient
    assert report.condition_number < 100


def test_a_robot_is_a_closed_chain_with_a_platform(robot):
    """Home is assembled, and it is the inverse kinematics of its own pose; the chain pickles."""
    assert isinstance(robot, sst_pin.ClosedChain)
    assert np.abs(robot.residual(robot.home)).max(initial=0) < 1e-14  # rounding
    assert robot.model.existFrame("platform")
    pose = pin.SE3(robot.platform_pose(robot.home))
    assert_allclose(robot.inverse_kinematics(pose), robot.home, rtol=0, atol=1e-13)
    copy = pickle.loads(pickle.dumps(robot))
    assert_allclose(copy.inverse_kinematics(pose), robot.home, rtol=0, atol=1e-13)


def test_inverse_kinematics_closes_the_loops_and_holds_the_pose(name, robot, configurations):
    poses = robot.platform_pose(configurations)
    q = robot.inverse_kinematics(poses)
    # Closed forms: rounding of lengths below 3 m, divided by sines above 0.1.
    assert max(np.abs(robot.residual(sample)).max(initial=0) for sample in q) < 1e-13
    rows = slice(3 if name == "five_bar" else 0, 4)
    assert_allclose(robot.platform_pose(q)[..., rows], poses[..., rows], rtol=0, atol=1e-13)
    if name not in ("governor", "ladder"):  # which have more freedoms than their platform
        for given, sample in zip(configurations, q, strict=True):
            turned = pin.difference(robot.model, given, sample)
            # Newton's method ends at 1e-15, times the condition number.
            assert_allclose((turned + np.pi) % (2 * np.pi) - np.pi, 0, atol=1e-12)


def test_a_pose_out_of_reach_is_refused(name, robot):
    """Two kilometres away, but for the Stewart platform, whose struts have no end; NaN."""
    pose = robot.platform_pose(robot.home)
    pose[:3, 3] += 0 if name == "stewart" else 2000
    pose[:3, :3] *= 2 if name == "stewart" else 1  # no rotation
    for wrong, error in ((pose, WorkspaceError), (np.full((4, 4), np.nan), InputError)):
        with pytest.raises(error):
            robot.inverse_kinematics(wrong)


def test_a_pose_that_a_robot_of_few_freedoms_cannot_take_is_refused():
    delta = robots.delta()
    poses = np.stack([delta.platform_pose(delta.home)] * 2)
    poses[1, :3, :3] = pin.rpy.rpyToMatrix(0.1, 0, 0)
    with pytest.raises(WorkspaceError, match="cannot reach this pose") as caught:
        delta.inverse_kinematics(poses)
    assert caught.value.samples == ((1,),)


def test_every_body_has_a_physical_inertia_and_a_shape(robot):
    for joint, body in list(enumerate(robot.model.inertias))[1:]:
        a, b, c = np.linalg.eigvalsh(body.inertia)
        assert body.mass > 0
        assert 0 < a <= b <= c < a + b
        shapes = [s.name for s in robot.visual_model.geometryObjects if s.parentJoint == joint]
        assert not all(name.startswith("joint_") for name in shapes)


def test_bennetts_linkage_moves_where_its_lengths_allow_it_only():
    """With other lengths than the sines' the four bars make a rigid frame."""
    moving = robots.bennett()
    model = moving.model.copy()
    frame = model.frames[model.getFrameId("follower_pin")]
    frame.placement = pin.SE3(frame.placement.rotation, 1.1 * frame.placement.translation)
    rigid = sst_pin.ClosedChain(model, moving.closures, ["crank"])
    assert np.linalg.matrix_rank(rigid.Phi(moving.home), 1e-6) == 3


def test_bennetts_linkage_with_equal_twists_stays_folded():
    """All bars are equal. The coupler lies on the crank, and the follower on the base."""
    chain = robots.bennett(twist=0.5, coupler_twist=0.5)
    assert chain.mobility(chain.home).degrees_of_freedom == 1
    np.testing.assert_allclose(chain.home[1], np.pi)


def test_the_page_of_the_gallery_is_current(tmp_path, monkeypatch):
    """Counts to the letter, errors to two orders of magnitude; and its example runs."""
    script = load("scripts/pages/make_robots_table.py")
    assert script.main(["--check"]) == 0
    page, scope = script.PAGE.read_text(encoding="utf-8"), {}
    monkeypatch.chdir(tmp_path)  # the example saves a page
    exec(page.split("```python")[1].split("```")[0], scope)
    # The struts hold up platform and themselves: the weight of the platform at least.
    assert sum(scope["tau"]) > 20 * 9.81


@pytest.mark.parametrize("build", [robots.agile_eye, robots.agile_wrist])
def test_the_home_of_the_agile_eye_is_isotropic(build):
    """Motors turn the platform alike in every direction (Gosselin and Hamel 1994)."""
    robot = build()
    turning = robot.frame_jacobian(robot.home, "platform")[3:]
    assert_allclose(turning @ turning.T, np.eye(3), rtol=0, atol=1e-14)  # rounding


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (partial(robots.scissor_lift, 0), "cells: 0, expected at least 1"),
        (partial(robots.delta, arm=0.0), "arm:"),
        (partial(robots.five_bar, span=np.nan), "span:"),
        (partial(robots.hexaglide, rails=(0, 1, 2)), "rails:"),
        (partial(robots.bennett, crank="long"), "crank:"),
        (partial(robots.four_bar, rocker=[1, 2]), "rocker:"),
        (partial(robots.delta, forearm=0.1), ".* do not close at home"),
        (partial(robots.hexaglide, strut=0.1), ".* do not close at home"),
        (partial(robots.four_bar, rocker=0.01), ".* do not close at home"),
        (partial(robots.stewart, retracted=0.01), ".* do not close at home"),
    ],
)
def test_dimensions_that_no_robot_has_are_refused(call, said):
    with pytest.raises((InputError, WorkspaceError), match=f"^{said}"):
        call()

# SPDX-License-Identifier: BSD-2-Clause
"""The geometry from heights, distances and incomplete poses, and of unknown measuring systems."""

import importlib.util
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin.errors import InputError
from sst_pin.identification import Distances, Heights, Poses, calibrate, calibrate_with
from sst_pin.identification.error_fit import ErrorFit
from tests.support.files import ROOT
from tests.support.standard_errors import RUNS, assert_deviations_are_those_of_errors

SPEC = importlib.util.spec_from_file_location("printer", ROOT / "examples" / "delta_printer.py")
PRINTER = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(PRINTER)

MOTORS = ["motor_*.ry"]
#: What heights on a bed tell: end stops, the radius of one tower, and the angles of two.
SEEN = [f"tower_{k}.z" for k in (1, 2, 3)] + ["tower_1.x", "tower_1.y", "tower_2.y"]


def configurations_of(chain, x):
    return np.array([chain.assemble(dict(zip(chain.coordinates, each, strict=True))) for each in x])


def poses_of(chain, x, frame="platform"):
    p, R = chain.frame_placement(configurations_of(chain, x), frame)
    poses = np.tile(np.eye(4), (len(x), 1, 1))
    poses[:, :3, 3], poses[:, :3, :3] = p, R
    return poses


@cache
def delta():
    """A delta as drawn, one whose motors are off, their errors, positions, and poses there."""
    drawn, random = sst_pin.robots.delta(), np.random.default_rng(8)
    errors = {f"motor_{k}.ry": float(5e-3 * random.normal()) for k in (1, 2, 3)}
    at_home = [drawn.home[drawn.position_names.index(name)] for name in drawn.coordinates]
    x = at_home + random.uniform(-0.3, 0.3, (14, 3))
    return drawn, errors, x, poses_of(drawn.with_design(errors), x)


def assert_found(result, errors, atol=1e-10):
    found = dict(zip(result.names, result.values, strict=True))
    assert_allclose([found[name] for name in errors], list(errors.values()), atol=atol)


def test_entries_that_were_not_measured_are_left_out():
    drawn, errors, x, poses = delta()
    some = poses.copy()
    some[::2, :3, 3] = np.nan
    some[1::3, 0, 3] = np.nan
    some[::3, :3, :3] = np.nan
    assert_found(calibrate(drawn, "platform", x, some, which=MOTORS), errors)
    noise = np.random.default_rng(0).normal(scale=1e-5, size=(14, 3))
    heights = poses[:, :3, 3] + noise
    heights[:, :2] = np.nan
    one = calibrate(drawn, "platform", x, heights, which=MOTORS)
    two = calibrate_with(drawn, [Heights("platform", x, heights=heights[:, 2])], which=MOTORS)
    assert_allclose(one.values, two.values, rtol=1e-9)
    assert_allclose(one.covariance, two.covariance, rtol=1e-6)


def test_heights_along_any_direction_tell_the_motors():
    drawn, errors, x, poses = delta()
    directions = np.random.default_rng(1).normal(size=(14, 3))
    along = np.vecdot(poses[:, :3, 3], directions / np.linalg.norm(directions, axis=1)[:, None])
    heights = Heights("platform", x, heights=along, direction=directions)
    assert_found(calibrate_with(drawn, [heights], which=MOTORS), errors)


def test_a_ball_bar_from_an_unknown_post_tells_the_motors_and_the_post():
    drawn, errors, x, poses = delta()
    post = np.array([0.1, -0.05, -0.4])
    lengths = np.linalg.norm(poses[:, :3, 3] - post, axis=1)
    model = pin.Model(drawn.model)
    near = pin.SE3(np.eye(3), post + np.array([0.002, -0.001, 0.003]))
    model.addFrame(pin.Frame("post", 0, near, pin.FrameType.OP_FRAME))
    bar = Distances("platform", x, distances=lengths, other="post")
    which = [*MOTORS, "post.[xyz]"]
    result = calibrate_with(drawn.with_model(model), [bar], which=which)
    assert_found(result, errors | {"post.x": -0.002, "post.y": 0.001, "post.z": -0.003})


@pytest.mark.parametrize("post", [(0.1, -0.05, -0.4), (0.5, 0.3, 0.2), (-0.2, 0.1, -0.6)])
def test_a_ball_bar_whose_post_is_unknown_tells_the_motors_and_the_post(post):
    """The post may be anywhere: its first guess is that of trilateration."""
    drawn, errors, x, poses = delta()
    lengths = np.linalg.norm(poses[:, :3, 3] - post, axis=1)
    bar = Distances("platform", x, distances=lengths, unknown_base=True, name="post")
    result = calibrate_with(drawn, [bar], which=MOTORS)
    assert_found(result, errors)
    assert_allclose(result.placements["post_base"][:3, 3], post, atol=1e-9)
    assert {"post_base.rx", "post_base.ry", "post_base.rz"} <= set(result.hidden)


def test_a_ball_bar_in_the_plane_of_a_planar_robot_tells_its_post():
    drawn = sst_pin.robots.five_bar()
    angles = drawn.home[[drawn.position_names.index(name) for name in drawn.coordinates]]
    x = angles + np.random.default_rng(0).uniform(-0.2, 0.2, (12, 2))
    (first,) = [name for name in drawn.coordinates if name.endswith("1")]
    real = drawn.with_design({f"{first}.length": 1e-3})
    p = real.frame_placement(configurations_of(real, x), "platform")[0]
    normal = np.linalg.svd(p - p.mean(axis=0))[2][2]
    post = p.mean(axis=0) + np.array([0.2, 0.1, 0.15])
    post -= normal * (normal @ (post - p.mean(axis=0)))
    bar = Distances("platform", x, distances=np.linalg.norm(p - post, axis=1), unknown_base=True)
    result = calibrate_with(drawn, [bar], which=["elbow_1.x"])
    assert_found(result, {"elbow_1.x": 1e-3}, atol=1e-9)
    assert_allclose(result.placements["measured_base"][:3, 3], post, atol=1e-9)


def test_a_tracker_with_unknown_base_and_target_is_placed_with_the_robot():
    drawn, errors, x, poses = delta()
    tracker = pin.SE3(pin.exp3(np.array([0.3, -1.0, 2.0])), np.array([2.0, 1.0, 0.5]))
    target = np.array([0.01, 0.02, 0.03])
    seen = poses[:, :3, 3] + poses[:, :3, :3] @ target
    measured = (seen - tracker.translation) @ tracker.rotation
    system = Poses(
        "platform", x, poses=measured, unknown_base=True, unknown_target=True, name="tracker"
    )
    which = ["motor_*.ry", "rod_1a.x"]
    result = calibrate_with(drawn, [system], which=which)
    # The platform does not turn: its target's offset looks like one of the base.
    assert {f"tracker_target.{axis}" for axis in ("rx", "ry", "rz")} <= set(result.hidden)
    again = result.chain.frame_placement(configurations_of(result.chain, x), "platform")
    placed, held = pin.SE3(result.placements["tracker_base"]), result.placements["tracker_target"]
    there = again[0] + again[1] @ held[:3, 3]
    assert_allclose((there - placed.translation) @ placed.rotation, measured, atol=1e-9)
    moves = dict(zip(result.names, result.values, strict=True))
    assert {name for name in moves if not name.startswith("tracker")} >= set(errors) - {
        *result.hidden
    }


def test_what_only_moves_the_robot_as_a_whole_is_hidden_behind_an_unknown_base():
    chain = sst_pin.robots.four_bar()
    x = chain.home[:1] + np.linspace(-0.4, 0.4, 12)[:, None]
    seen = poses_of(chain, x)[:, :3, 3]
    system = Poses("platform", x, poses=seen, unknown_base=True)
    which = ["crank.x", "crank.z", "rocker.x", "rocker.z", "crank.length"]
    with pytest.raises(sst_pin.UnknownNameError):
        calibrate_with(chain, [system], which=which)
    result = calibrate_with(chain, [system], which=which[:4])
    assert "rocker.x" in result.hidden or "rocker.z" in result.hidden
    assert {"measured_base.x", "measured_base.z"} <= {*result.names}
    assert_allclose(result.values, 0, atol=1e-9)


def test_each_kind_has_its_own_noise():
    drawn, errors, _, _ = delta()
    random = np.random.default_rng(5)
    at_home = [drawn.home[drawn.position_names.index(name)] for name in drawn.coordinates]
    x = at_home + random.uniform(-0.3, 0.3, (60, 3))
    start = configurations_of(drawn, x)
    p = drawn.with_design(errors).frame_placement(
        drawn.with_design(errors).assemble(start), "platform"
    )[0]
    heights = p[:, 2] + 1e-5 * random.normal(size=60)
    probe = Heights("platform", x, heights=heights, start=start)
    lengths = np.linalg.norm(p, axis=1) + 3e-4 * random.normal(size=60)
    tape = Distances("platform", x, distances=lengths, start=start)
    result = calibrate_with(drawn, [probe, tape], which=MOTORS)
    # Of 60 values each; three of their standard deviations are 27 percent.
    assert_allclose(result.noise, [1e-5, 3e-4], rtol=0.27)
    off = np.abs(result.values - [errors[name] for name in result.names])
    assert (off < 3 * result.deviations).all()
    alone = calibrate_with(drawn, [probe], which=MOTORS)
    assert (result.deviations <= alone.deviations * 1.3).all()


@pytest.mark.parametrize("count", [7, 16, 50])
def test_heights_of_a_bed_tell_six_numbers_of_a_delta_printer(count):
    """Its placement on the bed is hidden: two radii and an angle follow from the first ones."""
    drawn, random = PRINTER.printer(), np.random.default_rng(0)
    errors = {name: float(2e-4 * random.normal()) for name in SEEN}
    where = PRINTER.points(count)
    at = [drawn.position_names.index(tower) for tower in PRINTER.TOWERS]
    real = drawn.with_design(errors)
    q = drawn.frame_configuration("nozzle", np.column_stack([where, 0 * where[:, 0]]))
    heights = real.frame_placement(real.assemble(q), "nozzle")[0][:, 2]
    probe = Heights("nozzle", q[:, at], heights=heights, noise=1e-5, start=q)
    result = calibrate_with(drawn, [probe], which=PRINTER.WHICH)
    assert sorted(result.names) == sorted(SEEN)
    assert set(result.hidden) == set(PRINTER.WHICH) - set(SEEN)
    assert_found(result, errors, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("count", [7, 16])
def test_errors_of_a_printer_have_the_standard_deviations_of_the_result(count):
    drawn, random = PRINTER.printer(), np.random.default_rng(1)
    errors = {name: float(3e-4 * random.normal()) for name in SEEN}
    at = [drawn.position_names.index(tower) for tower in PRINTER.TOWERS]
    where = PRINTER.points(count)
    q = drawn.frame_configuration("nozzle", np.column_stack([where, 0 * where[:, 0]]))
    real = drawn.with_design(errors)
    exact = real.frame_placement(real.assemble(q), "nozzle")[0][:, 2]
    noise = 1e-5 if count == 7 else None  # one degree of freedom cannot tell it
    ratios, noises = [], []
    for seed in range(RUNS):
        heights = exact + 1e-5 * np.random.default_rng(seed).normal(size=count)
        probe = Heights("nozzle", q[:, at], heights=heights, noise=noise, start=q)
        result = calibrate_with(drawn, [probe], which=SEEN)
        assert not result.hidden
        true = np.array([errors[name] for name in result.names])
        noises.append(result.noise[0])
        ratios.append((result.values - true) / (result.deviations * 1e-5 / result.noise[0]))
    assert_deviations_are_those_of_errors(ratios)
    # Within four standard deviations: each run has as many degrees of freedom as values to spare.
    spare = RUNS * (count - len(SEEN))
    assert_allclose(np.mean(np.square(noises)), 1e-10, rtol=4 * np.sqrt(2 / spare))


def test_values_that_are_too_few_for_their_noise_are_refused_at_once(monkeypatch):
    """Three heights that tell three errors leave none for their noise; hiding errors is no cure."""
    drawn, _, x, poses = delta()
    coarse = Poses("platform", x, poses=poses, noise=(1.0, 1.0))
    heights = Heights("platform", x[:3], heights=poses[:3, 2, 3])
    fits = []
    estimate = ErrorFit.estimate
    monkeypatch.setattr(ErrorFit, "estimate", lambda *x: fits.append(x) or estimate(*x))
    with pytest.raises(InputError, match="noise: 3 values are too few to estimate it"):
        calibrate_with(drawn, [coarse, heights], which=MOTORS)
    assert len(fits) == 1


def test_wrong_measurements_are_refused():
    drawn, _, x, poses = delta()
    z = poses[:, 2, 3]
    with pytest.raises(InputError, match="at least one of Poses, Heights, Distances"):
        calibrate_with(drawn, [])
    with pytest.raises(InputError, match="heights: shape"):
        calibrate_with(drawn, [Heights("platform", x, heights=z[:3])])
    with pytest.raises(InputError, match="direction: zero"):
        calibrate_with(drawn, [Heights("platform", x, heights=z, direction=(0, 0, 0))])
    with pytest.raises(InputError, match="must be positive"):
        calibrate_with(drawn, [Distances("platform", x, distances=-z * 0 - 1)])
    some = poses.copy()
    some[2, 0, 1] = np.nan
    with pytest.raises(InputError, match="measured whole"):
        calibrate(drawn, "platform", x, some)
    for noise in (1e-3, (1e-3,), (1e-3, 1e-3, 1e-3)):
        with pytest.raises(InputError, match="noise: of poses: two numbers"):
            calibrate_with(drawn, [Poses("platform", x, poses=poses, noise=noise)], which=MOTORS)
    for bad in ([[1.0, 2.0], [3.0]], poses[:, :3, :3], poses[0, 0, 0]):  # before the noise
        with pytest.raises(InputError, match=r"^poses: "):
            calibrate_with(drawn, [Poses("platform", x, poses=bad, noise=1e-3)], which=MOTORS)
    for noise in ((1e-3, 1e-3), ()):
        with pytest.raises(InputError, match="expected one number"):
            calibrate_with(drawn, [Heights("platform", x, heights=z, noise=noise)], which=MOTORS)
    few = Heights("platform", x[:3], heights=z[:3])
    with pytest.raises(InputError, match="3 equations for 3 errors"):
        calibrate_with(drawn, [few], which=MOTORS)
    three = Distances("platform", x[:3], distances=np.ones(3), unknown_base=True)
    with pytest.raises(InputError, match="at least four values"):
        calibrate_with(drawn, [three], which=MOTORS)
    flat = sst_pin.robots.five_bar()
    angles = flat.home[[flat.position_names.index(name) for name in flat.coordinates]]
    around = angles + np.random.default_rng(0).uniform(-0.2, 0.2, (12, 2))
    q = configurations_of(flat, around)
    above = flat.frame_placement(q, "platform")[0] - [0.1, 0.3, 0.2]  # it moves in one plane
    lengths = np.linalg.norm(above, axis=1)
    bar = Distances("platform", around, distances=lengths, unknown_base=True)
    with pytest.raises(InputError, match="is on one of its sides; give a frame near it, other="):
        calibrate_with(flat, [bar])
    base = Poses("platform", x[:2], poses=poses[:2, :3, 3], unknown_base=True)
    with pytest.raises(InputError, match="at least three whole positions"):
        calibrate_with(drawn, [base], which=MOTORS)


def test_a_noise_that_does_not_explain_what_is_left_is_told():
    drawn, _, x, poses = delta()
    z = poses[:, 2, 3] + 1e-3 * np.random.default_rng(0).normal(size=14)
    with pytest.warns(sst_pin.DescriptionWarning, match="times the given noise"):
        calibrate_with(drawn, [Heights("platform", x, heights=z, noise=1e-6)], which=MOTORS)


def _bars(coupler):
    """A four-bar in the plane x, z whose coupler is a body with an end."""
    model = pin.Model()
    bars = ("crank", "universe", (0, 0, 0)), ("rocker", "universe", (0.25, 0, 0))
    for name, parent, place in (*bars, ("coupler", "crank", (0, 0, 0.1))):
        at = pin.SE3(np.eye(3), np.array(place, dtype=float))
        joint = model.addJoint(model.getJointId(parent), pin.JointModelRY(), at, name)
        body = pin.Inertia(0.1, np.zeros(3), 1e-3 * np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    for name, body, place in (("tip", "rocker", (0, 0, 0.2)), ("end", "coupler", (coupler, 0, 0))):
        at = pin.SE3(np.eye(3), np.array(place, dtype=float))
        model.addFrame(pin.Frame(name, model.getJointId(body), at, pin.FrameType.OP_FRAME))
    return sst_pin.ClosedChain(model, [sst_pin.Closure("end", "tip", "3d")], ["crank"])


def test_the_length_of_a_rod_that_is_a_body_is_an_error_of_its_end():
    """Exact positions of the rocker's tip; the coupler is 1 mm longer than drawn."""
    drawn, real = _bars(0.3), _bars(0.301)
    x = np.linspace(-1, 1, 12)[:, None]
    start = {"coupler": 0.1, "rocker": 0.2}
    drawn_q, real_q = (
        [robot.assemble({"crank": angle} | start, fixed=["crank"]) for (angle,) in x]
        for robot in (drawn, real)
    )
    places = real.frame_placement(np.array(real_q), "tip")[0]
    result = calibrate(drawn, "tip", x, places, which=["end.x"], start=drawn_q)
    assert result.values == pytest.approx([1e-3], rel=1e-9)

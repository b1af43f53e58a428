# SPDX-License-Identifier: BSD-2-Clause
"""Lengths of rods from measurements; the referee has positions in closed form."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin.identification import Heights, calibrate, calibrate_with
from tests.support.rods import (
    delta_points,
    hexaglide,
    hexaglide_configuration,
    rod_delta,
)
from tests.support.standard_errors import RUNS, assert_deviations_are_those_of_errors

DELTA_RODS = [f"elbow_{k} - ball_{k}.length" for k in (1, 2, 3)]
HEXAGLIDE_RODS = [f"carriage_{k} - ball_{k}.length" for k in range(1, 7)]


def angles(count: int) -> np.ndarray:
    return 0.3 + np.random.default_rng(0).uniform(-0.4, 0.4, (count, 3))


def assert_values(result, expected, atol):
    values = dict(zip(result.names, result.values, strict=True))
    assert_allclose([values[name] for name in expected], list(expected.values()), atol=atol)


def test_positions_tell_the_lengths_of_the_rods_of_a_delta():
    errors = [1e-3, -2e-3, 5e-4]
    points = delta_points(0.36 + np.array(errors), angles(12))
    which = ["*.length", "motor_?.ry"]
    result = calibrate(rod_delta([0.36] * 3), "platform", angles(12), points, which=which)
    # Newton's method stops at steps of 1e-9 lengths, and converges quadratically.
    assert_values(result, dict(zip(DELTA_RODS, errors, strict=True)), 1e-11)
    lengths = [closure.distance for closure in result.chain.closures]
    assert_allclose(lengths, 0.36 + np.array(errors), atol=1e-11)


def hexaglide_measurements(errors):
    """Joints as drawn and as they are, in 12 poses that were measured."""
    random = np.random.default_rng(1)
    turns, places = random.uniform(-0.1, 0.1, (2, 12, 3))
    poses = [
        pin.SE3(pin.rpy.rpyToMatrix(*turn), place)
        for turn, place in zip(turns, places, strict=True)
    ]
    start = np.array([hexaglide_configuration(np.full(6, 0.5), pose) for pose in poses])
    q = np.array([hexaglide_configuration(0.5 + errors, pose) for pose in poses])
    return start, q, np.array([pose.homogeneous for pose in poses])


def test_poses_tell_the_lengths_of_the_rods_of_a_hexaglide():
    """Orientations of the platform too, in quaternions."""
    errors = 1e-3 * np.random.default_rng(2).normal(size=6)
    start, q, measured = hexaglide_measurements(errors)
    drawn = hexaglide([0.5] * 6)
    result = calibrate(drawn, "platform", q[:, 7:], measured, which=["*.length"], start=start)
    assert_values(result, dict(zip(HEXAGLIDE_RODS, errors, strict=True)), 1e-11)


@pytest.mark.slow
def test_by_default_lengths_and_places_are_considered_together():
    """Some are hidden; the calibrated robot is the real one in other poses."""
    errors = 1e-3 * np.random.default_rng(2).normal(size=6)
    start, q, measured = hexaglide_measurements(errors)
    result = calibrate(hexaglide([0.5] * 6), "platform", q[:, 7:], measured, start=start)
    assert set(HEXAGLIDE_RODS) <= {*result.names}
    assert result.hidden
    pose = pin.SE3(pin.rpy.rpyToMatrix(0.05, -0.1, 0.1), np.array([0.02, 0.05, 0.03]))
    again = result.chain.assemble(hexaglide_configuration(0.5 + errors, pose))
    p, R = result.chain.frame_placement(again, "platform")
    # 72 values without noise tell them; their conditions multiply the rounding.
    assert_allclose(p, pose.translation, atol=1e-8)
    assert_allclose(R, pose.rotation, atol=1e-8)


def test_a_length_that_acts_as_another_error_is_hidden():
    """At one angle of the arms, a longer rod and an elbow that is elsewhere look alike."""
    drawn = rod_delta([0.36] * 3)
    x = np.full((8, 3), 0.3)
    points = delta_points([0.361] * 3, x)
    result = calibrate(drawn, "platform", x, points, which=["elbow_1 - *.length", "elbow_1.x"])
    assert result.names == ("elbow_1 - ball_1.length",)
    assert result.hidden == ("elbow_1.x",)


@pytest.mark.slow
def test_errors_of_rods_have_the_standard_deviations_of_the_result():
    drawn, x = rod_delta([0.36] * 3), angles(30)
    errors = np.array([4e-4, -3e-4, 6e-4])
    exact = delta_points(0.36 + errors, x)
    start = np.array(
        [drawn.assemble(dict(zip(drawn.coordinates, each, strict=True))) for each in x]
    )
    ratios, noises = [], []
    for seed in range(RUNS):
        points = exact + 2e-5 * np.random.default_rng(seed).normal(size=exact.shape)
        heights = Heights("platform", x, heights=points[:, 2], start=start)
        result = calibrate_with(drawn, [heights], which=["*.length"])
        assert result.names == tuple(DELTA_RODS)
        noises.append(result.noise[0])
        ratios.append((result.values - errors) / (result.deviations * 2e-5 / result.noise[0]))
    assert_deviations_are_those_of_errors(ratios)
    # Within four standard deviations: 27 of the 30 heights of a run are to spare.
    assert_allclose(np.mean(np.square(noises)), 4e-10, rtol=4 * np.sqrt(2 / (27 * RUNS)))


def test_a_urdf_takes_no_lengths_and_the_yaml_beside_it_does(tmp_path):
    """The text of the warning, pasted into the YAML, gives the calibrated robot."""
    drawn = _swing(tmp_path / "swing.urdf", 0.3)
    real = _swing(tmp_path / "real.urdf", 0.302)
    x = np.linspace(0.2, 1.2, 12)[:, None]
    start = drawn.assemble({"crank": 0.2, "rocker": 0.3}, fixed=["crank"])
    q = [real.assemble({"crank": angle, "rocker": 0.3}, fixed=["crank"]) for (angle,) in x]
    points = real.frame_placement(np.array(q), "rod_b")[0]
    urdf = tmp_path / "swing.urdf"
    result = calibrate(drawn, "rod_b", x, points, which=["*.length"], urdf=urdf, start=start)
    with pytest.warns(sst_pin.DescriptionWarning, match="has no lengths of rods") as caught:
        result.write_urdf(urdf, tmp_path / "calibrated.urdf")
    kind, frames = str(caught[0].message).partition("the type ")[2].split(" for ")
    assert frames == "rod_a - rod_b"
    text = urdf.with_suffix(".yaml").read_text().replace("distance 0.3", kind)
    (tmp_path / "calibrated.yaml").write_text(text)
    again = sst_pin.ClosedChain.from_urdf(tmp_path / "calibrated.urdf")
    assert_allclose(again.closures[0].distance, 0.302, atol=1e-11)


def _swing(urdf, length):
    """Two bars on the ground that a rod connects, written and read."""
    bars = ""
    for joint, place in (("crank", 0.0), ("rocker", 0.25)):
        bars += f"""
  <link name="{joint}_bar"><inertial><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{joint}" type="revolute"><parent link="base"/><child link="{joint}_bar"/>
    <origin xyz="{place} 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="9" velocity="9"/></joint>"""
    for frame, joint, height in (("rod_a", "crank", 0.1), ("rod_b", "rocker", 0.2)):
        bars += f"""
  <link name="{frame}"/>
  <joint name="{frame}_fixed" type="fixed"><parent link="{joint}_bar"/><child link="{frame}"/>
    <origin xyz="0 0 {height}"/></joint>"""
    urdf.write_text(f'<robot name="swing"><link name="base"/>{bars}\n</robot>')
    urdf.with_suffix(".yaml").write_text(
        f"closed_loop: [[rod_a, rod_b]]\ntype: [distance {length}]\nname_mot: [crank]\n"
    )
    return sst_pin.ClosedChain.from_urdf(urdf)

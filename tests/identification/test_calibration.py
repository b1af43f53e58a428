# SPDX-License-Identifier: BSD-2-Clause
"""The geometry from measured poses: exact without noise, honest with noise, named where hidden."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin.identification import calibrate
from tests.support.files import ROOT
from tests.support.planar_bars import DRAG_LINK, planar
from tests.support.standard_errors import RUNS, assert_deviations_are_those_of_errors

WHICH = ["motor_*.ry", "rod_*a.x", "rod_*b.x"]


def configurations_of(chain: sst_pin.ClosedChain, x: np.ndarray) -> np.ndarray:
    return np.array([chain.assemble(dict(zip(chain.coordinates, each, strict=True))) for each in x])


def poses_of(chain: sst_pin.ClosedChain, x: np.ndarray, frame: str) -> np.ndarray:
    """Poses of a frame, by assembly and Pinocchio's kinematics."""
    data, result = chain.model.createData(), []
    for q in configurations_of(chain, x):
        pin.framesForwardKinematics(chain.model, data, q)
        result.append(data.oMf[chain.model.getFrameId(frame)].homogeneous)
    return np.array(result)


@cache
def deltas() -> tuple[sst_pin.ClosedChain, sst_pin.ClosedChain, dict[str, float], np.ndarray]:
    """The delta as drawn, as made with errors of tenths of a millimetre, these, and poses."""
    drawn, rng = sst_pin.robots.delta(), np.random.default_rng(4)
    names = [f"motor_{k}.ry" for k in "123"] + [f"rod_{k}{s}.x" for k in "123" for s in "ab"]
    errors = dict(zip(names, rng.normal(size=9) * ([5e-3] * 3 + [3e-4] * 6), strict=True))
    actual = drawn.with_design(errors)
    at_home = [drawn.home[drawn.position_names.index(name)] for name in drawn.coordinates]
    return drawn, actual, errors, at_home + rng.uniform(-0.3, 0.3, (40, 3))


def test_errors_of_a_delta_are_found_exactly_from_exact_poses():
    drawn, actual, errors, x = deltas()
    result = calibrate(drawn, "platform", x[:12], poses_of(actual, x[:12], "platform"), which=WHICH)
    assert set(result.names) == set(errors)
    assert_allclose(result.values, [errors[name] for name in result.names], atol=1e-11)
    # and the calibrated robot goes where the actual one goes, in other poses
    again = poses_of(result.chain, x[12:16], "platform")
    assert_allclose(again, poses_of(actual, x[12:16], "platform"), atol=1e-10)


def test_positions_alone_tell_the_offsets_of_the_motors():
    drawn, _, errors, x = deltas()
    only = {name: value for name, value in errors.items() if name.startswith("motor")}
    turned = drawn.with_design(only)
    feet = poses_of(turned, x[:8], "platform")[:, :3, 3]
    result = calibrate(drawn, "platform", x[:8], feet, which=["motor_*.ry"])
    assert_allclose(result.values, list(only.values()), atol=1e-11)
    assert result.noise.shape == (1,)


@pytest.mark.slow
def test_what_is_hidden_moves_the_frame_as_errors_that_were_found_do():
    """The referee is the difference of robots with each error, not the enlarged robot."""
    drawn, _, _, x = deltas()
    x = x[:8]
    which = ["motor_1.*", "rod_1*.x", "rod_1*.y"]
    result = calibrate(drawn, "platform", x, poses_of(drawn, x, "platform"), which=which)
    assert result.hidden
    size, columns = 1e-6, []
    for name in (*result.names, *result.hidden):
        chains = (drawn.with_design({name: s}) for s in (-size, size))
        ends = [poses_of(chain, x, "platform") for chain in chains]
        columns.append(((ends[1] - ends[0]) / (2 * size))[:, :3].ravel())
    A = np.array(columns).T
    A /= np.maximum(np.linalg.norm(A, axis=0), 1e-6)
    count = len(result.names)
    assert np.linalg.matrix_rank(A[:, :count], 1e-6) == count
    assert np.linalg.matrix_rank(A, 1e-6) == count


def noisy(poses: np.ndarray, seed: int) -> np.ndarray:
    """Poses with noise of 0.05 mm and 0.2 mrad."""
    rng, turned = np.random.default_rng(seed), poses.copy()
    turned[:, :3, 3] += rng.normal(size=(len(poses), 3)) * 5e-5
    for k, turn in enumerate(rng.normal(size=(len(poses), 3)) * 2e-4):
        turned[k, :3, :3] = pin.exp3(turn) @ poses[k, :3, :3]
    return turned


@pytest.mark.slow
def test_errors_of_a_delta_have_the_standard_deviations_of_the_result():
    drawn, actual, errors, x = deltas()
    exact, ratios = poses_of(actual, x, "platform"), []
    start = configurations_of(drawn, x)
    for seed in range(RUNS):
        result = calibrate(drawn, "platform", x, noisy(exact, seed), which=WHICH, start=start)
        true = np.array([errors[name] for name in result.names])
        ratios.append((result.values - true) / result.deviations)
        assert_allclose(result.noise, [5e-5, 2e-4], rtol=0.35)
    assert_deviations_are_those_of_errors(ratios)
    left = poses_of(result.chain, x, "platform")[:, :3, 3] - exact[:, :3, 3]
    assert np.sqrt(np.mean(left**2)) < 5e-5  # below the noise, which is averaged


def test_a_calibrated_urdf_is_the_calibrated_robot(tmp_path):
    urdf = ROOT / "examples" / "delta.urdf"
    drawn = sst_pin.ClosedChain.from_urdf(urdf)
    rng = np.random.default_rng(1)
    joints = [name for name in drawn.joint_names if name in drawn.coordinates] + ["elbow_1a_X"]
    frame = drawn.closures[0].frame_a
    names = [f"{joint}.{axis}" for joint in joints for axis in ("x", "ry")] + [f"{frame}.y"]
    actual = drawn.with_design({name: 1e-3 * rng.normal() for name in names})
    q = drawn.generic_configuration()
    held = [q[drawn.position_names.index(name)] for name in drawn.coordinates]
    x = held + rng.uniform(-0.1, 0.1, (8, len(held)))
    measured = next(n.name for n in drawn.model.frames if "platform" in n.name)
    drawn.model.referenceConfigurations["home"] = q
    actual.model.referenceConfigurations["home"] = q
    drawn.refresh()
    actual.refresh()
    poses = poses_of(actual, x, measured)
    result = calibrate(drawn, measured, x, poses, which=names, urdf=urdf)
    result.write_urdf(urdf, tmp_path / "delta.urdf")
    (tmp_path / "delta.yaml").write_bytes(urdf.with_suffix(".yaml").read_bytes())
    again = sst_pin.ClosedChain.from_urdf(tmp_path / "delta.urdf")
    for k in range(1, again.model.njoints):
        mine, theirs = result.chain.model.jointPlacements[k], again.model.jointPlacements[k]
        assert mine.isApprox(theirs, 1e-12)
    for mine in result.chain.model.frames:
        theirs = again.model.frames[again.model.getFrameId(mine.name, mine.type)]
        if mine.name == frame or mine.type == pin.FrameType.OP_FRAME:
            assert mine.placement.isApprox(theirs.placement, 1e-12)


def test_errors_that_a_urdf_cannot_store_are_known_before():
    """No joint of the file stands between both axes of a universal joint."""
    urdf = ROOT / "examples" / "delta.urdf"
    drawn = sst_pin.ClosedChain.from_urdf(urdf)
    measured = next(n.name for n in drawn.model.frames if "platform" in n.name)
    x, poses = np.zeros((2, 3)), np.zeros((2, 3))
    with pytest.raises(
        sst_pin.InputError, match=r"delta\.urdf cannot store elbow_1a_Y\.x: no joint"
    ):
        calibrate(drawn, measured, x, poses, which=["elbow_1a_[XY].x"], urdf=urdf)
    drawn.model.referenceConfigurations["home"] = q = drawn.generic_configuration()
    drawn.refresh()
    held = [q[drawn.position_names.index(name)] for name in drawn.coordinates]
    x = held + np.random.default_rng(0).uniform(-0.1, 0.1, (16, 3))
    result = calibrate(drawn, measured, x, poses_of(drawn, x, measured), urdf=urdf)
    places = {name.rpartition(".")[0] for name in result.names + result.hidden}
    assert "motor_1" in places
    assert not [name for name in places if name.endswith("_Y")]


@pytest.mark.parametrize("x", [np.zeros((0, 1)), np.full((3, 1), np.nan)], ids=["none", "nan"])
def test_positions_of_the_coordinates_are_needed_and_finite(x):
    bar = sst_pin.robots.four_bar()
    poses = sst_pin.identification.Poses("coupler_pin", x, np.zeros((len(x), 3)))
    with pytest.raises(sst_pin.InputError, match=r"\bx: "):
        sst_pin.identification.calibrate_with(bar, [poses])


def test_errors_that_do_not_settle_are_refused(monkeypatch):
    """A four-bar's noise of 24 mm and errors that the poses hardly tell apart: steps go on."""
    model = planar(DRAG_LINK)
    closures = [sst_pin.Closure("coupler_end", "rocker_end", "3d")]
    chain, x = sst_pin.ClosedChain(model, closures, ["crank"]), np.linspace(2, 4.5, 40)[:, None]
    start = chain.assemble(np.array([2.0, -1.5, 1.5]))
    q = sst_pin.coordinate_motion(chain, np.arange(40), x, start=start).q
    points, _ = chain.frame_placement(q, "coupler_end")
    which = ["rocker.y", "crank.y", "coupler.x", "crank.rz", "coupler_end.y"]
    noisy_points = points + np.random.default_rng(0).normal(scale=0.024, size=(len(x), 3))
    monkeypatch.setattr("sst_pin.identification.error_fit._STEPS", 5)  # as in 30, but sooner
    with pytest.raises(sst_pin.InputError, match="do not settle in 5 steps"):
        calibrate(chain, "coupler_end", x, noisy_points, which=which, start=start)


def test_errors_that_open_the_loops_of_an_overconstrained_robot_are_left_out():
    """In a plane: each error along z or about x or y would open the loops."""
    drawn, rng = sst_pin.robots.planar_3rrr(), np.random.default_rng(0)
    values = {"elbow_2.x": 1e-3, "tip_3.x": -2e-3, "shoulder_1.rz": 4e-3}
    actual = drawn.with_design(values)
    at_home = [drawn.home[drawn.position_names.index(name)] for name in drawn.coordinates]
    x = at_home + rng.uniform(-0.1, 0.1, (12, 3))
    exact = poses_of(actual, x, "platform")
    result = calibrate(drawn, "platform", x, exact)
    assert not [name for name in result.names + result.hidden if name.endswith((".z", ".rx", ".ry"))
                and not name.startswith(("tip", "vertex"))]  # fmt: skip
    other = at_home + rng.uniform(-0.1, 0.1, (4, 3))
    at_others = poses_of(actual, other, "platform")
    assert_allclose(poses_of(result.chain, other, "platform"), at_others, atol=1e-10)
    with pytest.raises(sst_pin.InputError, match=r"elbow_1.z.* each alone opens loops"):
        calibrate(drawn, "platform", x, exact, which=["*.x", "*.z"])


def test_exact_orientations_beside_noisy_positions_do_not_spoil_the_errors():
    drawn, rng = sst_pin.robots.five_bar(), np.random.default_rng(0)
    at_home = [drawn.home[drawn.position_names.index(name)] for name in drawn.coordinates]
    x = at_home + rng.uniform(-0.2, 0.2, (40, 2))
    poses = poses_of(drawn, x, "platform")
    poses[:, :3, 3] += 1e-5 * rng.normal(size=(40, 3))
    result = calibrate(drawn, "platform", x, poses)
    assert (np.abs(result.values) < 4 * result.deviations).all()
    assert result.noise[0] == pytest.approx(1e-5, rel=0.2)


def test_where_brakes_hold_is_no_matter_of_the_home():
    """Away from home, x does not say where a motor with a brake stands; the start does."""
    drawn, _, errors, x = deltas()
    x = x[:8].copy()
    x[:, 0] = x[0, 0]
    rods = {name: value for name, value in errors.items() if name.startswith("rod")}
    poses = poses_of(drawn.with_design(rods), x, "platform")
    braked = drawn.with_brakes(["motor_1"])
    with pytest.raises(sst_pin.InputError, match=r"^start: .* brakes hold motor_1"):
        calibrate(braked, "platform", x[:, 1:], poses, which=["rod_*.x"])
    start = configurations_of(drawn, x[:1])[0]
    result = calibrate(braked, "platform", x[:, 1:], poses, which=["rod_*.x"], start=start)
    # 1e-11 as without brakes, but the start closes its loops to 1e-10 only
    assert_allclose(result.values, [rods[name] for name in result.names], atol=1e-9)


def test_a_single_string_is_no_sequence_of_errors():
    drawn, actual, _, x = deltas()
    poses = poses_of(actual, x[:8], "platform")
    with pytest.raises(sst_pin.InputError, match=r"^which: 'motor_1.ry': a sequence of names"):
        calibrate(drawn, "platform", x[:8], poses, which="motor_1.ry")

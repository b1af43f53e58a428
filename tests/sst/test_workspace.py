# SPDX-License-Identifier: BSD-2-Clause
"""The map of the star's axis, held against the robot's own kinematics and against geometry."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sst_pin
from sst_pin.description.urdf_writer import urdf_of
from sst_pin.sst import workspace as workspace_module
from sst_pin.sst.workspace import Chart, WorkspaceMap, workspace_at, workspace_over_rolls
from sst_pin.verification.sampling import random_parameters


@pytest.fixture(scope="module")
def at_zero(robot):
    return workspace_at(robot)


@pytest.fixture(scope="module")
def over_rolls(robot):
    """Coarser than one would draw it."""
    return workspace_over_rolls(robot, rolls=36, rings=31, spokes=60)


def orientations(workspace):
    return sst_pin.orientation(workspace.theta, workspace.phi, workspace.psi)


def distance_inside(robot, q):
    """The distance of the joint that is farthest out from the ends of its arc."""
    v, gamma, beta = robot.geometry.R_0[:, :, 0], q[..., ::3], q[..., 2::3]
    sides = np.arccos((v * v[[1, 2, 0]]).sum(axis=1))
    ends = [gamma, sides - gamma, beta, np.pi / 2 - beta]
    return np.concatenate(ends, axis=-1).min(axis=-1)


def test_chart_and_its_inverse_undo_each_other(odd):
    chart = Chart.of_robot(odd)
    s = Rotation.random(200, np.random.default_rng(0)).as_matrix()[:, 0]
    s = s[s @ chart.axes[2] > -0.5]  # beyond, 1 + cos loses digits
    assert np.abs(chart.directions(chart.project(s)) - s).max() < 1e-14
    assert np.abs(chart.axes @ chart.axes.T - np.eye(3)).max() < 1e-15
    assert np.linalg.det(chart.axes) > 0


def test_chart_keeps_areas(robot):
    """Uniform directions are uniform points: a cap of height h fills a disc of area 2 pi h."""
    chart = Chart.of_robot(robot)
    for height in (0.1, 0.5, 1.0):
        along = chart.axes[0] * np.sqrt(1 - (1 - height) ** 2) + chart.axes[2] * (1 - height)
        radius = np.linalg.norm(chart.project(along))
        assert np.pi * radius**2 == pytest.approx(2 * np.pi * height, rel=1e-14)


def test_grid_is_the_half_sphere_about_the_middle_of_the_triangle(odd):
    workspace = workspace_at(odd, 0.7, rings=21, spokes=60)
    middle = Chart.of_robot(odd).axes[2]
    ahead = workspace.s @ middle
    assert ahead[0] == pytest.approx(1)
    assert np.abs(ahead[-1]).max() < 1e-14
    assert np.abs(np.linalg.norm(workspace.s, axis=-1) - 1).max() < 1e-15
    assert np.abs(orientations(workspace)[..., 0] - workspace.s).max() < 1e-14


@pytest.mark.parametrize("psi", [0.7, -1.3, 2.6])
def test_map_agrees_with_the_robot_sample_by_sample(odd, psi):
    """Inverse kinematics and singularities of the public interface; the arcs by their ends."""
    workspace = workspace_at(odd, psi, rings=21, spokes=60)
    q = odd.inverse_kinematics(orientations(workspace))
    found = odd.singularities(q)
    assert workspace.reachable.all()
    assert np.abs(workspace.first_kind - found.first_kind).max() < 1e-12
    # Rounding in q, larger by 1 / sin(mu), goes into A, and from there into its condition number
    # times it.
    error = workspace.condition_number / found.condition_number - 1
    assert (np.abs(error) * found.first_kind / found.condition_number).max() < 1e-13
    inside = distance_inside(odd, q)
    assert np.abs(workspace.margin - inside).max() < 2e-9  # the slack at the ends is 1e-9
    assert np.array_equal(workspace.on_arcs, inside >= -1e-9)
    assert np.array_equal(workspace.roll, 2 * np.pi * workspace.on_arcs)


def test_reachable_is_what_inverse_kinematics_does_not_refuse(tmp_path):
    """A robot whose joints have narrow limits: WorkspaceError where the map says no."""
    text = urdf_of(sst_pin.Parameters()).replace('lower="-6.283185307179586"', 'lower="0.3"')
    (tmp_path / "narrow.urdf").write_text(text.replace('upper="6.283185307179586"', 'upper="1.9"'))
    robot = sst_pin.SST.from_urdf(tmp_path / "narrow.urdf")
    workspace = workspace_at(robot, 0.2, rings=16, spokes=24)
    assert 0.02 < workspace.reachable.mean() < 0.98
    R = orientations(workspace)
    robot.inverse_kinematics(R[workspace.reachable])
    for unreachable in R[~workspace.reachable]:
        with pytest.raises(sst_pin.WorkspaceError):
            robot.inverse_kinematics(unreachable)
    assert not (workspace.on_arcs & ~workspace.reachable).any()
    assert np.isinf(workspace.condition_number[~workspace.reachable]).all()


def test_flat_legs_are_told_and_break_nothing(robot, monkeypatch):
    """At psi = 90 deg leg 1 lies flat for all s in its plane; few samples hit that exactly."""
    with pytest.raises(sst_pin.SingularConfigurationError):
        robot.inverse_kinematics(sst_pin.orientation(0.3, np.pi / 2, np.pi / 2))
    monkeypatch.setattr(workspace_module, "_FLAT", 0.05)
    workspace = workspace_at(robot, np.pi / 2, rings=31, spokes=36)
    flat = workspace.first_kind <= 0.05
    assert flat.any()
    undefined = map(np.isnan, (workspace.determinant, workspace.margin))
    for found in (~workspace.reachable, np.isinf(workspace.condition_number), *undefined):
        assert np.array_equal(found, flat)
    assert not workspace.on_arcs[flat].any()
    # Some other psi does.
    assert workspace_over_rolls(robot, rolls=8, rings=11, spokes=12).reachable.all()


def test_paper_robot_is_isotropic_in_the_middle(robot, at_zero, over_rolls):
    s = robot.platform_orientation(robot.home)[:, 0]
    for workspace in (at_zero, over_rolls):
        assert workspace.condition_number[workspace.best] == pytest.approx(1, abs=1e-14)
        assert np.abs(workspace.s[workspace.best] - s).max() < 1e-15


def test_paper_robot_reaches_its_base_triangle_and_no_more(at_zero, over_rolls):
    """At psi = 0 and over all psi: an eighth of the sphere, all components of s positive."""
    for workspace in (at_zero, over_rolls):
        inside = workspace.s.min(axis=-1)
        clear = np.abs(inside) > 1e-6  # on the sides of the triangle rounding decides
        assert np.array_equal(workspace.on_arcs[clear], inside[clear] > 0)
        # Samples a degree or three apart see an edge as sharp as that.
        assert workspace.area == pytest.approx(np.pi / 2, rel=0.03)


def test_paper_robot_has_no_singularity_on_its_arcs(robot, over_rolls):
    """At any psi |sin mu_k| stays above 1/2 and det A above 1/sqrt 2; best conditioned, sqrt 3."""
    for psi in np.radians(np.arange(-60, 61, 10)):
        found = workspace_at(robot, psi, rings=31, spokes=60)
        # The slack is that of the ends of the arcs, where both are met.
        assert found.first_kind[found.on_arcs].min(initial=1) > 0.5 - 1e-8
        assert found.determinant[found.on_arcs].min(initial=1) > 0.5**0.5 - 1e-8
        assert found.condition_number[found.on_arcs].max(initial=1) < 2.04
    # The vertices, where it is worst, are no samples; it rises by less than 0.1 on a degree.
    assert over_rolls.condition_number[over_rolls.on_arcs].max() == pytest.approx(3**0.5, abs=0.01)


def test_map_over_all_rolls_has_the_symmetry_of_the_robot(robot, over_rolls):
    """A turn by 120 degrees about the middle makes each leg the next one: nothing changes."""
    finer = workspace_over_rolls(robot, rolls=72, rings=31, spokes=60)
    third = 60 // 3
    clear = (np.abs(over_rolls.margin) > 0.1) & over_rolls.on_arcs
    for name in ("condition_number", "margin", "roll"):
        here, there = (getattr(w, name) for w in (over_rolls, finer))
        # The turn shifts the samples of psi off one another. At kinks the error falls with their
        # distance: what halving it changes is half of the error, and two maps have one each.
        error = 4 * np.abs(here - there)[clear].max()
        turned = np.roll(here[:, :-1], third, axis=1)
        assert np.abs(here[:, :-1] - turned)[clear[:, :-1]].max() < error < 0.3, name


def test_symmetric_poses_are_equally_conditioned(robot, over_rolls):
    turn = Rotation.from_rotvec(2 * np.pi / 3 * Chart.of_robot(robot).axes[2]).as_matrix()
    rename = robot.geometry.R_E[0].T @ robot.geometry.R_E[1]  # arc 2 to where arc 1 was
    R = orientations(over_rolls)[5:25:4, ::7]
    here, there = (
        robot.singularities(robot.inverse_kinematics(pose)) for pose in (R, turn @ R @ rename)
    )
    assert np.abs(here.condition_number / there.condition_number - 1).max() < 1e-12
    assert np.abs(here.first_kind - there.first_kind).max() < 1e-14


@pytest.mark.parametrize("seed", [None, 0, 2])
def test_best_psi_is_the_best_on_the_arcs(robot, seed):
    """Condition number at the psi shown, against those at all 36 that the robot has on its arcs."""
    if seed is not None:
        robot = sst_pin.SST(random_parameters(np.random.default_rng(seed)))
    workspace = workspace_over_rolls(robot, rolls=36, rings=16, spokes=30)
    places = np.argwhere(workspace.on_arcs)
    assert len(places) > 10
    psi = np.arange(36) * np.pi / 18
    for place in map(tuple, places[:: max(len(places) // 20, 1)]):
        R = sst_pin.orientation(workspace.theta[place], workspace.phi[place], psi)
        q = robot.inverse_kinematics(R)
        on_arcs = distance_inside(robot, q) > -1e-9
        condition = robot.singularities(q).condition_number
        assert workspace.condition_number[place] == pytest.approx(condition[on_arcs].min())
        # The roll that is left: an interval counts to within a step at each of its ends.
        ends = (on_arcs != np.roll(on_arcs, 1)).sum()
        roll = on_arcs.sum() * np.pi / 18
        assert workspace.roll[place] == pytest.approx(roll, abs=ends * np.pi / 36 + 1e-9)


def test_roll_in_the_middle_is_a_third_of_a_turn(over_rolls):
    """There beta is at home for all psi, and R_k runs its whole side: 120 degrees."""
    assert over_rolls.roll[0, 0] == pytest.approx(2 * np.pi / 3, abs=1e-6)


def test_npz_holds_every_attribute(at_zero, tmp_path):
    at_zero.save(tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz") as file:
        assert set(file) == {field.name for field in fields(WorkspaceMap)}
        for name in file:
            assert np.array_equal(file[name], getattr(at_zero, name), equal_nan=True)


def test_csv_has_one_row_for_each_direction(robot, tmp_path):
    workspace = workspace_at(robot, rings=5, spokes=6)
    workspace.save(tmp_path / "map.csv")
    header = (tmp_path / "map.csv").read_text().partition("\n")[0]
    assert header.startswith("theta_rad,phi_rad,psi_rad,reachable,first_kind,determinant,")
    values = np.loadtxt(tmp_path / "map.csv", delimiter=",", skiprows=1)
    assert len(values) == len(np.unique(values[:, :2].round(12), axis=0)) == 4 * 6 + 1


def test_bad_arguments_have_their_own_errors(robot, at_zero, tmp_path):
    with pytest.raises(sst_pin.OutputError, match=r"known: \.csv, \.npz"):
        at_zero.save(tmp_path / "map.xlsx")
    with pytest.raises(sst_pin.InputError, match="psi"):
        workspace_at(robot, np.nan)
    for bad in ({"rings": 2}, {"spokes": 0}, {"rolls": 0}):
        with pytest.raises(sst_pin.InputError, match="at least"):
            workspace_over_rolls(robot, **bad)

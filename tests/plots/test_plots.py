# SPDX-License-Identifier: BSD-2-Clause
"""Figures: what they show is right, and nothing in them is in the way of anything else."""

import numpy as np
import pytest
from matplotlib import figure as figures

import sst_pin
from sst_pin import plots
from sst_pin.simulation.energy import energy_balance
from sst_pin.sst import paper
from tests.support.figure_texts import require_legible


@pytest.fixture(scope="module")
def sticky():
    """The paper's robot with friction in all joints."""
    return sst_pin.SST(sst_pin.Parameters(viscous_friction=0.2))


@pytest.fixture(scope="module")
def circle(sticky):
    return paper.example_1(sticky, np.linspace(0, paper.PERIOD, 121))


def axes(projection=None):
    return figures.Figure().add_subplot(projection=projection)


CURVES = {
    "motor_torques": ("motor torque (N m)", 3),
    "joint_angles": ("joint angle (deg)", 9),
    "joint_rates": ("joint rate (rad/s)", 9),
    "powers": ("power (W)", 5),
    "energy_balance": ("energy since start (J)", 5),
    "condition_number": ("condition number (1)", 2),
}


@pytest.mark.parametrize("name", CURVES)
def test_curves_are_drawn_where_asked_with_units_and_legend(sticky, circle, name):
    ax, draw = axes(), getattr(plots, name)
    robot = () if name in ("motor_torques", "joint_angles") else (sticky,)
    assert draw(ax, *robot, circle) is ax
    label, count = CURVES[name]
    assert ax.get_ylabel() == label
    assert ax.get_xlabel() == "time (s)"
    entries = [text.get_text() for text in ax.get_legend().get_texts()]
    assert len(entries) == len(set(entries)) == count
    looks = {
        (line.get_color(), str(line.get_linestyle()), line._unscaled_dash_pattern)
        for line in ax.get_lines()
        if not line.get_label().startswith("_")
    }
    assert len(looks) == count


def curve(ax, label):
    (line,) = [line for line in ax.get_lines() if line.get_label() == label]
    return np.asarray(line.get_ydata())


def test_curves_are_what_the_robot_computes(sticky, circle):
    rates = sticky.joint_rates(circle.q, circle.va)
    ax = plots.joint_rates(axes(), sticky, circle)
    names = [rf"$\dot\{letter}_{k}$" for k in (1, 2, 3) for letter in ("gamma", "mu", "beta")]
    assert np.array_equal([curve(ax, name) for name in names], rates.T)
    assert np.abs(rates[:, ::3] - circle.va).max() < 1e-12
    ax = plots.joint_angles(axes(), circle)
    assert np.array_equal(curve(ax, r"$\beta_3$"), np.degrees(circle.q[:, 8]))
    ax = plots.powers(axes(), sticky, circle)
    assert np.abs(curve(ax, "all motors") - (circle.tau * circle.va).sum(axis=1)).max() < 1e-12
    assert np.abs(curve(ax, "friction") + 0.2 * (rates**2).sum(axis=1)).max() < 1e-12
    result = sticky.singularities(circle.q)
    ax = plots.condition_number(axes(), sticky, circle)
    assert np.array_equal(curve(ax, "singularity (second kind), cond A"), result.condition_number)


def test_energy_drawn_is_balanced(sticky, circle):
    """What is gained is what motors and friction did; torques that are off leave a residual."""
    ax = plots.energy_balance(axes(), sticky, circle)
    gained = curve(ax, "kinetic") + curve(ax, "potential")
    done = curve(ax, "work of motors") + curve(ax, "work of friction")
    assert np.abs(gained).max() > 1
    # Splines of degree five through 121 samples of a period.
    assert np.abs(gained - done).max() < 1e-6
    assert np.abs(sst_pin.energy_error(sticky, circle)).max() < 1e-6
    balance = energy_balance(sticky.engine, circle)
    assert [energy[0] for energy in balance] == [0] * 4
    assert (np.diff(balance.friction) < 0).all()
    wrong = sticky.trajectory(circle.t, circle.q, circle.va, circle.aa, 1.1 * circle.tau)
    assert np.abs(energy_balance(sticky.engine, wrong).error).max() > 0.1


@pytest.mark.parametrize("radius", [0.004, 37.0])
def test_a_star_is_drawn_at_its_own_size(radius):
    robot = sst_pin.SST(sst_pin.Parameters(base_radius=7 / 8 * radius, star_radius=radius))
    motion = paper.example_1(robot, np.linspace(0, paper.PERIOD, 21))
    ax = plots.paths_on_sphere(axes("3d"), robot, [("path", motion)])
    path = next(line for line in ax.get_lines() if line.get_label() == "path")
    assert np.linalg.norm(path.get_data_3d(), axis=0) == pytest.approx(radius, rel=1e-12)
    assert 2 <= sum(abs(tick) <= radius for tick in ax.get_xticks()) <= 8
    texts = plots.robot_pose(axes("3d"), robot, robot.home).texts
    tips = np.linalg.norm([text.get_position_3d() for text in texts], axis=1)
    assert 0.8 * radius < tips.min() < tips.max() < 1.4 * radius


def test_a_legible_page_says_what_the_machine_cannot_take(robot, monkeypatch):
    t = np.linspace(0, 1, 31)
    angles = np.full_like(t, np.radians(20)), np.radians(60 + 110 * t)
    rates = sst_pin.sst.interpolate_orientations(t, sst_pin.sst.orientation(*angles), t)
    q, va, aa = robot.joint_motion(*rates)
    off = robot.trajectory(t, q, va, aa, 0 * va)
    figure = plots.motion_page(robot, off, plots.SUBJECTS)
    for finding in robot.check_limits(off):
        assert f"Warning: {finding}" in figure.get_supxlabel()
    require_legible(figure, monkeypatch)
    within = robot.trajectory(t, q[[0] * 31], va, aa, 0 * va)
    assert plots.motion_page(robot, within, ("joints",)).get_supxlabel() == ""

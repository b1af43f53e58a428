# SPDX-License-Identifier: BSD-2-Clause
"""Pages of any closed chain: units, names, looks that grey print keeps apart; loads, maps."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import sst_pin
from sst_pin import plots
from sst_pin.plots import curves
from sst_pin.plots.motions import SUBJECTS_OVER_TIME
from sst_pin.plots.style import StyledFigure
from tests.support.figure_texts import require_legible


def falling(chain, q):
    """A short motion without torques."""
    tau, va = np.zeros(len(chain.motor_names)), np.full(chain.degrees_of_freedom, 0.1)
    return chain.simulate(tau, q, va, np.linspace(0, 0.02, 21), rtol=1e-6)


@functools.cache
def fallen(name, at_home=True):
    """A robot of the gallery and a short motion of it, from home or some other configuration."""
    robot = getattr(sst_pin.robots, name)()
    return robot, falling(robot, robot.home if at_home else robot.generic_configuration())


@pytest.mark.parametrize("name", ["five_bar", pytest.param("stewart", marks=pytest.mark.slow)])
def test_a_page_of_any_robot_is_legible(name, monkeypatch):
    robot, motion = fallen(name)
    require_legible(plots.motion_page(robot, motion, SUBJECTS_OVER_TIME), monkeypatch)


def test_axes_have_the_units_of_their_joints():
    robot, motion = fallen("stewart")
    page = plots.motion_page(robot, motion, ("torques", "joints", "rates"))
    labels = [ax.get_ylabel() for ax in page.axes]
    assert labels[0] == "motor force (N)"
    assert {"joint angle (deg)", "joint displacement (m)", "joint rate (rad/s)"} <= set(labels)
    for ax in page.axes:
        assert 1 <= len(ax.get_legend().get_texts()) <= curves.MOST
    with pytest.raises(sst_pin.InputError, match="of several units"):
        plots.joint_angles(page.axes[0], motion)


def test_an_endless_joint_is_drawn_as_an_angle():
    """Not as a cosine and a sine, and without jumps at half turns."""
    angle = np.linspace(0, 10, 101)
    q = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    v = np.full((101, 1), 10.0)
    t = np.linspace(0, 1, 101)
    motion = sst_pin.Trajectory(t, q, v, 0 * v, v, ["wheel_cos", "wheel_sin"], ["wheel"], ["", ""])
    ax = plots.joint_angles(Figure().add_subplot(), motion)
    assert ax.get_ylabel() == "joint angle (deg)"
    (line,) = ax.get_lines()
    assert line.get_label() == "wheel"
    assert np.abs(line.get_ydata() - np.degrees(angle)).max() < 1e-9


@pytest.mark.parametrize("name", ["_hidden", "a$b$c", "x_{", "\\frac"])
def test_any_name_has_its_entry_in_the_legend(name):
    """Matplotlib leaves out what begins with an underscore and takes dollars for mathematics."""
    none = np.zeros((2, 1))
    motion = sst_pin.Trajectory([0, 1], none, none, none, none, [name], [name])
    figure = StyledFigure()
    ax = plots.joint_angles(figure.add_subplot(), motion)
    FigureCanvasAgg(figure).draw()
    (text,) = ax.get_legend().get_texts()
    assert text.get_text().strip().replace("\\$", "$") == name


def test_a_page_of_a_robot_without_motors_has_no_torques_and_says_so_when_asked():
    bars, _ = fallen("four_bar")
    passive = sst_pin.ClosedChain(bars.model, bars.closures, [])
    motion = falling(passive, bars.home)
    labels = [ax.get_ylabel() for ax in plots.motion_page(passive, motion).axes]
    assert labels[0] == "joint angle (deg)"
    assert len(labels) == 4
    for subject in ("torques", "power"):
        with pytest.raises(sst_pin.InputError, match=f"{subject} of a robot without motors"):
            plots.motion_page(passive, motion, [subject, "joints"])
    with pytest.raises(sst_pin.InputError, match="nothing to draw"):
        plots.motor_torques(Figure().add_subplot(), motion)
    with pytest.raises(sst_pin.InputError, match="has no motors"):
        plots.torques_page(motion, motion.tau)


@pytest.mark.parametrize(("name", "frame"), [("four_bar", "platform"), ("delta", "ball_2a")])
def test_the_path_of_a_frame_moves_as_its_jacobian_says(name, frame, monkeypatch):
    """Central differences of what is drawn are the first rows of J(q) va.

    They are off by h^2 / 6 of the third derivative; h is a twentieth of the motion: 4e-4 of it.
    """
    robot, motion = fallen(name, at_home=False)
    page = plots.motion_page(robot, motion, ("path", "torques"), frame)
    ax, other = page.axes
    (line, *_), J = ax.get_lines(), robot.frame_jacobian(motion.q, frame)[:, :3]
    rates = np.einsum("nij,nj->ni", J, motion.va)
    if name == "delta":
        points = np.transpose(line.get_data_3d())
        require_legible(page, monkeypatch)
        with pytest.raises(sst_pin.InputError, match="lies in no plane"):
            plots.frame_path(other, robot, motion)
    else:  # in the plane that the linkage moves in
        points = np.transpose(line.get_data())
        letters = [ax.get_xlabel()[1], ax.get_ylabel()[1]]
        rates = rates[:, ["xyz".index(letter) for letter in letters]]
    steps = (points[2:] - points[:-2]) / (motion.t[2:] - motion.t[:-2])[:, None]
    assert np.abs(steps - rates[1:-1]).max() < 4e-4 * np.abs(rates).max()


def test_a_map_shows_what_is_reached_and_what_ends_it(monkeypatch):
    lift = sst_pin.robots.five_bar()
    side = np.linspace(-0.15, 0.15, 5)
    result = sst_pin.reach_map(lift, "platform", 2.0, x=side, y=side)
    figure = Figure(figsize=(7, 3), layout="constrained")
    for axes, show in zip(figure.subplots(1, 2), ("condition", "used"), strict=True):
        ax = plots.reach_map(axes, result, show)
        field, ends = (drawn.get_array() for drawn in ax.collections)
        assert (np.ma.getmaskarray(field) ^ result.reached).all()
        assert np.array_equal(field[result.reached], getattr(result, show)[result.reached])
        assert (np.ma.getmaskarray(ends) ^ (result.why == 2)).all()
        assert [text.get_text() for text in ax.get_legend().get_texts()] == ["singular"]
    require_legible(figure, monkeypatch)
    with pytest.raises(sst_pin.InputError, match="'q' unknown; known: condition, used"):
        plots.reach_map(ax, result, "q")


def bars(ax):
    """Lengths of the outer and inner bars by their place."""
    result = {}
    for patch in ax.patches:
        place = round(patch.get_y() + patch.get_height() / 2)
        result.setdefault(place, []).append(patch.get_width())
    return result


@pytest.mark.parametrize("soft", [False, True])
def test_bars_are_peaks_and_means_and_what_is_not_unique_has_none(soft):
    chain, motion = fallen("four_bar")
    names = (*chain.joint_names, str(chain.closures[0]))
    stiffness = dict.fromkeys(names, np.ones(6)) if soft else None
    loads = chain.loads(motion, stiffness=stiffness)
    assert ("not unique" in repr(loads)) is not soft
    page = plots.loads_page(loads)
    largest = np.nanmax([row.peak for row in loads.rows])
    for kind, ax in zip(("force", "moment"), page.axes, strict=True):
        rows = [row for row in loads.rows if row.kind == kind]
        wanted = {k: [x.peak, x.rms] for k, x in enumerate(rows) if x.peak > 1e-9 * largest}
        assert bars(ax) == wanted
        texts = [text.get_text() for text in ax.texts]
        assert len(texts) == len(rows)
        for row, text in zip(rows, texts, strict=True):
            assert (text == "not unique") == np.isnan(row.peak)
            if row.peak > 1e-9 * largest:
                letters, _, numbers = text.rpartition(": ")
                assert letters == ("" if row.determined or soft else row.components)
                direction = [x for x in row[4:7] if np.isfinite(x)]
                shown = [float(x) for x in numbers.split(", ")]
                assert shown == pytest.approx(direction, abs=0.006)
        hatched = [bool(patch.get_hatch()) for patch in ax.patches[::2]]
        from_stiffness = [soft and not row.determined for row in rows]
        seen = [row.peak > 1e-9 * largest for row in rows]
        assert hatched == [x for x, drawn in zip(from_stiffness, seen, strict=True) if drawn]
    in_plane = ["xy: " in text.get_text() for text in page.axes[0].texts]
    assert in_plane == [not soft] * 4
    heavy = plots.loads_page(replace(loads, rows=tuple(r._replace(peak=2e4) for r in loads.rows)))
    assert [ax.get_xlabel() for ax in heavy.axes] == ["force (kN)", "moment (kN m)"]
    with pytest.raises(sst_pin.InputError, match="a table of loads is needed, not list"):
        plots.loads_page([])


def test_a_row_of_each_motor_shows_both_and_the_difference():
    _, motion = fallen("five_bar")
    motion = replace(motion, tau=np.stack([np.sin(motion.t), np.cos(motion.t)], axis=1))
    page = plots.torques_page(motion, 0.5 * motion.tau)
    for ax, tau in zip(page.axes, motion.tau.T, strict=True):
        drawn = {line.get_label(): line.get_ydata() for line in ax.lines[1:]}
        for name, share in {"measured": 1, "predicted": 0.5, "difference": 0.5}.items():
            np.testing.assert_array_equal(drawn[name], share * tau)
    with pytest.raises(sst_pin.InputError, match="predicted"):
        plots.torques_page(motion, motion.tau[1:])

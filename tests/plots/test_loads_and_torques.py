# SPDX-License-Identifier: BSD-2-Clause
"""Pages of loads and of measured torques show the numbers that they are given."""

import numpy as np
import pytest

import sst_pin
from sst_pin import plots, robots
from sst_pin.cli import main


def swing(chain):
    return chain.simulate([0], chain.home, [0], np.linspace(0, 0.1, 11))


def bars(ax):
    """Lengths of the outer and inner bars by their place."""
    found = {}
    for patch in ax.patches:
        place = round(patch.get_y() + patch.get_height() / 2)
        found.setdefault(place, []).append(patch.get_width())
    return found


@pytest.mark.parametrize("soft", [False, True])
def test_bars_are_peaks_and_means_and_what_is_not_unique_has_none(soft):
    chain = robots.four_bar()
    names = (*chain.joint_names, str(chain.closures[0]))
    stiffness = dict.fromkeys(names, np.ones(6)) if soft else None
    loads = chain.loads(swing(chain), stiffness=stiffness)
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
                assert [float(x) for x in text.split(", ")] == pytest.approx(row[4:7], abs=0.006)
        hatched = [bool(patch.get_hatch()) for patch in ax.patches[::2]]
        assert hatched == [not row.determined for row in rows if row.peak > 1e-9 * largest]
    assert ["not unique" in text.get_text() for text in page.axes[0].texts] == [not soft] * 4


def test_something_else_is_no_table():
    with pytest.raises(sst_pin.InputError, match="a table of loads is needed, not list"):
        plots.loads_page([])


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_the_command_writes_a_figure(tmp_path, ending, capsys):
    delta = robots.delta()
    motion = delta.simulate(np.zeros(3), delta.home, np.zeros(3), np.linspace(0, 0.1, 11))
    source, target = tmp_path / "motion.csv", tmp_path / f"bearings.{ending}"
    motion.save(source)
    assert main(["loads", str(source), "-o", str(target), "--robot", "delta"]) == 0
    assert target.read_bytes()[:5] in (b"\x89PNG\r", b"<?xml")
    assert "largest force" in capsys.readouterr().out


@pytest.mark.parametrize("make", [robots.four_bar, robots.five_bar])
def test_a_row_of_each_motor_shows_both_and_the_difference(make):
    chain, t = make(), np.linspace(0, 1, 21)
    x = np.array([chain.home[chain.position_names.index(name)] for name in chain.coordinates])
    motion = sst_pin.coordinate_motion(chain, t, x + 0.1 * np.sin(t)[:, None])
    page = plots.torques_page(motion, 0.5 * motion.tau)
    assert len(page.axes) == len(chain.motor_names)
    for ax, tau in zip(page.axes, motion.tau.T, strict=True):
        drawn = {line.get_label(): line.get_ydata() for line in ax.lines[1:]}
        np.testing.assert_array_equal(drawn["measured"], tau)
        np.testing.assert_array_equal(drawn["predicted"], 0.5 * tau)
        np.testing.assert_array_equal(drawn["difference"], 0.5 * tau)
    with pytest.raises(sst_pin.InputError, match="predicted"):
        plots.torques_page(motion, motion.tau[1:])

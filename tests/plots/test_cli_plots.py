# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin plot` and `sst-pin workspace`, as one types them."""

import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

from sst_pin import plots
from sst_pin.cli import motion_commands, sst_commands
from sst_pin.description.urdf_writer import urdf_of
from sst_pin.sst.workspace import workspace_over_rolls
from sst_pin.verification.sampling import random_parameters
from tests.support.command_line import run

SAMPLE = Path(__file__).resolve().parents[2] / "examples" / "figure_eight.csv"


def require_picture(path):
    """Ink of several colours, nothing cut off at the border."""
    pixels = image.imread(path)[..., :3]
    assert min(pixels.shape[:2]) > 600
    assert len(np.unique((pixels[::8, ::8].reshape(-1, 3) * 7).round(), axis=0)) > 10
    border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    assert (border > 0.99).all()


def test_a_page_of_a_motion(here, capsys):
    code, out, _ = run(capsys, "plot", SAMPLE, "-o", "page.png")
    assert code == 0
    assert "path, torques, joints, rates, energy, condition of 201 samples" in out
    require_picture(here / "page.png")


def test_what_torques_wrote_and_the_motion_itself_give_the_same_figure(here, capsys):
    """CSV and NPZ of `torques` are drawn as they stand; of the motion the torques are computed."""
    run(capsys, "torques", SAMPLE, "-o", "torques.csv")
    run(capsys, "torques", SAMPLE, "-o", "torques.npz")
    for number, source in enumerate((SAMPLE, "torques.csv", "torques.npz")):
        code, out, _ = run(capsys, "plot", source, "-o", f"{number}.svg", "--what", "torques,rates")
        assert code == 0
        assert out == f"torques, rates of 201 samples -> {number}.svg\n"
    first, *others = ((here / f"{number}.svg").read_bytes() for number in range(3))
    assert all(other == first for other in others)
    assert b"motor torque (N m)" in first
    assert b"joint angle" not in first


def test_subjects_of_the_command_are_those_of_the_plots():
    assert motion_commands.SUBJECTS == plots.SUBJECTS


@pytest.mark.slow
def test_workspace_as_picture_and_numbers(here, capsys):
    """A turn of the star on the command line, in degrees, is that of the map."""
    code, out, _ = run(capsys, "workspace", "-o", "map.png", "--psi", "-20", "--data", "map.npz")
    assert code == 0
    require_picture(here / "map.png")
    first, second, last = out.splitlines()
    assert first.startswith("at psi = -20 deg: ")
    assert last == "-> map.npz, map.png"
    # The base triangle is an eighth of the sphere; its middle is the isotropic pose.
    assert second == (
        "over all psi: 1.57 sr on the arcs, condition number 1 (theta 45.0, phi 54.7 deg) "
        "to 1.73, up to 120 deg of roll"
    )
    with np.load("map.npz") as data:
        assert np.degrees(data["psi"]) == pytest.approx(-20)
        best = data["condition_number"][data["margin"] >= 0].min()
    assert float(re.search(r"condition number ([\d.]+)", first)[1]) == pytest.approx(best, rel=5e-3)


def test_a_robot_that_reaches_nothing_on_its_arcs_is_told(here, capsys, monkeypatch):
    coarse = partial(workspace_over_rolls, rolls=24, rings=21, spokes=60)
    monkeypatch.setattr(sst_commands, "workspace_over_rolls", coarse)
    odd = random_parameters(np.random.default_rng(3))
    (here / "odd.urdf").write_text(urdf_of(odd))
    code, out, _ = run(capsys, "workspace", "-o", "map.svg", "--robot", "odd.urdf")
    assert code == 0
    assert out.count("no direction has all sliders on their arcs") == 2
    assert b"circle of the paper" not in (here / "map.svg").read_bytes()

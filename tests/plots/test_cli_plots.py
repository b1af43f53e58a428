# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin plot`, as one types it."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

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


@pytest.mark.slow
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

# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin plot`, as one types it."""

import numpy as np
import pytest
from matplotlib import image

from tests.support.command_line import run
from tests.support.files import ROOT

SAMPLE = ROOT / "examples" / "figure_eight.csv"


@pytest.mark.slow
def test_a_page_of_a_motion(here, capsys):
    """Ink of several colours, nothing cut off at the border."""
    code, out, _ = run(capsys, "plot", SAMPLE, "-o", "page.png")
    assert code == 0
    assert "path, torques, joints, rates, energy, condition of 201 samples" in out
    pixels = image.imread(here / "page.png")[..., :3]
    assert min(pixels.shape[:2]) > 600
    assert len(np.unique((pixels[::8, ::8].reshape(-1, 3) * 7).round(), axis=0)) > 10
    border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    assert (border > 0.99).all()

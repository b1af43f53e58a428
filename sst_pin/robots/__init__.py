# SPDX-License-Identifier: BSD-2-Clause
"""The gallery: classical closed-chain robots, each a function of its dimensions and masses."""

import json
from pathlib import Path
from typing import Any

from .gallery_robot import GalleryRobot
from .legs import ankle, knee, leg
from .overconstrained import agile_eye, agile_wrist, bennett
from .planar import five_bar, four_bar, planar_3rrr, planar_4rrr
from .platforms import delta, hexaglide, stewart, ups_pu
from .standard_problems import andrews, bricard, governor, n_four_bar, slider_crank
from .upright import excavator, ladder, scissor_lift

#: Ten states of the SST and of each robot, to 40 digits; see docs/reference_data.md.
REFERENCE_PATH = Path(__file__).with_name("reference.json")
#: For each standard problem: rates at the start, torques, and what is published at time t.
#: "forces" are what the body of this joint takes from that of theta where they meet, base axes.
PUBLISHED: dict[str, dict[str, Any]] = json.loads(
    Path(__file__).with_name("published.json").read_text(encoding="utf-8")
)

__all__ = [
    "PUBLISHED",
    "REFERENCE_PATH",
    "GalleryRobot",
    "agile_eye",
    "agile_wrist",
    "andrews",
    "ankle",
    "bennett",
    "bricard",
    "delta",
    "excavator",
    "five_bar",
    "four_bar",
    "governor",
    "hexaglide",
    "knee",
    "ladder",
    "leg",
    "n_four_bar",
    "planar_3rrr",
    "planar_4rrr",
    "scissor_lift",
    "slider_crank",
    "stewart",
    "ups_pu",
]


def __dir__() -> list[str]:
    return __all__

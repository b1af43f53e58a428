# SPDX-License-Identifier: BSD-2-Clause
"""The gallery: classical closed-chain robots, each a function of its dimensions and masses."""

from .gallery_robot import GalleryRobot
from .legs import ankle, knee, leg
from .overconstrained import agile_eye, agile_wrist, bennett
from .planar import five_bar, four_bar, planar_3rrr, planar_4rrr
from .platforms import delta, hexaglide, stewart, ups_pu
from .standard_problems import bricard, slider_crank
from .upright import excavator, scissor_lift

__all__ = [
    "GalleryRobot",
    "agile_eye",
    "agile_wrist",
    "ankle",
    "bennett",
    "bricard",
    "delta",
    "excavator",
    "five_bar",
    "four_bar",
    "hexaglide",
    "knee",
    "leg",
    "planar_3rrr",
    "planar_4rrr",
    "scissor_lift",
    "slider_crank",
    "stewart",
    "ups_pu",
]


def __dir__() -> list[str]:
    return __all__

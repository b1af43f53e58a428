# SPDX-License-Identifier: BSD-2-Clause
"""Colours of the parts of each link, for URDF and MJCF."""

#: One colour per leg, distinct for colour-blind readers too (Okabe and Ito). The carriage of a leg
#: has a lighter tint. The last colours belong to no leg.
COLOURS = {
    "leg_1": "0.0 0.447 0.698 1.0",
    "leg_2": "0.835 0.369 0.0 1.0",
    "leg_3": "0.0 0.62 0.451 1.0",
    "leg_1_light": "0.5 0.724 0.849 1.0",
    "leg_2_light": "0.918 0.685 0.5 1.0",
    "leg_3_light": "0.5 0.81 0.726 1.0",
    "base": "0.7 0.7 0.7 1.0",
    "motor": "0.25 0.25 0.27 1.0",
}


def _hexadecimal(colour: str) -> str:
    """A colour as "#RRGGBB", from red, green, blue and opacity between 0 and 1."""
    parts = [round(255 * float(number)) for number in colour.split()[:3]]
    return "#" + "".join(f"{part:02X}" for part in parts)


#: Colours of legs 1, 2, 3 for figures and pages.
LEG_COLOURS = tuple(_hexadecimal(COLOURS[f"leg_{k}"]) for k in (1, 2, 3))

#: These and three more colours of Okabe and Ito, for motors and curves.
HUES = (*LEG_COLOURS, "#CC79A7", "#E69F00", "#56B4E9")

#: Colour of each part of `parts_of` of a link, by the link's name.
PART_COLOURS = {
    "base": {"base": "base", "motors": "motor"},
    **{f"link_{k}": {"link": f"leg_{k}"} for k in (1, 2, 3)},
    **{f"passive_{k}": {"passive": f"leg_{k}_light"} for k in (1, 2, 3)},
    **{f"star_{k}": {"arc": f"leg_{k}"} for k in (1, 2, 3)},
}
PART_COLOURS["star_1"]["tool"] = "motor"

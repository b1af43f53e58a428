# SPDX-License-Identifier: BSD-2-Clause
"""Pictures of an SST: the paper's axes and frames, the path of E, the arcs, shapes."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin

from ..description.colours import LEG_COLOURS
from ..description.parameters import Parameters
from ..description.parts import mesh_writers
from ..description.urdf_writer import urdf_of
from ..files import write_files
from ..model.appearance import Appearance, DrawnFrame
from ..reading.shapes import urdf_shapes
from .arc_limits import arc_ends
from .kinematics import Geometry


def shapes_of(parameters: Parameters, model: pin.Model) -> pin.GeometryModel:
    """Visual shapes of the robot with these parameters."""
    root = ET.fromstring(urdf_of(parameters))
    with TemporaryDirectory() as name:
        folder = Path(name)
        files = mesh_writers(parameters)
        write_files({folder / n: write for n, write in files.items()}, folder=folder)
        return urdf_shapes(root, folder, model)


def appearance_of(geometry: Geometry, radius: float) -> Appearance:
    """Axes e_1..9, frames {0k}..{3k} and {E}, the path of E, the arcs; `radius` is OE."""
    # gamma_k, mu_k, beta_k turn about e_k, e_{k+3}, e_{k+6}.
    axes = []
    for k, colour in enumerate(LEG_COLOURS, start=1):
        for number in (k, k + 3, k + 6):
            axes.append((f"e_{number}", colour))
    E = pin.SE3(np.eye(3), radius * geometry.R_E[0][:, 0])
    frames = tuple(_frames(geometry, radius))
    beta_1 = 3  # the joint that moves the star
    point = DrawnFrame("E", beta_1, E)
    return Appearance(
        axes=tuple(axes),
        frames=frames,
        point=point,
        size=radius,
        axis_length=1.25,
        arcs=arc_ends(geometry),
        spherical=True,
    )


def _frames(geometry: Geometry, r: float) -> Iterator[DrawnFrame]:
    """The frames; their origins are O, but each is drawn on the part that it belongs to.

    `r` is the radius of the star's arcs, [m].
    """
    # Where frames {1k}, {2k}, {3k} of the links of a leg are drawn, in their own axes, in radii.
    on_links = ((0.72, 0, 0), (1.16, 0, 0), (1.06 * np.cos(0.7), -1.06 * np.sin(0.7), 0))
    for k in range(3):
        colour = LEG_COLOURS[k]
        on_base = pin.SE3(geometry.R_0[k], np.zeros(3)) * pin.SE3(np.eye(3), np.array([r, 0, 0]))
        yield DrawnFrame(f"{{0{k + 1}}}", 0, on_base, colour)
        for i, place in enumerate(on_links, start=1):
            joint = 3 * k + i  # gamma_k, mu_k, beta_k; 0 is the base
            at = pin.SE3(np.eye(3), r * np.array(place, dtype=float))
            yield DrawnFrame(f"{{{i}{k + 1}}}", joint, at, colour)
    R_E = geometry.R_E[0]
    beta_1 = 3
    yield DrawnFrame("{E}", beta_1, pin.SE3(R_E, 1.12 * r * R_E[:, 0]))

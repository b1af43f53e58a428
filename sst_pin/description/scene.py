# SPDX-License-Identifier: BSD-2-Clause
"""The robot with a floor, light and a camera, as MJCF."""

from __future__ import annotations

import numpy as np

from .parameters import Parameters
from .parts import parts_of
from .solids import Cylinder

_SCENE = """\
<mujoco model="sst scene">
  <include file="sst.xml"/>
  <statistic center="0 0 0" extent="{extent}"/>
  <visual>
    <headlight diffuse="0.25 0.25 0.25" ambient="0.4 0.4 0.4" specular="0 0 0"/>
    <rgba haze="1 1 1 1"/>
    <global azimuth="-158" elevation="-23" offwidth="1600" offheight="1200"/>
    <quality shadowsize="8192"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="1 1 1" rgb2="0.92 0.94 0.97"
      width="256" height="1536"/>
    <texture name="floor" type="2d" builtin="checker" rgb1="1 1 1" rgb2="0.94 0.94 0.94"
      width="300" height="300"/>
    <material name="floor" texture="floor" texrepeat="4 4" texuniform="true"/>
  </asset>
  <worldbody>
    <light pos="{light}" dir="-0.3 0.1 -1" directional="true"
      diffuse="0.5 0.5 0.5" specular="0.2 0.2 0.2"/>
    <geom name="floor" type="plane" size="0 0 0.05" pos="0 0 {floor}" material="floor"/>
    <camera name="front" pos="{camera}" xyaxes="-0.369 0.929 0 -0.397 -0.157 0.904" fovy="38"/>
  </worldbody>
</mujoco>
"""


def scene_of(p: Parameters) -> str:
    """XML of a scene around `sst.xml`, as large as the robot."""
    radius = max(p.base_radius, p.star_radius)

    def times_radius(*factors: float) -> str:
        return " ".join(repr(round(factor * radius, 6)) for factor in factors)

    return _SCENE.format(
        extent=times_radius(2.5),
        light=times_radius(1.2, -0.4, 4),
        floor=repr(round(_floor(p, radius), 6)),
        camera=times_radius(3.2, 1.3, 1.5),
    )


def _floor(p: Parameters, radius: float) -> float:
    """Height of the foot that the robot stands on, but below the reach of the star."""
    lowest = -1.25 * radius
    for solid in parts_of(p)["base"]:
        if isinstance(solid, Cylinder):
            axis = (solid.end - solid.start) / np.linalg.norm(solid.end - solid.start)
            tilt = np.sqrt(max(1 - axis[2] ** 2, 0))
            for point, size in ((solid.start, solid.radius), (solid.end, solid.end_radius)):
                lowest = min(lowest, float(point[2] - size * tilt))
    return lowest

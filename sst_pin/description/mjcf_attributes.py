# SPDX-License-Identifier: BSD-2-Clause
"""Attributes of elements of an MJCF."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from .urdf_writer import numbers

#: Kinds of MuJoCo's joints with one rate.
SINGLE = ("hinge", "slide")


def pose_attributes(at: pin.SE3, write: Callable[[Any], str] = numbers) -> dict[str, str]:
    """Attributes `pos` and `quat` of a placement; an attribute that would be zero is left out.

    `write` converts numbers to text.
    """
    from scipy.spatial.transform import Rotation

    pose = {}
    if at.translation.any():
        pose["pos"] = write(at.translation)
    if not np.array_equal(at.rotation, np.eye(3)):
        x, y, z, w = Rotation.from_matrix(at.rotation).as_quat(canonical=True)
        pose["quat"] = write(np.array([w, x, y, z]))
    return pose

# SPDX-License-Identifier: BSD-2-Clause
"""Identification of the parameters of a robot from measurements."""

from .base_parameters import BaseParameters, base_parameters
from .calibration import Calibration, calibrate, calibrate_with
from .consistency import consistent_parameters
from .estimation import Estimate, estimate
from .excitation import condition_number, excitation
from .geometry_measurements import Distances, Heights, Poses
from .measurements import MeasuredMotion, measured_motion
from .prediction import predicted_torques, report
from .random_states import random_states
from .urdf_numbers import write_urdf

__all__ = [
    "BaseParameters",
    "Calibration",
    "Distances",
    "Estimate",
    "Heights",
    "MeasuredMotion",
    "Poses",
    "base_parameters",
    "calibrate",
    "calibrate_with",
    "condition_number",
    "consistent_parameters",
    "estimate",
    "excitation",
    "measured_motion",
    "predicted_torques",
    "random_states",
    "report",
    "write_urdf",
]


def __dir__() -> list[str]:
    return __all__

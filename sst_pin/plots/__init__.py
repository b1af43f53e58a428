# SPDX-License-Identifier: BSD-2-Clause
"""Figures (Matplotlib). Each function draws into the given axes and returns them."""

from ..errors import MissingExtraError

try:
    import matplotlib  # noqa: F401  before the modules that need it
except ImportError:
    raise MissingExtraError("matplotlib", "plot") from None

from .abilities import convex_set, equal_area, reach_map
from .load_page import loads_page
from .motions import (
    condition_number,
    energy_balance,
    joint_angles,
    joint_rates,
    motor_torques,
    powers,
)
from .pages import SUBJECTS, motion_page
from .pages import summary_of as summary_of  # with an alias: for the commands alone
from .paper_figures import paper_figures as paper_figures
from .shares import tolerance_shares
from .space import frame_path, paths_on_sphere, robot_pose
from .style import figure_writer as figure_writer
from .style import picture_kind as picture_kind
from .style import style
from .torque_page import torques_page

__all__ = [
    "SUBJECTS",
    "condition_number",
    "convex_set",
    "energy_balance",
    "equal_area",
    "frame_path",
    "joint_angles",
    "joint_rates",
    "loads_page",
    "motion_page",
    "motor_torques",
    "paths_on_sphere",
    "powers",
    "reach_map",
    "robot_pose",
    "style",
    "tolerance_shares",
    "torques_page",
]

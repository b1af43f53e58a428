# SPDX-License-Identifier: BSD-2-Clause
"""Figures (Matplotlib). Each function draws into the given axes and returns them."""

from ..errors import MissingExtraError

try:
    import matplotlib  # noqa: F401  before the rooms that need it
except ImportError:
    raise MissingExtraError("matplotlib", "plot") from None

from .convex_sets import convex_set
from .frame_paths import frame_path
from .load_bars import loads_page
from .motions import (
    condition_number,
    energy_balance,
    joint_angles,
    joint_rates,
    motor_torques,
    path_errors,
    powers,
)
from .pages import SUBJECTS, motion_page, summary_of, workspace_page
from .paper_figures import paper_figures
from .reach_maps import reach_map
from .sphere import paths_on_sphere, robot_pose
from .style import (
    COLOURS,
    DASHES,
    StyledFigure,
    figure_writer,
    figure_writers,
    require_ending,
    style,
)
from .torque_errors import torques_page
from .workspace_maps import (
    condition_colourbar,
    second_kind,
    workspace_legend,
    workspace_map,
    workspace_on_sphere,
)

__all__ = [
    "COLOURS",
    "DASHES",
    "SUBJECTS",
    "StyledFigure",
    "condition_colourbar",
    "condition_number",
    "convex_set",
    "energy_balance",
    "figure_writer",
    "figure_writers",
    "frame_path",
    "joint_angles",
    "joint_rates",
    "loads_page",
    "motion_page",
    "motor_torques",
    "paper_figures",
    "path_errors",
    "paths_on_sphere",
    "powers",
    "reach_map",
    "require_ending",
    "robot_pose",
    "second_kind",
    "style",
    "summary_of",
    "torques_page",
    "workspace_legend",
    "workspace_map",
    "workspace_on_sphere",
    "workspace_page",
]

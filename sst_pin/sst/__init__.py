# SPDX-License-Identifier: BSD-2-Clause
"""The SST: kinematics, robot, motions, workspace, the paper's examples."""

from ..extensions import require_current_modules

require_current_modules(__name__, ("calls",))

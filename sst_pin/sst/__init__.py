# SPDX-License-Identifier: BSD-2-Clause
"""The SST: kinematics, robot, motions, workspace, the paper's examples."""

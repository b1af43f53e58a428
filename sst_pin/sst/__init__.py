# SPDX-License-Identifier: BSD-2-Clause
"""The SST: kinematics, robot, motions, the paper's examples."""

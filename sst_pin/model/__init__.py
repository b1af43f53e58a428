# SPDX-License-Identifier: BSD-2-Clause
"""What a robot is: closures, lines, joints, the mechanism."""

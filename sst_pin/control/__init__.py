# SPDX-License-Identifier: BSD-2-Clause
"""Uses of the dynamics for control: parallel joints as serial ones, and controllers."""

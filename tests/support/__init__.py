# SPDX-License-Identifier: BSD-2-Clause
"""Robots, oracles and tools that the tests share."""

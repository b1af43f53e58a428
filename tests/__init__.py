# SPDX-License-Identifier: BSD-2-Clause
"""Tests: a folder for each room of the package, and `support`, which they share."""

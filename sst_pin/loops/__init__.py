# SPDX-License-Identifier: BSD-2-Clause
"""Closing the loops: rows, assembly, mobility, coordinates."""

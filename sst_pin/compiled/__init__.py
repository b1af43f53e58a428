# SPDX-License-Identifier: BSD-2-Clause
"""Kernels for any closed chain: equations on symbols, C, compiler, cache, binding."""

# SPDX-License-Identifier: BSD-2-Clause
"""Equations (3) to (96): the orthogonal complement, dynamics, derivatives, reactions."""

# SPDX-License-Identifier: BSD-2-Clause
"""Motions in time: simulation, rollouts, trajectories, energies."""

# SPDX-License-Identifier: BSD-2-Clause
"""Independent computations of the dynamics, and the comparison with them."""

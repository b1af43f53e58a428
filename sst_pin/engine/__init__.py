# SPDX-License-Identifier: BSD-2-Clause
"""What computes a quantity, on either path."""

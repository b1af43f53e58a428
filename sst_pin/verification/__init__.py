# SPDX-License-Identifier: BSD-2-Clause
"""Referees that share no code with what they judge, and the comparison with them."""

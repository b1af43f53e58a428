# SPDX-License-Identifier: BSD-2-Clause
"""Any closed chain: closures, assembly, mobility, the orthogonal complement, dynamics."""
